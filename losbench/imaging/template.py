"""Centroids by a Gaussian template: the optimal weighted one, and the least-squares fit to check it
against.

The light of a spot in a pixel is A g, with the flux A and the integral g of a Gaussian over that
pixel. A centroid that weights each pixel by the inverse of its variance V = V0 + A g / gain has the
least error that any can have, the bound of Cramer and Rao, as long as the spot is such a Gaussian
and its width is known. It is the fixed point of weighted least squares of the reading on g and its
two slopes,

    d = A g + a dg/dx + b dg/dy,    centre <- centre + (a, b) / A,

the scoring steps of Fisher, of which about three are enough. Here M spots are fitted at once.
Positions are counted from the middle of each stamp, x first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

from losbench.arrays import Bools, Floats, Ints, Pixels
from losbench.imaging.background import PixelNoise

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

__all__ = ["FittedWidths", "TemplateFit", "fitted_widths", "gaussian", "weighted"]


_LONGEST_STEP = 1.0  # pixels
_NARROWEST = 0.3  # pixels of sigma
_MISFIT = 0.1  # of the light of a window
_SURE = 5.0  # sigma
_SQUARE_ROOT_2_PI = np.sqrt(2.0 * np.pi)


@dataclass(frozen=True)
class TemplateFit:
    """Fits of M spots.

    Centroid and its error (M, 2); flux and its error, evaluations, converged or not, and whether
    the template does not fit, each (M,).
    """

    centroid: Floats
    sigma: Floats
    flux: Floats
    sigma_flux: Floats
    n_iter: Ints
    converged: Bools
    misfit: Bools


@dataclass(frozen=True)
class FittedWidths:
    """Widths (M, 2) in pixels, and the flux that they rest on in units of its error (M,)."""

    width: Floats
    significance: Floats


def weighted(
    pixels: Pixels,
    start: Floats,
    width: Floats,
    noise: PixelNoise,
    *,
    tolerance: float,
    max_iter: int,
) -> TemplateFit:
    """Fit flux and place of a Gaussian of known width to M stamps, each pixel weighted by its
    inverse variance.

    Parameters
    ----------
    pixels : (M, S, S) array, DN
        Stamps without background.
    start : (M, 2) array, pixels
    width : (M, 2) array, pixels
        Sigma along x and y.
    noise : PixelNoise
    tolerance : float, pixels
        A fit is done when a step is shorter.
    max_iter : int

    Returns
    -------
    TemplateFit
        With the information error. A fit that leaves the middle pixel by more than a pixel stops
        there, not converged.
    """
    count = len(pixels)
    centre, flux = start.copy(), pixels.sum(axis=(1, 2), dtype=np.float64)
    n_iter, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    variance = np.full((count, 3), np.nan)
    moving = np.arange(count)
    for _ in range(max_iter):
        some = slice(None) if moving.size == count else moving
        columns = _columns(pixels, centre[some], width[some])
        solved = _weighted_fit(columns, pixels[some], flux[some], noise.of(some))
        step = _step(solved.values)
        centre[some] += step
        flux[some], variance[some] = solved.values[:, 0], solved.variance
        n_iter[some] += 1
        converged[some] = done = np.hypot(step[:, 0], step[:, 1]) < tolerance
        within = (np.abs(centre[some]) <= 1.0).all(axis=1)
        moving = moving[~done & within]
        if not moving.size:
            break
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.sqrt(variance[:, 1:]) / np.where(flux > 0, flux, np.nan)[:, None]
    misfit = _misfits(pixels, centre, flux, width, noise)
    return TemplateFit(
        centre, sigma, flux, np.sqrt(variance[:, 0]), n_iter, converged & (flux > 0), misfit
    )


def gaussian(
    pixels: Pixels, start: Floats, width: Floats, noise: PixelNoise, *, max_iter: int
) -> TemplateFit:
    """Fit flux, place and both widths of a Gaussian to M stamps by unweighted least squares, one
    after the other.

    Parameters
    ----------
    pixels, start, noise
        As in `weighted`.
    width : (M, 2) array, pixels
        Where both widths begin.
    max_iter : int

    Returns
    -------
    TemplateFit
        With the sandwich error: what pixels of this variance do to a fit that weights them alike.
    """
    count = len(pixels)
    values, variance = np.full((count, 5), np.nan), np.full((count, 3), np.nan)
    n_iter, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    for k in range(count):
        data = pixels[k].astype(np.float64)
        unit = float(np.abs(data).max())
        if not 0.0 < unit < np.inf or not np.isfinite(noise.floor[k]):
            continue
        # The fit's own tolerances are absolute.
        fit = _least_squares(data / unit, start[k], width[k], max_iter)
        pull = np.linalg.pinv(np.asarray(fit.jac))
        model = fit.fun + data.ravel() / unit
        of_pixels = noise.floor[k] / unit**2 + noise.per_dn / unit * np.maximum(model, 0.0)
        spread = pull**2 @ of_pixels + (pull @ _plane_basis(len(data)).T) ** 2 @ (
            noise.plane[k] / unit**2
        )
        values[k], variance[k], n_iter[k] = fit.x, spread[:3], fit.nfev
        values[k, 0], variance[k, 0] = unit * fit.x[0], unit**2 * spread[0]
        converged[k] = fit.success and fit.x[0] > 0
    sigma = np.sqrt(variance)
    flux, centre = values[:, 0], values[:, 1:3]
    misfit = _misfits(pixels, centre, flux, np.exp(values[:, 3:]), noise)
    return TemplateFit(centre, sigma[:, 1:], flux, sigma[:, 0], n_iter, converged, misfit)


def _least_squares(data: Floats, start: Floats, width: Floats, max_iter: int) -> OptimizeResult:
    """Fit flux, x, y and the logarithms of both widths to one stamp."""
    from scipy.optimize import least_squares

    def columns(p: Floats) -> Floats:
        """Derivatives of the model, the first of which is the template itself."""
        p = np.concatenate([p[:3], np.clip(p[3:], *np.log([0.05, 2.0 * len(data)]))])
        template: Floats = _columns(data[None], p[None, 1:3], np.exp(p[3:]), widths=True)[0]
        return (template.T * np.array([1.0, *[p[0]] * 4])).T

    def misfit(p: Floats) -> Floats:
        return p[0] * columns(p)[0] - data.ravel()

    def slopes(p: Floats) -> Floats:
        return columns(p).T

    first = np.array([max(float(data.sum()), 1e-3), *start, *np.log(width)])
    return least_squares(misfit, first, jac=slopes, x_scale="jac", max_nfev=max_iter)


def fitted_widths(
    pixels: Pixels, start: Floats, width: Floats, noise: PixelNoise, *, steps: int = 12
) -> FittedWidths:
    """Fit flux, place and both widths of M spots by weighted least squares, from a first guess
    ``width`` (2,).
    """
    reach = pixels.shape[1] / 3.0
    centre, flux = np.clip(start, -reach, reach), pixels.sum(axis=(1, 2), dtype=np.float64)
    each = np.broadcast_to(width, centre.shape).copy()
    for _ in range(steps):
        columns = _columns(pixels, centre, each, widths=True)
        solved = _weighted_fit(columns, pixels, flux, noise)
        flux = solved.values[:, 0]
        centre = np.clip(centre + _step(solved.values[:, :3]), -reach, reach)
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.nan_to_num(solved.values[:, 3:] / flux[:, None])
        each = np.clip(each + np.clip(change, -0.3, 0.3) * each, _NARROWEST, pixels.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        significance = np.nan_to_num(flux / np.sqrt(solved.variance[:, 0]), posinf=1e9)
    return FittedWidths(each, np.clip(significance, 0.0, None))


def _misfits(
    pixels: Pixels, centre: Floats, flux: Floats, width: Floats, noise: PixelNoise
) -> Bools:
    """Whether a template's light is not that of its window, or of the window's middle, half as
    wide, (M,).

    There a wrong width or shape shows.
    """
    side = pixels.shape[1]
    misfit = np.zeros(len(pixels), dtype=bool)
    for border in (0, side // 4):
        half, count = side / 2 - border, (side - 2 * border) ** 2
        part = slice(border, side - border)
        total = pixels[:, part, part].sum(axis=(1, 2), dtype=np.float64)
        held = flux * np.prod(
            ndtr((half - centre) / width) - ndtr((-half - centre) / width), axis=1
        )
        variance = (
            count * noise.floor
            + noise.per_dn * np.maximum(total, 0.0)
            + count**2 * noise.plane[:, 0]
        )
        with np.errstate(invalid="ignore"):
            misfit |= np.abs(held - total) > _MISFIT * np.abs(total) + _SURE * np.sqrt(variance)
    return misfit


@dataclass(frozen=True)
class _Solved:
    """Coefficients (M, p) of the columns, and the variances (M, 3) of the first three."""

    values: Floats
    variance: Floats


def _weighted_fit(columns: Pixels, pixels: Pixels, flux: Floats, noise: PixelNoise) -> _Solved:
    """Least squares of pixels on columns (M, p, S * S), the first of which is g, weighted by the
    inverse variance.
    """
    shot = noise.per_dn * np.maximum(np.nan_to_num(flux), 0.0)
    unit = noise.floor + shot
    with np.errstate(divide="ignore", invalid="ignore"):
        # Frames without noise still need weights, though any will do.
        share = np.where(unit > 0, shot / unit, 0.0).astype(columns.dtype)[:, None]
    pulled = columns / (np.maximum(1.0 - share, 1e-6) + share * columns[:, 0])[:, None]
    normal = (pulled @ columns.swapaxes(1, 2)).astype(np.float64)
    inverse = np.linalg.inv(normal + 1e-12 * np.eye(normal.shape[-1]))
    values = (inverse @ (pulled @ pixels.reshape(len(pixels), -1, 1)))[:, :, 0]
    basis = _plane_basis(pixels.shape[1]).T.astype(columns.dtype)
    of_plane = inverse[:, :3] @ (pulled.reshape(-1, len(basis)) @ basis).reshape(
        *pulled.shape[:2], 3
    )
    errors = unit[:, None] * np.diagonal(inverse, axis1=1, axis2=2)[:, :3]
    return _Solved(values, errors + np.einsum("mij,mj->mi", of_plane**2, noise.plane))


def _step(values: Floats) -> Floats:
    """Step of the centre from the coefficients of g and its slopes; none where there is no
    light.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(values[:, :1] > 0, values[:, 1:3] / values[:, :1], 0.0)
    return np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)


