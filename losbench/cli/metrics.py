"""``losbench metrics``: the pointing metrics of any series."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from losbench.cli.arguments import Commands, publishing
from losbench.cli.series import add_series, series_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["add"]

_WRITTEN = ("metrics.csv", "percentiles.csv", "report.txt")


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "metrics", parents=[quiet], help="APE, MPE, RPE, PDE, PRE, smear and jitter of a series"
    )
    add_series(parser)
    parser.add_argument("--window-s", type=float, required=True, help="length of a window")
    parser.add_argument("--separation-s", type=float, help="between two windows, for the PDE")
    parser.add_argument("--route", default="windows", choices=["windows", "spectrum"])
    parser.add_argument("--require", type=Path, metavar="BUDGET.toml", help="requirements to judge")
    parser.add_argument("--out", type=Path, help="folder for metrics.csv, percentiles.csv, report")
    parser.add_argument(
        "--force", action="store_true", help="write into an existing folder that is not empty"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    inputs = [path for path in (options.series, options.require) if path is not None]
    with publishing(options, inputs, _WRITTEN) as publish:
        table, percentiles, lines = _judged(options)
        style: Any = {"index": False, "lineterminator": "\n", "float_format": "%.9g"}
        report = "\n".join(lines) + "\n"
        publish(
            dict(
                zip(
                    _WRITTEN,
                    (table.to_csv(**style), percentiles.to_csv(**style), report),
                    strict=True,
                )
            )
        )
    if not options.quiet:
        print("\n".join(lines))
    return 0


def _judged(options: argparse.Namespace) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
    """Metrics, percentiles, and the report's lines."""
    from losbench.pointing.performance import pointing_metrics
    from losbench.pointing.performance.budget import read_requirements

    series = series_of(options)
    found = pointing_metrics(
        series.angles,
        series.time_s,
        options.window_s,
        options.separation_s,
        route=options.route,
    )
    table, percentiles = found.table(), found.percentiles()
    table["axis"] = [series.names[i - 1] for i in table["axis"]]
    lines = [
        *series.notes,
        f"{found.windows} windows of {found.window_s:g} s used, {found.dropped} dropped for gaps",
        table.dropna(subset=["value_arcsec"]).round(6).to_string(index=False),
        percentiles.round(6).to_string(index=False),
        *found.notes,
    ]
    if options.require is not None:
        for need in read_requirements(options.require):
            verdicts = zip(series.names, found.verdict(need), strict=True)
            said = ", ".join(f"{name} {verdict}" for name, verdict in verdicts)
            lines.append(f"{need.id} ({need.index} x {need.factor:.3g}): {said}")
    return table, percentiles, lines
