"""How wide the spots of a call are: what the methods with a template begin with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats, Indices
from losbench.imaging.eiwa import grey
from losbench.imaging.estimates import Choices
from losbench.imaging.stamps import evenly
from losbench.imaging.template import fitted_widths
from losbench.imaging.windows import cut_windows, level_of, pixel_noise, saturated

__all__ = ["template_widths"]


_FITS = 400
_FRAMES = 64
_FAINTEST = 10.0  # flux in units of its error
_FEWEST = 4  # frames of a spot that tell a width of its own


def template_widths(
    stack: NDArray[Any], frame: Indices, spot: Indices, middle: Indices, n_spots: int, how: Choices
) -> Floats:
    """Width (n, 2) of each spot along x and y, in pixels, from windows (M,) of frame, spot and
    whole pixel (M, 2).

    A spot seen in four frames or more has its own, the median over up to 64 of them. All others
    share the median of the call, weighted by the information that each has: single stars, and
    undersampled ones above all, do not tell theirs. Spots that are saturated, not wholly read or
    fainter than ten times their error have no vote.
    """
    guess = np.full(2, how.window / 6.0)
    some = _chosen(frame, spot, n_spots)
    if not some.size:
        return np.tile(guess, (n_spots, 1))
    stamps = cut_windows(stack, frame[some], middle[some], how)
    level = level_of(stamps, how)
    usable = np.isfinite(stamps.signal).all(axis=(1, 2)) & ~saturated(stamps, level, how)
    if stamps.missing is not None:
        usable &= ~stamps.missing.any(axis=(1, 2))
    if not usable.any():
        return np.tile(guess, (n_spots, 1))
    start = grey(stamps.signal[usable], np.zeros((int(usable.sum()), 2)), how.window).centroid
    fit = fitted_widths(
        stamps.signal[usable, 1:-1, 1:-1],
        np.nan_to_num(start),
        guess,
        pixel_noise(stamps, level, how).of(usable),
    )
    bright = fit.significance >= _FAINTEST
    voters, width, weight = (
        spot[some][usable][bright],
        fit.width[bright],
        fit.significance[bright] ** 2,
    )
    if not voters.size:
        return np.tile(guess, (n_spots, 1))
    found = np.tile(_weighted_median(width, weight), (n_spots, 1))
    for k in np.flatnonzero(np.bincount(voters, minlength=n_spots) >= _FEWEST):
        found[k] = _weighted_median(width[voters == k], weight[voters == k])
    return found


def _chosen(frame: Indices, spot: Indices, n_spots: int) -> Indices:
    """Which windows to fit: of up to 400 spots, each in as many frames as that allows, evenly
    spread.
    """
    frames = np.unique(frame)
    share = evenly(len(frames), min(_FRAMES, max(1, _FITS // n_spots)))
    return np.flatnonzero(np.isin(frame, frames[share]) & np.isin(spot, evenly(n_spots, _FITS)))


def _weighted_median(values: Floats, weight: Floats) -> Floats:
    """Median of each column of values (M, 2), each counted with its weight (M,)."""
    order = np.argsort(values, axis=0)
    share = np.cumsum(weight[order], axis=0)
    place = (share >= 0.5 * share[-1]).argmax(axis=0)
    median: Floats = np.take_along_axis(
        values, np.take_along_axis(order, place[None], axis=0), axis=0
    )[0]
    return median
