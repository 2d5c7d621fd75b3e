"""A least-squares fit of a Gaussian, to check the others against."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import integer
from losbench.imaging.common import as_width, check_fields
from losbench.imaging.protocols import Estimate, Windows
from losbench.imaging.template import misfits, plane_basis, template_columns

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

__all__ = ["Gaussian"]


@dataclass(frozen=True)
class Gaussian:
    """Fit a Gaussian by plain least squares, place, flux and both widths: a reference for the
    others.

    It takes some milliseconds a spot, and weighs all pixels alike.

    Parameters
    ----------
    width : float, (2,) or (n, 2) array, pixels, optional
        Where both widths begin; by default found as for `Weighted`.
    window : odd int, pixels, optional
        Side N of the window; see `centroid` for the default.
    max_iter : int
        Evaluations before it counts as not converged.
    centre, hot_pixel_gate, smooth
        As for `EIWA`.

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

    width: ArrayLike | None = None
    _: KW_ONLY
    window: int | None = None
    max_iter: int = 50
    centre: str | None = None
    hot_pixel_gate: bool = False
    smooth: str | None = None

    stays: ClassVar[bool] = False
    template: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, "width", as_width(self.width))
        integer("max_iter", self.max_iter, low=1)

    def measure(self, windows: Windows) -> Estimate:
        """Fit flux, place and both widths to one window after the other."""
        pixels, noise, width = windows.signal[:, 1:-1, 1:-1], windows.noise, windows.width
        count = len(pixels)
        values, variance = np.full((count, 5), np.nan), np.full((count, 3), np.nan)
        n_iter, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
        for k in range(count):
            data = pixels[k].astype(np.float64)
            unit = float(np.abs(data).max())
            if not 0.0 < unit < np.inf or not np.isfinite(noise.floor[k]):
                continue
            # The fit's own tolerances are absolute.
            fit = _least_squares(data / unit, windows.start[k], width[k], self.max_iter)
            pull = np.linalg.pinv(np.asarray(fit.jac))
            model = fit.fun + data.ravel() / unit
            of_pixels = noise.floor[k] / unit**2 + noise.per_dn / unit * np.maximum(model, 0.0)
            spread = pull**2 @ of_pixels + (pull @ plane_basis(len(data)).T) ** 2 @ (
                noise.plane[k] / unit**2
            )
            values[k], variance[k], n_iter[k] = fit.x, spread[:3], fit.nfev
            values[k, 0], variance[k, 0] = unit * fit.x[0], unit**2 * spread[0]
            converged[k] = fit.success and fit.x[0] > 0
        sigma = np.sqrt(variance)
        flux, centre = values[:, 0], values[:, 1:3]
        misfit = misfits(pixels, centre, flux, np.exp(values[:, 3:]), noise)
        return Estimate(
            centroid=centre,
            sigma=sigma[:, 1:],
            flux=flux,
            sigma_flux=sigma[:, 0],
            n_iter=n_iter,
            converged=converged,
            middle=np.zeros_like(centre),
            slow=np.zeros(count, dtype=bool),
            misfit=misfit,
        )


def _least_squares(data: Floats, start: Floats, width: Floats, max_iter: int) -> OptimizeResult:
    """Fit flux, x, y and the logarithms of both widths to one stamp."""
    from scipy.optimize import least_squares

    def columns(p: Floats) -> Floats:
        """Derivatives of the model, the first of which is the template itself."""
        p = np.concatenate([p[:3], np.clip(p[3:], *np.log([0.05, 2.0 * len(data)]))])
        template: Floats = template_columns(data[None], p[None, 1:3], np.exp(p[3:]), widths=True)[0]
        return (template.T * np.array([1.0, *[p[0]] * 4])).T

    def misfit(p: Floats) -> Floats:
        return p[0] * columns(p)[0] - data.ravel()

    def slopes(p: Floats) -> Floats:
        return columns(p).T

    first = np.array([max(float(data.sum()), 1e-3), *start, *np.log(width)])
    return least_squares(misfit, first, jac=slopes, x_scale="jac", max_nfev=max_iter)
