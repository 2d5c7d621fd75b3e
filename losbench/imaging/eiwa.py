"""The window centroids of liu2026: the grey-weighted one (eq. 11-12) and EIWA, which moves its window (eq. 13-15).

EIWA is the virtual-window centre of mass of Berglund et al. 2008 (Opt. Express 16, 14064). A window of N x N pixels is
centred on the last centroid; its edges fall between pixel borders, and an edge pixel counts by the fraction that lies
inside. The centroid of the window is the next centre, until it moves no more.

Here M spots move at once. Positions are counted from the middle of each stamp, x first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["NEWTON_LIMIT", "Look", "WindowFit", "eiwa", "grey", "look", "spread"]

Floats = NDArray[np.float64]

NEWTON_LIMIT = 0.85  # contraction beyond which extrapolation amplifies noise more than it helps
_LONGEST_STEP = 1.0  # pixels


@dataclass(frozen=True)
class Look:
    """What one window sees: total (M,), its centroid (M, 2) and how far the centroid follows the window, (M, 2)."""

    total: Floats
    centroid: Floats
    contraction: Floats


@dataclass(frozen=True)
class WindowFit:
    """Where M windows came to rest: centre and the error that is left (M, 2), evaluations, at rest or not (M,)."""

    centre: Floats
    remaining: Floats
    n_iter: NDArray[np.int64]
    converged: NDArray[np.bool_]


def look(pixels: Floats, centre: Floats, window: int) -> Look:
    """Sum and centroid of a window (eq. 13-14), and the derivative of the centroid by the window's centre.

    The centroid is m = sum w x I / sum w I over weights w that are 1 inside, 0 outside and the overlapping fraction on
    the edge. Moving the window by dc lets the column at its right edge in and the one at its left edge out, so that
    dm/dc = ((x_right - m) S_right + (m - x_left) S_left) / T, about N S_edge / T.
    """
    offset = np.arange(pixels.shape[2]) - pixels.shape[2] // 2
    weight_x, weight_y = _overlap(offset, centre[:, 0], window), _overlap(offset, centre[:, 1], window)
    columns = np.matmul(weight_y[:, None, :], pixels)[:, 0]
    rows = np.matmul(pixels, weight_x[:, :, None])[:, :, 0]
    weighted = columns * weight_x
    total = weighted.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        centroid = np.stack([weighted @ offset, (rows * weight_y) @ offset], axis=-1) / total[:, None]
        edges = [_edge_pull(sums, centre[:, k], centroid[:, k], window) for k, sums in enumerate((columns, rows))]
        contraction = np.stack(edges, axis=-1) / total[:, None]
    return Look(total, centroid, contraction)


def grey(pixels: Floats, centre: Floats, window: int) -> WindowFit:
    """Centroid of a window that stays where it is (eq. 11-12); what is left is its pull, contraction * (centre - m)."""
    seen = look(pixels, centre, window)
    pull = seen.contraction * (centre - seen.centroid)
    measured = np.isfinite(seen.centroid).sum(axis=1) == 2
    return WindowFit(seen.centroid, pull, np.ones(len(pixels), dtype=np.int64), measured)


def eiwa(
    pixels: Floats,
    start: Floats,
    window: int,
    *,
    stop: str,
    tolerance: float,
    max_iter: int,
    path: list[Floats] | None = None,
) -> WindowFit:
    """Move M windows until they are centred on their own centroid.

    Parameters
    ----------
    pixels : (M, S, S) array, DN
        Stamps without background, S at least ``window + 2``.
    start : (M, 2) array, pixels
    window : int, pixels
    stop : "step" or "error"
        "step" is the paper's rule: replace the centre by the centroid and stop once it moves by less than the
        tolerance, eq. (15). What is left then is contraction / (1 - contraction) times the last step. "error" takes
        Newton steps to the same fixed point, step / (1 - contraction), and stops once that predicted error is below it.
    tolerance : float, pixels
    max_iter : int
    path : list, optional
        Receives the centres (M, 2) of every iteration, the start included.

    Returns
    -------
    WindowFit
        A window that leaves the middle pixel of its stamp by more than a pixel stops there, not converged.
    """
    centre = start.copy()
    remaining = np.full_like(centre, np.nan)
    n_iter = np.zeros(len(pixels), dtype=np.int64)
    converged = np.zeros(len(pixels), dtype=bool)
    moving = np.arange(len(pixels))
    if path is not None:
        path.append(centre.copy())
    for k in range(max_iter):
        seen = look(pixels if moving.size == len(pixels) else pixels[moving], centre[moving], window)
        step = seen.centroid - centre[moving]
        ahead = step / np.maximum(1.0 - seen.contraction, 1.0 - NEWTON_LIMIT)
        if stop == "step":
            error, move, left = step, step, ahead - step
        else:
            # The derivative is worth having only near the fixed point and away from the pole.
            newton = (k > 0) & (np.abs(seen.contraction) < NEWTON_LIMIT)
            move = np.clip(np.where(newton, ahead, step), -_LONGEST_STEP, _LONGEST_STEP)
            error, left = ahead, ahead - move
        centre[moving] += move
        remaining[moving] = left
        n_iter[moving] += 1
        if path is not None:
            path.append(centre.copy())
        rest = np.hypot(error[:, 0], error[:, 1]) < tolerance
        converged[moving] = rest
        astray = ~(np.abs(centre[moving]).max(axis=1) <= 1.0)
        moving = moving[~(rest | astray)]
        if not moving.size:
            break
    return WindowFit(centre, remaining, n_iter, converged)


def spread(pixels: Floats, centre: Floats, window: int, floor: Floats, per_dn: float) -> tuple[Floats, Floats]:
    """Variance of the sum of a window, and of its first moment about the centre, for independent pixels.

    The variance of a pixel is ``floor + per_dn * pixel``: (M,) DN squared, and DN per DN (the inverse of the gain).

    Returns
    -------
    (M,) and (M, 2) arrays
        sum w^2 V, and sum w^2 (x - c)^2 V for x and y.
    """
    offset = np.arange(pixels.shape[2]) - pixels.shape[2] // 2
    square_x, square_y = (_overlap(offset, centre[:, k], window) ** 2 for k in (0, 1))
    arm_x, arm_y = (square * (offset - centre[:, k, None]) ** 2 for k, square in enumerate((square_x, square_y)))
    columns = floor[:, None] * square_y.sum(axis=1)[:, None]
    rows = floor[:, None] * square_x.sum(axis=1)[:, None]
    if per_dn:
        columns = columns + per_dn * np.matmul(square_y[:, None, :], pixels)[:, 0]
        rows = rows + per_dn * np.matmul(pixels, square_x[:, :, None])[:, :, 0]
    total = (columns * square_x).sum(axis=1)
    return total, np.stack([(columns * arm_x).sum(axis=1), (rows * arm_y).sum(axis=1)], axis=-1)


def _overlap(offset: NDArray[np.intp], centre: Floats, window: int) -> Floats:
    """Fraction of each pixel that lies within half a window of the centre, along one axis."""
    return np.clip(0.5 * (window + 1) - np.abs(offset - centre[:, None]), 0.0, 1.0)


def _edge_pull(sums: Floats, centre: Floats, centroid: Floats, window: int) -> Floats:
    """Numerator of the contraction along one axis, from the sums of the two pixel columns that the edges cross."""
    middle = sums.shape[1] // 2
    first = np.floor(np.nan_to_num(centre) - 0.5 * window + 0.5).clip(-middle, middle - window)
    left, right = first, first + window
    at = np.arange(len(sums))
    sum_left, sum_right = sums[at, left.astype(int) + middle], sums[at, right.astype(int) + middle]
    return (right - centroid) * sum_right + (centroid - left) * sum_left
