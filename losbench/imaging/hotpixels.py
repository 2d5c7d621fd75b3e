"""Pixels that are bright by themselves, found by their neighbours and replaced by them."""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats, Pixels

__all__ = ["gate_hot_pixels"]


def gate_hot_pixels(signal: Pixels, scatter: Floats) -> Pixels:
    """Replace each pixel that stands out of its 3 x 3 neighbourhood by the neighbourhood's median.

    Parameters
    ----------
    signal : (M, S, S) array, DN
        Stamps without background; their outermost pixels are left as they are.
    scatter : (M,) array, DN
        Noise of the background.

    Returns
    -------
    (M, S, S) array, DN

    Notes
    -----
    A pixel stands out if it exceeds twice the median by five sigma. The peak of a spot does not, if
    its sigma is at least 0.9 pixels; sharper spots must not be gated.
    """
    import cv2

    tall = np.ascontiguousarray(signal.reshape(-1, signal.shape[2]), dtype=np.float32)
    median = cv2.medianBlur(tall, 3).reshape(signal.shape).astype(signal.dtype)
    hot = signal > 2.0 * np.maximum(median, 0.0) + 5.0 * scatter[:, None, None]
    hot[:, [0, -1]] = hot[:, :, [0, -1]] = False
    return np.where(hot, median, signal)
