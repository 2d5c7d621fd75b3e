"""Small windows cut out of whole frames: the only pixels that centroiding ever converts or
copies.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from losbench.arrays import Indices, Pixels

__all__ = ["RING", "cut_stamps", "ring_of", "ring_places"]


RING = 4  # pixels, the breadth of the ring around a window


def cut_stamps(stack: NDArray[Any], frame: Indices, centre: Indices, reach: int) -> Pixels:
    """Cut M square stamps of ``2 * reach + 1`` pixels around whole-pixel centres.

    Parameters
    ----------
    stack : (F, H, W) array
    frame : (M,) integers
        Which frame each stamp comes from.
    centre : (M, 2) integers, pixels
        (x, y) of each stamp's middle, within the frame.
    reach : int, pixels

    Returns
    -------
    (M, 2 reach + 1, 2 reach + 1) array
        NaN where a stamp reaches beyond the frame. Single precision for integers of up to 16 bits
        and for float32.
    """
    size, (_, rows, columns) = 2 * reach + 1, stack.shape
    corner = centre - reach
    inside = ((corner >= 0) & (corner + size <= (columns, rows))).all(axis=1)
    stamps = np.empty((len(centre), size, size), np.result_type(stack.dtype, np.float32))
    if inside.any():
        some = slice(None) if inside.all() else inside
        # Row by row: half the time of pixel by pixel.
        windows = sliding_window_view(stack, (size, size), axis=(1, 2))
        stamps[some] = windows[frame[some], corner[some, 1], corner[some, 0]]
    if not inside.all():
        at = corner[~inside, :, None] + np.arange(size)
        x, y = at[:, 0].clip(0, columns - 1), at[:, 1].clip(0, rows - 1)
        pixels = stack[frame[~inside, None, None], y[:, :, None], x[:, None, :]]
        within = (at[:, 1] == y)[:, :, None] & (at[:, 0] == x)[:, None, :]
        stamps[~inside] = np.where(within, pixels, np.nan)
    if stack.dtype.kind == "f" and np.isinf(stamps).any():
        raise ValueError("frames must be finite, or NaN where a pixel was not read, got infinity")
    return stamps


def ring_of(stamps: Pixels, side: int) -> Pixels:
    """Copy the pixels (M, R) of the ring around the middle ``side`` pixels out of stamps (M, S, S),
    in the order of `ring_places`.
    """
    size, (x, y) = stamps.shape[1], ring_places(side)
    flat = stamps.reshape(-1, size * size)
    return flat.take((y + size // 2) * size + x + size // 2, axis=1)


@cache
def ring_places(side: int) -> tuple[Indices, Indices]:
    """Offsets x and y (R,) of the pixels of the ring of four pixels around ``side`` pixels."""
    offset = np.arange(side + 2 * RING) - side // 2 - RING
    row, column = np.nonzero(np.maximum(abs(offset)[:, None], abs(offset)) > side // 2)
    return offset[column], offset[row]
