"""What every centroid checks of its fields, and how places are smoothed over the frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import boolean, choice, finite, integer, number, odd
from losbench.estimation.smoothing import Smoothed, kalman_smooth
from losbench.imaging.protocols import CentroidFields, Window

__all__ = ["TemplateFields", "Width", "as_width", "as_window", "check_fields", "smoothed"]


Width: TypeAlias = float | tuple[float, float] | tuple[tuple[float, float], ...]

_SMOOTHERS: dict[str, Callable[[Floats], Smoothed]] = {"kalman": kalman_smooth}


def check_fields(method: CentroidFields) -> None:
    """Check the fields that every centroid has, and bring the window into the form of `as_window`.

    Raises
    ------
    ValueError
        If one is out of range.
    """
    object.__setattr__(method, "window", as_window(method.window))
    if method.centre is not None:
        choice("centre", method.centre, ("start", "peak"))
    boolean("hot_pixel_gate", method.hot_pixel_gate)
    choice("smooth", method.smooth or "none", ("none", *_SMOOTHERS))


def as_window(window: ArrayLike | None) -> Window | None:
    """Return the side of a window as an odd number, or as one for each spot where they differ; None
    stays.

    >>> as_window([13, 13]), as_window(np.array([9, 73]))
    (13, (9, 73))

    Raises
    ------
    ValueError
        If one is even, or below 3.
    """
    if window is None:
        return None
    if np.ndim(window) != 1:
        return odd("window", window, low=3)
    sides = tuple(odd("window", side, low=3) for side in np.asarray(window).tolist())
    return sides[0] if len(set(sides)) == 1 else sides


def as_width(width: ArrayLike | None) -> Width | None:
    """Return the sigma of a template as a number, a pair, or a pair for each spot; None stays.

    Raises
    ------
    ValueError
        If it is none of these, or below 0.1 pixels.
    """
    if width is None:
        return None
    given = finite("width (sigma of a spot)", width)
    fits = given.shape in ((), (2,)) or (given.ndim == 2 and given.shape[1] == 2)
    if not fits or not (given >= 0.1).all():
        raise ValueError(
            "width (sigma of a spot) must be a number, two, or two for each spot, of at least 0.1 "
            f"pixels, got {width!r}"
        )
    if given.ndim == 2:
        return tuple((x, y) for x, y in given.tolist())
    return float(given) if given.ndim == 0 else (float(given[0]), float(given[1]))


@dataclass(frozen=True)
class TemplateFields:
    """The fields of a centroid that fits a template, checked when they are given."""

    width: ArrayLike | None = None
    _: KW_ONLY
    window: Window | None = None
    tolerance: float = 1e-3
    max_iter: int = 50
    centre: str | None = None
    hot_pixel_gate: bool = False
    smooth: str | None = None

    stays: ClassVar[bool] = False
    template: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, "width", as_width(self.width))
        number("tolerance", self.tolerance, low=1e-12)
        integer("max_iter", self.max_iter, low=1)


def smoothed(name: str, xy: Floats) -> tuple[Floats, Floats]:
    """Places (F, n, 2) smoothed over the frames, and their errors."""
    fit = _SMOOTHERS[name](xy.reshape(len(xy), -1))
    return fit.smoothed.reshape(xy.shape), fit.smoothed_std.reshape(xy.shape)
