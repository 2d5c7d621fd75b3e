"""Scene 2: loss, pull and weight, and what their constant costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.arrays import Floats
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Choice, Control, Slider
from losbench.workbench.explorers.view import Handle

__all__ = ["LossShapes"]

_LOSSES = ("Huber", "Bisquare", "Cauchy", "Welsch", "Hampel")
_U = np.linspace(-8.0, 8.0, 321)
_FACTORS = np.linspace(0.2, 2.0, 37)


def loss_and_its_cost(*, loss: str, factor: float) -> dict[str, Any]:
    """Scale the constants of a loss, and say what it keeps and what it lets a bad value do."""
    default = getattr(lb, loss)()
    scaled = type(default)(**{name: value * factor for name, value in vars(default).items()})
    return {
        "loss": scaled,
        "efficiency": lb.efficiency(scaled),
        "gross error sensitivity": lb.gross_error_sensitivity(scaled),
    }


class LossShapes(Explorer):
    """One of five losses: rho, psi and weight over the residual, and its efficiency over its
    constant.
    """

    controls: ClassVar[dict[str, Control]] = {
        "loss": Choice("loss", {name: name for name in _LOSSES}, "Huber"),
        "factor": Slider("constant, in that of 95 %", 1.0, 0.2, 2.0, 0.02),
    }
    experiment = staticmethod(loss_and_its_cost)
    answer = '100 * seen["efficiency"], seen["gross error sensitivity"]'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "nearly the median": {"loss": "Huber", "factor": 0.2}
    }
    size_in = (8.4, 3.1)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw four panels."""
        panels = figure.subplots(1, 4)
        titles = {"loss ρ(u)": 9.0, "pull ψ(u)": 4.0, "weight ψ(u)/u": 1.05}
        self._curves = []
        for axes, (title, top) in zip(panels, titles.items(), strict=False):
            self._curves += axes.plot([], [], color=COLOURS["blue"])
            axes.set(
                title=title,
                xlim=(-8, 8),
                ylim=(-4.0 if title[-4:] == "ψ(u)" else -0.02, top),
                xlabel="u",
            )
        panels[0].plot(_U, _U**2 / 2, color=COLOURS["black"], lw=0.7, ls="--")
        panels[1].plot(_U, _U, color=COLOURS["black"], lw=0.7, ls="--")
        (self._cost,) = panels[3].plot([], [], color=COLOURS["black"])
        (self._here,) = panels[3].plot([], [], "o", color=COLOURS["vermilion"], ms=7)
        panels[3].set(title="efficiency (%)", xlabel="constant", xlim=(0.15, 2.05), ylim=(0, 102))
        self._name = figure.suptitle(" ", fontsize=10)
        return [*self._curves, self._cost, self._here, self._name]

    def handles(self, *, factor: float, **_: Any) -> Sequence[Handle]:
        """The constant."""
        along, (x, y) = self.slides("factor"), self._here.get_xydata()[0]
        where = f"constant {factor:g}"
        return [Handle("constant", self._here.axes, x, float(y), along, (0.02, 0.0), where)]

    def update(self, *, loss: str, factor: float) -> Mapping[str, str]:
        """Draw the loss with this constant."""
        seen = self.experiment(loss=loss, factor=factor)
        chosen, kept = seen["loss"], seen["efficiency"]
        for line, values in zip(
            self._curves, (chosen.rho(_U), chosen.psi(_U), chosen.weights(_U)), strict=True
        ):
            line.set_data(_U, values)
        self._cost.set_data(_FACTORS, 100.0 * _efficiencies(loss))
        constants = ", ".join(f"{name} = {value:.4g}" for name, value in vars(chosen).items())
        self._name.set_text(f"{loss}, {constants}")
        self._here.set_data([factor], [100.0 * kept])
        return {
            "constant": constants,
            "efficiency on normal errors": f"{100.0 * kept:.2f} %",
            "most that one bad value can do": f"{seen['gross error sensitivity']:.3f} scales / n",
        }


@cache
def _efficiencies(loss: str) -> Floats:
    costs = [loss_and_its_cost(loss=loss, factor=float(factor)) for factor in _FACTORS]
    return np.array([cost["efficiency"] for cost in costs])
