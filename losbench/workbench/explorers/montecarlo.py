"""Fig. 1 of liu2026 as something to turn: which precision, optics and layout of spots give which
pointing error?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.papers import liu2026
from losbench.units import rad_to_arcsec
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import (
    Choice,
    Control,
    Field,
    LogSlider,
    Slider,
    whole_number,
)
from losbench.workbench.explorers.picture import round_up

__all__ = ["MonteCarloExplorer"]

_THINNED = 8  # one trial in eight is drawn; the numbers come from all
_PAPER = {
    "precision_px": 0.1,
    "focal_mm": 475.0,
    "pixel_um": 4.5,
    "separation_mm": 10.0,
    "offset_mm": 75.0,
}


def setting_of_figure_1(
    *,
    precision_px: float,
    focal_mm: float,
    pixel_um: float,
    separation_mm: float,
    offset_mm: float,
    noise: str,
    seed: int,
) -> liu2026.MonteCarlo:
    """Two spots side by side on the focal plane, which lies at -f in the paper."""
    return liu2026.MonteCarlo(
        spot_a_mm=(separation_mm / 2, offset_mm, -focal_mm),
        spot_b_mm=(-separation_mm / 2, offset_mm, -focal_mm),
        pixel_um=pixel_um,
        precisions_px=(precision_px,),
        noise=noise,
        seed=seed,
    )


def pointing_errors(*, model: str, **setting: Any) -> liu2026.Simulation:
    """Run the trials of Fig. 1 with one precision of the centroids."""
    return liu2026.figure_1(setting_of_figure_1(**setting), model=model)


class MonteCarloExplorer(Explorer):
    """5000 trials of noise on two spots (liu2026, section 2.2), and the errors about three axes
    (Fig. 1).
    """

    controls: ClassVar[dict[str, Control]] = {
        "precision_px": LogSlider("centroid precision", 0.1, 0.001, 1.0, unit="px"),
        "focal_mm": Slider("focal length, |z|", 475.0, 50.0, 1000.0, 5.0, "mm"),
        "pixel_um": Slider("pixel size", 4.5, 1.0, 20.0, 0.5, "µm"),
        "separation_mm": Slider("spots apart, along x", 10.0, 0.5, 40.0, 0.5, "mm"),
        "offset_mm": Slider("spot offset, along y", 75.0, 0.0, 100.0, 0.5, "mm"),
        "model": Choice(
            "rows of A", {"paper, eq. (2)": "paper", "pinhole, exact": "pinhole"}, "paper"
        ),
        "noise": Choice(
            "precision is", {"three sigma, clipped": "clipped", "one sigma": "gaussian"}, "clipped"
        ),
        "seed": Field("seed", liu2026.MonteCarlo.seed, whole_number),
    }
    experiment = staticmethod(pointing_errors)
    answer = "seen.sigma_arcsec"
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "as in the paper": {**_PAPER, "model": "paper", "noise": "clipped"},
        "0.5 px": {"precision_px": 0.5},
        "0.01 px": {"precision_px": 0.01},
        "spots on the axis": {"offset_mm": 0.0},
    }
    size_in = (8.4, 4.0)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw three panels, one for each axis, sharing the trials."""
        panels = figure.subplots(3, 1, sharex=True)
        trials = np.arange(1, liu2026.MonteCarlo.trials + 1, _THINNED)
        self._axes, self._lines, self._bands = panels, [], []
        for axes, name, colour in zip(panels, "XYZ", ("blue", "vermilion", "green"), strict=True):
            (line,) = axes.plot(trials, np.zeros(trials.size), color=COLOURS[colour], lw=0.6)
            self._lines.append(line)
            self._bands += [
                axes.axhline(0.0, color=COLOURS["black"], lw=1.0, ls="--") for _ in range(2)
            ]
            axes.set(ylabel=f"{name} error (″)", xlim=(1, liu2026.MonteCarlo.trials))
        panels[0].set_title(
            "errors of 5000 trials (every 8th drawn); dashed: one sigma, closed form", fontsize=10
        )
        panels[-1].set_xlabel("trial")
        return [*self._lines, *self._bands]

    def update(self, *, model: Any, **setting: Any) -> Mapping[str, str]:
        """Run the trials and compare them with the closed form."""
        run = self.experiment(model=model, **setting)
        scenario, precision_px = setting_of_figure_1(**setting), setting["precision_px"]
        sigma_px = precision_px / (3.0 if setting["noise"] == "clipped" else 1.0)
        covariance = lb.attitude_covariance(
            scenario.points_mm, sigma_px * scenario.pixel_um * 1e-3, model=model
        )
        closed = rad_to_arcsec(np.sqrt(np.diag(covariance)))
        errors = run.errors_arcsec[:, 0]
        for k, axes in enumerate(self._axes):
            self._lines[k].set_ydata(errors[::_THINNED, k])
            for band, sign in zip(self._bands[2 * k : 2 * k + 2], (-1.0, 1.0), strict=True):
                band.set_ydata([sign * closed[k]] * 2)
            # In two steps, so that a change of precision meets the limits of all axes at once, and
            # seldom.
            limit = round_up(precision_px) * round_up(4.2 * closed[k] / precision_px)
            axes.set_ylim(-limit, limit)
        rows = {
            "RMS": run.sigma_arcsec[0],
            "peak": run.peak_arcsec[0],
            "one sigma, closed form": closed,
        }
        return {
            f"{name} X · Y · Z (″)": " · ".join(f"{v:.3g}" for v in values)
            for name, values in rows.items()
        }
