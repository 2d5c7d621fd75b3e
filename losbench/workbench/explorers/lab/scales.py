"""Scene 4: the scale is the hero. The same loss with three yardsticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from losbench.arrays import Floats
from losbench.estimation.robust import irls, lstsq
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, LogSlider, Slider, whole_number
from losbench.workbench.explorers.lab.layout import ring

__all__ = ["ScaleIsTheHero"]


_OFF = np.geomspace(1.0, 1000.0, 13)
_DRAWS = 60
_RULES: dict[str, tuple[str, str, Any]] = {
    "std": ("vermilion", "--", "std"),
    "MAD": ("blue", "-", "mad"),
    "known": ("green", "-.", 1.0),
}


class ScaleIsTheHero(Explorer):
    """Spots on a ring, one of them off: weight of the bad spot and error of the angle over how far
    off it is.
    """

    controls: ClassVar[dict[str, Control]] = {
        "off": LogSlider("bad spot off by", 100.0, 1.0, 1000.0, unit="sigma"),
        "spots": Slider("spots", 8, 3, 12, 1),
        "seed": Field("seed", 0, whole_number),
    }
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "four spots": {"spots": 4},
        "three spots": {"spots": 3},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw both panels."""
        left, right = figure.subplots(1, 2)
        self._weights = {
            name: left.plot([], [], color=COLOURS[colour], ls=dashes, label=f"Huber, {name}")[0]
            for name, (colour, dashes, _) in _RULES.items()
        }
        self._errors = {
            name: right.plot([], [], color=COLOURS[colour], ls=dashes)[0]
            for name, (colour, dashes, _) in _RULES.items()
        }
        (self._least,) = right.plot([], [], color=COLOURS["orange"], ls=":", label="least squares")
        self._here = [axes.axvline(1.0, color=COLOURS["black"], lw=1.0) for axes in (left, right)]
        left.set(
            xscale="log",
            yscale="log",
            xlim=(1, 1000),
            ylim=(1e-3, 1.5),
            title="weight of the bad spot",
        )
        right.set(
            xscale="log",
            yscale="log",
            xlim=(1, 1000),
            ylim=(0.2, 500),
            title="error of the angle, RMS (sigma)",
        )
        for axes in (left, right):
            axes.set_xlabel("bad spot off by (sigma)")
            axes.legend(fontsize=8, loc="lower left" if axes is left else "upper left")
        return [*self._weights.values(), *self._errors.values(), self._least, *self._here]

    def update(self, *, off: float, spots: int, seed: int) -> Mapping[str, str]:
        """Solve many draws at every distance, and at this one."""
        for name in _RULES:
            weights, errors = _curves(name, spots, seed)
            self._weights[name].set_data(_OFF, weights)
            self._errors[name].set_data(_OFF, errors)
        self._least.set_data(_OFF, _curves("least squares", spots, seed)[1])
        for mark in self._here:
            mark.set_xdata([off] * 2)
        texts = {}
        for name in _RULES:
            weight, error = _solved(name, spots, seed, np.array([off]))
            texts[f"{name}: weight · error"] = f"{weight[0]:.4f} · {error[0]:.3f}"
        return texts

    def code(self, *, off: float, spots: int, seed: int) -> str:
        """Return the draws and the solves."""
        return f"""\
import numpy as np
import losbench as lb

turn = 2 * np.pi * np.arange({spots}) / {spots}
A = np.zeros(({spots}, 2, 3))
A[:, 0, 0] = A[:, 1, 1] = 1.0
A[:, 0, 2], A[:, 1, 2] = -np.sin(turn), np.cos(turn)
rng = np.random.default_rng({seed})
b = rng.standard_normal(({_DRAWS}, {spots}, 2))
heading = rng.uniform(0.0, 2 * np.pi, {_DRAWS})
b[:, 0] += {off} * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
spot = np.repeat(np.arange({spots}), 2)
for scale in ("std", "mad", 1.0):
    fit = lb.irls(A.reshape(-1, 3), b.reshape({_DRAWS}, -1), scale=scale, group=spot, max_iter=200, on_fail="ignore")
    print(scale, fit.weights[:, 0].mean(), np.sqrt(np.mean(fit.x[:, 0] ** 2)))"""


@lru_cache(maxsize=64)
def _curves(name: str, spots: int, seed: int) -> tuple[Floats, Floats]:
    return _solved(name, spots, seed, _OFF)


def _solved(name: str, spots: int, seed: int, off: Floats) -> tuple[Floats, Floats]:
    """Mean weight of the bad spot, and root mean square error of the first unknown, for each
    distance (k,).
    """
    A, group = ring(spots)
    rng = np.random.default_rng(seed)
    b = np.repeat(rng.standard_normal((_DRAWS, spots, 2))[None], len(off), axis=0)
    heading = rng.uniform(0.0, 2 * np.pi, _DRAWS)
    b[:, :, 0] += off[:, None, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    y = b.reshape(len(off), _DRAWS, -1)
    if name == "least squares":
        fit = lstsq(A, y)
    else:
        fit = irls(A, y, scale=_RULES[name][2], group=group, max_iter=200, on_fail="ignore")
    return fit.weights[..., 0].mean(axis=1), np.sqrt(np.mean(fit.x[..., 0] ** 2, axis=1))
