"""A camera of mirrors and metal as something to heat: temperatures, deformation, spots, focus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench import thermoelastic
from losbench.figures import COLOURS
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

__all__ = ["ThermoelasticExplorer"]

_SENSORS = {"wall +x": "blue", "wall -x": "vermilion", "bench": "green", "rear": "purple"}
_SPOTS = {"A x": "blue", "A y": "vermilion", "B x": "sky", "B y": "orange"}
_EXAGGERATE = 1000.0
_HALF_MM = (30.5, 11.0, 23.5, 10.5)  # half the height of M1, M2, M3 and the detector


def heat_to_spots(
    *,
    materials: str,
    room_end_degC: float,
    ramp_min: int,
    air_W_per_m2K: float,
    sun_W_per_m2: int,
    electronics_W: float,
    error_px: float,
    seed: int,
) -> dict[str, Any]:
    """Heat the camera from the tenth minute on, and follow its parts and its two spots."""
    camera, reduced = thermoelastic.prepared_camera(materials)
    start = camera.reference_degC
    time_s = np.arange(0.0, 9001.0, 60.0)
    on = (time_s >= 600.0).astype(float)
    room = np.interp(time_s, [600.0, 600.0 + 60.0 * ramp_min], [start, room_end_degC])
    modes = reduced.modes([air_W_per_m2K / 10.0, 1.0, 1.0, 1.0, 1.0])
    drive = reduced.heat.drive(
        time_s,
        {
            "room_degC": room,
            "sun_W_per_m2": on * sun_W_per_m2,
            "electronics_W": on * electronics_W,
        },
    )
    noise = np.random.default_rng(seed).normal(0.0, error_px, (time_s.size, 4))
    rise_K = modes.amplitudes(time_s, drive) @ modes.shapes.T - start
    return {
        "time_s": time_s,
        "room_degC": room,
        "temperature_degC": start + rise_K[:, list(camera.sensor_nodes)],
        "spots_px": rise_K @ camera.los_map[:4].T + noise,
        "focus_um": rise_K[-1] @ camera.los_map[4:].T,
        "motion": camera.motion_map @ rise_K[-1],
        "angles_arcsec": lb.units.rad_to_arcsec(camera.angle_map @ rise_K[-1]),
        "at_rest_arcsec_per_degC": lb.units.rad_to_arcsec(camera.steady_rad_per_degC),
    }


class ThermoelasticExplorer(Explorer):
    """Room, air, sun and electronics on a three-mirror camera of four materials: its temperatures,
    the drift of its two spots, and where its optics have gone.
    """

    controls: ClassVar[dict[str, Control]] = {
        "room_end_degC": Slider("room at the end", 25.0, 18.0, 40.0, 0.5, "°C"),
        "ramp_min": Slider("ramp", 80, 5, 140, 5, "min"),
        "air_W_per_m2K": LogSlider("air", 10.0, 2.0, 50.0, "W/m²K"),
        "sun_W_per_m2": Slider("sun on one wall", 0, 0, 400, 10, "W/m²"),
        "electronics_W": Slider("electronics", 0.0, 0.0, 5.0, 0.1, "W"),
        "materials": Choice(
            "materials", {name: name for name in thermoelastic.MATERIAL_SETS}, "aluminium + Zerodur"
        ),
        "error_px": LogSlider("error of a centroid", 0.005, 0.001, 0.1, "px"),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(heat_to_spots)
    answer = 'seen["angles_arcsec"], seen["focus_um"]'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "sun alone": {"room_end_degC": 18.0, "sun_W_per_m2": 400},
        "electronics alone": {"room_end_degC": 18.0, "electronics_W": 3.0},
    }
    size_in = (8.4, 3.7)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw temperatures and drift over time, and the optics from the side."""
        self._heat, self._drift, self._side = figure.subplots(1, 3)
        (self._room,) = self._heat.plot([], [], color=COLOURS["black"], lw=2.0, label="room")
        self._sensors = [
            self._heat.plot([], [], color=COLOURS[colour], label=name)[0]
            for name, colour in _SENSORS.items()
        ]
        self._spots = [
            self._drift.plot([], [], color=COLOURS[colour], label=name)[0]
            for name, colour in _SPOTS.items()
        ]
        below = {"fontsize": 8, "loc": "upper left", "bbox_to_anchor": (-0.02, -0.22)}
        below |= {"ncols": 2, "columnspacing": 0.8, "handlelength": 1.6}
        self._heat.set(title="temperature", xlabel="time (min)", ylabel="°C", xlim=(0, 150))
        self._drift.set(title="spots", xlabel="time (min)", ylabel="drift (px)", xlim=(0, 150))
        optics = thermoelastic.prepared_camera("aluminium + Zerodur")[0].optics
        self._pivots = optics.pivot_mm
        for (_, y, z), half in zip(self._pivots, _HALF_MM, strict=True):
            self._side.plot([z, z], [y - half, y + half], color="#BBBBBB", lw=3)
        ray = np.vstack([self._pivots[0] + 230.0 * optics.directions([0.0, 0.0]), self._pivots])
        self._side.plot(ray[:, 2], ray[:, 1], color=COLOURS["orange"], lw=0.8)
        self._moved = [
            self._side.plot([], [], color=COLOURS["blue"], lw=1.5)[0] for _ in self._pivots
        ]
        self._side.set(title=f"optics, × {_EXAGGERATE:.0f}", xlabel="z (mm)", ylabel="y (mm)")
        self._side.set(xlim=(-60, 250), ylim=(-110, 110))
        self._heat.legend(**below)
        self._drift.legend(**below)
        return [self._room, *self._sensors, *self._spots, *self._moved]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Heat the camera, and draw what it did."""
        seen = self.experiment(**settings)
        minutes, spots = seen["time_s"] / 60.0, seen["spots_px"]
        self._room.set_data(minutes, seen["room_degC"])
        for line, column in zip(self._sensors, seen["temperature_degC"].T, strict=True):
            line.set_data(minutes, column)
        for line, column in zip(self._spots, spots.T, strict=True):
            line.set_data(minutes, column)
        motions = seen["motion"].reshape(4, 8)
        for line, pivot, motion, half in zip(
            self._moved, self._pivots, motions, _HALF_MM, strict=True
        ):
            ends = np.array([-half, half])
            y = pivot[1] + ends + _EXAGGERATE * motion[1]
            line.set_data(pivot[2] + _EXAGGERATE * (motion[2] + motion[3] * ends), y)
        hottest = max(seen["room_degC"].max(), seen["temperature_degC"].max())
        self._heat.set_ylim(17.5, 5.0 * np.ceil(hottest / 5.0) + 0.5)
        top = round_up(float(np.abs(spots).max()), least=0.01)
        self._drift.set_ylim(-top, top)
        return {
            "line of sight at the end, X · Y · Z (″)": _row(seen["angles_arcsec"]),
            "focus at the end (µm)": f"{seen['focus_um'].mean():.1f}",
            "true sensitivity at rest, X · Y · Z (″/°C)": _row(seen["at_rest_arcsec_per_degC"]),
            "M1 tilts about X by (″)": f"{lb.units.rad_to_arcsec(motions[0, 3]):.2f}",
        }


def _row(values: Any) -> str:
    return " · ".join(f"{value:.3f}" for value in values)
