"""Spots followed through a recording, a block of frames at a time."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from losbench.arrays import Bools, Floats
from losbench.imaging.background import Background
from losbench.imaging.centroid import centroid
from losbench.imaging.protocols import CentroidMethod
from losbench.imaging.results import Centroids, SpotFlag
from losbench.imaging.sizes import window_in_first
from losbench.recording.readers import Recording
from losbench.recording.stamps import Stamp
from losbench.recording.track import Track

__all__ = ["follow"]


def follow(
    recording: Recording,
    stamp: Stamp,
    start: Floats,
    method: CentroidMethod,
    background: Background,
    *,
    block: int,
    bar: tqdm[Any],
) -> Track:
    """Follow the spots of one stamp: every block of frames starts where the one before saw each
    spot last.

    Parameters
    ----------
    recording, stamp
        Where the frames come from.
    start : (n, 2) array, pixels of the stamp
        Where the spots are in the first frame.
    method, background
        As for `centroid`; the window, and the width of a template, are chosen in the first block
        and then stay.
    block : int
        Frames in memory at a time.
    bar : tqdm
        Told of every block.

    Returns
    -------
    Track
        In pixels of the detector, with the frames that could not be read and why.
    """
    parts: list[Track] = []
    skipped: dict[int, str] = {}
    last = start
    how = replace(method, centre=method.centre or "peak")

    see = partial(
        centroid,
        background=background,
        detector=recording.detector,
        full_scale_dn=recording.full_scale_dn,
    )
    for first in range(0, recording.n_frames, block):
        read = stamp.read(
            first, min(first + block, recording.n_frames), skip=recording.skip_unreadable
        )
        skipped |= read.skipped
        frames, good = read.frames, read.good
        if not good.any():
            parts.append(_unseen(len(frames), len(start)))
        else:
            if how.window is None:
                how = replace(how, window=window_in_first(frames[good][0], last))
            seen = see(frames, last, method=how)
            if how.template:
                how = replace(how, width=seen.width_px)
            part = _track(seen, good)
            # Spots that wander out of reach within a block are followed frame by frame.
            if len(frames) > 1 and not part.stays_near(last, good, max(2, seen.window // 4) - 0.5):
                steps = []
                for k in range(len(frames)):
                    one = slice(k, k + 1)
                    steps.append(
                        _track(see(frames[one], last, method=how), good[one])
                        if good[k]
                        else _unseen(1, len(start))
                    )
                    last = steps[-1].last_seen(last)
                part = Track.one_after_another(steps)
            parts.append(part)
            last = part.last_seen(last)
        bar.update(len(frames))
    track = Track.one_after_another(parts)
    return replace(track, xy=track.xy + np.array(stamp.origin_px), skipped=skipped)


def _track(seen: Centroids, good: Bools) -> Track:
    lost = ~good[:, None] | (seen.flags & SpotFlag.NOT_CONVERGED > 0)
    flags = np.where(good[:, None], seen.flags, SpotFlag.MISSING)
    xy, sigma = (np.where(lost[..., None], np.nan, values) for values in (seen.xy, seen.sigma_xy))
    return Track(xy, sigma, flags)


def _unseen(n_frames: int, n_spots: int) -> Track:
    nowhere = np.full((n_frames, n_spots, 2), np.nan)
    return Track(nowhere, nowhere, np.full((n_frames, n_spots), int(SpotFlag.MISSING)))
