"""What reports say of pointing metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from losbench.page import section, sentences, table
from losbench.pointing.performance import PointingMetrics
from losbench.pointing.told.numbers import between, finite, short
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["METRICS", "metric_numbers", "metric_sentences", "metrics_figure", "metrics_section"]

METRICS = ("ape", "mpe", "rpe", "smear", "jitter")
_MARKS = "os^D"
_MEANING = (
    "One sigma (rms), as ECSS-E-ST-60-10C names them. APE: all of the error; MPE: that of a "
    "window's mean; RPE: what moves within a window, of which smear is the straight motion and "
    "jitter the rest."
)


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


def metrics_section(
    found: PointingMetrics, names: Mapping[str, str], *drawn: str, title: str = ""
) -> str:
    """Of a page: a row a metric, and pictures."""
    rows = []
    for key in METRICS:
        metric = getattr(found, key)
        cells = [
            (
                short(float(rad_to_arcsec(metric.value[i]))),
                between(*map(float, rad_to_arcsec(metric.interval[i]))),
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


def _word(key: str) -> str:
    return key.upper() if len(key) == 3 else key
