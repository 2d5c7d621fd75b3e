"""Scene 3: the breakdown meter. How many bad points does each estimate survive?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, LogSlider, Slider, whole_number
from losbench.workbench.explorers.lab.sample import TRUTH, all_fits, design, line, lines
from losbench.workbench.explorers.view import Handle

__all__ = ["BreakdownMeter"]

_COUNT, _MOST = 20, 12
_METHODS = ("least squares", "Huber", "LTS", "MM")
_SURVIVED = 3.0  # a fit that is nowhere farther off than ten sigma


def lifted_points(*, bad: int | np.ndarray, off: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return heights of the points and which of them are lifted, a row for each number of them."""
    _, y = line(_COUNT, seed)
    lifted = np.arange(_COUNT) >= _COUNT - np.reshape(bad, (-1, 1))
    return y + off * lifted, lifted


def fits_with_lifted_points(
    *, bad: int | np.ndarray, off: float, seed: int
) -> dict[str, lb.RobustFit]:
    """Fit a line whose last points are lifted together, once for each number of them."""
    y, _ = lifted_points(bad=bad, off=off, seed=seed)
    return all_fits(design(np.arange(float(_COUNT))), y, _METHODS)


class BreakdownMeter(Explorer):
    """Twenty points, the last ones lifted together: the fits, and how far off each is for every
    number of bad ones.
    """

    controls: ClassVar[dict[str, Control]] = {
        "bad": Slider("bad points", 4, 0, _MOST, 1),
        "off": LogSlider("lifted by", 20.0, 1.0, 1000.0),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(fits_with_lifted_points)
    answer = "*(fit.x[-1, 1] for fit in seen.values())"
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "nine of twenty": {"bad": 9},
        "ten of twenty": {"bad": 10},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the points, and the largest error over the number of bad ones."""
        left, right = figure.subplots(1, 2)
        (self._points,) = left.plot([], [], "o", ms=4, color=COLOURS["black"])
        (self._bad,) = left.plot([], [], "x", ms=6, mew=1.6, color=COLOURS["vermilion"])
        self._lines = lines(left, _METHODS)
        left.set(xlim=(-1, 20), ylim=(-10, 40), xlabel="x", ylabel="y", title="the data")
        left.legend(fontsize=8, loc="upper left")
        self._curves = lines(right, _METHODS, label=False, marker="o", ms=3)
        self._here = right.axvline(0.0, color=COLOURS["vermilion"], lw=1.0)
        right.set(yscale="log", xlim=(-0.3, _MOST + 0.3), ylim=(0.02, 1e4))
        right.set(xlabel="bad points of 20", title="largest error of the line")
        return [self._points, *self._lines.values(), self._bad, *self._curves.values(), self._here]

    def handles(self, *, bad: int, **_: Any) -> Sequence[Handle]:
        """How many are bad."""
        axes, along = self._here.axes, self.slides("bad")
        return [Handle("bad points", axes, bad, 1.0, along, (1.0, 0.0), f"{bad} of {_COUNT}")]

    def update(self, *, bad: int, off: float, seed: int) -> Mapping[str, str]:
        """Fit with every number of bad points."""
        counts, x = np.arange(_MOST + 1), np.arange(float(_COUNT))
        every, lifted = lifted_points(bad=counts, off=off, seed=seed)
        fits = self.experiment(bad=counts, off=off, seed=seed)
        good = ~lifted[bad]
        self._points.set_data(x[good], every[bad][good])
        self._bad.set_data(x[~good], every[bad][~good])
        survived = {}
        for name, fit in fits.items():
            self._lines[name].set_data(x, design(x) @ fit.x[bad])
            errors = np.abs((fit.x - TRUTH) @ design(x).T).max(axis=1)
            self._curves[name].set_data(counts, errors)
            survived[name] = (
                int(np.argmax(errors > _SURVIVED)) - 1 if (errors > _SURVIVED).any() else _MOST
            )
        self._here.set_xdata([bad] * 2)
        return {f"{name} survives": f"{count} of {_COUNT}" for name, count in survived.items()} | {
            "slope now, MM": f"{fits['MM'].x[bad, 1]:.3f}"
        }
