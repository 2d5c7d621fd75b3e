"""From a recording to a table: find or take the spots, follow them, turn their shifts into
angles.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from losbench.checks import integer
from losbench.estimation.solvers import Solver
from losbench.imaging.background import Background
from losbench.imaging.common import smoothed
from losbench.imaging.finder import Find
from losbench.imaging.methods import as_background, as_method
from losbench.imaging.protocols import CentroidMethod
from losbench.logs import TemperatureLog
from losbench.optics.camera import Camera
from losbench.recording.angles import Angles, as_angles
from losbench.recording.measurement import Measurement
from losbench.recording.notes import notes_on_frames
from losbench.recording.readers import Recording
from losbench.recording.reference import shifts_from
from losbench.recording.run import Run
from losbench.recording.starts import check_shape, first_places
from losbench.recording.survey import survey
from losbench.recording.table import measurement_table, temperatures
from losbench.recording.work import Job, tracked

__all__ = ["Measurement", "measure"]


def measure(
    recording: Recording,
    camera: Camera | None = None,
    *,
    spots: ArrayLike | Find | None = None,
    temperature: TemperatureLog | None = None,
    centroid: CentroidMethod | str | None = None,
    background: Background | str | float | None = "ring",
    solver: Angles | Solver | str | None = None,
    reference: str | int = "first",
    run: Run | None = None,
) -> Measurement:
    """Measure the spots of a recording and the rotation that their shifts tell of.

    Parameters
    ----------
    recording : Recording
        From `read_recording`, which also takes the detector, dark, flat and bad pixels. Without a
        detector, from there or from the files, predicted errors rest on the noise that up to 64
        frames tell of themselves (`estimate_gain`).
    camera : Camera, optional
        Turns shifts into angles. Without it the table ends with the shifts, and a note says so.
    spots : (n, 2) array, int or Find, optional
        Detector positions (x, y) in the first frame, a pixel or so near, for recordings of whole
        frames; or how many to find, or how to find them. By default all that stand out. They are
        numbered from left to right, unless `Find` says otherwise, and keep their numbers.
    temperature : TemperatureLog, optional
        Interpolated to the frames' times.
    centroid : AutoCentroid, EIWA, Weighted, Likelihood, Empirical, Grey, Gaussian, or a name
        As ``method`` of `centroid`; by default `AutoCentroid`, which chooses by what the spots look
        like; a note says what and why. That, a window, and the width or shape of a template, where
        they are not given, are chosen on up to 64 frames spread over the recording, and then hold
        for all. Every frame starts on the brightest pixels, unless ``centre`` says otherwise. With
        ``smooth``, the positions are smoothed before shifts are taken.
    background : Ring, Level, None, "ring", "none" or float
        As for `centroid`.
    solver : Angles, IRLS, LeastSquares, LTS, MM, or the name of a solver, optional
        How shifts become angles, see `Angles`.
    reference : "first" or int
        Shifts count from the first frame that shows every spot, or from the mean of the first K
        frames. Its error enters the shifts' errors.
    run : Run, optional
        Who measures, what is kept of it on the way, and the progress bar.

    Returns
    -------
    Measurement

    Raises
    ------
    ValueError
        If no spot is found, a spot cannot be measured in any reference frame, or an argument is out
        of range.
    UnreadableFrame
        If a frame cannot be read and the recording was opened to stop at that.

    Examples
    --------
    >>> import losbench as lb
    >>> frame = lb.render_spots([[20.0, 15.0]], 5e4, 2.0, (32, 48)).astype(np.uint16)
    >>> recording = lb.read_recording(np.stack([frame] * 3))
    >>> lb.measure(recording, centroid=lb.EIWA(13), background=lb.Ring(15)).xy_px.round(2).tolist()
    [[[20.0, 15.0]], [[20.0, 15.0]], [[20.0, 15.0]]]
    """
    how, under = as_method(centroid or "auto", {}), as_background(background)
    angles = as_angles(solver)
    if reference != "first":
        integer("reference", reference, low=1, high=recording.n_frames)
    check_shape(recording, camera)
    celsius, said = temperatures(recording, temperature)
    places = first_places(recording, spots)
    raw = replace(how, smooth=None)
    surveys = tuple(
        survey(recording, stamp, start, raw, under)
        for stamp, start in zip(recording.stamps, places, strict=True)
    )
    track = tracked(Job(recording, surveys, under), run or Run())
    xy, sigma, flags = track.xy, track.sigma, track.flags
    notes = notes_on_frames(track, surveys)
    if how.smooth is not None:
        xy, sigma = smoothed(how.smooth, xy)
        notes.append("Positions are smoothed: neighbouring frames share their errors.")
    origin = shifts_from(xy, sigma, reference)
    shifts, sigma_shifts = xy - origin.xy_px, np.hypot(sigma, origin.sigma_px)
    attitude, how_solved = angles.solve(camera, origin.xy_px, shifts, sigma_shifts)
    notes += [*origin.notes, how_solved]
    table = measurement_table(recording, celsius, xy, sigma, flags, shifts, attitude)
    return Measurement(
        xy,
        sigma,
        flags,
        shifts,
        sigma_shifts,
        origin.xy_px,
        attitude,
        table,
        (*recording.notes, *notes, *said),
        surveys,
    )
