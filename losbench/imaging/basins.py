"""Bright pixels grouped into spots: every pixel belongs to the peak that it leads up to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Indices

__all__ = ["Basins", "group", "without_crumbs"]


# two peaks are two spots if the saddle between them falls below this part of the fainter one
_DIP = 0.8
_SURE = 1.5  # noises that the saddle must lie below the fainter peak, too
_FAINTEST = 0.005  # of the brightest spot of a connected group
_ROUNDS = 20  # of joining; one to three are enough
_WIDE = 200  # pixels of a spot that may have crumbs around it


@dataclass(frozen=True)
class Basins:
    """Which spot each bright pixel belongs to (B,), from 0 on, how many there are, and which pixels
    touch: ``ones`` and ``others`` (P,).
    """

    owner: Indices
    count: int
    ones: Indices
    others: Indices


def group(place: Indices, width: int, value: Floats, noise: Floats) -> Basins:
    """Group the pixels of an image of so many columns, bright ones and those around them.

    Parameters
    ----------
    place : (B,) array of int
        Their places in the flat image, rising.
    width : int
    value : (B,) array
        Height that decides what leads up: a mean over 3 x 3 pixels.
    noise : (B,) array

    Notes
    -----
    Each pixel points to its highest neighbour; what points to the same peak is a basin. A basin
    joins the one beyond its highest saddle if that is higher and the saddle is not below 0.8 of its
    own peak, nor below it by 1.5 noises; and so on until none joins. All steps are linear in the
    number of bright pixels.
    """
    ones, others = _neighbours(place, width)
    order = np.argsort(value, kind="stable")  # of equals, the later
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    best = rank.copy()
    for a, b in ((ones, others), (others, ones)):
        np.maximum.at(best, a, rank[b])
    owner = _roots(order[best])
    for _ in range(_ROUNDS):
        joined = _joined(owner, ones, others, value, noise, rank)
        if np.array_equal(joined, owner):
            break
        owner = joined
    peaks, owner = np.unique(owner, return_inverse=True)
    return Basins(owner, len(peaks), ones, others)


def without_crumbs(basins: Basins, area: Floats, light: Floats, centre: Floats) -> Bools:
    """Which spots are more than crumbs: of a brighter spot that they touch, or that is wide and
    near.
    """
    a, b = basins.owner[basins.ones], basins.owner[basins.others]
    touching = np.flatnonzero(a != b)
    brightest = light.copy()
    for _ in range(_ROUNDS if touching.size else 0):
        before = brightest.copy()
        np.maximum.at(brightest, a[touching], before[b[touching]])
        np.maximum.at(brightest, b[touching], before[a[touching]])
        if np.array_equal(before, brightest):
            break
    kept = light >= _FAINTEST * brightest
    for k in np.flatnonzero(area > _WIDE):
        reach = 2.0 * np.sqrt(area[k] / np.pi) + 3.0
        near = np.hypot(*(centre - centre[k]).T) < reach
        kept &= ~(near & (light < _FAINTEST * light[k]))
    return kept


def _neighbours(place: Indices, width: int) -> tuple[Indices, Indices]:
    """Pairs of bright pixels that touch, each once."""
    ones, others = [], []
    column = place % width
    for step, shift in ((1, 1), (width - 1, -1), (width, 0), (width + 1, 1)):
        found = np.searchsorted(place, place + step)
        found[found == len(place)] = 0
        inside = (column + shift >= 0) & (column + shift < width)
        pair = np.flatnonzero((place[found] == place + step) & inside)
        ones.append(pair)
        others.append(found[pair])
    return np.concatenate(ones), np.concatenate(others)


def _roots(up: Indices) -> Indices:
    """Where everything leads that leads up, by doubling the step."""
    while True:
        further = up[up]
        if np.array_equal(further, up):
            return up
        up = further


def _joined(
    owner: Indices,
    ones: Indices,
    others: Indices,
    value: Floats,
    noise: Floats,
    rank: NDArray[Any],
) -> Indices:
    """Owners after every basin has joined the higher one beyond its best saddle, if that is no
    dip.
    """
    a, b = owner[ones], owner[others]
    border = a != b
    if not border.any():
        return owner
    a, b = a[border], b[border]
    saddle = np.minimum(value[ones[border]], value[others[border]])
    low, high = np.where(rank[a] < rank[b], a, b), np.where(rank[a] < rank[b], b, a)
    order = np.lexsort((saddle, low))
    last = np.flatnonzero(np.append(low[order][1:] != low[order][:-1], True))
    low, high, saddle = low[order][last], high[order][last], saddle[order][last]
    height = value[low]
    joins = saddle >= np.minimum(_DIP * height, height - _SURE * noise[low])
    up = np.arange(len(owner))
    up[low[joins]] = high[joins]
    return _roots(up)[owner]
