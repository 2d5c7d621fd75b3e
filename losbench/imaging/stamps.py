"""Small windows cut out of whole frames: the only pixels that centroiding ever converts or
copies.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from losbench.arrays import Indices, Pixels

__all__ = ["cut_stamps"]


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
    corner = centre - reach
    _, rows, columns = stack.shape
    inside = ((corner >= 0) & (corner + size <= (columns, rows))).all(axis=1)
    stamps = np.empty((len(frame), size, size), dtype=np.result_type(stack.dtype, np.float32))
    if inside.any():
        views = sliding_window_view(stack, (size, size), axis=(1, 2))
        stamps[inside] = views[frame[inside], corner[inside, 1], corner[inside, 0]]
    outside = np.flatnonzero(~inside)
    if outside.size:
        x = corner[outside, 0, None] + np.arange(size)
        y = corner[outside, 1, None] + np.arange(size)
        pixels = stack[
            frame[outside, None, None],
            y.clip(0, rows - 1)[:, :, None],
            x.clip(0, columns - 1)[:, None, :],
        ]
        present = ((y >= 0) & (y < rows))[:, :, None] & ((x >= 0) & (x < columns))[:, None, :]
        stamps[outside] = np.where(present, pixels, np.nan)
    if stack.dtype.kind == "f" and np.isinf(stamps).any():
        raise ValueError("frames must be finite, or NaN where a pixel was not read, got infinity")
    return stamps
