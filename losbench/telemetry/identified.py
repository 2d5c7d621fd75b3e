"""An identification on disk: model, table, compensated angles, picture, report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from losbench.made import Made, head_of
from losbench.outputs import Claim, into
from losbench.pointing.thermal import Identification, cross_validate, identify
from losbench.pointing.thermal.terms import Adds
from losbench.telemetry.series import AngleSeries
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["WRITTEN", "write_identification"]

WRITTEN = (
    "sensitivity.csv",
    "compensated.csv",
    "folds.csv",
    "angles.png",
    "report.txt",
    "model.toml",
)


def write_identification(
    series: AngleSeries,
    model: Adds,
    folder: Path | Claim,
    *,
    solver: str = "irls",
    folds: str | int | None = None,
    made: Made | None = None,
) -> list[str]:
    """Write ``model.toml``, ``sensitivity.csv``, ``compensated.csv``, ``angles.png``,
    ``report.txt`` and ``report.json``; with folds ``folds.csv``.

    Returns
    -------
    list of str
        The report's lines.
    """
    import pandas as pd

    from losbench.figures import png, styled

    found = identify(model, series.angles, series.sensors, series.time_s, solver=solver)
    predicted = found.predict(series.sensors, series.time_s)
    table = found.table()
    table["axis"] = [series.names[i - 1] for i in table["axis"]]
    columns = {"time_s": series.time_s}
    for i, name in enumerate(series.names):
        angle = rad_to_arcsec(series.angles[:, i])
        stem = name.removesuffix("_arcsec")
        columns[f"{stem}_arcsec"] = angle
        columns[f"{stem}_predicted_arcsec"] = rad_to_arcsec(predicted[:, i])
        columns[f"{stem}_compensated_arcsec"] = angle - rad_to_arcsec(predicted[:, i])
        columns[f"{stem}_rejected"] = found.rejected[:, i].astype(float)
    lines = [
        *series.notes,
        *([] if table.empty else [table.round(5).to_string(index=False)]),
        *_lags(found, series),
        *found.notes,
    ]
    files: dict[str, str | bytes] = {
        "sensitivity.csv": table.to_csv(index=False, lineterminator="\n", float_format="%.9g"),
        "compensated.csv": pd.DataFrame(columns).to_csv(
            index=False, lineterminator="\n", float_format="%.9g"
        ),
    }
    if folds is not None:
        judged = cross_validate(
            model, series.angles, series.sensors, series.time_s, folds=folds, solver=solver
        )
        by_fold = judged.table().set_axis(list(series.names), axis=1)
        files["folds.csv"] = by_fold.to_csv(lineterminator="\n", float_format="%.6g")
        lines += ["Sigma about zero of folds left out, and of baselines, arcsec:"]
        lines += by_fold.round(4).to_string().splitlines()
        if judged.not_predictable:
            lines.append(f"Not predictable: {', '.join(judged.not_predictable)}")
    with styled():
        files["angles.png"] = png(_picture(series, predicted))
    files["report.txt"] = "\n".join(lines) + "\n"
    files["model.toml"] = found.fitted.to_toml()
    with into(folder, WRITTEN) as results:
        for name, content in files.items():
            results.write(name, content)
        results.publish(head_of("identification", made or Made()))
    return [*lines, f"Written to {results.folder}: {', '.join([*files, 'report.json'])}"]


def _lags(found: Identification, series: AngleSeries) -> list[str]:
    return [
        f"{series.names[i]}: lag {k + 1} {state}"
        + ("" if np.isnan(found.tau_s[i, k]) else f", {found.tau_s[i, k]:.4g} s")
        + " ({:.4g} to {:.4g} s)".format(*found.tau_interval_s[i, k])
        for i in range(len(series.names))
        for k, state in enumerate(found.tau_state[i])
    ]


def _picture(series: AngleSeries, predicted: np.ndarray) -> Figure:
    from matplotlib.figure import Figure

    count = len(series.names)
    fig = Figure(figsize=(9.0, 2.4 * count + 0.6))
    axes = fig.subplots(count, 2, sharex=True, squeeze=False)
    for i, name in enumerate(series.names):
        angle, model = rad_to_arcsec(series.angles[:, i]), rad_to_arcsec(predicted[:, i])
        axes[i, 0].plot(series.time_s, angle, ".", ms=2, color="#999999", label="measured")
        axes[i, 0].plot(series.time_s, model, lw=1.0, label="model")
        left = angle - model
        axes[i, 1].plot(series.time_s, left, ".", ms=2)
        spread = 8.0 * float(np.nanmedian(np.abs(left))) or 1.0
        axes[i, 1].set(ylim=(-spread, spread), ylabel="left over (arcsec)")
        axes[i, 0].set_ylabel(f"{name.removesuffix('_arcsec')} (arcsec)")
        # Gross outliers would flatten everything else.
        low, high = np.nanpercentile(np.r_[angle, model], [0.5, 99.5])
        axes[i, 0].set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
    axes[0, 0].legend()
    for axis in axes[-1]:
        axis.set_xlabel("time (s)")
    return fig
