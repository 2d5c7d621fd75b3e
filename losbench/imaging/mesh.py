"""Level and noise in tiles, where no single ones hold for a frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Indices
from losbench.imaging.pattern import Pattern
from losbench.imaging.ranks import CLIPPED, level_and_noise
from losbench.imaging.sky import Sky
from losbench.units import SIGMA_PER_MAD

__all__ = ["mesh"]


_TILE = 13  # samples
_BIG = 8.0  # noises above the surface: part of a big object, if a tile beside it is so too
_SEEN = 2.0  # noises: how far such an object reaches


def mesh(pixels: NDArray[Any], digit: float, noise: float, least: float) -> Sky:
    """Level and noise of tiles of 13 x 13 samples, of every fifth pixel, or third of a small
    frame.
    """
    step = 5 if min(pixels.shape) >= 256 else 3
    sample = pixels[::step, ::step].astype(np.float64)
    clipped = sample <= sample.min()
    pattern = Pattern.of(sample, step, pixels.shape, max(noise / 2, digit))
    rows, columns = (step * np.arange(size) for size in sample.shape)
    sample = sample - pattern.at(rows[:, None], columns)
    # What a pattern has lifted off black is as unknown as black itself.
    clipped = sample <= sample[clipped].max()
    starts = [_starts(size) for size in sample.shape]
    side = [min(_TILE, size) for size in sample.shape]
    y, x = (s[:, None] + np.arange(k) for s, k in zip(starts, side, strict=True))
    of_tiles = y[:, None, :, None], x[None, :, None, :]
    tiles = sample[of_tiles]
    flat = tiles.reshape(-1, side[0] * side[1])
    dark: Bools = clipped[of_tiles].reshape(flat.shape)
    pooled = level_and_noise(sample.reshape(1, -1), digit, clipped.reshape(1, -1))
    whole = float(pooled[0][0]), float(pooled[1][0])
    level, spread = level_and_noise(flat, digit, dark, unknown=whole)
    slope = _slopes(tiles).reshape(-1, 2)
    steep = np.abs(slope * side).sum(axis=1) > np.maximum(spread, least)
    steep &= dark.mean(axis=1) < CLIPPED
    if steep.any():
        down, across = (np.arange(k) - (k - 1) / 2 for k in side)
        plane = slope[steep, :1, None] * down[:, None] + slope[steep, 1:, None] * across
        level[steep], spread[steep] = level_and_noise(
            flat[steep] - plane.reshape(len(plane), -1), digit, np.zeros_like(dark[steep])
        )
    shape = tiles.shape[:2]
    level, spread = _smooth_tiles(level.reshape(shape), np.maximum(spread, least).reshape(shape))
    middles = [step * (s + (k - 1) / 2) for s, k in zip(starts, side, strict=True)]
    least = 0.5 * float(spread.min())
    for axis, size in enumerate(pixels.shape):
        level, spread = (_to_the_ends(a, middles[axis], size, axis) for a in (level, spread))
    row, column = (
        np.concatenate([[0.0], middle, [size - 1.0]])
        for middle, size in zip(middles, pixels.shape, strict=True)
    )
    return Sky(level, np.maximum(spread, least), row, column, pattern)


def _starts(size: int) -> Indices:
    """First samples of tiles that cover so many, the last of them overlapping if need be."""
    count = max(1, -(-size // _TILE))
    return np.rint(np.linspace(0, max(size - _TILE, 0), count)).astype(np.intp)


def _slopes(tiles: Floats) -> Floats:
    """Slope (..., 2) of each tile down and across, from the medians of its halves."""
    slopes = []
    for axis in (2, 3):
        half = tiles.shape[axis] // 2
        first, last = (
            np.median(np.take(tiles, part, axis=axis), axis=(2, 3))
            for part in (np.arange(half), np.arange(tiles.shape[axis] - half, tiles.shape[axis]))
        )
        slopes.append((last - first) / (tiles.shape[axis] - half))
    return np.stack(slopes, axis=-1)


def _smooth_tiles(level: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Tiles without those that spots have raised: single ones by a median, big objects by the
    surface through the others.
    """
    from scipy import ndimage

    surface = _surface(level, noise)
    typical = float(np.median(noise))
    above = (level - surface) / np.maximum(noise, typical)
    groups, count = ndimage.label(above > _SEEN, np.ones((3, 3)))
    core = above > _BIG
    big = np.zeros(level.shape, dtype=bool)
    for group in range(1, count + 1):
        if np.count_nonzero(core & (groups == group)) >= 2:
            big |= groups == group
    if big.any():
        big = ndimage.binary_dilation(big, np.ones((3, 3), dtype=bool))
        level = np.where(big, surface, level)
        noise = np.where(big, np.median(noise[~big]) if (~big).any() else noise.min(), noise)
    # Of the level itself the median would bend a gradient at the border.
    rest = ndimage.median_filter(level - surface, 3, mode="nearest")
    return surface + rest, ndimage.median_filter(noise, 3, mode="nearest")


def _surface(level: Floats, noise: Floats) -> Floats:
    """Quadratic surface through the tiles, clipped at three sigma from the darkest four fifths."""
    y, x = (np.linspace(-1.0, 1.0, size) if size > 1 else np.zeros(1) for size in level.shape)
    down, across = (a.ravel() for a in np.meshgrid(y, x, indexing="ij"))
    terms = [np.ones_like(down)]
    for size, coordinate in zip(level.shape, (down, across), strict=True):
        terms += [coordinate] * (size > 1) + [coordinate**2] * (size > 3)
    terms += [down * across] * (min(level.shape) > 2)
    basis, values = np.stack(terms, axis=-1), level.ravel()
    kept = values <= np.quantile(values, 0.8)
    error = 1.5 * float(np.median(noise)) / np.sqrt(_TILE**2)
    for _ in range(8):
        if np.count_nonzero(kept) <= basis.shape[1]:
            break
        fit = np.linalg.lstsq(basis[kept], values[kept], rcond=None)[0]
        left = values - basis @ fit
        scatter = max(SIGMA_PER_MAD * float(np.median(np.abs(left[kept]))), error)
        now = np.abs(left) <= 3.0 * scatter
        if np.array_equal(now, kept):
            break
        kept = now
    else:
        return (basis @ fit).reshape(level.shape)
    if np.count_nonzero(kept) <= basis.shape[1]:
        return np.full(level.shape, float(np.quantile(values, 0.2)))
    return (basis @ fit).reshape(level.shape)


def _to_the_ends(tiles: Floats, middle: Floats, size: int, axis: int) -> Floats:
    """Carry tiles straight on to the first and last row (or column) of the frame."""
    first, last = (np.take(tiles, k, axis=axis) for k in (0, -1))
    if len(middle) > 1:
        second, before = (np.take(tiles, k, axis=axis) for k in (1, -2))
        first = first + (first - second) * middle[0] / (middle[1] - middle[0])
        last = last + (last - before) * (size - 1 - middle[-1]) / (middle[-1] - middle[-2])
    ends = [np.expand_dims(a, axis) for a in (first, last)]
    return np.concatenate([ends[0], tiles, ends[1]], axis=axis)