def _columns(pixels: Pixels, centre: Floats, width: Floats, *, widths: bool = False) -> Pixels:
    """Template g, its slopes by x and y and, if asked, by the logarithm of its widths, (M, 3 or 5,
    S * S).
    """
    side = pixels.shape[1]
    sigma = np.broadcast_to(width, centre.shape)[:, :, None]
    edges = (np.arange(side + 1) - side / 2 - centre[:, :, None]) / sigma
    bell = np.exp(-0.5 * edges**2) / _SQUARE_ROOT_2_PI
    profiles = [
        np.diff(ndtr(edges)),
        -np.diff(bell) / sigma,
        *([-np.diff(edges * bell)] if widths else []),
    ]
    inside, *slopes = (profile.astype(pixels.dtype) for profile in profiles)
    pairs = [
        (inside, inside),
        *(pair for slope in slopes for pair in ((slope, inside), (inside, slope))),
    ]
    columns = np.empty((len(centre), len(pairs), side, side), dtype=pixels.dtype)
    for place, (along_x, along_y) in enumerate(pairs):
        np.multiply(along_y[:, 1, :, None], along_x[:, 0, None, :], out=columns[:, place])
    return columns.reshape(len(centre), len(pairs), -1)


def _plane_basis(side: int) -> Floats:
    """1, x and y of every pixel, (3, side * side)."""
    offset = np.arange(side) - side // 2
    x, y = np.meshgrid(offset, offset)
    return np.stack([np.ones(side * side), x.ravel(), y.ravel()])
