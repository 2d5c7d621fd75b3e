"""From a recording to a table: find or take the spots, follow them, turn their shifts into
angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from losbench.arrays import Floats, Ints
from losbench.checks import choice, finite, integer, shaped
from losbench.estimation.smoothing import kalman_smooth
from losbench.imaging.detector import Detector
from losbench.imaging.finder import find_spots
from losbench.imaging.results import SpotFlag
from losbench.logs import TemperatureLog
from losbench.optics.camera import Camera
from losbench.pointing.attitude import AttitudeFit, solve_attitude
from losbench.recording.readers import Recording
from losbench.recording.stamps import Stamp
from losbench.recording.table import measurement_table, temperatures
from losbench.recording.tracks import follow

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Measurement", "measure"]


_SKIPPED_NAMED = 3


@dataclass(frozen=True)
class Measurement:
    """What a recording says, frame by frame.

    Attributes
    ----------
    xy_px, sigma_xy_px : (F, n, 2) arrays
        Spot positions on the detector and their predicted one-sigma errors; NaN where a spot was
        lost.
    flags : (F, n) array
        `SpotFlag` bits of each spot.
    shifts_px, sigma_shifts_px : (F, n, 2) arrays
        Displacement from the reference, the reference's own error included.
    reference_px : (n, 2) array
        Reference positions.
    attitude : AttitudeFit or None
        Angles in radians with covariance; None without a camera.
    table : DataFrame
        One row a frame: time, temperatures, positions, shifts, angles in arcseconds with one-sigma
        errors.
    notes : tuple of str
        What the reader of the table must know, a line each.
    """

    xy_px: Floats
    sigma_xy_px: Floats
    flags: NDArray[np.int_]
    shifts_px: Floats
    sigma_shifts_px: Floats
    reference_px: Floats
    attitude: AttitudeFit | None
    table: pd.DataFrame
    notes: tuple[str, ...]


def measure(
    recording: Recording,
    camera: Camera | None = None,
    *,
    spots: ArrayLike | None = None,
    n_spots: int | None = None,
    temperature: TemperatureLog | None = None,
    detector: Detector | None = None,
    method: str = "eiwa",
    window: int | None = None,
    background: str | float = "ring",
    reference: str | int = "first",
    smooth: str | None = None,
    model: str = "pinhole",
    solver: str = "auto",
    block: int = 32,
    progress: bool = False,
) -> Measurement:
    """Measure the spots of a recording and the rotation that their shifts tell of.

    Parameters
    ----------
    recording : Recording
        From `read_recording`; read a block of frames at a time.
    camera : Camera, optional
        Turns shifts into angles. Without it the table ends with the shifts, and a note says so.
    spots : (n, 2) array, optional
        Detector positions (x, y) in the first frame, a pixel or so near, for recordings of whole
        frames; found if not given, brightest first, and the order then stays.
    n_spots : int, optional
        How many spots to find; default all that stand out.
    temperature : TemperatureLog, optional
        Interpolated to the frames' times.
    detector : Detector, optional
        Gain, read noise and offset, for the predicted errors; by default what the recording's files
        tell. Without either they leave out the shot noise of the spots.
    method, window, background
        As for `centroid`; the window is chosen in the first block of frames and then stays.
    reference : "first" or int
        Shifts count from the first frame that shows every spot, or from the mean of the first K
        frames. Its error enters the shifts' errors.
    smooth : None or "kalman"
        Smooth the positions with a local linear trend (liu2026, section 3.2) before taking shifts.
    model : "pinhole" or "paper"
        As for `solve_attitude`.
    solver : "auto", "irls" or "ls"
        "auto" is IRLS with one weight per spot for four or more spots, and least squares below,
        where no outlier can be told from the rest.
    block : int
        Frames in memory at a time.
    progress : bool
        Show a progress bar where it takes longer than two seconds.

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
    >>> result = measure(lb.read_recording(np.stack([frame] * 3)))
    >>> result.xy_px.round(2).tolist()
    [[[20.0, 15.0]], [[20.0, 15.0]], [[20.0, 15.0]]]
    """
    choice("smooth", "none" if smooth is None else smooth, ("none", "kalman"))
    choice("solver", solver, ("auto", "irls", "ls"))
    whole = recording.stamps[0] if len(recording.stamps) == 1 else None
    whole_shape = None if whole is None else whole.whole or whole.shape
    if camera is not None and whole_shape not in (None, camera.shape):
        raise ValueError(
            f"camera must have the shape of the frames, {whole_shape}, got {camera.shape}"
        )
    n_reference = (
        1
        if reference == "first"
        else integer("reference", reference, low=1, high=recording.n_frames)
    )
    options: dict[str, Any] = {
        "method": method,
        "window": window,
        "background": background,
        "noise": detector or recording.detector,
    }
    told = recording if detector is None else replace(recording, detector=detector)
    options["full_scale_dn"] = told.full_scale_dn
    celsius, said = temperatures(recording, temperature)
    with tqdm(
        total=recording.n_frames * len(recording.stamps),
        unit="frame",
        delay=2,
        disable=not progress,
    ) as bar:
        tracks = [
            follow(recording, stamp, start, options, integer("block", block, low=1), bar)
            for stamp, start in zip(
                recording.stamps, _starts(recording, spots, n_spots), strict=True
            )
        ]
    skipped = {k: why for track in tracks for k, why in track.skipped.items()}
    xy, sigma, flags = (
        np.concatenate([getattr(track, name) for track in tracks], axis=1)
        for name in ("xy", "sigma", "flags")
    )
    notes = [*_notes_on_skipped(skipped, len(xy)), *_notes_on_loss(xy, flags)]
    first = _first_whole(xy) if reference == "first" else 0
    if options["noise"] is None:
        notes.append(
            "No detector was given: predicted errors leave out the shot noise of the spots, and "
            "are too small."
        )
    if smooth == "kalman":
        xy, sigma = _smoothed(xy)
        notes.append("Positions are smoothed: neighbouring frames share their errors.")
    if first:
        notes.append(f"Shifts count from frame {first}, the first that shows every spot.")
    counted = slice(first, first + n_reference)
    reference_px, sigma_reference = _reference(xy[counted], sigma[counted])
    shifts, sigma_shifts = xy - reference_px, np.hypot(sigma, sigma_reference)
    if camera is None:
        attitude = None
        notes.append("No camera was given: the table holds shifts in pixels, no angles.")
    else:
        attitude, note = _solve(camera, reference_px, shifts, sigma_shifts, model, solver)
        notes.append(note)
    table = measurement_table(recording, celsius, xy, sigma, flags, shifts, attitude)
    return Measurement(
        xy,
        sigma,
        flags,
        shifts,
        sigma_shifts,
        reference_px,
        attitude,
        table,
        (*recording.notes, *notes, *said),
    )


def _starts(recording: Recording, spots: ArrayLike | None, n_spots: int | None) -> list[Floats]:
    """Return the first positions in each stamp's own pixels."""
    if len(recording.stamps) > 1:
        if spots is not None or n_spots is not None:
            raise ValueError(
                "spots and n_spots are for whole frames: a folder of pixel files has one spot in "
                "each"
            )
        return [_found(recording, stamp, 1) for stamp in recording.stamps]
    stamp = recording.stamps[0]
    if spots is None:
        return [
            _found(
                recording, stamp, None if n_spots is None else integer("n_spots", n_spots, low=1)
            )
        ]
    given = finite("spots", spots)
    shaped("spots", given, ("n", 2))
    local = given - np.array(stamp.origin_px)
    if not ((local >= -0.5) & (local <= np.array(stamp.shape[::-1]) - 0.5)).all():
        raise ValueError(
            f"spots must lie inside the {stamp.shape[0]}x{stamp.shape[1]} frame, got "
            f"{given.tolist()}"
        )
    return [local]


