"""The window centroids of liu2026: the grey-weighted one (eq. 11-12) and EIWA, which moves its
window (eq. 13-15).

EIWA is the virtual-window centre of mass of Berglund et al. 2008 (Opt. Express 16, 14064). A window
of N x N pixels is centred on the last centroid; its edges fall between pixel borders, and an edge
pixel counts by the fraction that lies inside. The centroid of the window is the next centre, until
it moves no more.

Here M spots move at once. Positions are counted from the middle of each stamp, x first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Indices, Ints, Pixels

__all__ = ["NEWTON_LIMIT", "Look", "WindowFit", "eiwa", "grey", "look", "spread"]


NEWTON_LIMIT = 0.85  # contraction beyond which extrapolation amplifies noise more than it helps
_LONGEST_STEP = 1.0  # pixels
_NEWTON_LEAVES = (
    0.1  # part of a Newton step that may be left after it: the contraction's own change and noise
)


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


def grey(pixels: Pixels, centre: Floats, window: int) -> WindowFit:
    """Centroid of a window that stays where it is (eq. 11-12); what is left is its pull,
    contraction * (centre - m).
    """
    seen = look(pixels, centre, window)
    pull = seen.contraction * (centre - seen.centroid)
    measured = np.isfinite(seen.centroid).sum(axis=1) == 2
    return WindowFit(seen.centroid, pull, np.ones(len(pixels), dtype=np.int64), measured, seen)


def eiwa(
    pixels: Pixels,
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
        "step" is the paper's rule: replace the centre by the centroid and stop once it moves by
        less than the tolerance, eq. (15). What is left then is contraction / (1 - contraction)
        times the last step. "error" takes Newton steps to the same fixed point, step / (1 -
        contraction), and stops once what is left is below it.
    tolerance : float, pixels
    max_iter : int
    path : list, optional
        Receives the centres (M, 2) of every iteration, the start included.

    Returns
    -------
    WindowFit
        A window that leaves the middle pixel of its stamp by more than a pixel stops there, not
        converged.
    """
    centre = start.copy()
    remaining, contraction = np.full_like(centre, np.nan), np.full_like(centre, np.nan)
    total = np.full(len(pixels), np.nan)
    n_iter = np.zeros(len(pixels), dtype=np.int64)
    converged = np.zeros(len(pixels), dtype=bool)
    moving = np.arange(len(pixels))
    if path is not None:
        path.append(centre.copy())
    for k in range(max_iter):
        seen = look(
            pixels if moving.size == len(pixels) else pixels[moving], centre[moving], window
        )
        step = seen.centroid - centre[moving]
        ahead = step / np.maximum(1.0 - seen.contraction, 1.0 - NEWTON_LIMIT)
        if stop == "step":
            move, left, small = step, ahead - step, step
        else:
            # The derivative is worth having only near the fixed point and away from the pole.
            newton = (k > 0) & (np.abs(seen.contraction) < NEWTON_LIMIT)
            move = np.clip(np.where(newton, ahead, step), -_LONGEST_STEP, _LONGEST_STEP)
            left = small = ahead - move + _NEWTON_LEAVES * ahead
        centre[moving] += move
        remaining[moving], contraction[moving], total[moving] = left, seen.contraction, seen.total
        n_iter[moving] += 1
        if path is not None:
            path.append(centre.copy())
        rest = np.hypot(small[:, 0], small[:, 1]) < tolerance
        converged[moving] = rest
        within = (np.abs(centre[moving, 0]) <= 1.0) & (np.abs(centre[moving, 1]) <= 1.0)
        moving = moving[~rest & within]
        if not moving.size:
            break
    return WindowFit(centre, remaining, n_iter, converged, Look(total, centre, contraction))


def spread(
    pixels: Pixels, centre: Floats, window: int, floor: Floats, per_dn: float
) -> tuple[Floats, Floats]:
    """Variance of the sum of a window, and of its first moment about the centre, for independent
    pixels.

    The variance of a pixel is ``floor + per_dn * pixel``: (M,) DN squared, and DN per DN (the
    inverse of the gain).

    Returns
    -------
    (M,) and (M, 2) arrays
        sum w^2 V, and sum w^2 (x - c)^2 V for x and y.
    """
    offset = np.arange(pixels.shape[2]) - pixels.shape[2] // 2
    square = _overlap(offset, centre, window) ** 2
    arm = square * (offset - centre[:, :, None]) ** 2
    sums = floor[:, None, None] * square[:, ::-1].sum(axis=2, keepdims=True)
    if per_dn:
        sums = sums + per_dn * _column_and_row_sums(pixels, square)
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
    left = np.floor(np.nan_to_num(centre) - 0.5 * (window - 1)).clip(-middle, middle - window)
    right = left + window
    place = left.astype(np.intp) + middle
    spot, axis = np.arange(len(sums))[:, None], np.array([0, 1])
    return (right - centroid) * sums[spot, axis, place + window] + (centroid - left) * sums[
        spot, axis, place
    ]
