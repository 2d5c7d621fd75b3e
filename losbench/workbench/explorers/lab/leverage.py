"""Scene 5: leverage. A point far out along x pulls the line to itself, and no residual tells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, Slider, whole_number
from losbench.workbench.explorers.lab.sample import all_fits, design, line, lines
from losbench.workbench.explorers.view import Handle

__all__ = ["Leverage"]

_COUNT = 12
_METHODS = ("least squares", "Huber", "MM")
_PLACES = np.linspace(0.0, 60.0, 41)
_HEIGHT = 0.0


def fits_with_a_bad_point_at(*, place: float | np.ndarray, seed: int) -> dict[str, lb.RobustFit]:
    """Fit a line whose last point lies far below it, once for each place along x."""
    x, y = line(_COUNT, seed)
    y[-1] = _HEIGHT
    every = np.repeat(x[None], np.size(place), axis=0)
    every[:, -1] = place
    return all_fits(design(every), y, _METHODS)


class Leverage(Explorer):
    """A bad point that moves along x at the same height: the fits, and their slope over its
    place.
    """

    controls: ClassVar[dict[str, Control]] = {
        "place": Slider("place of the bad point", 30.0, 0.0, 60.0, 0.5),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(fits_with_a_bad_point_at)
    answer = 'seen["least squares"].leverage[-1, -1], seen["Huber"].x[-1, 1], seen["MM"].x[-1, 1]'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "in the middle": {"place": 5.5},
        "far out": {"place": 60.0},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the points, and the slope over the place of the bad one."""
        left, right = figure.subplots(1, 2)
        (self._points,) = left.plot([], [], "o", ms=4, color=COLOURS["black"])
        (self._bad,) = left.plot([], [], "x", ms=9, mew=2.0, color=COLOURS["vermilion"])
        self._lines = lines(left, _METHODS)
        left.set(
            xlim=(-1, 62), ylim=(-3, 12), xlabel="x", ylabel="y", title="drag the cross along x"
        )
        left.legend(fontsize=8, loc="upper right")
        self._slopes = lines(right, _METHODS, label=False)
        (self._h,) = right.plot(
            [], [], color=COLOURS["black"], lw=1.0, label="leverage h of the bad point"
        )
        self._here = right.axvline(0.0, color=COLOURS["vermilion"], lw=1.0)
        right.set(
            xlim=(0, 60),
            ylim=(-0.25, 1.05),
            xlabel="place of the bad point",
            title="slope (truth 0.5)",
        )
        right.legend(fontsize=8, loc="center right")
        return [
            self._points,
            *self._lines.values(),
            self._bad,
            *self._slopes.values(),
            self._h,
            self._here,
        ]

    def handles(self, *, place: float, seed: int) -> Sequence[Handle]:
        """The cross."""
        along = self.slides("place")
        axes = self._bad.axes
        return [Handle("the bad point", axes, place, _HEIGHT, along, (0.5, 0.0), f"x {place:g}")]

    def update(self, *, place: float, seed: int) -> Mapping[str, str]:
        """Fit with the bad point everywhere, and here."""
        x, y = line(_COUNT, seed)
        fits = self.experiment(place=np.append(_PLACES, place), seed=seed)
        self._points.set_data(x[:-1], y[:-1])
        self._bad.set_data([place], [_HEIGHT])
        ends = np.array([-1.0, 62.0])
        for name, fit in fits.items():
            self._lines[name].set_data(ends, fit.x[-1, 0] + fit.x[-1, 1] * ends)
            self._slopes[name].set_data(_PLACES, fit.x[:-1, 1])
        least = fits["least squares"]
        self._h.set_data(_PLACES, least.leverage[:-1, -1])
        self._here.set_xdata([place] * 2)
        texts = {f"slope, {name}": f"{fit.x[-1, 1]:.3f}" for name, fit in fits.items()}
        return texts | {
            "leverage": f"{least.leverage[-1, -1]:.3f}",
            "its residual, least squares": f"{least.residuals[-1, -1]:.2f}",
            "its weight, Huber": f"{fits['Huber'].weights[-1, -1]:.3f}",
        }
