"""Scene 6: masking. Outliers that vouch for each other pass every test that takes them one at a
time.
"""

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

__all__ = ["Masking"]

_COUNT = 16
_METHODS = ("least squares", "MM")
_LIMIT = 3.0


def two_hunts(*, bad: int, off: float, seed: int) -> dict[str, Any]:
    """Lift the last points of a line, and measure every point one by one and against MM."""
    x, y = line(_COUNT, seed)
    y[_COUNT - bad :] += off
    fits = all_fits(design(x), y, _METHODS)
    measures = {
        "one by one": np.abs(lb.deletion_residuals(fits["least squares"])),
        "against MM": np.abs(fits["MM"].residuals) / fits["MM"].scale,
    }
    return {"y": y, "fits": fits, "measures": measures}


class Masking(Explorer):
    """A few points lifted at the end of a line, hunted in two ways: one by one, and against a fit
    they cannot move.
    """

    controls: ClassVar[dict[str, Control]] = {
        "bad": Slider("bad points", 2, 0, 6, 1),
        "off": Slider("lifted by", 6.0, 0.0, 15.0, 0.2),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(two_hunts)
    answer = f'*(np.flatnonzero(each > {_LIMIT}) for each in seen["measures"].values())'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "one alone": {"bad": 1},
        "three together": {"bad": 3},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the data, and the two measures of every point."""
        left, right = figure.subplots(1, 2)
        (self._points,) = left.plot([], [], "o", ms=4, color=COLOURS["black"])
        (self._bad,) = left.plot([], [], "x", ms=8, mew=1.8, color=COLOURS["vermilion"])
        self._lines = lines(left, _METHODS)
        left.set(xlim=(-1, _COUNT), ylim=(-2, 26), xlabel="x", ylabel="y", title="the data")
        left.legend(fontsize=8, loc="upper left")
        (self._single,) = right.plot(
            [], [], "s", ms=5, color=COLOURS["orange"], label="deletion residual, least squares"
        )
        (self._robust,) = right.plot(
            [], [], "o", ms=5, color=COLOURS["green"], label="residual / scale, MM"
        )
        right.axhline(_LIMIT, color=COLOURS["vermilion"], lw=1.2, ls="--")
        right.set(
            yscale="log",
            xlim=(-1, _COUNT),
            ylim=(0.01, 300),
            xlabel="row",
            title="who is suspected: above 3",
        )
        right.legend(fontsize=8, loc="upper left")
        return [self._points, *self._lines.values(), self._bad, self._single, self._robust]

    def handles(self, *, bad: int, off: float, **_: Any) -> Sequence[Handle]:
        """The last of the bad points, which lifts all of them."""
        if not bad:
            return ()
        x, y = self._bad.get_xydata()[-1]
        up, ground = self.slides(y="off"), y - off
        return [
            Handle(
                label="the bad points",
                axes=self._bad.axes,
                x=float(x),
                y=float(y),
                move=lambda _, height: up(0.0, height - ground),
                step=(0.0, 0.2),
                text=f"lifted by {off:g}",
            )
        ]

    def update(self, *, bad: int, off: float, seed: int) -> Mapping[str, str]:
        """Fit, and measure every point both ways."""
        seen = self.experiment(bad=bad, off=off, seed=seed)
        x, y = np.arange(float(_COUNT)), seen["y"]
        lifted = np.arange(_COUNT) >= _COUNT - bad
        self._points.set_data(x[~lifted], y[~lifted])
        self._bad.set_data(x[lifted], y[lifted])
        for name, fit in seen["fits"].items():
            self._lines[name].set_data(x, design(x) @ fit.x)
        for marks, values in zip(
            (self._single, self._robust), seen["measures"].values(), strict=True
        ):
            marks.set_data(x, np.clip(values, 0.011, 290.0))
        counts = {name: values > _LIMIT for name, values in seen["measures"].items()}
        texts = {
            f"bad ones found, {name}": f"{int((found & lifted).sum())} of {bad}"
            for name, found in counts.items()
        }
        return texts | {
            f"good ones accused, {name}": f"{int((found & ~lifted).sum())}"
            for name, found in counts.items()
        }
