"""The star-camera pair of ren2023 as something to turn: which drift and which error make which
angle and split?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.papers import ren2023
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, LogSlider, Slider, whole_number
from losbench.workbench.explorers.picture import round_up

__all__ = ["StarCameraExplorer"]

_DAYS = (0.0, 58.0)
_PAIR = ren2023.Pair()
_SAMPLES = round(_PAIR.track_s * _PAIR.rate_hz)
_TAU = np.unique(np.round(np.geomspace(1, _SAMPLES / 4, 24))) / _PAIR.rate_hz
_THINNED = 2  # one sample in two is drawn; the numbers come from all
_COLOURS = {"uncorrected": "vermilion", "corrected": "blue"}


def two_tracks(
    *,
    drift_1_arcsec: float,
    drift_2_arcsec: float,
    lsfe_arcsec: float,
    correlation_s: float,
    nea_arcsec: float,
    spot_noise_um: float,
    smooth_s: float,
    window: int,
    seed: int,
) -> dict[str, Any]:
    """Simulate two tracks 58 days apart, correct them, and split the error of the last."""
    standard = ren2023.Pair()
    pair = ren2023.Pair(
        days=_DAYS,
        drift_1_arcsec=(drift_1_arcsec, *standard.drift_1_arcsec[1:]),
        drift_2_arcsec=(drift_2_arcsec, *standard.drift_2_arcsec[1:]),
        lsfe_arcsec=lsfe_arcsec,
        correlation_s=correlation_s,
        nea_arcsec=nea_arcsec,
        spot_noise_um=spot_noise_um,
    )
    tracks = ren2023.first_order(pair, seed, smooth_s=smooth_s or None)
    both = (tracks.before, tracks.after)
    return {
        "tracks": tracks,
        "splits": [lb.split_error(angle[-1], window=window) for angle in both],
        "unbiased": lb.split_error(tracks.before[-1], window=window, unbiased=True),
    }


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
        "seed": Field("seed", _PAIR.seed, whole_number),
    }
    experiment = staticmethod(two_tracks)
    answer = 'seen["unbiased"].lsfe, seen["unbiased"].nea'
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
        time = np.arange(2 * _SAMPLES)[::_THINNED] / _PAIR.rate_hz
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
        self._angle.set_xlim(0, 2 * _PAIR.track_s)
        self._angle.axvline(_PAIR.track_s, color=COLOURS["black"], lw=0.8)
        self._angle.set_xticks([0, 150, 300, 450, 600], ["0", "150", "300 | 0", "150", "300"])
        self._angle.legend(loc="upper left", ncols=2, fontsize=9)
        self._allan.set(
            xlabel="averaging time (s)", ylabel="3 x Allan deviation (″)", ylim=(0.005, 5.0)
        )
        self._allan.set_title("the last track", fontsize=10)
        self._allan.legend(loc="upper right", fontsize=9)
        return [*self._lines, *self._deviations, self._windows, self._white]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Simulate both tracks, correct them, split the error of the last."""
        seen = self.experiment(**settings)
        tracks, window = seen["tracks"], settings["window"]
        lsfe, nea = settings["lsfe_arcsec"], settings["nea_arcsec"]
        both = (tracks.before, tracks.after)
        reach = round_up(1.15 * max(0.01, *(np.abs(angle).max() for angle in both)))
        self._angle.set_ylim(-reach, reach)
        for line, deviation, angle in zip(self._lines, self._deviations, both, strict=True):
            line.set_ydata(angle.ravel()[::_THINNED])
            deviation.set_ydata(
                3.0 * lb.allan_deviation(angle[-1], rate_hz=_PAIR.rate_hz, tau_s=_TAU)
            )
        self._windows.set_xdata([window / _PAIR.rate_hz] * 2)
        self._white.set_ydata(np.sqrt(2.0) * nea / np.sqrt(_TAU * _PAIR.rate_hz))
        (before, after), fair = seen["splits"], seen["unbiased"]
        change = f"{tracks.change_before:+.3f} → {tracks.change_after:+.3f}"
        return {
            "change in two months, raw → corrected (″)": change,
            "total (″)": f"{before.total:.3f} → {after.total:.3f}",
            "LSFE, as in the paper (″)": f"{before.lsfe:.3f} → {after.lsfe:.3f}",
            "NEA (″)": f"{before.nea:.3f} → {after.nea:.3f}",
            "LSFE · NEA unbiased, raw (″)": f"{fair.lsfe:.3f} · {fair.nea:.3f}",
            "their uncertainty (″)": f"{fair.lsfe_sigma:.3f} · {fair.nea_sigma:.3f}",
            "truth (″)": f"{np.sqrt(2.0) * lsfe:.3f} · {np.sqrt(2.0) * nea:.3f}",
        }
