"""Small windows cut out of whole frames: the only pixels that centroiding ever converts or
copies.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Indices, Pixels

__all__ = ["RING", "cut_stamps", "ring_places", "take_pixels"]


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
    size = 2 * reach + 1
    row, column = np.divmod(np.arange(size * size), size)
    pixels = take_pixels(stack, frame, centre, column - reach, row - reach)
    return pixels.reshape(-1, size, size)


def take_pixels(
    stack: NDArray[Any], frame: Indices, centre: Indices, x: Indices, y: Indices
) -> Pixels:
    """Take the pixels at the offsets x and y (P,) from M whole-pixel centres, (M, P), as
    `cut_stamps` does.
    """
    _, rows, columns = stack.shape
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    inside = ((centre + low >= 0) & (centre + high < (columns, rows))).all(axis=1)
    outside = np.flatnonzero(~inside)
    at_x, at_y = (centre[outside, axis, None] + off for axis, off in enumerate((x, y)))
    near_x, near_y = at_x.clip(0, columns - 1), at_y.clip(0, rows - 1)
    if stack.flags.c_contiguous:
        first = (frame * rows + centre[:, 1]) * columns + centre[:, 0]
        place = first[:, None] + (y * columns + x)
        place[outside] = (frame[outside, None] * rows + near_y) * columns + near_x
        pixels = stack.reshape(-1).take(place)
    else:
        row, column = (
            (centre[:, 1:] + y).clip(0, rows - 1),
            (centre[:, :1] + x).clip(0, columns - 1),
        )
        pixels = stack[frame[:, None], row, column]
    pixels = pixels.astype(np.result_type(stack.dtype, np.float32))
    if outside.size:
        pixels[outside] = np.where((at_x == near_x) & (at_y == near_y), pixels[outside], np.nan)
    if stack.dtype.kind == "f" and np.isinf(pixels).any():
        raise ValueError("frames must be finite, or NaN where a pixel was not read, got infinity")
    return pixels


@cache
def ring_places(side: int) -> tuple[Indices, Indices]:
    """Offsets x and y (R,) of the pixels of the ring of four pixels around ``side`` pixels."""
    offset = np.arange(side + 2 * RING) - side // 2 - RING
    row, column = np.nonzero(np.maximum(abs(offset)[:, None], abs(offset)) > side // 2)
    return offset[column], offset[row]
