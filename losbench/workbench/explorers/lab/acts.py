"""Scene 8: an MM-estimate in three acts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, Slider, whole_number
from losbench.workbench.explorers.lab.sample import ERROR, design, line
from losbench.workbench.explorers.view import Handle

__all__ = ["MMActs"]


_COUNT = 20
_S_EFFICIENCY = 0.2868  # of the bisquare whose scale survives one half, c = 1.5476
_ENDS = np.array([-1.0, 20.0])
_REACH = 12.0


def points_on_a_level(*, bad: int, level: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of the line, the last ones of which lie on a level of their own."""
    x, y = line(_COUNT, seed)
    rng = np.random.default_rng(seed)
    rng.standard_normal(_COUNT)  # those of the line
    y[_COUNT - bad :] = level + ERROR * rng.standard_normal(bad)
    return x, y


def fit_of_an_act(*, act: int, bad: int, level: float, seed: int) -> lb.RobustFit:
    """Fit by MM; with 28.7 % efficiency, as in acts 1 and 2, it is the S-estimate itself."""
    x, y = points_on_a_level(bad=bad, level=level, seed=seed)
    efficiency = 0.95 if act == 3 else _S_EFFICIENCY
    return lb.mm(design(x), y, efficiency=efficiency, on_fail="ignore")


class MMActs(Explorer):
    """Act 1: the line of least scale among those through two points. Act 2: freeze it. Act 3: the
    efficient step.
    """

    controls: ClassVar[dict[str, Control]] = {
        "act": Slider("act", 1, 1, 3, 1),
        "bad": Slider("bad points", 7, 0, 10, 1),
        "level": Slider("their level", 2.0, -5.0, 20.0, 0.25),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(fit_of_an_act)
    answer = "seen.x[1], seen.scale"
    presets: ClassVar[dict[str, dict[str, Any]]] = {"act 2": {"act": 2}, "act 3": {"act": 3}}
    size_in = (8.4, 3.8)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw data, candidates, the chosen line with its band, and the weights."""
        left, right = figure.subplots(1, 2)
        self._candidates = LineCollection([], colors=COLOURS["sky"], linewidths=0.5, alpha=0.5)
        left.add_collection(self._candidates)
        self._band = PolyCollection([], facecolors=COLOURS["green"], alpha=0.2)
        left.add_collection(self._band)
        (self._points,) = left.plot([], [], "o", ms=4, color=COLOURS["black"])
        (self._bad,) = left.plot([], [], "x", ms=7, mew=1.6, color=COLOURS["vermilion"])
        (self._line,) = left.plot([], [], color=COLOURS["green"], lw=2.2)
        left.set(xlim=(-1, 20), ylim=(-6, 24), xlabel="x", ylabel="y")
        left.set_title("1 candidates  2 frozen scale  3 last step", fontsize=10)
        (self._curve,) = right.plot([], [], color=COLOURS["black"], lw=1.0)
        (self._good_weights,) = right.plot([], [], "o", ms=5, color=COLOURS["blue"], label="good")
        (self._bad_weights,) = right.plot(
            [], [], "x", ms=7, mew=1.6, color=COLOURS["vermilion"], label="bad"
        )
        right.set(
            xlim=(-1.05 * _REACH, 1.05 * _REACH),
            ylim=(-0.03, 1.05),
            xlabel="residual / scale (beyond 12: on the edge)",
            title="weights",
        )
        right.legend(fontsize=8, loc="upper right")
        return [
            self._candidates,
            self._band,
            self._points,
            self._bad,
            self._line,
            self._curve,
            self._good_weights,
            self._bad_weights,
        ]

    def handles(self, *, bad: int, level: float, **_: Any) -> Sequence[Handle]:
        """The level of the bad points."""
        if not bad:
            return ()
        up, middle = self.slides(y="level"), _COUNT - (bad + 1) / 2
        where = f"level {level:g}"
        return [Handle("the bad points", self._bad.axes, middle, level, up, (0.0, 0.25), where)]

    def update(self, *, act: int, bad: int, level: float, seed: int) -> Mapping[str, str]:
        """Play as far as this act."""
        x, y = points_on_a_level(bad=bad, level=level, seed=seed)
        lifted = np.arange(_COUNT) >= _COUNT - bad
        fit = self.experiment(act=act, bad=bad, level=level, seed=seed)
        pairs = np.array(list(combinations(range(_COUNT), 2)))
        slope = np.diff(y[pairs], axis=1)[:, 0] / np.diff(x[pairs], axis=1)[:, 0]
        heights = y[pairs[:, :1]] + slope[:, None] * (_ENDS - x[pairs[:, :1]])
        through = np.stack([np.broadcast_to(_ENDS, heights.shape), heights], axis=-1)
        self._candidates.set_segments(list(through) if act == 1 else [])
        middle = fit.x[0] + fit.x[1] * _ENDS
        edge = 2.5 * fit.scale
        corners = np.column_stack(
            [[*_ENDS, *_ENDS[::-1]], [*(middle - edge), *(middle + edge)[::-1]]]
        )
        self._band.set_verts([corners] if act > 1 else [])
        self._points.set_data(x[~lifted], y[~lifted])
        self._bad.set_data(x[lifted], y[lifted])
        self._line.set_data(_ENDS, middle)
        u = np.linspace(-_REACH, _REACH, 241)
        c = 4.685 if act == 3 else 1.5476
        self._curve.set_data(u, np.maximum(1.0 - (u / c) ** 2, 0.0) ** 2)
        scaled = np.clip(fit.residuals / fit.scale, -_REACH, _REACH)
        self._good_weights.set_data(scaled[~lifted], fit.weights[~lifted])
        self._bad_weights.set_data(scaled[lifted], fit.weights[lifted])
        return {
            "scale, frozen since act 1": f"{fit.scale:.4f}",
            "slope": f"{fit.x[1]:.4f} ± {fit.std_error[1]:.4f}",
            "weight of all good points": f"{fit.weights[~lifted].mean():.3f} on average",
            "efficiency of this act": "95 %" if act == 3 else "29 %",
        }
