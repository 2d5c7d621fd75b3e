"""Scene 7: where a redescending loss ends depends on where it starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.arrays import Floats
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Choice, Control, Field, Slider, whole_number
from losbench.workbench.explorers.view import Handle

__all__ = ["Basins"]


_LOSSES = ("Huber", "Bisquare", "Welsch")
_GOOD, _BAD, _APART = 14, 6, 8.0
_STARTS = np.linspace(-4.0, 12.0, 81)


def two_heaps(seed: int) -> np.ndarray:
    """Values about 0, and fewer and narrower ones far off."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.standard_normal(_GOOD), _APART + 0.7 * rng.standard_normal(_BAD)])


def where_it_ends(*, start: float | np.ndarray, loss: str, seed: int) -> lb.RobustFit:
    """Reweight the mean of all values until it settles, from each start."""
    y, starts = two_heaps(seed), np.reshape(start, (-1, 1))
    return lb.irls(
        np.ones((len(y), 1)),
        np.broadcast_to(y, (len(starts), len(y))),
        loss=getattr(lb, loss)(),
        scale=1.0,
        x0=starts,
        max_iter=500,
        on_fail="ignore",
    )


class Basins(Explorer):
    """Two heaps of values, the sum of losses over the location, and where reweighting ends from
    every start.
    """

    controls: ClassVar[dict[str, Control]] = {
        "start": Slider("start", 7.0, -4.0, 12.0, 0.1),
        "loss": Choice("loss", {name: name for name in _LOSSES}, "Bisquare"),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(where_it_ends)
    answer = "seen.x[-1, 0]"
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "monotone": {"loss": "Huber"},
        "start at the median": {"start": 0.3},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the landscape with the path, and the end over the start."""
        left, right = figure.subplots(1, 2)
        (self._curve,) = left.plot([], [], color=COLOURS["black"])
        (self._path,) = left.plot(
            [], [], "o-", ms=4, lw=1.0, color=COLOURS["vermilion"], label="reweighting"
        )
        (self._values,) = left.plot([], [], "|", ms=12, color=COLOURS["blue"])
        left.text(
            _APART / 2, 0.0, "values", color=COLOURS["blue"], fontsize=8, ha="center", va="center"
        )
        left.set(
            xlim=(-4, 12),
            ylim=(-0.08, 1.05),
            xlabel="location",
            title="sum of losses (largest = 1)",
        )
        left.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 0.1))
        (self._ends,) = right.plot([], [], ".", ms=4, color=COLOURS["blue"])
        (self._here,) = right.plot([], [], "o", ms=8, color=COLOURS["vermilion"])
        right.plot([-4, 12], [-4, 12], color=COLOURS["black"], lw=0.6, ls="--")
        right.set(xlim=(-4, 12), ylim=(-4, 12), xlabel="start", title="where it ends")
        return [self._curve, self._values, self._path, self._ends, self._here]

    def handles(self, *, start: float, **_: Any) -> Sequence[Handle]:
        """The start, on both panels."""
        along, where = self.slides("start"), f"start {start:g}"
        left, right = self._path.axes, self._here.axes
        at = (self._path.get_xydata()[0, 1], self._here.get_ydata()[0])
        return [
            Handle("start of reweighting", axes, start, float(y), along, (0.1, 0.0), where)
            for axes, y in zip((left, right), at, strict=True)
        ]

    def update(self, *, start: float, loss: str, seed: int) -> Mapping[str, str]:
        """Walk from every start, and from this one step by step."""
        y, rule = two_heaps(seed), getattr(lb, loss)()
        total = rule.rho(_STARTS[:, None] - y).sum(axis=1)
        top = total.max()
        ends = _ends(loss, seed)
        end = float(self.experiment(start=start, loss=loss, seed=seed).x[-1, 0])
        path = _path(rule, y, start)
        self._curve.set_data(_STARTS, total / top)
        self._values.set_data(y, np.zeros_like(y))
        self._path.set_data(path, rule.rho(path[:, None] - y).sum(axis=1) / top)
        self._ends.set_data(_STARTS, ends)
        self._here.set_data([start], path[-1:])
        places = np.unique(ends.round(2))
        distinct = places[np.append(True, np.diff(places) > 0.1)]
        return {
            "ends at": f"{end:.4f}",
            "steps": str(len(path) - 1),
            "different ends": " · ".join(f"{place:.2f}" for place in distinct),
            "median of all values": f"{np.median(y):.2f}",
        }


@lru_cache(maxsize=32)
def _ends(loss: str, seed: int) -> Floats:
    return where_it_ends(start=_STARTS, loss=loss, seed=seed).x[:, 0]


def _path(rule: Any, y: Floats, start: float) -> Floats:
    """Places of the location, step by step, until it settles."""
    places = [start]
    for _ in range(500):
        weights = rule.weights(y - places[-1])
        if not weights.any():
            break
        places.append(float(weights @ y / weights.sum()))
        if abs(places[-1] - places[-2]) < 1e-9:
            break
    return np.array(places)
