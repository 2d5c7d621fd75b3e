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

import numpy as np
from scipy.special import ndtr

from losbench.arrays import Bools, Floats, Pixels
from losbench.imaging.noise import PixelNoise

__all__ = [
    "FittedWidths",
    "fitted_widths",
    "misfits",
    "plane_basis",
    "template_columns",
    "template_step",
    "weighted_fit",
]


_LONGEST_STEP = 1.0  # pixels
_NARROWEST = 0.3  # pixels of sigma
_MISFIT = 0.1  # of the light of a window
_SURE = 5.0  # sigma
_SQUARE_ROOT_2_PI = np.sqrt(2.0 * np.pi)


@dataclass(frozen=True)
class FittedWidths:
    """Widths (M, 2) in pixels, and the flux that they rest on in units of its error (M,)."""

    width: Floats
    significance: Floats


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
        columns = template_columns(pixels, centre, each, widths=True)
        solved = weighted_fit(columns, pixels, flux, noise)
        flux = solved.values[:, 0]
        centre = np.clip(centre + template_step(solved.values[:, :3]), -reach, reach)
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.nan_to_num(solved.values[:, 3:] / flux[:, None])
        each = np.clip(each + np.clip(change, -0.3, 0.3) * each, _NARROWEST, pixels.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        significance = np.nan_to_num(flux / np.sqrt(solved.variance[:, 0]), posinf=1e9)
    return FittedWidths(each, np.clip(significance, 0.0, None))


def misfits(
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


def weighted_fit(columns: Pixels, pixels: Pixels, flux: Floats, noise: PixelNoise) -> _Solved:
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
    basis = plane_basis(pixels.shape[1]).T.astype(columns.dtype)
    of_plane = inverse[:, :3] @ (pulled.reshape(-1, len(basis)) @ basis).reshape(
        *pulled.shape[:2], 3
    )
    errors = unit[:, None] * np.diagonal(inverse, axis1=1, axis2=2)[:, :3]
    return _Solved(values, errors + np.einsum("mij,mj->mi", of_plane**2, noise.plane))


def template_step(values: Floats) -> Floats:
    """Step of the centre from the coefficients of g and its slopes; none where there is no
    light.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(values[:, :1] > 0, values[:, 1:3] / values[:, :1], 0.0)
    return np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)


def template_columns(
    pixels: Pixels, centre: Floats, width: Floats, *, widths: bool = False
) -> Pixels:
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


def plane_basis(side: int) -> Floats:
    """1, x and y of every pixel, (3, side * side)."""
    offset = np.arange(side) - side // 2
    x, y = np.meshgrid(offset, offset)
    return np.stack([np.ones(side * side), x.ravel(), y.ravel()])
