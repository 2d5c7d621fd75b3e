"""Centroids by a Gaussian template, of known widths or with both widths fitted.

The light of a spot in a pixel is A g, with the flux A and the integral g of a Gaussian over that
pixel. A centroid that weights each pixel by the inverse of its variance V = V0 + A g / gain has the
least error that any can have, the bound of Cramer and Rao, as long as the spot is such a Gaussian.
It is the fixed point of weighted least squares of the reading on g and its slopes,

    d = A g + a dg/dx + b dg/dy + ...,    centre <- centre + (a, b) / A,

the scoring steps of Fisher, of which about two are enough. Here M spots are fitted at once.
Positions are counted from the middle of each stamp, x first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from losbench.arrays import Bools, Floats, Indices, Ints, Pixels
from losbench.imaging.columns import Drawing, Templates
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Estimate, Windows

__all__ = ["Draw", "TemplateFit", "fit_template"]


# Draws some of the windows, (K,) of them or all, with their spots at (K, 2).
Draw: TypeAlias = Callable[[Indices | slice, Floats], Drawing]


_LONGEST_STEP = 1.0  # pixels
_WIDEST_STEP = 0.3  # of a width
_NARROWEST = 0.3  # pixels of sigma
_MISFIT = 0.1  # of the light of a window
_SURE = 5.0  # sigma
_RIDGE = 1e-9  # of a unit diagonal
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
# Which entries of a 3 x 3 matrix, row by row, make up its cofactors: ab - cd.
_MINORS = np.array(
    [
        (3 * rows[:, None] + columns).ravel()
        for rows, columns in ((_NEXT, _NEXT), (_LAST, _LAST), (_NEXT, _LAST), (_LAST, _NEXT))
    ]
)


@dataclass(frozen=True)
class TemplateFit:
    """Gaussians that were fitted to M windows.

    Centre and width (M, 2) in pixels, flux (M,), variances (M, 3) of flux, x and y, evaluations,
    and converged or not.
    """

    centre: Floats
    width: Floats
    flux: Floats
    variance: Floats
    n_iter: Ints
    converged: Bools

    def estimate(self, windows: Windows, misfit: Bools | None = None) -> Estimate:
        """Return what was found, with what does not fit; None: by the light of a Gaussian."""
        # Too few pixels for their columns leave no error that could be stated.
        known: Bools = np.asarray((self.variance >= 0).all(axis=1))
        sigma = np.sqrt(np.where(known[:, None], self.variance, np.nan))
        flux = np.where(self.flux > 0, self.flux, np.nan)
        return Estimate(
            centroid=self.centre,
            sigma=sigma[:, 1:] / flux[:, None],
            flux=self.flux,
            sigma_flux=sigma[:, 0],
            n_iter=self.n_iter,
            converged=self.converged & known & (self.flux > 0),
            middle=np.zeros_like(self.centre),
            slow=np.zeros(len(self.flux), dtype=bool),
            misfit=_misfits(self, windows) if misfit is None else misfit,
            width=self.width if misfit is None else None,
        )

    def of(self, some: NDArray[Any]) -> TemplateFit:
        """Return some of them."""
        return TemplateFit(*(getattr(self, field.name)[some] for field in fields(self)))

    def put(self, where: NDArray[Any], part: TemplateFit) -> None:
        """Replace what is ``where`` by a part."""
        for field in fields(self):
            getattr(self, field.name)[where] = getattr(part, field.name)


@dataclass(frozen=True)
class _Step:
    """One scoring step: flux (M,), steps of the others in units of the flux (M, p - 1), and the
    variances (M, 3) of the first three columns.
    """

    flux: Floats
    others: Floats
    variance: Floats


def fit_template(
    windows: Windows,
    *,
    free: bool = False,
    equal: bool = False,
    tolerance: float,
    max_iter: int,
    draw: Draw | None = None,
) -> TemplateFit:
    """Fit flux and place of a Gaussian to each of M windows, and both its widths if ``free``; or of
    what ``draw`` draws.

    Parameters
    ----------
    windows : Windows
        Their widths are where those of the fit begin.
    free : bool
    equal : bool
        Weigh all pixels alike, whatever their noise; the variances stay honest.
    tolerance : float, pixels
        A fit is done when the square of its step, which is what the step leaves, is shorter.
    max_iter : int
        A fit that leaves the middle of its window by more than ``windows.leave`` stops before, not
        converged.
    """
    pixels, width = windows.inner, windows.width.copy()
    kept = None if windows.kept is None else windows.kept[:, 1:-1, 1:-1]
    count, side = len(pixels), pixels.shape[1]
    first = pixels if kept is None else pixels * kept
    centre, flux = windows.start.copy(), first.sum(axis=(1, 2), dtype=np.float64)
    variance = np.full((count, 3), np.nan)
    n_iter, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    floor, per_dn, plane = windows.noise.floor, windows.noise.per_dn, windows.noise.plane
    moving = np.arange(count)
    for _ in range(max_iter):
        some = slice(None) if moving.size == count else moving
        at: Drawing
        if draw is None:
            at = Templates.of(side, centre[some], width[some], pixels.dtype, free=free)
        else:
            at = draw(some, centre[some])
        seen = None if kept is None else kept[some]
        noise = PixelNoise(floor[some], per_dn, plane[some])
        step = _scoring(at, pixels[some], seen, flux[some], noise, equal)
        move = step.others[:, :2].clip(-_LONGEST_STEP, _LONGEST_STEP)
        centre[some] += move
        flux[some], variance[some] = step.flux, step.variance
        square = np.vecdot(move, move)
        if free:
            wider = np.clip(step.others[:, 2:], -_WIDEST_STEP, _WIDEST_STEP) * width[some]
            width[some] = np.clip(width[some] + wider, _NARROWEST, side)
            square = np.maximum(square, (wider**2).max(axis=1))
        n_iter[some] += 1
        converged[some] = done = square < tolerance
        moving = moving[~done & (np.abs(centre[some]) <= windows.leave).all(axis=1)]
        if not moving.size:
            break
    return TemplateFit(centre, width, flux, variance, n_iter, converged)


def _scoring(
    at: Drawing,
    pixels: Pixels,
    kept: Pixels | None,
    flux: Floats,
    noise: PixelNoise,
    equal: bool,
) -> _Step:
    """Least squares of pixels on the template and its slopes, weighted by the inverse variance."""
    unit = noise.floor + noise.per_dn * np.fmax(flux, 0.0)
    relative = _relative(at, noise.floor, unit) if noise.per_dn else None
    weight = kept if equal or relative is None else (1.0 if kept is None else kept) / relative
    sums = at.sums(pixels, weight)
    inverse = _inverse(sums.normal)
    values = np.einsum("mij,mj->mi", inverse, sums.reading)
    first = inverse[:, :3]
    if equal and relative is not None:
        spread = at.sums(pixels, relative if kept is None else kept * relative).normal
        errors = unit[:, None] * np.einsum("mij,mjk,mik->mi", first, spread, first)
    else:
        errors = unit[:, None] * np.diagonal(inverse, axis1=1, axis2=2)[:, :3]
    errors = errors + np.einsum("mij,mj->mi", (first @ sums.plane) ** 2, noise.plane)
    light, others = values[:, :1], np.zeros_like(values[:, 1:])
    np.divide(values[:, 1:], light, out=others, where=light > 0)
    return _Step(values[:, 0], others, errors)


def _relative(at: Drawing, floor: Floats, unit: Floats) -> Pixels:
    """Variance (M, S, S) of pixels under templates, in units (M,) of that under all the light."""
    # Frames without noise still need weights, though any will do.
    flat = np.divide(floor, unit, out=np.ones(len(unit)), where=unit > 0)
    light = at.light
    light *= (1.0 - flat).astype(light.dtype)[:, None, None]
    light += np.maximum(flat, 1e-6).astype(light.dtype)[:, None, None]
    return light


def _inverse(normal: Floats) -> Floats:
    """Inverse of M symmetric normal matrices, each brought to a unit diagonal first."""
    entry = np.ascontiguousarray(normal.T)  # with the windows last, as many lie side by side
    scale = np.sqrt(np.einsum("iim->im", entry))
    scale[~(scale > 0)] = 1.0
    scale = scale[:, None] * scale
    unit = entry / scale + _RIDGE * np.eye(len(entry))[:, :, None]
    if len(unit) > 3:
        return np.asarray(np.linalg.inv(unit.T) / scale.T, dtype=np.float64)
    flat = unit.reshape(9, len(normal))
    a, b, c, d = flat[_MINORS]
    adjugate = a * b - c * d
    determinant = (flat[:3] * adjugate[:3]).sum(axis=0)
    return (adjugate.reshape(unit.shape) / (determinant * scale)).T


def _misfits(fit: TemplateFit, windows: Windows) -> Bools:
    """Whether a template's light is not that of its window, or of the window's middle, half as
    wide, (M,).

    There a wrong width or shape shows.
    """
    side, noise, pixels = windows.side, windows.noise, windows.inner
    half, middles = _middles(side, pixels.dtype)
    if windows.kept is not None:
        pixels = pixels * windows.kept[:, 1:-1, 1:-1]
    pixels = pixels.reshape(-1, side * side)
    total = (pixels @ middles).astype(np.float64).T
    if windows.kept is None:
        ends = np.array([half, -half])[:, :, None, None]
        upper, lower = ndtr((ends - fit.centre) / fit.width)
        held = fit.flux * (upper - lower).prod(axis=2)
    else:
        at = Templates.of(side, fit.centre, fit.width, pixels.dtype, free=False)
        seen = (at.light * windows.kept[:, 1:-1, 1:-1]).reshape(-1, side * side)
        held = fit.flux * (seen @ middles).T
    count = 4.0 * half[:, None] ** 2
    variance = count * noise.floor + noise.per_dn * np.maximum(total, 0.0)
    variance += count**2 * noise.plane[:, 0]
    with np.errstate(invalid="ignore"):
        apart = np.abs(held - total) > _MISFIT * np.abs(total) + _SURE * np.sqrt(variance)
    return apart.any(axis=0)


@lru_cache(maxsize=8)
def _middles(side: int, dtype: np.dtype[np.floating[Any]]) -> tuple[Floats, Pixels]:
    """Half of the side (2,) of a window and of its middle, and their pixels (S * S, 2)."""
    half = side / 2 - np.array([0, side // 4])
    inside = np.abs(np.arange(side) - side // 2)[:, None] < half
    return half, (inside[:, None] & inside).reshape(-1, 2).astype(dtype)
