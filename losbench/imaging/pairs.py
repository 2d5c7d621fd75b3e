"""Pairs of frames in which a spot lies nearly alike, and what may explain how they differ."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.imaging.background import fit_ring
from losbench.imaging.columns import Templates
from losbench.imaging.stamps import RING, cut_stamps, ring_of

__all__ = ["Pairing", "Pairs", "nearest_pairs"]


_PLATEAU = 5  # pixels that share the highest reading
_FAINT = 3.0  # noises


@dataclass(frozen=True)
class Pairing:
    """Which spot (P,) is compared in which two frames (P, 2), and how much larger the squared error
    of a mean over the pairs of that spot is, as they share frames, (P,).
    """

    spot: Indices
    frames: Indices
    shared: Floats

    @classmethod
    def of_frames(cls, spot: Indices, frames: Indices) -> Self:
        """Count how many pairs share a frame."""
        member = np.repeat(spot, 2)
        _, which, degree = np.unique(
            np.stack([member, frames.ravel()]), axis=1, return_inverse=True, return_counts=True
        )
        # Each frame of a spot is counted once for every pair that it is in.
        more = np.bincount(member, (degree - 1.0)[which.ravel()])
        return cls(spot, frames, (1.0 + more / 4.0 / np.maximum(np.bincount(spot), 1))[spot])

    def of(self, some: slice) -> Pairing:
        """Return some of them."""
        return Pairing(self.spot[some], self.frames[some], self.shared[some])


def nearest_pairs(places: Floats, most: int) -> Pairing:
    """Pairs of frames in which a spot at (F, n, 2) lies nearest, the closest ``most`` of each."""
    seen = np.isfinite(places).all(axis=-1)
    seen &= seen.sum(axis=0) > 1
    spot, frame = np.nonzero(seen.T)
    if not len(spot):
        return Pairing(spot, np.zeros((0, 2), np.intp), np.zeros(0))
    # Where a spot rests, all frames are as near: a millipixel decides, lest one be in all pairs.
    nth = np.cumsum(seen, axis=0)[frame, spot] - 1
    at = places[frame, spot] + 1e-3 * np.random.default_rng(0).random((len(places), 2))[nth]
    apart = 2.0 * np.ptp(at) + 1.0  # spots lie above each other, out of reach
    points = np.column_stack([at, apart * spot])
    found = KDTree(points).query(points, k=2)
    gap, nearest = np.asarray(found[0])[:, 1], np.asarray(found[1])[:, 1]
    first, last = np.minimum(frame, frame[nearest]), np.maximum(frame, frame[nearest])
    _, once = np.unique((spot * len(places) + first) * len(places) + last, return_index=True)
    once = once[np.lexsort((gap[once], spot[once]))]
    rank = np.arange(len(once)) - np.searchsorted(spot[once], spot[once])
    once = once[rank < most]
    return Pairing.of_frames(spot[once], np.stack([first[once], last[once]], axis=1))


@dataclass(frozen=True)
class Pairs:
    """P pairs of windows of S pixels: their difference, mean signal (P, S), what may explain the
    difference (P, 14, S), the floor (P, 1) of the variance, which pixels count, and gradient
    squared times shift squared; how much pairs share frames, and the level (P,) of the ring.
    """

    difference: Floats
    signal: Floats
    basis: Floats
    floor: Floats
    use: Bools
    shifted: Floats
    shared: Floats
    level: Floats

    @classmethod
    def compared(
        cls,
        stack: NDArray[Any],
        pairing: Pairing,
        at: Floats,
        width: Floats,
        side: int,
        full_scale_dn: float,
        step: float,
    ) -> Self:
        """Cut windows around spots at (P, 2, 2) of widths (P,) out of frames (F, H, W)."""
        count, middle = len(at), np.rint(at.mean(axis=1)).astype(np.intp)
        frames = pairing.frames.T.ravel()
        around = cut_stamps(stack, frames, np.tile(middle, (2, 1)), side // 2 + RING)
        around = around.astype(np.float64)
        plane = fit_ring(ring_of(around, side), side)
        rim = slice(RING - 1, 1 - RING)
        whole = around[:, rim, rim]
        light = plane.off(whole)
        signal = (light[:count] + light[count:]) / 2
        one, two = whole[:count, 1:-1, 1:-1], whole[count:, 1:-1, 1:-1]
        top = np.maximum(one, two)
        missing = ~np.isfinite(signal)
        signal[missing] = 0.0
        use = np.isfinite(one - two) & (top < full_scale_dn)
        # A plateau below full scale is saturation as well, and has no noise.
        highest = np.nanmax(np.where(use, top, -np.inf), axis=(1, 2), keepdims=True)
        sharing = (top >= highest).sum(axis=(1, 2), keepdims=True)
        use &= (sharing < _PLATEAU) | (top < highest)
        use &= ~missing[:, 1:-1, 1:-1]
        basis = _explaining(signal, at.mean(axis=1) - middle, width)
        slope = (basis[:, 4] ** 2 + basis[:, 5] ** 2) / 4
        shift = ((at[:, 1] - at[:, 0]) ** 2).sum(axis=1)
        variance = plane.noise[:count] ** 2 + plane.noise[count:] ** 2
        floor = np.maximum(variance, step**2 / 6.0) / 2
        # Where black is clipped, faint pixels have less noise than the others' floor.
        faint = signal[:, 1:-1, 1:-1] < _FAINT * np.sqrt(floor)[:, None, None]
        use &= ~((plane.clipped[:count] | plane.clipped[count:])[:, None, None] & faint)
        return cls(
            np.where(use, one - two, 0.0).reshape(count, -1),
            signal[:, 1:-1, 1:-1].reshape(count, -1),
            basis,
            np.nan_to_num(floor)[:, None],
            use.reshape(count, -1) & np.isfinite(floor)[:, None],
            slope * shift[:, None],
            pairing.shared,
            (plane.level[:count] + plane.level[count:]) / 2,
        )

    def of(self, some: slice) -> Pairs:
        """Return some of them."""
        return Pairs(*(getattr(self, field.name)[some] for field in fields(self)))


def _explaining(signal: Pixels, centre: Floats, width: Floats) -> Floats:
    """What may explain a difference of two windows, from their mean with a margin of one pixel,
    (P, 14, S).
    """
    count, side = len(signal), signal.shape[1] - 2
    offset = np.arange(side, dtype=np.float64) - side // 2
    middle = signal[:, 1:-1, 1:-1]
    left, right = signal[:, 1:-1, :-2], signal[:, 1:-1, 2:]
    up, down = signal[:, :-2, 1:-1], signal[:, 2:, 1:-1]
    twist = signal[:, :-2, :-2] - signal[:, :-2, 2:] - signal[:, 2:, :-2] + signal[:, 2:, 2:]
    sigma = np.repeat(np.maximum(width, 0.3)[:, None], 2, axis=1)
    profiles = Templates.of(side, centre, sigma, np.float64, free=True).profiles
    x, y = np.moveaxis(profiles, 1, 0)
    columns = [
        np.ones_like(middle),
        middle,
        offset,
        offset[:, None],
        right - left,
        down - up,
        right - 2 * middle + left,
        down - 2 * middle + up,
        twist,
        # the template, its slopes by place, and by the logarithm of the width
        *(y[:, i, :, None] * x[:, j, None, :] for i, j in ((0, 0), (0, 1), (1, 0), (0, 2), (2, 0))),
    ]
    basis = np.empty((count, len(columns), side, side))
    for k, column in enumerate(columns):
        basis[:, k] = column
    return basis.reshape(count, len(columns), side**2)
