"""Light around a spot that is not its own: hot pixels, and other spots."""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats, Pixels

__all__ = ["STANDS_OUT", "without_hot", "without_others"]


STANDS_OUT = 5.0  # noises
_CROSS = 0.3  # part of a real peak that its four neighbours hold
_NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], np.float32)
_DIP = 0.8  # of the lower of two tops, what is darker between them makes them two
_ON_THE_WAY = np.linspace(0.2, 1.0, 9)  # parts of the way from the centre


def without_hot(signal: Pixels, noise: float) -> Pixels:
    """Replace pixels that stand out of their 3 x 3 median, unless their neighbours share their
    light.
    """
    import cv2

    median = cv2.medianBlur(signal, 3)
    hot = signal > 2.0 * np.maximum(median, 0.0) + STANDS_OUT * noise
    if hot.any():
        cross = cv2.filter2D(signal, -1, _NEIGHBOURS)
        hot &= cross < _CROSS * signal
    return np.where(hot, median, signal)


def without_others(light: Floats, centre: Floats, least: float, noise: float) -> Floats:
    """Give pixels of another spot the light that stands on the other side of the centre.

    They are brighter than that by ``least``, and lie beyond a dip on the straight line from the
    centre, as deep as the one by which the finder tells two spots apart: a tail has none, and a
    ring has its like on the other side.
    """
    import cv2

    own = light.astype(np.float32)
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP

    def seen_from(scale: float) -> Pixels:
        away = np.column_stack([scale * np.eye(2), (1.0 - scale) * centre])
        return cv2.warpAffine(own, away, own.shape[::-1], flags=how)

    turned = seen_from(-1.0)
    more = own - turned > least
    if not more.any():
        return light
    along = np.stack([seen_from(part) for part in _ON_THE_WAY])
    lowest = np.maximum(np.minimum.accumulate(along, axis=0), 0.0)
    more &= (along > lowest / _DIP + STANDS_OUT * noise).any(axis=0)
    return np.where(more, turned, light)
