"""Scene 1: move a point, and see which line follows."""

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
from losbench.workbench.explorers.lab.sample import TRUTH, all_fits, design, line, lines
from losbench.workbench.explorers.view import Handle

__all__ = ["DragPoint"]

_COUNT = 12
_METHODS = ("least squares", "Huber", "MM")
_HEIGHTS = np.linspace(-25.0, 25.0, 101)
_NEAR = 0.1


def fits_with_the_last_point_at(
    *, height: float | np.ndarray, place: float, seed: int
) -> dict[str, lb.RobustFit]:
    """Fit a line whose last point has been moved, once for each height."""
    x, y = line(_COUNT, seed)
    x[-1] = place
    every = np.repeat(y[None], np.size(height), axis=0)
    every[:, -1] = height
    return all_fits(design(x), every, _METHODS)


class DragPoint(Explorer):
    """Eleven points on a line and one that can be moved: three fits, and what each makes of every
    height.
    """

    controls: ClassVar[dict[str, Control]] = {
        "height": Slider("height of the point", 16.0, -25.0, 25.0, 0.5),
        "place": Slider("its place along x", 9.0, 0.0, 20.0, 0.5),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(fits_with_the_last_point_at)
    answer = "*(fit.x[-1, 1] for fit in seen.values())"
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "on the line": {"height": 5.5, "place": 9.0},
        "in the middle": {"place": 5.5},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the points with their lines, and the slope over the height of the point, whole and
        near the truth.
        """
        panels = figure.subplot_mosaic([["data", "whole"], ["data", "near"]])
        left, whole, near = panels.values()
        self._data = left
        (self._points,) = left.plot([], [], "o", ms=4, color=COLOURS["black"])
        (self._point,) = left.plot([], [], "o", ms=9, color=COLOURS["vermilion"])
        self._lines = lines(left, _METHODS)
        left.set(xlim=(-1, 21), ylim=(-26, 26), xlabel="x", ylabel="y", title="drag the big point")
        left.legend(fontsize=8, loc="lower left")
        self._curves = [lines(axes, _METHODS, label=False) for axes in (whole, near)]
        self._here = [
            axes.axvline(0.0, color=COLOURS["vermilion"], lw=1.0) for axes in (whole, near)
        ]
        for axes in (whole, near):
            axes.axhline(TRUTH[1], color=COLOURS["black"], lw=0.7)
            axes.set_xlim(-25, 25)
        whole.tick_params(labelbottom=False)
        whole.set(ylim=(-1.5, 2.5), title=f"slope (truth {TRUTH[1]})")
        near.set(
            ylim=(TRUTH[1] - _NEAR, TRUTH[1] + _NEAR),
            xlabel="height of the point",
            title="near the truth",
        )
        curves = [curve for both in self._curves for curve in both.values()]
        return [self._points, *self._lines.values(), self._point, *curves, *self._here]

    def handles(self, *, height: float, place: float, seed: int) -> Sequence[Handle]:
        """The big point."""
        at = f"x {place:g}, y {height:g}"
        both = self.slides("place", "height")
        return [Handle("the big point", self._data, place, height, both, (0.5, 0.5), at)]

    def update(self, *, height: float, place: float, seed: int) -> Mapping[str, str]:
        """Fit with the point at every height, and at this one."""
        x, y = line(_COUNT, seed)
        fits = self.experiment(height=np.append(_HEIGHTS, height), place=place, seed=seed)
        self._points.set_data(x[:-1], y[:-1])
        self._point.set_data([place], [height])
        ends = np.array([-1.0, 21.0])
        for name, fit in fits.items():
            self._lines[name].set_data(ends, fit.x[-1, 0] + fit.x[-1, 1] * ends)
            for curves in self._curves:
                curves[name].set_data(_HEIGHTS, fit.x[:-1, 1])
        for mark in self._here:
            mark.set_xdata([height] * 2)
        texts = {f"slope, {name}": f"{fit.x[-1, 1]:.3f}" for name, fit in fits.items()}
        return texts | {
            f"its weight, {name}": f"{fits[name].weights[-1, -1]:.3f}" for name in _METHODS[1:]
        }
