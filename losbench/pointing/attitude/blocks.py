"""Frames of shifts, cut into the blocks that are solved together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats
from losbench.checks import finite_or_nan, shaped
from losbench.optics.camera import checked_points

__all__ = ["SAME_DIRECTION", "Blocks", "broadcast_sigma", "distinct_points", "uncut"]


SAME_DIRECTION = 1e-9  # radians: spots closer than this fix no rotation about their line of sight


@dataclass(frozen=True)
class Blocks:
    """Shifts cut into B blocks of m = K n spots, K frames each; frames that a last block lacks are
    missing spots.
    """

    points: Floats  # (n, 3)
    shifts: Floats  # (B, m, 2)
    sigma: Floats  # (B or 1, m, 2); 1 where unknown or missing
    present: Bools  # (B, m)
    batch: tuple[int, ...]
    stack: int

    @classmethod
    def read(cls, points: Floats, shifts: Floats, sigma: ArrayLike | None, stack: int) -> Blocks:
        """Cut shifts (..., F, n, 2), or (n, 2) of one frame."""
        size = stack * len(points)
        present: Bools = np.all(np.isfinite(shifts), axis=-1, keepdims=True)
        error = _read_sigma(sigma, shifts.shape, present)
        cut = _cut(shifts, stack)
        return cls(
            points,
            cut.reshape(-1, size, 2),
            _cut(error, stack, fill=1.0).reshape(-1, size, 2)
            if error.ndim > 2
            else np.tile(error, (1, stack, 1)),
            np.all(np.isfinite(cut), axis=-1).reshape(-1, size),
            cut.shape[:-3],
            stack,
        )

    @property
    def ok(self) -> Bools:
        """Blocks in which at least two different spots were seen, (B,): any two directions fix all
        three angles.
        """
        seen = self.present.reshape(len(self.present), self.stack, -1).any(axis=1)
        return np.count_nonzero(seen, axis=1) >= 2


def distinct_points(points: ArrayLike) -> Floats:
    """Points (n, 3) that fix three angles: two directions are enough, on one line or not."""
    p = checked_points(points)
    shaped("points", p, ("n", 3))
    if len(p) < 2:
        raise ValueError(f"points must hold at least 2 spots to fix three angles, got {len(p)}")
    direction = p[:, :2] / p[:, 2:]
    apart = np.abs(direction[:, None] - direction).max(axis=-1) + 2 * np.eye(len(p))
    i, j = map(int, np.unravel_index(np.argmin(apart), apart.shape))
    if apart[i, j] > SAME_DIRECTION:
        return p
    if (p[i] == p[j]).all():
        raise ValueError(f"points must differ, got two equal points: {i} and {j}")
    raise ValueError(
        f"points must lie in different directions, got {i} and {j} on one line of sight, "
        "which leaves the rotation about it undetermined"
    )


def broadcast_sigma(sigma: Floats, shape: tuple[int, ...]) -> Floats:
    """Standard deviations of the given shape, or ``ValueError``."""
    try:
        return np.broadcast_to(sigma, shape)
    except ValueError:
        raise ValueError(f"sigma must broadcast to shape {shape}, got {sigma.shape}") from None


def _cut(frames: Floats, stack: int, fill: float = np.nan) -> Floats:
    """Frames (..., F, n, 2) as blocks (..., ceil(F / K), K, n, 2), the last one filled up."""
    if stack == 1:
        return frames[..., None, :, :]
    *lead, count, n, _ = frames.shape
    lacking = np.full((*lead, -count % stack, n, 2), fill)
    return np.concatenate([frames, lacking], axis=-3).reshape(*lead, -1, stack, n, 2)


def uncut(blocks: Floats, shape: tuple[int, ...]) -> Floats:
    """Blocks (B, K n, 2) as the frames of the given shape that they came from."""
    if blocks.size == np.prod(shape):
        return blocks.reshape(shape)
    *lead, count, n, _ = shape
    return blocks.reshape(*lead, -1, n, 2)[..., :count, :, :]


def _read_sigma(sigma: ArrayLike | None, shape: tuple[int, ...], present: Bools) -> Floats:
    """Standard deviations (n, 2), or (..., n, 2) where they differ from frame to frame; 1 where
    unknown or missing.
    """
    if sigma is None:
        return np.ones(shape[-2:])
    given = finite_or_nan("sigma", sigma)
    each_frame = given.ndim > 2
    error = broadcast_sigma(given, shape if each_frame else shape[-2:])
    needed = np.broadcast_to(present, shape) if each_frame else np.ones(shape[-2:], dtype=bool)
    if not np.all(error[needed] > 0):
        raise ValueError("sigma must be positive wherever a shift is given, got NaN, zero or less")
    return np.where(needed, error, 1.0)
