"""How wide the spots of a call are: what the methods with a template begin with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Indices
from losbench.imaging.grey import grey
from losbench.imaging.groups import Group, in_order
from losbench.imaging.places import evenly
from losbench.imaging.protocols import Windows
from losbench.imaging.scrutiny import asks, look_into
from losbench.imaging.template import TemplateFit, fit_template

__all__ = ["SpotFits", "spot_fits", "spot_widths"]


_FITS = 400
_FITS_OF_ONE = 64  # where no spot is seen often enough to tell a width of its own
_STEPS = 12
_FRAMES = 64
_FAINTEST = 10.0  # flux in units of its error
_FEWEST = 4  # frames of a spot that tell a width of its own


def spot_widths(groups: Sequence[Group], stack: NDArray[Any]) -> Floats:
    """Width (n, 2) of each spot of some groups along x and y, in pixels, as their method needs it.

    NaN where it has no template, or one that needs none; what is given, spread over the spots; or
    what fits the windows best.

    Raises
    ------
    ValueError
        If the width that is given has another number of spots, or is wider than the window.
    """
    n_spots, method = sum(len(group.numbers) for group in groups), groups[0].engine.method
    if not method.template or (isinstance(method.width, tuple) and not method.width):
        return np.full((n_spots, 2), np.nan)
    if method.width is None:
        return in_order(groups, [spot_fits(group, stack).widths() for group in groups])
    width = np.asarray(method.width, dtype=np.float64)
    fits = width.shape in ((), (2,), (n_spots, 2))
    each = np.full((n_spots, 2), width if fits else np.nan)
    for group in groups:
        window = group.engine.window
        if not (each[group.numbers] <= window).all():
            raise ValueError(
                f"width (sigma of a spot) must be a number, two or ({n_spots}, 2), of 0.1 to "
                f"{window} pixels, the window, got {method.width!r}"
            )
    return each


@dataclass(frozen=True)
class SpotFits:
    """Gaussians with free widths, fitted to some windows of ``count`` spots: of which spots (M,),
    the windows, the fits, and the flux in units of its error (M,).
    """

    count: int
    spot: Indices
    windows: Windows
    fit: TemplateFit
    significance: Floats

    def widths(self) -> Floats:
        """Width (n, 2) of each spot that fits best.

        A spot seen in four frames or more has its own, the median over up to 64 of them. All others
        share the median of the call, weighted by the information that each has: single stars, and
        undersampled ones above all, do not tell theirs. Spots fainter than ten times their error
        have no vote.
        """
        bright = self.bright
        voters, width = self.spot[bright], self.fit.width[bright]
        weight = self.significance[bright] ** 2
        if not voters.size:
            return np.full((self.count, 2), self.windows.side / 6.0)
        found = np.tile(_weighted_median(width, weight), (self.count, 1))
        for k in np.flatnonzero(np.bincount(voters, minlength=self.count) >= _FEWEST):
            found[k] = _weighted_median(width[voters == k], weight[voters == k])
        return found

    @property
    def bright(self) -> Bools:
        """Which stand out enough to tell their width."""
        return self.significance >= _FAINTEST


def spot_fits(group: Group, stack: NDArray[Any], *, saturated: bool = False) -> SpotFits:
    """Fit Gaussians to some of the windows of a group.

    Spots that are not wholly read are left out, and saturated ones unless they are wanted.
    """
    count, side = len(group.numbers), group.engine.window
    some = _chosen(group.frame, group.spot, count)
    spot, middle = group.spot[some], group.middle[some]
    cut = group.engine.cut(stack, group.frame[some], middle)
    usable = np.isfinite(cut.signal).all(axis=(1, 2)) & (saturated | ~cut.saturated)
    if cut.missing is not None:
        usable &= ~cut.missing.any(axis=(1, 2))
    signal = cut.signal[usable]
    start = np.nan_to_num(grey(signal, np.zeros((len(signal), 2)), side).centroid)
    windows = Windows(
        signal,
        side,
        np.clip(start, -side / 3.0, side / 3.0),
        middle[usable],
        cut.noise.of(usable),
        np.full((len(signal), 2), side / 6.0),
        None if cut.kept is None else cut.kept[usable],
        leave=side / 3.0,
    )
    fit = fit_template(windows, free=True, tolerance=1e-5, max_iter=_STEPS)
    asking = np.flatnonzero(asks(windows, fit.estimate(windows)))
    if asking.size:
        fit.put(asking, look_into(windows.of(asking)).fit)
    with np.errstate(divide="ignore", invalid="ignore"):
        significance = np.nan_to_num(fit.flux / np.sqrt(fit.variance[:, 0]), posinf=1e9)
    return SpotFits(count, spot[usable], windows, fit, significance)


def _chosen(frame: Indices, spot: Indices, n_spots: int) -> Indices:
    """Which windows to fit: of up to 400 spots, each in as many frames as that allows, evenly
    spread; 64 spots where there are not four frames.
    """
    frames = np.unique(frame)
    most = _FITS if len(frames) >= _FEWEST else _FITS_OF_ONE
    share = evenly(len(frames), min(_FRAMES, max(1, most // n_spots)))
    return np.flatnonzero(np.isin(frame, frames[share]) & np.isin(spot, evenly(n_spots, most)))


def _weighted_median(values: Floats, weight: Floats) -> Floats:
    """Median of each column of values (M, 2), each counted with its weight (M,)."""
    order = np.argsort(values, axis=0)
    share = np.cumsum(weight[order], axis=0)
    place = (share >= 0.5 * share[-1]).argmax(axis=0)
    median: Floats = np.take_along_axis(
        values, np.take_along_axis(order, place[None], axis=0), axis=0
    )[0]
    return median
