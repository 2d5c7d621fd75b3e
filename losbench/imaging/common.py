"""What every centroid checks of its fields, and how places are smoothed over the frames."""

from __future__ import annotations

from collections.abc import Callable

from losbench.arrays import Floats
from losbench.checks import boolean, choice, odd
from losbench.estimation.smoothing import Smoothed, kalman_smooth
from losbench.imaging.protocols import CentroidMethod

__all__ = ["check_fields", "smoothed"]


_SMOOTHERS: dict[str, Callable[[Floats], Smoothed]] = {"kalman": kalman_smooth}


def check_fields(method: CentroidMethod) -> None:
    """Raise ``ValueError`` unless the fields that every centroid has are in range."""
    if method.window is not None:
        odd("window", method.window, low=3)
    if method.centre is not None:
        choice("centre", method.centre, ("start", "peak"))
    boolean("hot_pixel_gate", method.hot_pixel_gate)
    choice("smooth", method.smooth or "none", ("none", *_SMOOTHERS))


def smoothed(name: str, xy: Floats) -> tuple[Floats, Floats]:
    """Places (F, n, 2) smoothed over the frames, and their errors."""
    fit = _SMOOTHERS[name](xy.reshape(len(xy), -1))
    return fit.smoothed.reshape(xy.shape), fit.smoothed_std.reshape(xy.shape)
