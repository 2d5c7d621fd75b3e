"""Spots followed through a recording, a block of frames at a time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from losbench.arrays import Bools, Floats, Ints
from losbench.imaging.centroid import centroid, default_window
from losbench.imaging.results import SpotFlag
from losbench.recording.readers import Recording
from losbench.recording.stamps import Stamp

__all__ = ["Track", "follow"]


def follow(
    recording: Recording,
    stamp: Stamp,
    start: Floats,
    options: dict[str, Any],
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
    options : dict
        For `centroid`; a window of None, and the width of a template, are chosen in the first block
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
    skipped: dict[int, str] = {}
    parts, last, settings = [], start, options
    for first in range(0, recording.n_frames, block):
        until = min(first + block, recording.n_frames)
        block_read = stamp.read(first, until, skip=recording.skip_unreadable)
        frames, good = block_read.frames, block_read.good
        skipped |= block_read.skipped
        if settings["window"] is None and good.any():
            settings = settings | {"window": _default_window(frames[good][0], last, stamp)}
        part = _see(frames, good, last, settings)
        if part.width_px is not None:
            settings = settings | {"sigma": part.width_px}
        if len(frames) > 1 and not part.stays_near(last, good):
            steps = []
            for k in range(len(frames)):
                steps.append(_see(frames[k : k + 1], good[k : k + 1], last, settings))
                last = steps[-1].last_seen(last)
            part = Track.join(steps)
        parts.append(part)
        last = part.last_seen(last)
        bar.update(len(frames))
    return replace(Track.join(parts).moved(np.array(stamp.origin_px)), skipped=skipped)


@dataclass(frozen=True)
class Track:
    """Positions (F, n, 2), their errors and flags (F, n) of some frames of one stamp, and what
    measured them.
    """

    xy: Floats
    sigma: Floats
    flags: Ints
    window: int
    width_px: Floats | None = None
    skipped: dict[int, str] = field(default_factory=dict)

    @classmethod
    def join(cls, parts: list[Track]) -> Track:
        """Put parts one after the other."""
        xy, sigma, flags = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("xy", "sigma", "flags")
        )
        return cls(xy, sigma, flags, parts[0].window, parts[-1].width_px)

    def moved(self, origin: Floats) -> Track:
        """Count positions from another origin."""
        return replace(self, xy=self.xy + origin)

    def last_seen(self, before: Floats) -> Floats:
        """Return where each spot was seen last, or ``before`` where it was not seen at all."""
        for frame in self.xy:
            before = np.where(np.isnan(frame), before, frame)
        return before

    def stays_near(self, start: Floats, good: Bools) -> bool:
        """Whether every readable frame shows every spot, well within reach of the start."""
        reach = max(2, self.window // 4) - 0.5
        return bool((np.abs(self.xy[good] - start) < reach).all())


def _see(frames: NDArray[Any], good: Bools, start: Floats, settings: dict[str, Any]) -> Track:
    if not good.any():
        missing = np.full((len(frames), *start.shape), np.nan)
        return Track(
            missing,
            missing,
            np.full(missing.shape[:2], int(SpotFlag.MISSING)),
            settings["window"] or 3,
        )
    seen = centroid(frames, start, centre="peak", **settings)
    lost = ~good[:, None] | (seen.flags & SpotFlag.NOT_CONVERGED > 0)
    flags = np.where(good[:, None], seen.flags, SpotFlag.MISSING)
    xy, sigma = (np.where(lost[..., None], np.nan, values) for values in (seen.xy, seen.sigma_xy))
    return Track(xy, sigma, flags, seen.window, seen.width_px)


def _default_window(frame: NDArray[Any], start: Floats, stamp: Stamp) -> int:
    found = default_window(frame, start)
    if found < 3:
        raise ValueError(
            f"no spot stands at {start.round(1).tolist()} in the first frame: nothing there to "
            "size a window by"
        )
    return min(found, min(stamp.shape) - (min(stamp.shape) + 1) % 2)
