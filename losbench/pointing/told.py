"""What reports say of sensitivities and pointing metrics: numbers, sentences, sections, pictures.

The series that they are about have names: a key for files, and words for sentences, as
``{"alpha": "about X"}``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats
from losbench.page import section, sentences, table
from losbench.pointing.performance import PointingMetrics
from losbench.pointing.thermal import Identification, identify
from losbench.pointing.thermal.terms import Lagged, Linear, Offset
from losbench.units import arcsec_to_rad, rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = [
    "METRICS",
    "Sensitivity",
    "compensated_figure",
    "finite",
    "metric_numbers",
    "metric_sentences",
    "metrics_figure",
    "metrics_section",
    "sensitivity_section",
    "sensitivity_to",
    "table_of",
]

METRICS = ("ape", "mpe", "rpe", "smear", "jitter")
_FEWEST = 10  # samples with a temperature, for a sensitivity
_SMALLEST_RANGE_DEGC = 0.5
_SHORTEST_LAG = 0.2  # median steps; a lag that may be shorter is none
_MANY = 3000  # points of a line, beyond which it is drawn as an image
_MARKS = "os^D"
_MEANING = (
    "One sigma (rms), as ECSS-E-ST-60-10C names them. APE: all of the error; MPE: that of a "
    "window's mean; RPE: what moves within a window, of which smear is the straight motion and "
    "jitter the rest."
)


@dataclass(frozen=True)
class Sensitivity:
    """What k series of n samples owe to one temperature.

    Attributes
    ----------
    column : str
        The temperature.
    names : dict of str
        Words for each series, by its key.
    found : Identification
        Every lag of that temperature.
    used : (n,) bool array
        Samples with a time and that temperature.
    predicted : (n, k) array, radians
        What goes with the temperature; NaN at samples that were not used.
    shortest_lag_s : float
        A lag that may be shorter is none.
    """

    column: str
    names: Mapping[str, str]
    found: Identification
    used: Bools
    predicted: Floats
    shortest_lag_s: float

    @property
    def one_lag_arcsec_per_degC(self) -> Floats:
        """What the best single lag says, (k,); its interval would be too narrow."""
        return rad_to_arcsec(self.found.fitted.coefficients[:, 1])

    @property
    def lag_s(self) -> Floats:
        """Lag of each series (k,), zero where none was fitted or none can be told from the data."""
        if not self.found.tau_s.shape[1]:
            return np.zeros(len(self.names))
        told = self.found.tau_interval_s[:, 0, 0] > self.shortest_lag_s
        return np.where(told, self.found.fitted.tau_s[:, 0], 0.0)

    @property
    def lag_state(self) -> list[str]:
        """State of each series' lag, "given" where none was fitted."""
        states = self.found.tau_state
        return states[:, 0].tolist() if states.shape[1] else ["given"] * len(self.names)

    @property
    def rms_arcsec(self) -> Floats:
        """What compensation leaves over, (k,)."""
        return rad_to_arcsec(np.sqrt(np.nanmean(self.found.residuals**2, axis=0)))

    def numbers(self) -> dict[str, dict[str, Any]]:
        """By series, what `sentences` says, as report.json has it; a lag of zero is none."""
        found, lags = self.found, self.found.tau_s.shape[1]
        return {
            key: {
                "arcsec_per_degC": finite(found.sensitivity[i, 0]),
                "interval_95_arcsec_per_degC": [finite(v) for v in found.interval[i, 0]],
                "one_lag_arcsec_per_degC": finite(self.one_lag_arcsec_per_degC[i]),
                "lag_s": finite(self.lag_s[i], 3),
                "lag_interval_95_s": [finite(v, 3) for v in found.tau_interval_s[i, :1].ravel()],
                "lag_state": self.lag_state[i],
                "one_lag_p_value": finite(found.lack_of_fit[i].f_p_value, 30) if lags else None,
                "white_p_value": finite(found.lack_of_fit[i].neumann_p_value, 30) if lags else None,
                "set_aside": int(found.rejected[:, i].sum()),
                "rms_arcsec": finite(self.rms_arcsec[i]),
            }
            for i, key in enumerate(self.names)
        }

    def sentences(self) -> list[str]:
        """Say it, a series a line."""
        k, (low, high) = self.found.sensitivity[:, 0], self.found.interval[:, 0].T
        lines = []
        for i, (name, lag_s) in enumerate(zip(self.names.values(), self.lag_s, strict=True)):
            lag = f"lag {lag_s / 60:.1f} min" if lag_s > 0 else "no lag"
            one = self.one_lag_arcsec_per_degC[i]
            if not low[i] <= one <= high[i]:
                lag += f", over all lags: one alone gives {one:+.4f}"
            if self.lag_state[i] == "not identifiable":
                lag += ", not identifiable: one as long as the record fits as well"
            lines.append(
                f"Sensitivity {name} to {self.column}: {k[i]:+.4f} arcsec/degC (95 %: "
                f"{low[i]:+.4f} to {high[i]:+.4f}), {lag}, {self.rms_arcsec[i]:.4f} arcsec rms "
                "left after compensation"
            )
        return lines

    def notes(self) -> list[str]:
        """What the identification noticed, by the names of the series."""
        named = {
            f"Axis {i}: ": f"{name[0].upper()}{name[1:]}: "
            for i, name in enumerate(self.names.values(), 1)
        }
        notes = []
        for note in self.found.notes:
            start = next((start for start in named if note.startswith(start)), "")
            notes.append(named.get(start, "") + note.removeprefix(start))
        return notes

    def compensated(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a table of ``KEY_arcsec`` with the same less what goes with the temperature."""
        columns = {
            f"{key}_compensated_arcsec": frame[f"{key}_arcsec"]
            - rad_to_arcsec(self.predicted[:, i])
            for i, key in enumerate(self.names)
        }
        return frame.assign(**columns)


def sensitivity_to(
    column: str, frame: pd.DataFrame, names: Mapping[str, str], *, others: tuple[str, ...] = ()
) -> Sensitivity | None:
    """Fit columns ``KEY_arcsec`` of a table to one of temperatures, if it says anything; with every
    lag where times (``time_s``) increase. Other temperatures tell whether one was left out.
    """
    time_s = frame["time_s"].to_numpy()
    angles = arcsec_to_rad(np.stack([frame[f"{key}_arcsec"].to_numpy() for key in names], axis=1))
    used = np.isfinite(frame[[column, "time_s"]].to_numpy()).all(axis=1)
    celsius, seen = frame[column].to_numpy()[used], np.isfinite(angles[used]).all(axis=1)
    if seen.sum() < _FEWEST or np.ptp(celsius[seen]) < _SMALLEST_RANGE_DEGC:
        return None
    timed = bool((np.diff(time_s[used]) > 0).all())
    clock = time_s[used] if timed else np.arange(float(celsius.size))
    sensors = {name: frame[name].to_numpy()[used] for name in dict.fromkeys((column, *others))}
    term = Lagged(column, tau_s="spectrum") if timed else Linear(column)
    found = identify(Offset() + term, angles[used], sensors, clock)
    predicted = np.full(angles.shape, np.nan)
    predicted[used] = found.predict({column: celsius}, clock)
    shortest_s = _SHORTEST_LAG * float(np.nanmedian(np.diff(time_s)))
    return Sensitivity(column, names, found, np.asarray(used), predicted, shortest_s)


def metric_numbers(found: PointingMetrics, names: Mapping[str, str]) -> dict[str, Any]:
    """Metrics as report.json has them."""
    series: dict[str, dict[str, Any]] = {}
    for i, key in enumerate(names):
        series[key] = {}
        for name in METRICS:
            metric = getattr(found, name)
            interval = rad_to_arcsec(metric.interval[i])
            series[key][f"{name}_arcsec"] = finite(float(rad_to_arcsec(metric.value[i])))
            series[key][f"{name}_interval_95_arcsec"] = [finite(v) for v in interval]
    return {
        "window_s": finite(found.window_s),
        "windows": found.windows,
        "dropped": found.dropped,
        "series": series,
        "notes": list(found.notes),
    }


def metric_sentences(found: PointingMetrics, names: Mapping[str, str]) -> list[str]:
    """Say the metrics, a series a line."""
    lines = []
    for i, name in enumerate(names.values()):
        parts = []
        for key in METRICS:
            metric = getattr(found, key)
            low, high = rad_to_arcsec(metric.interval[i])
            between = f" ({low:.3g} to {high:.3g})" if np.isfinite(low) else " (no interval)"
            parts.append(f"{_word(key)} {float(rad_to_arcsec(metric.value[i])):.3g}{between}")
        lines.append(
            f"Pointing {name} in windows of {found.window_s:.4g} s, arcsec (95 %): "
            + ", ".join(parts)
        )
    return lines


def sensitivity_section(fit: Sensitivity, *drawn: str, title: str = "") -> str:
    """Of a page: a row a series, whether to trust it, and pictures."""
    heads = [
        "series",
        "sensitivity (arcsec/degC)",
        "95 % interval",
        "by one lag",
        "lag (s)",
        "lag is",
        "one lag fits, p",
        "left after compensation (arcsec rms)",
        "samples set aside",
    ]
    rows = [
        [
            _together(fit.names[key]),
            _short(each["arcsec_per_degC"]),
            _between(*each["interval_95_arcsec_per_degC"]),
            _short(each["one_lag_arcsec_per_degC"]),
            "" if each["lag_s"] is None else f"{each['lag_s']:.0f}",
            each["lag_state"],
            "" if each["one_lag_p_value"] is None else f"{each['one_lag_p_value']:.2g}",
            _short(each["rms_arcsec"]),
            each["set_aside"],
        ]
        for key, each in fit.numbers().items()
    ]
    return section(
        f"Sensitivity to temperature{title}",
        table(heads, rows, caption=f"Sensitivity to {fit.column}, at rest"),
        sentences(fit.notes()),
        *drawn,
    )


def metrics_section(
    found: PointingMetrics, names: Mapping[str, str], *drawn: str, title: str = ""
) -> str:
    """Of a page: a row a metric, and pictures."""
    rows = []
    for key in METRICS:
        metric = getattr(found, key)
        cells = [
            (
                _short(float(rad_to_arcsec(metric.value[i]))),
                _between(*map(float, rad_to_arcsec(metric.interval[i]))),
            )
            for i in range(len(names))
        ]
        rows.append([_word(key), *(cell for row in cells for cell in row)])
    ends = (" (arcsec)", ", 95 %")
    heads = ["metric", *(f"{name}{end}" for name in names.values() for end in ends)]
    caption = (
        f"Over {found.windows} windows of {found.window_s:.4g} s, with 95 % intervals; "
        f"{found.dropped} dropped for gaps"
    )
    return section(
        f"Pointing metrics{title}",
        table(heads, rows, caption=caption),
        sentences([_MEANING, *found.notes]),
        *drawn,
    )


def metrics_figure(found: PointingMetrics, names: Mapping[str, str]) -> Figure:
    """Each pointing metric of each series with its interval."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(8.0, 3.4))
    axis = fig.subplots()
    place = np.arange(len(METRICS))
    metrics = [getattr(found, key) for key in METRICS]
    for i, (name, mark) in enumerate(zip(names.values(), _MARKS, strict=False)):
        value = rad_to_arcsec(np.array([metric.value[i] for metric in metrics]))
        low, high = rad_to_arcsec(np.array([metric.interval[i] for metric in metrics])).T
        at = place + 0.18 * (i - 0.5 * (len(names) - 1))
        (line,) = axis.plot(at, value, mark, ms=5, label=name)
        axis.vlines(at, low, high, color=line.get_color(), lw=1.5)
    axis.set_xticks(place, [_word(key) for key in METRICS])
    axis.set(ylabel=f"windows of {found.window_s:.4g} s (arcsec)", yscale="log")
    axis.legend(ncols=3)
    return fig


def compensated_figure(
    fit: Sensitivity, frame: pd.DataFrame, along: NDArray[Any], label: str
) -> Figure:
    """Over time, each series beside what the temperature predicts, and what that leaves over."""
    from matplotlib.figure import Figure

    frame, many = fit.compensated(frame), len(frame) > _MANY
    fig = Figure(figsize=(8.0, 2.0 * len(fit.names) + 0.6))
    axes = fig.subplots(len(fit.names), 2, sharex=True, squeeze=False)
    far = np.zeros(fit.predicted.shape, dtype=bool)
    far[fit.used] = fit.found.rejected
    for i, (row, (key, name)) in enumerate(zip(axes, fit.names.items(), strict=True)):
        row[0].plot(along, frame[f"{key}_arcsec"], ".", ms=3, label="measured", rasterized=many)
        predicted = rad_to_arcsec(fit.predicted[:, i])
        row[0].plot(along, predicted, lw=1.2, label="by temperature", rasterized=many)
        row[0].set_ylabel(f"{name} (arcsec)")
        left = frame[f"{key}_compensated_arcsec"].to_numpy()
        row[1].plot(along, left, ".", ms=3, rasterized=many)
        row[1].plot(along[far[:, i]], left[far[:, i]], "x", color="#D55E00", label="set aside")
        row[1].set_ylabel("left over (arcsec)")
    axes[0, 0].legend()
    if far.any():
        axes[int(np.argmax(far.any(axis=0))), 1].legend()
    for axis in axes[-1]:
        axis.set_xlabel(label)
    return fig


def table_of(frame: pd.DataFrame, names: Mapping[str, str]) -> str:
    """CSV of a table of `Identification` or `PointingMetrics`, its axes by their keys."""
    keys = list(names)
    named = frame.assign(axis=[keys[i - 1] for i in frame["axis"]])
    return str(named.to_csv(index=False, lineterminator="\n", float_format="%.9g"))


def finite(value: float, digits: int = 6) -> float | None:
    """Return a number for a file, None where there is none: JSON knows no NaN."""
    return round(float(value), digits) if np.isfinite(value) else None


def _short(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else _digits(value)


def _digits(value: float) -> str:
    return f"{value:#.3g}".rstrip(".")


def _between(low: float | None, high: float | None) -> str:
    if low is None or high is None or not np.isfinite([low, high]).all():
        return ""
    return _together(f"{_digits(low)} to {_digits(high)}")


def _together(text: str) -> str:
    """Text that a narrow column does not break."""
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def _word(key: str) -> str:
    return key.upper() if len(key) == 3 else key