def _found(recording: Recording, stamp: Stamp, n: int | None) -> Floats:
    for k in range(recording.n_frames):
        block = stamp.read(k, k + 1, skip=recording.skip_unreadable)
        if block.good[0]:
            found = find_spots(block.frames[0], n)
            if not len(found):
                raise ValueError(
                    f"no spot stands out in the first frame of {stamp.name}: give spots, or look "
                    "at it"
                )
            return found
    raise ValueError(f"no frame of {recording.source} can be read")


def _smoothed(xy: Floats) -> tuple[Floats, Floats]:
    fit = kalman_smooth(xy.reshape(len(xy), -1))
    return fit.smoothed.reshape(xy.shape), fit.smoothed_std.reshape(xy.shape)


def _first_whole(xy: Floats) -> int:
    """Return the first frame that shows every spot."""
    seen = ~np.isnan(xy[..., 0])
    if not seen.all(axis=1).any():
        lost = np.flatnonzero(~seen.any(axis=0)) + 1
        why = (
            f"spot {lost.tolist()} is in none"
            if lost.size
            else f"all {xy.shape[1]} at once are in none"
        )
        raise ValueError(f"reference must be a frame that shows every spot; {why} of {len(xy)}")
    return int(np.argmax(seen.all(axis=1)))


def _reference(xy: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    count = np.isfinite(xy).sum(axis=0)
    if not count.all():
        lost = np.flatnonzero((count == 0).any(axis=-1)) + 1
        raise ValueError(
            f"reference must hold a frame that shows every spot; spot {lost.tolist()} is in none "
            f"of {len(xy)}"
        )
    return np.nanmean(xy, axis=0), np.sqrt(np.nansum(sigma**2, axis=0)) / count


def _solve(
    camera: Camera,
    reference_px: Floats,
    shifts_px: Floats,
    sigma_px: Floats,
    model: str,
    solver: str,
) -> tuple[AttitudeFit, str]:
    robust = solver == "irls" or (solver == "auto" and len(reference_px) >= 4)
    fit = solve_attitude(
        camera.points_mm(reference_px),
        shifts_px * camera.pixel_mm,
        model=model,  # type: ignore[arg-type]
        method="irls" if robust else "ls",
        sigma=sigma_px * camera.pixel_mm,
    )
    how = "IRLS, Huber 1.345, one weight per spot" if robust else "least squares"
    note = f"Angles by {how}, {len(reference_px)} spots, redundancy {2 * len(reference_px) - 3}."
    return fit, note + (
        " Two spots cannot tell which of them is bad." if len(reference_px) == 2 else ""
    )


def _notes_on_skipped(skipped: dict[int, str], n_frames: int) -> list[str]:
    if not skipped:
        return []
    named = [f"frame {k} ({skipped[k]})" for k in sorted(skipped)[:_SKIPPED_NAMED]]
    more = [f"and {len(skipped) - len(named)} more"] if len(skipped) > len(named) else []
    return [
        f"{len(skipped)} of {n_frames} frames are left out as unreadable: "
        f"{', '.join([*named, *more])}."
    ]


def _notes_on_loss(xy: Floats, flags: Ints) -> list[str]:
    notes = []
    for spot in range(xy.shape[1]):
        lost = int(np.isnan(xy[:, spot]).any(axis=-1).sum())
        if lost:
            notes.append(f"Spot {spot + 1} is lost in {lost} of {len(xy)} frames.")
    silent = (SpotFlag.EDGE, SpotFlag.TOO_FAINT, SpotFlag.MISSING)
    for flag in (each for each in SpotFlag if each not in silent):
        marked = int((flags & flag > 0).sum())
        if marked:
            notes.append(f"{marked} of {flags.size} centroids carry the flag {flag.name}.")
    return notes
