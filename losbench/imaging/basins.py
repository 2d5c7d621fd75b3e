"""Bright pixels grouped into spots: every pixel belongs to the peak that it leads up to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
    of different spots touch: ``ones`` and ``others`` (P,).
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
    low = (1 << len(place).bit_length()) - 1  # the bits that hold a place among so many
    key = _keys(value, low)
    best = key.copy()
    for a, b in ((ones, others), (others, ones)):
        np.maximum.at(best, a, key[b])
    owner = _roots(best & low)
    for _ in range(_ROUNDS):
        border = np.flatnonzero(owner[ones] != owner[others])
        ones, others = ones[border], others[border]
        if not ones.size:
            break
        joined = _joined(owner, ones, others, value, noise, key)
        if joined is owner:
            break
        owner = joined
    peak = np.zeros(len(owner), dtype=bool)
    peak[owner] = True
    number = np.cumsum(peak) - 1
    return Basins(number[owner], int(number[-1]) + 1, ones, others)


def without_crumbs(basins: Basins, area: Floats, light: Floats, centre: Floats) -> Bools:
    """Which spots are more than crumbs: of a brighter spot that they touch, or that is wide and
    near.
    """
    a, b = basins.owner[basins.ones], basins.owner[basins.others]
    brightest = light.copy()
    for _ in range(_ROUNDS if a.size else 0):
        before = brightest.copy()
        np.maximum.at(brightest, a, before[b])
        np.maximum.at(brightest, b, before[a])
        if np.array_equal(before, brightest):
            break
    kept = light >= _FAINTEST * brightest
    for k in np.flatnonzero(area > _WIDE):
        reach = 2.0 * np.sqrt(area[k] / np.pi) + 3.0
        near = np.hypot(*(centre - centre[k]).T) < reach
        kept &= ~(near & (light < _FAINTEST * light[k]))
    return kept


def _keys(value: Floats, low: int) -> Indices:
    """Whole numbers that rise as the values do, with their places in the low bits: of values that
    agree to eight digits, the later is the higher.
    """
    # Read as whole numbers, positive floats rise in order and negative ones fall.
    bits = (value + 0.0).view(np.int64)
    bits ^= (bits >> 63) & np.iinfo(np.int64).max
    return (bits & ~low) | np.arange(len(value))


def _neighbours(place: Indices, width: int) -> tuple[Indices, Indices]:
    """Pairs of bright pixels that touch, each once."""
    ones, others = [], []
    column, ended = place % width, np.append(place, -1)
    first, last = column == 0, column == width - 1
    # The places are sorted: what lies below to the left is followed by what is below, and that by
    # what is below to the right, so that one search finds all three.
    found = np.searchsorted(place, place + (width - 1))
    for step, outside in ((width - 1, first), (width, None), (width + 1, last), (1, last)):
        if step == 1:
            found = np.arange(1, len(ended))
        there = ended[found] == place + step
        pair = np.flatnonzero(there if outside is None else there & ~outside)
        ones.append(pair)
        others.append(found[pair])
        found = found + there
    return np.concatenate(ones), np.concatenate(others)


def _roots(up: Indices) -> Indices:
    """Where everything leads that leads up, by doubling the step."""
    while True:
        further = up[up]
        if (further == up).all():
            return up
        up = further


def _joined(
    owner: Indices,
    ones: Indices,
    others: Indices,
    value: Floats,
    noise: Floats,
    key: Indices,
) -> Indices:
    """Owners after every basin has joined the higher one beyond its best saddle, if that is no
    dip; the same owners if none has.
    """
    a, b = owner[ones], owner[others]
    saddle = np.minimum(value[ones], value[others])
    rises = key[a] < key[b]
    low, high = np.where(rises, a, b), np.where(rises, b, a)
    best = np.full(len(owner), -np.inf)
    np.maximum.at(best, low, saddle)
    height = value[low]
    joins = saddle >= np.minimum(_DIP * height, height - _SURE * noise[low])
    joins &= saddle == best[low]
    if not joins.any():
        return owner
    up = np.arange(len(owner))
    up[low[joins]] = high[joins]  # of equal saddles, the last
    return _roots(up)[owner]
