"""The warm-up of liu2026 as something to turn: how heat paths and sensitivities make a drift, and
what a fit finds.
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
    Control,
    Field,
    LogSlider,
    Slider,
    numbers,
    whole_number,
)
from losbench.workbench.explorers.picture import round_up

__all__ = ["ThermalExplorer"]

_FRAME_PERIOD_S = 40.0
_AXES = {"X": "blue", "Y": "vermilion", "Z": "green"}
_NODE_STYLES = {
    "blue": "-",
    "vermilion": "--",
    "green": "-.",
    "purple": ":",
    "orange": (0, (5, 1, 1, 1, 1, 1)),
}


def warm_up_and_fits(
    *,
    room_end_degC: float,
    ramp_min: int,
    link_to_base_W_per_K: tuple[float, ...],
    room_W_per_K: tuple[float, ...],
    sensitivity_X: tuple[float, ...],
    sensitivity_Y: tuple[float, ...],
    sensitivity_Z: tuple[float, ...],
    lag_min: float,
    error_arcsec: float,
    bad_percent: int,
    bad_arcsec: float,
    seed: int,
    every_lag: bool = True,
) -> dict[str, Any]:
    """Warm the twin, measure its angles with noise and bad frames, and fit them over the room."""
    bench = liu2026.ThermalBench(
        room_end_degC=room_end_degC,
        ramp_s=60.0 * ramp_min,
        link_to_base_W_per_K=link_to_base_W_per_K,
        room_W_per_K=room_W_per_K,
        sensitivity_arcsec_per_degC=(sensitivity_X, sensitivity_Y, sensitivity_Z),
    )
    run = liu2026.warm_up(bench, time_s=np.arange(0.0, bench.duration_s, _FRAME_PERIOD_S))
    rng = np.random.default_rng(seed)
    errors = rng.normal(0.0, error_arcsec, run.angles_rad.shape)
    errors += bad_arcsec * (rng.random((len(errors), 1)) < bad_percent / 100)
    angles = run.angles_rad + lb.units.arcsec_to_rad(errors)
    when, lag_s = run.time_s, 60.0 * lag_min or None
    fits = {
        "IRLS": lb.fit_sensitivity(run.room_degC, angles, time_s=when, lag_s=lag_s),
        "least squares": lb.fit_sensitivity(
            run.room_degC, angles, time_s=when, lag_s=lag_s, method="ls", errors="white"
        ),
    }
    if every_lag:
        fits["every lag"] = lb.fit_sensitivity(
            run.room_degC, angles, time_s=when, lag_s="fit", errors="white"
        )
    return {"bench": bench, "run": run, "angles": angles, "fits": fits}


class ThermalExplorer(Explorer):
    """A room that warms from 18 °C, five nodes that follow, the line of sight that drifts, and the
    fit per degree.
    """

    controls: ClassVar[dict[str, Control]] = {
        "room_end_degC": Slider("room at the end", 25.0, 19.0, 40.0, 0.5, "°C"),
        "ramp_min": Slider("ramp", 80, 5, 240, 5, "min"),
        "link_to_base_W_per_K": Field(
            "links to the base plate",
            liu2026.ThermalBench.link_to_base_W_per_K,
            numbers(4, low=0.0, high=100.0),
            "W/K",
        ),
        "room_W_per_K": Field(
            "links to the room",
            liu2026.ThermalBench.room_W_per_K,
            numbers(5, low=0.0, high=100.0),
            "W/K",
        ),
        **{
            f"sensitivity_{axis}": Field(
                f"sensitivity {axis}", row, numbers(5, low=-100.0, high=100.0), "″/°C"
            )
            for axis, row in zip(
                _AXES, liu2026.ThermalBench.sensitivity_arcsec_per_degC, strict=True
            )
        },
        "lag_min": Slider("lag in the fit", 0.0, 0.0, 120.0, 1.0, "min"),
        "error_arcsec": LogSlider("error of an angle", 0.1, 0.001, 10.0, unit="″"),
        "bad_percent": Slider("bad frames", 0, 0, 30, 1, "%"),
        "bad_arcsec": Slider("their extra error", 10.0, 0.0, 50.0, 1.0, "″"),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(warm_up_and_fits)
    answer = 'seen["fits"]["IRLS"].k_arcsec_per_degC'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "five bad frames in a hundred": {"bad_percent": 5, "bad_arcsec": 20.0},
        "lag of 40 min": {"lag_min": 40.0},
    }
    size_in = (8.4, 3.7)
    settles = True

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw temperatures and drift over time, and drift over temperature."""
        self._heat, self._drift, self._law = figure.subplots(1, 3)
        (self._room,) = self._heat.plot([], [], color=COLOURS["black"], lw=2.0, label="room")
        self._nodes = [
            self._heat.plot(
                [], [], color=COLOURS[colour], ls=dashes, label=node.removesuffix(" mount")
            )[0]
            for node, (colour, dashes) in zip(
                liu2026.ThermalBench.NODES, _NODE_STYLES.items(), strict=True
            )
        ]
        self._heat.set(title="temperature", xlabel="time (min)", ylabel="°C")
        self._heat.legend(
            fontsize=8,
            loc="upper left",
            bbox_to_anchor=(-0.02, -0.22),
            ncols=2,
            columnspacing=0.8,
            handlelength=1.6,
        )
        dots = {"ls": "none", "marker": ".", "ms": 3}
        self._seen, self._against, self._fits, self._plain = [], [], [], []
        for axis, colour in _AXES.items():
            self._seen += self._drift.plot([], [], color=COLOURS[colour], label=axis, **dots)
            self._against += self._law.plot([], [], color=COLOURS[colour], alpha=0.5, **dots)
            self._fits += self._law.plot([], [], color=COLOURS[colour], lw=2.0)
            self._plain += self._law.plot([], [], color=COLOURS["black"], lw=1.0, ls="--")
        self._fits[0].set_label("IRLS")
        self._plain[0].set_label("least squares")
        self._drift.set(title="line of sight", xlabel="time (min)", ylabel="angle (″)")
        self._drift.legend(
            fontsize=8, loc="upper left", bbox_to_anchor=(-0.02, -0.22), ncols=3, markerscale=3
        )
        self._law.set(title="angle against room", xlabel="room (°C)")
        self._law.legend(fontsize=8, loc="upper left", bbox_to_anchor=(-0.02, -0.22), ncols=2)
        return [self._room, *self._nodes, *self._seen, *self._against, *self._fits, *self._plain]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Warm the twin, and fit its angles as a function of temperature; over every lag, once the
        hand rests.
        """
        seen = self.experiment(**settings, every_lag=not self.moving)
        bench, run, fits = seen["bench"], seen["run"], seen["fits"]
        robust, plain = fits["IRLS"], fits["least squares"]
        laws = [
            rad_to_arcsec(fit.predict(run.room_degC, time_s=run.time_s)) for fit in (robust, plain)
        ]
        self._show(run, rad_to_arcsec(seen["angles"]), *laws)
        resting = low = high = ()
        if every := fits.get("every lag"):
            resting = every.k_at_rest_arcsec_per_degC
            low, high = every.k_interval_arcsec_per_degC.T
        rows = {
            "sensitivity, IRLS X · Y · Z (″/°C)": robust.k_arcsec_per_degC,
            "… 95 % from, if this lag were the law": robust.k_interval_arcsec_per_degC[:, 0],
            "… to": robust.k_interval_arcsec_per_degC[:, 1],
            "… least squares": plain.k_arcsec_per_degC,
            "at rest, over every lag": resting,
            "… 95 % from": low,
            "… until": high,
            "… the truth, all nodes as warm as the room": np.sum(
                bench.sensitivity_arcsec_per_degC, axis=1
            ),
            "left after compensation, RMS (″)": rad_to_arcsec(robust.rms),
        }
        slowest = bench.network.time_constants_s[0] / 60.0
        texts = {
            name: " · ".join(f"{value:.3f}" for value in values) or "when it rests"
            for name, values in rows.items()
        }
        return texts | {
            "slowest time constant": f"{slowest:.0f} min"
            if np.isfinite(slowest)
            else "none: cut off"
        }

    def _show(self, run: Any, angles: Any, robust: Any, plain: Any) -> None:
        minutes = run.time_s / 60.0
        self._room.set_data(minutes, run.room_degC)
        for line, node in zip(self._nodes, run.node_degC.T, strict=True):
            line.set_data(minutes, node)
        for k in range(3):
            self._seen[k].set_data(minutes, angles[:, k])
            self._against[k].set_data(run.room_degC, angles[:, k])
            self._fits[k].set_data(run.room_degC, robust[:, k])
            self._plain[k].set_data(run.room_degC, plain[:, k])
        warm = 5.0 * np.ceil(run.room_degC[-1] / 5.0) + 0.5
        limits = -round_up(angles.min(), least=0.1 * angles.max()), round_up(angles.max())
        self._heat.set(xlim=(0, 60.0 * np.ceil(minutes[-1] / 60.0)), ylim=(17.5, warm))
        self._drift.set(xlim=self._heat.get_xlim(), ylim=limits)
        self._law.set(xlim=(17.5, warm), ylim=limits)
