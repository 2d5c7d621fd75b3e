"""The star-camera pair of ren2023 as something to turn: which drift and which error make which
angle and split?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from losbench.estimation.allan import allan_deviation
from losbench.estimation.stability import split_error
from losbench.figures import COLOURS
from losbench.papers.ren2023.results.figures import first_order
from losbench.papers.ren2023.scenario import Pair
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, LogSlider, Slider, whole_number
from losbench.workbench.explorers.picture import round_up

__all__ = ["StarCameraExplorer"]

_DAYS = (0.0, 58.0)
_SAMPLES = round(Pair.track_s * Pair.rate_hz)
_TAU = np.unique(np.round(np.geomspace(1, _SAMPLES / 4, 24))) / Pair.rate_hz
_THINNED = 2  # one sample in two is drawn; the numbers come from all
_COLOURS = {"uncorrected": "vermilion", "corrected": "blue"}


class StarCameraExplorer(Explorer):
    """Two tracks two months apart: the angle between the boresights, before and after correction,
    and its split.
    """

    controls: ClassVar[dict[str, Control]] = {
        "drift_1_arcsec": Slider("drift of camera 1", -0.45, -3.0, 3.0, 0.05, "″ in 58 d"),
        "drift_2_arcsec": Slider("drift of camera 2", 0.65, -3.0, 3.0, 0.05, "″ in 58 d"),
        "lsfe_arcsec": Slider("slow error, 3 sigma", 0.2225, 0.0, 1.0, 0.0025, "″"),
        "correlation_s": LogSlider("its memory", 15.0, 2.0, 60.0, unit="s"),
        "nea_arcsec": Slider("noise, 3 sigma", 0.48, 0.0, 1.5, 0.01, "″"),
        "spot_noise_um": Slider("noise of the spots", 0.137, 0.0, 1.0, 0.001, "µm"),
        "smooth_s": Slider("drift averaged over", 0.0, 0.0, 60.0, 1.0, "s"),
        "window": Slider("window of the split", 5, 3, 101, 2, "samples"),
        "seed": Field("seed", Pair.seed, whole_number),
    }
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "drift averaged over 10 s": {"smooth_s": 10.0},
        "window of 21": {"window": 21},
        "no slow error at all": {"lsfe_arcsec": 0.0},
        "poor spots": {"spot_noise_um": 1.0},
    }
    size_in = (8.4, 3.9)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the angle over both tracks, and the Allan deviation of the last one."""
        self._angle, self._allan = figure.subplots(1, 2, width_ratios=(3, 2))
        time = np.arange(2 * _SAMPLES)[::_THINNED] / Pair.rate_hz
        self._lines, self._deviations = [], []
        for name, colour in _COLOURS.items():
            self._lines += self._angle.plot(
                time, np.zeros(time.size), color=COLOURS[colour], lw=0.4, label=name
            )
            self._deviations += self._allan.loglog(_TAU, _TAU, ".-", color=COLOURS[colour], lw=1.0)
        self._windows = self._allan.axvline(1.0, color=COLOURS["green"], ls="--", label="window")
        (self._white,) = self._allan.loglog(
            _TAU, _TAU, ":", color=COLOURS["black"], label="white noise alone"
        )
        self._angle.set(
            xlabel="time in the first track | in the last (s)", ylabel="angle less design (″)"
        )
        self._angle.set_title("two tracks, 58 days apart", fontsize=10)
        self._angle.set_xlim(0, 2 * Pair.track_s)
        self._angle.axvline(Pair.track_s, color=COLOURS["black"], lw=0.8)
        self._angle.set_xticks([0, 150, 300, 450, 600], ["0", "150", "300 | 0", "150", "300"])
        self._angle.legend(loc="upper left", ncols=2, fontsize=9)
        self._allan.set(
            xlabel="averaging time (s)", ylabel="3 x Allan deviation (″)", ylim=(0.005, 5.0)
        )
        self._allan.set_title("the last track", fontsize=10)
        self._allan.legend(loc="upper right", fontsize=9)
        return [*self._lines, *self._deviations, self._windows, self._white]

    def update(
        self, *, window: int, seed: int, smooth_s: float, **setting: Any
    ) -> Mapping[str, str]:
        """Simulate both tracks, correct them, split the error of the last."""
        pair = _pair(**setting)
        tracks = first_order(pair, seed, smooth_s=smooth_s or None)
        both = (tracks.before, tracks.after)
        reach = round_up(1.15 * max(0.01, *(np.abs(angle).max() for angle in both)))
        self._angle.set_ylim(-reach, reach)
        for line, deviation, angle in zip(self._lines, self._deviations, both, strict=True):
            line.set_ydata(angle.ravel()[::_THINNED])
            deviation.set_ydata(3.0 * allan_deviation(angle[-1], rate_hz=pair.rate_hz, tau_s=_TAU))
        self._windows.set_xdata([window / pair.rate_hz] * 2)
        self._white.set_ydata(np.sqrt(2.0) * pair.nea_arcsec / np.sqrt(_TAU * pair.rate_hz))
        before, after = (split_error(angle[-1], window=window) for angle in both)
        fair = split_error(tracks.before[-1], window=window, unbiased=True)
        return {
            "change in two months, raw → corrected (″)": f"{tracks.change_before:+.3f} → {tracks.change_after:+.3f}",
            "total (″)": f"{before.total:.3f} → {after.total:.3f}",
            "LSFE, as in the paper (″)": f"{before.lsfe:.3f} → {after.lsfe:.3f}",
            "NEA (″)": f"{before.nea:.3f} → {after.nea:.3f}",
            "LSFE · NEA unbiased, raw (″)": f"{fair.lsfe:.3f} · {fair.nea:.3f}",
            "their uncertainty (″)": f"{fair.lsfe_sigma:.3f} · {fair.nea_sigma:.3f}",
            "truth (″)": f"{np.sqrt(2.0) * pair.lsfe_arcsec:.3f} · {np.sqrt(2.0) * pair.nea_arcsec:.3f}",
        }

    def code(self, *, window: int, seed: int, smooth_s: float, **setting: Any) -> str:
        """Return the simulation of the whole chain, attitudes included."""
        pair = _pair(**setting)
        names = (
            "days",
            "drift_1_arcsec",
            "drift_2_arcsec",
            "lsfe_arcsec",
            "correlation_s",
            "nea_arcsec",
            "spot_noise_um",
        )
        arguments = "".join(f"    {name}={getattr(pair, name)!r},\n" for name in names)
        return (
            "import losbench as lb\n"
            "from losbench.papers.ren2023 import Pair, evaluate\n\n"
            f"pair = Pair(\n{arguments})\n"
            f"tracks = evaluate(pair, {seed}, smooth_s={smooth_s or None})\n"
            "print(tracks.change_before, tracks.change_after)\n"
            f"split = lb.split_error(tracks.before[-1], window={window}, unbiased=True)\n"
            "shown = [float(split.lsfe), float(split.nea)]\n"
            "print(shown)"
        )


def _pair(*, drift_1_arcsec: float, drift_2_arcsec: float, **fields: Any) -> Pair:
    standard = Pair()
    return replace(
        standard,
        days=_DAYS,
        drift_1_arcsec=(drift_1_arcsec, *standard.drift_1_arcsec[1:]),
        drift_2_arcsec=(drift_2_arcsec, *standard.drift_2_arcsec[1:]),
        **fields,
    )
