"""What one window sees of M spots: its sum, its centroid, how far that follows the window, and the
error of it.

Positions are counted from the middle of each stamp, x first. The edges of a window fall between
pixel borders, and an edge pixel counts by the fraction that lies inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Indices, Ints, Pixels
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Estimate, Windows

__all__ = ["NEWTON_LIMIT", "Look", "WindowFit", "look", "spread", "window_estimate"]


_WHOLE = 1.5  # noises of light, from which on a pixel is hardly clipped
NEWTON_LIMIT = 0.85  # contraction beyond which extrapolation amplifies noise more than it helps


@dataclass(frozen=True)
class Look:
    """What one window sees: total (M,), its centroid (M, 2) and how far the centroid follows the
    window, (M, 2).
    """

    total: Floats
    centroid: Floats
    contraction: Floats


@dataclass(frozen=True)
class WindowFit:
    """Where M windows came to rest: centroid and the error that is left (M, 2), evaluations, at
    rest or not (M,).

    ``seen`` is what each window saw when it was last evaluated.
    """

    centroid: Floats
    remaining: Floats
    n_iter: Ints
    converged: Bools
    seen: Look


def look(pixels: Pixels, centre: Floats, window: int) -> Look:
    """Sum and centroid of a window (eq. 13-14), and the derivative of the centroid by the window's
    centre.

    The centroid is m = sum w x I / sum w I over weights w that are 1 inside, 0 outside and the
    overlapping fraction on the edge. Moving the window by dc lets the column at its right edge in
    and the one at its left edge out, so that dm/dc = ((x_right - m) S_right + (m - x_left) S_left)
    / T, about N S_edge / T.
    """
    offset = np.arange(pixels.shape[2]) - pixels.shape[2] // 2
    weight = _overlap(offset, centre, window)
    sums = _column_and_row_sums(pixels, weight)
    weighted = sums * weight
    total = weighted[:, 0].sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        centroid = weighted @ offset.astype(np.float64) / total[:, None]
        contraction = _edge_pull(sums, centre, centroid, window) / total[:, None]
    return Look(total, centroid, contraction)


def window_estimate(windows: Windows, fit: WindowFit, *, moved: bool) -> Estimate:
    """Errors of window centroids; `Centroids` has the formula."""
    seen, noise, side = fit.seen, windows.noise, windows.side
    middle = fit.centroid if moved else np.zeros_like(fit.centroid)
    total_variance, moment_variance = spread(windows.signal, middle, side, noise)
    arm = side**2 * (side**2 - 1) / 12.0
    moment_variance += arm**2 * noise.plane[:, 1:]
    total_variance += side**4 * noise.plane[:, 0]
    gain = 1.0 / np.maximum(1.0 - seen.contraction, 1.0 - NEWTON_LIMIT) if moved else 1.0
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


def spread(pixels: Pixels, centre: Floats, window: int, noise: PixelNoise) -> tuple[Floats, Floats]:
    """Variance of the sum of a window, and of its first moment about the centre, for independent
    pixels.

    The variance of a pixel is ``floor + per_dn * pixel``, less where black is clipped: there it
    rises to the floor with the light of the pixel.

    Returns
    -------
    (M,) and (M, 2) arrays
        sum w^2 V, and sum w^2 (x - c)^2 V for x and y.
    """
    offset = np.arange(pixels.shape[2]) - pixels.shape[2] // 2
    square = _overlap(offset, centre, window) ** 2
    arm = square * (offset - centre[:, :, None]) ** 2
    sums = noise.floor[:, None, None] * square[:, ::-1].sum(axis=2, keepdims=True)
    if noise.per_dn:
        sums = sums + noise.per_dn * _column_and_row_sums(pixels, square)
    if noise.lost is not None and noise.lost.any():
        whole = (_WHOLE * np.sqrt(noise.floor)).astype(pixels.dtype)[:, None, None]
        dark = np.clip(1.0 - pixels / whole, 0.0, 1.0)
        sums = sums - noise.lost[:, None, None] * _column_and_row_sums(dark, square)
    sums = np.broadcast_to(sums, arm.shape)
    return np.einsum("mk,mk->m", sums[:, 0], square[:, 0]), np.einsum("mak,mak->ma", sums, arm)


def _overlap(offset: Indices, centre: Floats, window: int) -> Floats:
    """Fraction of each pixel column and row that lies within half a window of the centre, (M, 2,
    S).
    """
    return np.clip(0.5 * (window + 1) - np.abs(offset - centre[:, :, None]), 0.0, 1.0)


def _column_and_row_sums(pixels: Pixels, weight: Floats) -> Floats:
    """Columns summed over weighted rows and rows summed over weighted columns, (M, 2, S)."""
    weight_x, weight_y = (weight[:, axis].astype(pixels.dtype, copy=False) for axis in (0, 1))
    sums = np.empty(weight.shape)
    sums[:, 0] = np.matmul(weight_y[:, None, :], pixels)[:, 0]
    sums[:, 1] = np.matmul(pixels, weight_x[:, :, None])[:, :, 0]
    return sums


def _edge_pull(sums: Floats, centre: Floats, centroid: Floats, window: int) -> Floats:
    """Numerator of the contraction, from the sums of the two pixel columns (and rows) that the
    edges cross.
    """
    middle = sums.shape[2] // 2
    left = np.floor(centre - 0.5 * (window - 1))
    left = np.fmax(np.fmin(left, middle - window), -middle)  # a number, where there is no centre
    right = left + window
    place = left.astype(np.intp) + middle
    spot, axis = np.arange(len(sums))[:, None], np.array([0, 1])
    return (right - centroid) * sums[spot, axis, place + window] + (centroid - left) * sums[
        spot, axis, place
    ]
