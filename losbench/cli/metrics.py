"""``losbench metrics``: the pointing metrics of any series."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from losbench.cli.arguments import Commands
from losbench.cli.series import add_series, series_of

__all__ = ["add"]


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
    from losbench.pointing.performance import pointing_metrics
    from losbench.pointing.performance.budget import read_requirements
    from losbench.resources import free_folder, write_whole

    folder = None if options.out is None else free_folder(options.out, force=options.force)
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
    if folder is not None:
        style: Any = {"index": False, "lineterminator": "\n", "float_format": "%.9g"}
        write_whole(folder / "metrics.csv", table.to_csv(**style))
        write_whole(folder / "percentiles.csv", percentiles.to_csv(**style))
        write_whole(folder / "report.txt", "\n".join(lines) + "\n")
    if not options.quiet:
        print("\n".join(lines))
    return 0
