"""The centroid that the spots of a call ask for, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools
from losbench.imaging.common import as_width, check_fields
from losbench.imaging.eiwa import EIWA
from losbench.imaging.groups import Group, in_order
from losbench.imaging.likelihood import Likelihood
from losbench.imaging.protocols import CentroidMethod, Estimate, Window, Windows
from losbench.imaging.scrutiny import UNEXPLAINED, unexplained
from losbench.imaging.weighted import Weighted
from losbench.imaging.widths import spot_fits

__all__ = ["AutoCentroid", "Chosen"]


_SATURATED = 0.05  # of the windows that are looked at


@dataclass(frozen=True)
class Chosen:
    """The centroid that was chosen, with its widths, and a sentence that says why."""

    method: CentroidMethod
    reason: str


@dataclass(frozen=True)
class AutoCentroid:
    """Choose the centroid by what the spots look like.

    `Weighted` for round spots, with a width for each spot or one for all; `Likelihood`, whose
    widths are free, where more than 5 % of the spots are saturated: their cores are masked; `EIWA`
    where a Gaussian leaves more than 0.3 of the light unexplained. The choice is made once for a
    call, and in `measure` once for a recording, by up to 64 frames; `Centroids.method` and
    `Centroids.reason`, and the notes of a measurement, tell it. Where it takes `EIWA`, `Empirical`
    scatters less, from ten frames on, if the shape stays.

    Parameters
    ----------
    width : float, (2,) or (n, 2) array, pixels, optional
        Sigma of the template, along x and y; by default found as for `Weighted`.
    window : odd int or (n,) of them, pixels, optional
        Side N of the window, or of that of each spot; see `centroid` for the default.
    centre, hot_pixel_gate, smooth
        As for `EIWA`.

    Raises
    ------
    ValueError
        If the window is even, or another field is out of range.

    Notes
    -----
    The share that a Gaussian model m does not explain of the readings r, with variances V, is the
    root of max(sum (r - m)^2 - sum V, 0) / sum m^2, the median over the spots that stand out by ten
    errors: 0 for a Gaussian, 0.13 for a Moffat profile, 0.45 for a disc, 0.6 and more for a ring.

    Examples
    --------
    >>> import losbench as lb
    >>> image = lb.render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> found = lb.centroid(image, [[20, 16]], method=lb.AutoCentroid(window=13))
    >>> found.xy.round(2).tolist(), found.reason
    ([[20.3, 15.8]], 'weighted: a Gaussian leaves 0 % of the light of the spots unexplained')
    """

    width: ArrayLike | None = None
    _: KW_ONLY
    window: Window | None = None
    centre: str | None = None
    hot_pixel_gate: bool = False
    smooth: str | None = None

    stays: ClassVar[bool] = False
    template: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, "width", as_width(self.width))

    def measure(self, windows: Windows) -> Estimate:
        """Measure as `Likelihood` does, which is right as long as nothing has been chosen."""
        return Likelihood().measure(windows)

    def choose(self, groups: Sequence[Group], stack: NDArray[Any]) -> Chosen:
        """Choose by some of the windows of groups of spots."""
        fits = [spot_fits(group, stack, saturated=True) for group in groups]
        bright = [fit.bright & np.isfinite(fit.fit.centre).all(axis=1) for fit in fits]
        width = self.width
        if not np.concatenate(bright).any():
            why = "no spot stands out enough to tell its shape"
            return Chosen(self._of(Weighted, width), f"weighted: {why}")
        if width is None:
            width = in_order(groups, [fit.widths() for fit in fits])
        seen = [
            (each.windows.of(some), each.fit.of(some))
            for each, some in zip(fits, bright, strict=True)
        ]
        left = float(np.median(np.concatenate([unexplained(w, fit, w.kept) for w, fit in seen])))
        full = float(np.concatenate([_masked(windows) for windows, _ in seen]).mean())
        why = f"a Gaussian leaves {100 * left:.0f} % of the light of the spots unexplained"
        if left > UNEXPLAINED:
            return Chosen(self._of(EIWA), f"eiwa: {why}")
        if full > _SATURATED:
            why = f"{100 * full:.0f} % of the spots are saturated, their cores are masked; {why}"
            return Chosen(self._of(Likelihood, width), f"likelihood: {why}")
        return Chosen(self._of(Weighted, width), f"weighted: {why}")

    def _of(self, kind: type[Any], width: ArrayLike | None = None) -> CentroidMethod:
        fields = {} if width is None else {"width": width}
        method: CentroidMethod = kind(
            **fields,
            window=self.window,
            centre=self.centre,
            hot_pixel_gate=self.hot_pixel_gate,
            smooth=self.smooth,
        )
        return method


def _masked(windows: Windows) -> Bools:
    """Which of M windows are not wholly kept."""
    if windows.kept is None:
        return np.zeros(len(windows.signal), dtype=bool)
    return np.asarray((windows.kept == 0).any(axis=(1, 2)))
