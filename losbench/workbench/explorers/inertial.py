"""One smeared star of lyu2015 as something to turn: how a vibration, a spot and a gyro make an
error.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.papers import lyu2015
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import (
    Choice,
    Control,
    Field,
    LogSlider,
    Slider,
    whole_number,
)

__all__ = ["InertialExplorer"]

_HALF_PX = 6.5
_STAR_PX = (255.8, 255.3)
_METHODS: dict[str, dict[str, Any]] = {
    "iterative, above 2 %": {"threshold": 0.02},
    "closed form": {"method": "closed_form"},
    "least squares": {"method": "least_squares"},
}
_MARKS = {
    "plain centroid": ("^", "green"),
    "iterative, above 2 %": ("o", "blue"),
    "closed form": ("s", "orange"),
    "least squares": ("D", "purple"),
}


def smeared_star(
    *,
    rate_deg_s: float,
    frequency_hz: float,
    phase_deg: float,
    ellipse: float,
    sigma_px: float,
    gyro_rate_hz: float,
    interpolation: str,
    bias_deg_h: float,
    late_ms: float,
    flux_e: float,
    read_noise_e: float,
    seed: int,
) -> dict[str, Any]:
    """Expose a star under vibration, and let every method find where it is at the end."""
    setting = lyu2015.Setting(sigma_px=sigma_px, read_noise_e=read_noise_e)
    rate = np.radians(rate_deg_s) * np.array([[ellipse, 1.0, 0.0]])
    phase = np.radians(phase_deg) + np.array([np.pi / 2, 0.0, 0.0])  # a quarter turn apart
    shake = lb.Vibration(amplitude_rad_s=rate, frequency_hz=frequency_hz, phase_rad=phase)
    gyro = lb.Gyro(rate_hz=gyro_rate_hz, bias_deg_h=bias_deg_h, time_offset_s=late_ms * 1e-3)
    path = setting.sensed(shake, gyro, interpolation=interpolation, nodes=8)
    star = lyu2015.expose(setting, shake, np.array([0]), np.array([_STAR_PX]), np.zeros(1))
    detector = lb.Detector(read_noise_e=read_noise_e, offset_dn=100.0)
    frames = detector.expose(star.windows * flux_e + setting.background_e, seed)
    level = setting.background_dn
    found = {
        name: star.aided(path, frames, noise=detector, background=level, **options)
        for name, options in _METHODS.items()
    }
    return {"star": star, "path": path, "light": frames[0, 0] - level, "found": found}


class InertialExplorer(Explorer):
    """A star that smears for 25 ms, its true path, the gyro's, and where each method puts the star
    at the end.
    """

    controls: ClassVar[dict[str, Control]] = {
        "rate_deg_s": Slider("largest rate", 3.0, 0.0, 5.0, 0.1, "°/s"),
        "frequency_hz": Slider("frequency", 20.0, 1.0, 100.0, 1.0, "Hz"),
        "phase_deg": Slider("phase", 0, 0, 355, 5, "°"),
        "ellipse": Slider("second axis over the first", 0.5, -1.0, 1.0, 0.1),
        "sigma_px": Slider("sigma of the spot", 0.45, 0.1, 1.5, 0.05, "px"),
        "gyro_rate_hz": Choice(
            "gyro rate", {"80 Hz": 80.0, "200 Hz": 200.0, "400 Hz": 400.0, "1000 Hz": 1000.0}, 200.0
        ),
        "interpolation": Choice(
            "between its samples", {"straight lines": "linear", "spline": "spline"}, "linear"
        ),
        "bias_deg_h": LogSlider("gyro bias", 0.1, 0.01, 1000.0, unit="°/h"),
        "late_ms": Slider("gyro late by", 0.0, -3.0, 3.0, 0.05, "ms"),
        "flux_e": LogSlider("light of the star", 20000.0, 1000.0, 1e5, unit="e⁻"),
        "read_noise_e": Slider("read noise", 5.0, 0.0, 50.0, 0.5, "e⁻"),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(smeared_star)
    answer = '{name: fit.xy[0, 0] - seen["star"].end[0] for name, fit in seen["found"].items()}'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "hardly any noise": {"flux_e": 5e4, "read_noise_e": 0.0},
        "there and back": {"frequency_hz": 40.0, "ellipse": 0.0, "phase_deg": 0},
        "narrow spot": {"sigma_px": 0.15, "flux_e": 5e4, "read_noise_e": 0.0},
        "late clock": {"late_ms": 1.0},
    }
    size_in = (8.4, 4.4)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the window with its paths on the left and the offsets of the methods on the
        right.
        """
        self._sky, self._near = figure.subplots(1, 2)
        self._image = self._sky.imshow(np.zeros((2, 2)), cmap="Greys", vmin=0.0, vmax=1.0)
        (self._true,) = self._sky.plot([], [], color=COLOURS["sky"], lw=2.0, label="true path")
        (self._gyro,) = self._sky.plot(
            [], [], ".", color=COLOURS["vermilion"], ms=5, label="gyro's path"
        )
        self._sky.set(
            xlim=(-_HALF_PX, _HALF_PX), ylim=(_HALF_PX, -_HALF_PX), xlabel="x (px)", ylabel="y (px)"
        )
        self._sky.yaxis.set_label_coords(-0.16, 0.5)
        self._sky.grid(visible=False)
        self._marks, self._offsets = [], []
        for name, (marker, colour) in _MARKS.items():
            style = {
                "marker": marker,
                "color": COLOURS[colour],
                "ls": "none",
                "mfc": "none",
                "ms": 9,
                "mew": 1.6,
            }
            self._marks += self._sky.plot([], [], label=name, **style)
            self._offsets += self._near.plot([], [], **style)
        self._near.plot(0.0, 0.0, "*", color=COLOURS["black"], ms=12)
        self._near.set(xlabel="x off the star at the end (px)", ylabel="y off (px)", aspect="equal")
        self._near.locator_params(nbins=5)
        self._near.set_title("★ the star when the exposure ends", fontsize=10)
        self._sky.legend(
            fontsize=8, loc="upper left", bbox_to_anchor=(-0.05, -0.17), ncols=3, columnspacing=1.0
        )
        return [self._image, self._true, self._gyro, *self._marks, *self._offsets]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Expose the star, and let every method find it."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            seen = self.experiment(**settings)
        star = seen["star"]
        light = np.maximum(seen["light"], 0.0)
        plain = np.array([light.sum(axis=k) @ np.arange(light.shape[-1]) for k in (0, 1)])
        places = {"plain centroid": plain / max(light.sum(), 1.0) + star.origin[0, 0]}
        places |= {name: found.xy[0, 0] for name, found in seen["found"].items()}
        self._show(star, seen["path"], seen["light"], places)
        errors = {name: f"{np.linalg.norm(xy - star.end[0]):.4f} px" for name, xy in places.items()}
        track = star.truth.tracks(star.start, star.setting.camera)[0, 0]
        length = np.linalg.norm(np.diff(track, axis=0), axis=1).sum()
        return {f"error, {name}": text for name, text in errors.items()} | {
            "length of the track": f"{length:.2f} px"
        }

    def _show(
        self, shot: lyu2015.Exposures, path: lb.AttitudePath, light: Any, places: Mapping[str, Any]
    ) -> None:
        camera, middle = shot.setting.camera, np.array(_STAR_PX)
        x, y = shot.origin[0, 0] - middle - 0.5
        high, wide = light.shape
        self._image.set_data(light)
        self._image.set_extent((x, x + wide, y + high, y))
        self._image.set_clim(0.0, max(float(light.max()), 1.0))
        self._true.set_data(*(shot.truth.tracks(shot.start, camera)[0, 0] - middle).T)
        self._gyro.set_data(*(path.tracks(shot.end[None], camera, epoch="end")[0, 0] - middle).T)
        offsets = np.array([xy - shot.end[0] for xy in places.values()])
        for mark, spot, xy, offset in zip(
            self._marks, self._offsets, places.values(), offsets, strict=True
        ):
            mark.set_data(*(xy - middle)[:, None])
            spot.set_data(*offset[:, None])
        reach = 1.3 * max(float(np.nanmax(np.abs(offsets[1:]), initial=0.0)), 0.004)
        reach = float(f"{reach:.1g}") + 10.0 ** np.floor(np.log10(reach))
        self._near.set(xlim=(-reach, reach), ylim=(reach, -reach))
