"""The likeliest Gaussian, place, flux and both widths fitted to many spots at once."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

from losbench.imaging.common import TemplateFields
from losbench.imaging.protocols import Estimate, Windows
from losbench.imaging.template import fit_template

__all__ = ["Gaussian", "Likelihood"]


@dataclass(frozen=True)
class Likelihood(TemplateFields):
    """Fit place, flux and both widths of a Gaussian, each pixel weighted by its own noise.

    Scoring steps to the maximum of the likelihood: for round spots it reaches the Cramer-Rao bound,
    as `Weighted` does, and needs no width; for a faint spot `Weighted` with the width of the whole
    recording is the safer of the two.

    Parameters
    ----------
    width : float, (2,) or (n, 2) array, pixels, optional
        Where both widths begin; by default found as for `Weighted`.
    window : odd int or (n,) of them, pixels, optional
        Side N of the window, or of that of each spot; see `centroid` for the default.
    tolerance : float, pixels
        A fit is done when the square of a step, which is about what it leaves, is shorter.
    max_iter : int
        Steps before it counts as not converged.
    centre, hot_pixel_gate, smooth
        As for `EIWA`.

    Raises
    ------
    ValueError
        If the window is even, or another field is out of range.

    Notes
    -----
    The variance of a pixel is that of the background plus the light of the fitted spot over the
    gain (Poisson; the gain from a detector). The error is that of the information in the window,
    with the error of the background plane; it does not know how far a spot is from a Gaussian.

    Examples
    --------
    >>> import losbench as lb
    >>> image = lb.render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> lb.centroid(image, [[20, 16]], method=lb.Likelihood(window=13)).xy.round(2).tolist()
    [[20.3, 15.8]]
    """

    _: KW_ONLY
    tolerance: float = 2.5e-4

    equal: ClassVar[bool] = False

    def measure(self, windows: Windows) -> Estimate:
        """Fit flux, place and both widths to each window, with the information error."""
        fit = fit_template(
            windows,
            free=True,
            equal=self.equal,
            tolerance=self.tolerance,
            max_iter=self.max_iter,
        )
        return fit.estimate(windows)


@dataclass(frozen=True)
class Gaussian(Likelihood):
    """Fit a Gaussian by plain least squares, place, flux and both widths: a reference for the
    others.

    `Likelihood` without the shot noise of the spot: it weighs all pixels alike.

    Parameters
    ----------
    width : float, (2,) or (n, 2) array, pixels, optional
        Where both widths begin; by default found as for `Weighted`.
    window, tolerance, max_iter, centre, hot_pixel_gate, smooth
        As for `Likelihood`.

    Raises
    ------
    ValueError
        If the window is even, or another field is out of range.

    Notes
    -----
    The error is the sandwich error of its equal weights, with the error of the background plane; it
    does not know how far a spot is from a Gaussian.

    Examples
    --------
    >>> import losbench as lb
    >>> image = lb.render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> lb.centroid(image, [[20, 16]], method=lb.Gaussian(window=13)).xy.round(2).tolist()
    [[20.3, 15.8]]
    """

    tolerance: float = 1e-8
    equal: ClassVar[bool] = True
