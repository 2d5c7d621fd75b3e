"""Spots followed through a block of frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats
from losbench.imaging.background import Background
from losbench.imaging.centroid import centroid
from losbench.imaging.results import Centroids, SpotFlag
from losbench.recording.acquire import elsewhere
from losbench.recording.bands import Bands
from losbench.recording.readers import Recording
from losbench.recording.stamps import Stamp
from losbench.recording.survey import Survey
from losbench.recording.track import Track

__all__ = ["measured"]


def measured(
    recording: Recording,
    stamp: Stamp,
    survey: Survey,
    background: Background,
    first: int,
    last: int,
) -> Track:
    """Measure frames ``first`` to ``last`` (excluded), in pixels of the stamp: what comes out rests
    on the survey and on these frames alone.
    """
    expected = survey.predicted(first, last)
    bands = Bands.around(expected, survey.method.window, background.side, stamp.shape[0])
    places = bands.within(expected)
    read = stamp.read(first, last, skip=recording.skip_unreadable, spans=bands.spans)
    frames, good = read.frames, read.good
    if not good.any():
        return replace(_unseen(*expected.shape[:2]), skipped=read.skipped)
    see = partial(
        centroid,
        method=survey.method,
        background=background,
        detector=survey.noise,
        full_scale_dn=recording.full_scale_dn,
    )
    seen = see(frames, places)
    track = _track(seen, good)
    track = replace(track, xy=bands.outside(track.xy))
    reach, at = np.maximum(2, survey.sides // 4) - 0.5, expected[0]
    near = track.near(expected, reach)
    away = len(good) > 1 and not near[good].all()
    for k in np.flatnonzero(good & away).tolist():
        # While spots are out of reach they are followed from frame to frame.
        if not near[k] or (np.abs(at - expected[k]).max(axis=1) >= reach).any():
            if bands.hold(at):
                step = _track(see(frames[k : k + 1], bands.within(at)), good[k : k + 1])
                step = replace(step, xy=bands.outside(step.xy))
            else:
                whole = stamp.read(first + k, first + k + 1, skip=recording.skip_unreadable)
                step = _track(see(whole.frames, at), whole.good)
            track.xy[k], track.sigma[k], track.flags[k] = step.xy[0], step.sigma[0], step.flags[0]
        at = np.where(np.isnan(track.xy[k]), at, track.xy[k])
    for k in np.flatnonzero(good & np.isnan(track.xy[..., 0]).any(axis=1)).tolist():
        whole = stamp.read(first + k, first + k + 1, skip=recording.skip_unreadable)
        _look_again(track, k, whole.frames, expected[k], survey, see)
    return replace(track, skipped=read.skipped)


def _look_again(
    track: Track,
    k: int,
    frames: NDArray[Any],
    expected: Floats,
    survey: Survey,
    see: Callable[..., Centroids],
) -> None:
    """Put the spots that frame ``k`` of a track lacks, and a whole frame (1, rows, columns) shows
    elsewhere, into the track.
    """
    lost = np.isnan(track.xy[k, :, 0])
    again = elsewhere(
        frames,
        np.where(lost[:, None], expected, track.xy[k]),
        lost,
        survey.known,
        see,
    )
    if again is not None:
        met = np.isfinite(again.xy[0, :, 0])
        track.xy[k, met], track.sigma[k, met] = again.xy[0, met], again.sigma_xy[0, met]
        track.flags[k, met] = again.flags[0, met] | SpotFlag.FOUND_AGAIN


def _track(seen: Centroids, good: Bools) -> Track:
    lost = ~good[:, None] | (seen.flags & SpotFlag.NOT_CONVERGED > 0)
    flags = np.where(good[:, None], seen.flags, SpotFlag.MISSING)
    xy, sigma = (np.where(lost[..., None], np.nan, values) for values in (seen.xy, seen.sigma_xy))
    return Track(xy, sigma, flags)


def _unseen(n_frames: int, n_spots: int) -> Track:
    nowhere = np.full((n_frames, n_spots, 2), np.nan)
    return Track(nowhere, nowhere, np.full((n_frames, n_spots), int(SpotFlag.MISSING)))
