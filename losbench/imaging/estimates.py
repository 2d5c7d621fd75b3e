"""The centroids of cut-out windows by any method, with their predicted errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Ints, Pixels
from losbench.imaging.background import PixelNoise
from losbench.imaging.detector import Detector
from losbench.imaging.eiwa import NEWTON_LIMIT, WindowFit, eiwa, grey, spread
from losbench.imaging.template import TemplateFit, gaussian, weighted

__all__ = ["TEMPLATES", "Choices", "Estimate", "estimate"]


TEMPLATES = ("weighted", "gaussian")


@dataclass(frozen=True)
class Choices:
    """How to measure: what holds for every spot of a call."""

    method: str
    window: int
    ring: int
    stop: str
    tolerance: float
    max_iter: int
    background: str | float
    gate: bool
    noise: Detector | None
    full_scale: float
    rounding: float  # variance of a reading's rounding, DN squared


@dataclass(frozen=True)
class Estimate:
    """Centroids of M windows, counted from the middle of their stamps.

    Centroid and its error (M, 2), flux and its error (M,), evaluations, converged or not, the
    middle of the window (M, 2), whether the centroid follows its window more than the spot, and
    whether a template does not fit it.
    """

    centroid: Floats
    sigma: Floats
    flux: Floats
    sigma_flux: Floats
    n_iter: Ints
    converged: Bools
    middle: Floats
    slow: Bools
    misfit: Bools


def estimate(
    signal: Pixels,
    start: Floats,
    noise: PixelNoise,
    how: Choices,
    *,
    width: Floats | None = None,
    path: list[Floats] | None = None,
) -> Estimate:
    """Measure M stamps without background (M, window + 2, window + 2) from starts (M, 2) near their
    middles.

    The methods with a template need its ``width`` (M, 2). ``path`` receives the centres of every
    iteration of EIWA, the start included.
    """
    if width is not None:
        return _of_template(np.ascontiguousarray(signal[:, 1:-1, 1:-1]), start, width, noise, how)
    if how.method == "grey":
        return _of_window(signal, grey(signal, np.zeros_like(start), how.window), noise, how)
    size, most = how.tolerance, how.max_iter
    fit = eiwa(signal, start, how.window, stop=how.stop, tolerance=size, max_iter=most, path=path)
    return _of_window(signal, fit, noise, how)


def _of_template(
    window: Pixels, start: Floats, width: Floats, noise: PixelNoise, how: Choices
) -> Estimate:
    if how.method == "weighted":
        fit: TemplateFit = weighted(
            window, start, width, noise, tolerance=how.tolerance, max_iter=how.max_iter
        )
    else:
        fit = gaussian(window, start, width, noise, max_iter=how.max_iter)
    return Estimate(**vars(fit), middle=np.zeros_like(start), slow=np.zeros(len(start), dtype=bool))


def _of_window(signal: Pixels, fit: WindowFit, noise: PixelNoise, how: Choices) -> Estimate:
    """Errors of window centroids; the docstring of `centroid` has the formula."""
    seen = fit.seen
    moves = how.method == "eiwa"
    middle = fit.centroid if moves else np.zeros_like(fit.centroid)
    total_variance, moment_variance = spread(signal, middle, how.window, noise.floor, noise.per_dn)
    arm = how.window**2 * (how.window**2 - 1) / 12.0
    moment_variance += arm**2 * noise.plane[:, 1:]
    total_variance += how.window**4 * noise.plane[:, 0]
    gain = 1.0 / np.maximum(1.0 - seen.contraction, 1.0 - NEWTON_LIMIT) if moves else 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        statistical = np.maximum(moment_variance, 0.0) * (gain / seen.total[:, None]) ** 2
    return Estimate(
        centroid=fit.centroid,
        sigma=np.sqrt(statistical + fit.remaining**2),
        flux=seen.total,
        sigma_flux=np.sqrt(np.maximum(total_variance, 0.0)),
        n_iter=fit.n_iter,
        converged=fit.converged,
        middle=middle,
        slow=seen.contraction.max(axis=1) > NEWTON_LIMIT,
        misfit=np.zeros(len(fit.centroid), dtype=bool),
    )
