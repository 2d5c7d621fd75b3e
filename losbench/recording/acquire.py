"""Spots that are not where they were expected, found again in the whole frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Ints
from losbench.imaging.finder import Find
from losbench.imaging.results import Centroids, SpotFlag

__all__ = ["Known", "elsewhere", "found_again", "same_light", "strangers"]


_FIND = Find(order="light")
_MOST = 200  # finds that are looked at, the brightest
_TOGETHER = 3.0  # pixels, within which spots have moved alike
_LIKE = 2.0  # times the light, by which a spot may differ from itself


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of the spots of a recording: where they were looked for at first (n, 2), the
    sides of their windows (n,), their light (n,), and where else something stood then, (m, 2).
    """

    start: Floats
    sides: Ints
    flux: Floats
    strangers: Floats

    def others(self, places: Floats) -> Floats:
        """What is not the spots, where they are at ``places``: it stays, or moves with them."""
        moved = np.nanmean(places - self.start, axis=0)
        return np.concatenate([self.strangers, self.strangers + moved])


def strangers(image: NDArray[Any], places: Floats, sides: Ints) -> Floats:
    """What else the finder sees in an image (H, W) with spots at (n, 2), in windows (n,)."""
    try:
        found = _FIND.find(image)[:_MOST]
    except ValueError:
        return np.zeros((0, 2))
    near = np.abs(found[:, None] - places).max(axis=-1) <= sides / 2
    return found[~near.any(axis=1)]


def found_again(image: NDArray[Any], places: Floats, lost: Bools, known: Known) -> list[Floats]:
    """Places (n, 2), NaN for spots that are not lost, at which lost ones may be, to be measured:
    where all have moved alike; else each find that no other spot has claimed, for one lost spot.

    Parameters
    ----------
    image : (H, W) array
    places : (n, 2) array, pixels
        Where the spots are, or were expected.
    lost : (n,) array of bool
    known : Known
    """
    others = known.others(places)
    taken = np.concatenate([places[~lost], others])
    sides = np.concatenate([known.sides[~lost], np.full(len(others), known.sides.max())])
    free = strangers(image, taken, sides)
    if not len(free):
        return []
    nowhere, missing = np.full_like(places, np.nan), np.flatnonzero(lost)
    if len(missing) == 1:
        options = []
        for place in free:
            option = nowhere.copy()
            option[missing[0]] = place
            options.append(option)
        return options
    shifts = (free[None] - places[missing][:, None]).reshape(-1, 2)
    gap = np.linalg.norm(places[missing] + shifts[:, None] - free[:, None, None], axis=-1)
    hits = (gap.min(axis=0) <= _TOGETHER).sum(axis=1)
    best = np.flatnonzero(hits == hits.max())
    apart = np.abs(shifts[best] - shifts[best[0]]).max()
    # Two shifts that fit as well do not tell which it was.
    if hits[best[0]] < 2 or apart > 2 * _TOGETHER:
        return []
    nearest = free[gap[:, best[0]].argmin(axis=0)]
    met = gap[:, best[0]].min(axis=0) <= _TOGETHER
    nowhere[missing[met]] = nearest[met]
    return [nowhere]


def elsewhere(
    frames: NDArray[Any],
    places: Floats,
    lost: Bools,
    known: Known,
    see: Callable[..., Centroids],
) -> Centroids | None:
    """Centroids of the lost spots of one frame (1, H, W), NaN for the others: of the only option at
    which they have the light (n,) that they have elsewhere; None where there is none, or two.
    """
    met = []
    for option in found_again(frames[0], places, lost, known):
        seen = see(frames, option)
        bad = (seen.flags[0] & SpotFlag.NOT_CONVERGED > 0) | ~same_light(seen.flux[0], known.flux)
        seen.xy[0, bad] = np.nan
        if np.isfinite(seen.xy).any():
            met.append(seen)
    return met[0] if len(met) == 1 else None


def same_light(flux: Floats, expected: Floats) -> Bools:
    """Whether each spot has about the light that it had elsewhere."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = flux / expected
        return np.isnan(expected) | ((ratio > 1.0 / _LIKE) & (ratio < _LIKE))
