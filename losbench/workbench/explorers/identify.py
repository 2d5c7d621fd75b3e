"""Years of drift as something to explain: terms on and off, and what years left out say of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
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

__all__ = ["IdentifyExplorer"]

_DAY_S = 86_400.0
_YEAR_S = 31_557_600.0
_YEARS = 5
_STEP_YEAR = 3.4
_TRUE_LAG_D = 10.0
_TRUE_SENSITIVITY = 0.6  # arcsec per degree
_LOSSES = {"least squares": "none", "Huber": "huber", "Cauchy": "cauchy"}
_BARS = {"constant": "constant", "trend": "trend", "30 d": "a month ago", "last": "last value"}


def years_of_drift(
    *,
    temperature: bool,
    lag_d: int,
    trend: bool,
    season: int,
    step: bool,
    loss: str,
    folds: str,
    horizon: Any,
    noise_arcsec: float,
    bad_percent: int,
    seed: int,
) -> dict[str, Any]:
    """Draw five years of a drift, fit a model to it, and predict folds that it has not seen."""
    rng, terms = np.random.default_rng(seed), lb.terms
    time_s = np.cumsum(rng.uniform(1.0, 5.0, 700)) * _DAY_S
    time_s = time_s[time_s < _YEARS * _YEAR_S]
    phase = 2 * np.pi * time_s / _YEAR_S
    weather = np.convolve(rng.standard_normal(time_s.size + 30), np.ones(30) / 6.0, "valid")
    sensors = {"T": 20.0 + 4.0 * np.sin(phase) + 2.0 * weather[: time_s.size]}
    behind = terms.Lagged("T", tau_s=_TRUE_LAG_D * _DAY_S)
    clean = _TRUE_SENSITIVITY * (behind.columns(sensors, time_s)[:, 0] - 20.0)
    clean += 0.4 * time_s / _YEAR_S + np.cos(2 * phase) + 2.5 * (time_s > _STEP_YEAR * _YEAR_S)
    bad = 30.0 * (rng.random(time_s.size) < bad_percent / 100)
    angle = clean + noise_arcsec * rng.standard_normal(time_s.size) + bad
    model: Any = terms.Offset()
    if temperature:
        model += terms.Lagged("T", tau_s=lag_d * _DAY_S) if lag_d else terms.Linear("T")
    if trend:
        model += terms.Trend(1)
    if season:
        model += terms.Fourier(_YEAR_S, season)
    if step:
        model += terms.Steps((_STEP_YEAR * _YEAR_S,))
    radians = lb.units.arcsec_to_rad(angle)
    solver: Any = lb.LeastSquares() if loss == "none" else lb.IRLS(loss)
    labels = "year" if folds == "years" else int(folds)
    judged = lb.cross_validate(
        model, radians, sensors, time_s, folds=labels, horizon=horizon, solver=solver
    )
    fit = lb.identify(model, radians, sensors, time_s, solver=solver)
    return {
        "time_s": time_s,
        "angle_arcsec": angle,
        "fit": fit,
        "predicted_arcsec": lb.units.rad_to_arcsec(fit.predict(sensors, time_s)),
        "judged": judged,
        "error_arcsec": float(lb.units.rad_to_arcsec(judged.sigma)),
    }


class IdentifyExplorer(Explorer):
    """Five years of a line of sight behind a temperature, with a trend, a season, a step and gross
    errors: terms on and off, and how well each model predicts years that it has not seen.
    """

    controls: ClassVar[dict[str, Control]] = {
        "lag_d": Slider("lag of the temperature", 0, 0, 60, 1, "d"),
        "temperature": Choice("temperature", {"in the model": True, "left out": False}, True),
        "trend": Choice("trend", {"in the model": True, "left out": False}, False),
        "season": Slider("harmonics of the year", 0, 0, 3, 1),
        "step": Choice("step", {"in the model": True, "left out": False}, False),
        "loss": Choice("loss", _LOSSES, "huber"),
        "folds": Choice("folds", {"years": "years", "3 blocks": "3", "10 blocks": "10"}, "years"),
        "horizon": Choice(
            "fitted to", {"all other folds": "left out", "those before": "forward"}, "left out"
        ),
        "noise_arcsec": LogSlider("noise", 0.3, 0.01, 3.0, unit="″"),
        "bad_percent": Slider("gross errors of 30″", 2, 0, 20, 1, "%"),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(years_of_drift)
    answer = 'seen["error_arcsec"], seen["judged"]'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "all that is there": {"lag_d": 10, "trend": True, "season": 2, "step": True},
        "season for temperature": {"temperature": False, "season": 2, "trend": True},
        "least squares": {"loss": "none", "bad_percent": 10},
    }
    size_in = (8.4, 3.7)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the series with the model, what left-out folds miss, and the bars beside them."""
        self._series, self._left, self._bars = figure.subplots(1, 3, width_ratios=(1, 1, 0.8))
        dots = {"ls": "none", "marker": ".", "ms": 3}
        (self._seen,) = self._series.plot([], [], color=COLOURS["sky"], label="measured", **dots)
        (self._model,) = self._series.plot([], [], color=COLOURS["vermilion"], lw=1.2)
        self._model.set_label("model")
        (self._error,) = self._left.plot([], [], color=COLOURS["blue"], **dots)
        self._error.set_label("predicted unseen")
        (self._far,) = self._left.plot([], [], "x", ms=4, color=COLOURS["vermilion"])
        self._far.set_label("set aside by the fit")
        below = {"fontsize": 8, "loc": "upper left", "bbox_to_anchor": (-0.02, -0.22)}
        for axis, title in ((self._series, "series"), (self._left, "left over")):
            axis.set(title=title, xlabel="years", ylabel="angle (″)", xlim=(0, _YEARS))
            axis.set_ylim(-8, 8)
            axis.legend(**below)
        names = ["model", *_BARS.values()]
        self._rects = self._bars.barh(names, np.ones(len(names)), color="#AAAAAA")
        self._rects[0].set_color(COLOURS["blue"])
        self._bars.set(title="error of unseen", xlabel="″", xlim=(0, 6))
        self._bars.invert_yaxis()
        self._bars.tick_params(axis="y", labelsize=8)
        return [self._seen, self._model, self._error, self._far, *self._rects]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Fit and judge, and draw what came of it."""
        seen = self.experiment(**settings)
        years, judged, fit = seen["time_s"] / _YEAR_S, seen["judged"], seen["fit"]
        middle = float(np.median(seen["angle_arcsec"]))
        self._seen.set_data(years, np.clip(seen["angle_arcsec"] - middle, -7.8, 7.8))
        self._model.set_data(years, seen["predicted_arcsec"] - middle)
        errors = np.clip(lb.units.rad_to_arcsec(judged.errors), -7.8, 7.8)
        self._error.set_data(years, errors)
        self._far.set_data(years[fit.rejected], errors[fit.rejected])
        sizes = [judged.sigma, *(judged.baselines[name] for name in _BARS)]
        for rect, size in zip(self._rects, sizes, strict=True):
            rect.set_width(min(np.nan_to_num(float(lb.units.rad_to_arcsec(size))), 6.0))
        rows = {
            "error of folds left out (″)": f"{seen['error_arcsec']:.3f}",
            "of the last value, without a model (″)": _arcsec(judged.baselines["last"]),
            "set aside by the fit": f"{int(fit.rejected.sum())} of {years.size}",
        }
        if settings["temperature"]:
            low, high = fit.interval[0]
            rows[f"sensitivity (″/°C); the truth is {_TRUE_SENSITIVITY:g} at rest"] = (
                f"{fit.sensitivity[0]:.3f}, 95 % {low:.3f} to {high:.3f}"
            )
        if judged.not_predictable:
            rows["cannot be predicted"] = ", ".join(judged.not_predictable)
        return rows


def _arcsec(angle: Any) -> str:
    return f"{float(lb.units.rad_to_arcsec(angle)):.3f}"
