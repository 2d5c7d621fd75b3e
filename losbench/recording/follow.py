"""Spots followed through a block of frames."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from losbench.arrays import Bools
from losbench.imaging.background import Background
from losbench.imaging.centroid import centroid
from losbench.imaging.results import Centroids, SpotFlag
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
    # Spots that wander out of reach within a block are followed frame by frame.
    if len(frames) > 1 and not track.stays_near(expected, good, max(2, seen.window // 4) - 0.5):
        steps, at = [], expected[0]
        for k in range(len(frames)):
            if not good[k]:
                steps.append(_unseen(1, len(at)))
                continue
            if bands.hold(at):
                step = _track(see(frames[k : k + 1], bands.within(at)), good[k : k + 1])
                step = replace(step, xy=bands.outside(step.xy))
            else:
                whole = stamp.read(first + k, first + k + 1, skip=recording.skip_unreadable)
                step = _track(see(whole.frames, at), whole.good)
            steps.append(step)
            at = step.last_seen(at)
        track = Track.one_after_another(steps)
    return replace(track, skipped=read.skipped)


def _track(seen: Centroids, good: Bools) -> Track:
    lost = ~good[:, None] | (seen.flags & SpotFlag.NOT_CONVERGED > 0)
    flags = np.where(good[:, None], seen.flags, SpotFlag.MISSING)
    xy, sigma = (np.where(lost[..., None], np.nan, values) for values in (seen.xy, seen.sigma_xy))
    return Track(xy, sigma, flags)


def _unseen(n_frames: int, n_spots: int) -> Track:
    nowhere = np.full((n_frames, n_spots, 2), np.nan)
    return Track(nowhere, nowhere, np.full((n_frames, n_spots), int(SpotFlag.MISSING)))
