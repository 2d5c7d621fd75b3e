"""Level and noise of a sky from the ranks of its pixels, even where a camera clips it at black.

The dark pixels of a frame are the lower ranks of a normal distribution of which the spots have
taken the upper ones, and a camera that clips at black the lowest. What is left in between is a
straight line over the normal scores: its slope is the noise, its intercept the level, which may lie
below black.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.special import ndtri

from losbench.arrays import Bools, Floats, Pixels

__all__ = ["CLIPPED", "digit_step", "level_and_noise", "medians", "noise_above_black"]


CLIPPED = 0.08  # share of pixels at the minimum from which on a frame is clipped there
_FEWEST = 15  # ranks
_LOWEST = 0.05  # share of the ranks below which a hot or dead pixel may lie
_TOLD = 1.2  # steps of noise; below, rounding looks like clipping
_FEW = 4096  # values, whose scores may stay in memory


def level_and_noise(
    values: Floats,
    digit: float,
    clipped: Bools,
    *,
    most: float = 0.75,
    unknown: tuple[float, float] | None = None,
) -> tuple[Floats, Floats]:
    """Level and noise (T,) of samples (T, n), of which the upper ranks may be spots.

    Parameters
    ----------
    values : (T, n) array
    digit : float
        Step of the numbers; 0 for what is not whole.
    clipped : (T, n) array of bool
        What lies at the minimum of the frame, where a camera clips.
    most : float
        Share of the ranks up to which there are no spots.
    unknown : (level, noise), optional
        What stands where fewer than 15 ranks are left; unless given, the minimum and half a step.

    Notes
    -----
    Ranks from 0.05 to 0.75; where a share c of at least 0.08 is clipped, from c + 0.1 (1 - c) to
    the larger of 0.75 and c + 0.7 (1 - c), or to c + 0.35 (1 - c) if the spots are most of what is
    left, and the noise would come out 1.5 times smaller by that. Whole numbers are spread over
    their step by a fixed dither first.

    Examples
    --------
    >>> dark = np.random.default_rng(1).normal(-0.2, 4.0, (1, 40000)).round().clip(0)
    >>> level, noise = level_and_noise(dark, 1.0, dark <= 0)
    >>> level.round(1).tolist(), noise.round(1).tolist()
    ([-0.2], [4.0])
    """
    n = values.shape[1]
    share = clipped.sum(axis=1) / n
    share[share < CLIPPED] = 0.0
    if digit:
        values = values + digit * _kept(_dither, n)
    lowest = values.min(axis=1)
    clips = bool(share.any())
    if clips:
        values = np.where(clipped & (share > 0)[:, None], values.min() - 1.0, values)
    ranked = np.sort(values, axis=1)
    if not clips:
        level, noise = _line(ranked, _kept(_weights, n, _LOWEST, most))
    else:
        left = 1.0 - share
        low = np.where(share > 0, share + 0.1 * left, _LOWEST)
        high = np.where((share > 0) & (most > 0.5), np.maximum(most, share + 0.7 * left), most)
        within = np.where(share > 0, np.minimum(share + 0.35 * left, high), high)
        level, noise = _line(ranked, _weights(n, low[:, None], high[:, None]))
        lower = _line(ranked, _weights(n, low[:, None], within[:, None]))
        narrow = lower[1] < noise / 1.5
        level, noise = (np.where(narrow, a, b) for a, b in zip(lower, (level, noise), strict=True))
    few = ~np.isfinite(noise)
    if unknown is not None:
        return np.where(few, unknown[0], level), np.where(few, unknown[1], noise)
    return np.where(few, lowest, level), np.where(few, digit / 2, noise)


def noise_above_black(rings: Pixels) -> Floats:
    """Noise (M,) that the readings of rings (M, R) had before a camera clipped them at black; NaN
    where so few are left that they do not tell it; 0 where nothing was clipped, or the noise is
    hardly more than their step, and rounding makes as many alike.

    >>> dark = np.random.default_rng(1).normal([[-1.0], [20.0]], 4.0, (2, 4000)).round()
    >>> noise_above_black(dark.clip(0)).round(1).tolist()
    [4.0, 0.0]
    """
    values = rings.astype(np.float64)
    black = values == np.fmin.reduce(values, axis=1)[:, None]
    absent = np.isnan(values)
    if absent.any():
        values = np.where(absent, np.nanmedian(values, axis=1)[:, None], values)
    digit = digit_step(values)
    found = level_and_noise(values, digit, black, unknown=(np.nan, np.nan))[1]
    above = values - values.min(axis=1, keepdims=True)
    beyond = (above > 1.5 * digit).any(axis=1)
    some = black.mean(axis=1) >= CLIPPED
    return np.where(some & beyond & ~(found < _TOLD * digit), found, 0.0)


def _kept(make: Callable[..., Floats], n: int, *more: float) -> Floats:
    """What is made for so many values; made once for few, as all frames of a recording ask."""
    return _once(make, n, *more) if n <= _FEW else make(n, *more)


@lru_cache(maxsize=8)
def _once(make: Callable[..., Floats], n: int, *more: float) -> Floats:
    made = make(n, *more)
    made.flags.writeable = False
    return made


def _dither(n: int) -> Floats:
    return np.random.default_rng(0).random(n) - 0.5


def _weights(n: int, low: float | Floats, high: float | Floats) -> Floats:
    """Weights that so many ranked values have in the intercept and the slope of a line over their
    normal scores, from the ranks low to high: (2, n), or (2, T, n) for ranks (T, 1); NaN where they
    are fewer than 15.
    """
    rank = (np.arange(n) + 0.5) / n
    score = ndtri(rank)
    used = ((rank >= low) & (rank <= high)).astype(np.float64)
    number = used.sum(axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = (used * score).sum(axis=-1, keepdims=True) / number
        across = used * (score - middle)
        slope = across / (across * score).sum(axis=-1, keepdims=True)
        slope = np.where(number < _FEWEST, np.nan, slope)
        return np.stack([used / number - middle * slope, slope])


def _line(ranked: Floats, weights: Floats) -> Floats:
    """Level and noise (2, T) of ranked values (T, n)."""
    weights = weights.reshape(2, -1, weights.shape[-1])
    return np.asarray((weights * ranked).sum(axis=-1))


def digit_step(sample: Floats) -> float:
    """Step of the numbers of a sample: 16 for twelve bits that are aligned to the left; 0 for
    numbers that are not whole.
    """
    whole = sample.astype(np.int64) if np.abs(sample).max() < 2**53 else np.zeros(1, dtype=np.int64)
    if not np.array_equal(whole, sample):
        return 0.0
    return float(np.gcd.reduce((whole - whole.min()).ravel())) or 1.0


def medians(values: Floats) -> Floats:
    """Median (T,) of each row, the upper of two."""
    middle = values.shape[1] // 2
    return np.partition(values, middle, axis=1)[:, middle]
