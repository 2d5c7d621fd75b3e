"""Scene 4: the scale is the hero. The same loss with three yardsticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, LogSlider, Slider, whole_number
from losbench.workbench.explorers.lab.layout import ring
from losbench.workbench.explorers.view import Handle

__all__ = ["ScaleIsTheHero"]


_OFF = np.geomspace(1.0, 1000.0, 13)
_DRAWS = 60
_LOOKS = {"std": ("vermilion", "--"), "MAD": ("blue", "-"), "known": ("green", "-.")}
_SCALES: dict[str, Any] = {"std": "std", "MAD": "mad", "known": 1.0}


def weights_and_errors(
    *, off: float | np.ndarray, spots: int, seed: int
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Solve many draws of noise with one spot off in a random direction, by each scale.

    Mean weight of that spot and root mean square error of the first unknown, for each distance.
    """
    A, group = ring(spots)
    rng, far = np.random.default_rng(seed), np.ravel(off)
    b = np.repeat(rng.standard_normal((_DRAWS, spots, 2))[None], len(far), axis=0)
    heading = rng.uniform(0.0, 2 * np.pi, _DRAWS)
    b[:, :, 0] += far[:, None, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    y = b.reshape(len(far), _DRAWS, -1)
    fits = {
        name: lb.irls(A, y, scale=scale, group=group, max_iter=200, on_fail="ignore")
        for name, scale in _SCALES.items()
    }
    fits["least squares"] = lb.lstsq(A, y)
    return {
        name: (fit.weights[..., 0].mean(axis=1), np.sqrt(np.mean(fit.x[..., 0] ** 2, axis=1)))
        for name, fit in fits.items()
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
    experiment = staticmethod(weights_and_errors)
    answer = "*(number for pair in seen.values() for number in pair)"
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "four spots": {"spots": 4},
        "three spots": {"spots": 3},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw both panels."""
        left, right = figure.subplots(1, 2)
        self._weights = {
            name: left.plot([], [], color=COLOURS[colour], ls=dashes, label=f"Huber, {name}")[0]
            for name, (colour, dashes) in _LOOKS.items()
        }
        self._errors = {
            name: right.plot([], [], color=COLOURS[colour], ls=dashes)[0]
            for name, (colour, dashes) in _LOOKS.items()
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

    def handles(self, *, off: float, **_: Any) -> Sequence[Handle]:
        """How far off the bad spot is, on both panels."""
        along, where = self.slides("off"), f"{off:g} sigma"
        return [
            Handle("bad spot off by", mark.axes, off, y, along, (0.05, 0.0), where)
            for mark, y in zip(self._here, (0.05, 10.0), strict=True)
        ]

    def update(self, *, off: float, spots: int, seed: int) -> Mapping[str, str]:
        """Solve many draws at every distance, and at this one."""
        curves = _curves(spots, seed)
        for name in _SCALES:
            self._weights[name].set_data(_OFF, curves[name][0])
            self._errors[name].set_data(_OFF, curves[name][1])
        self._least.set_data(_OFF, curves["least squares"][1])
        for mark in self._here:
            mark.set_xdata([off] * 2)
        here = self.experiment(off=off, spots=spots, seed=seed)
        return {
            f"{name}: weight · error": f"{here[name][0][0]:.4f} · {here[name][1][0]:.3f}"
            for name in _SCALES
        }


@lru_cache(maxsize=16)
def _curves(spots: int, seed: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return weights_and_errors(off=_OFF, spots=spots, seed=seed)
