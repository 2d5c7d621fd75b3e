"""``losbench identify``: from temperatures to line of sight, for any series."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands, made_by
from losbench.cli.series import add_series, series_of

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "identify",
        parents=[quiet],
        help="fit angles to temperatures, lags, trends, steps and seasons; compensate them",
    )
    add_series(parser)
    parser.add_argument("--temperatures", nargs="+", default=[], metavar="COLUMN")
    parser.add_argument(
        "--lag",
        default="spectrum",
        metavar="SECONDS|fit|spectrum|none",
        help="known, one per temperature, every lag (%(default)s), or none",
    )
    parser.add_argument("--linear", nargs="+", default=[], metavar="COLUMN", help="without a lag")
    parser.add_argument("--trend", type=int, metavar="DEGREE", help="powers of time")
    parser.add_argument("--steps", nargs="+", type=float, metavar="SECONDS", help="steps, by time")
    parser.add_argument("--period-s", type=float, help="of a season or an orbit")
    parser.add_argument("--harmonics", type=int, default=1, help="of the period (%(default)s)")
    parser.add_argument("--solver", default="irls", choices=["irls", "ls", "mm", "lts"])
    parser.add_argument("--folds", help="cross-validate: a number of blocks, or year")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument(
        "--force", action="store_true", help="write into an existing folder that is not empty"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.outputs import claim
    from losbench.pointing.thermal import terms
    from losbench.telemetry.identified import WRITTEN, write_identification

    inputs = [options.series]
    with claim(options.out, inputs=inputs, writes=WRITTEN, force=options.force) as results:
        made = made_by(options, inputs)
        series = series_of(options, [*options.temperatures, *options.linear])
        model: terms.Adds = terms.Offset()
        if options.temperatures:
            if options.lag == "none":
                model += terms.Linear(*options.temperatures)
            else:
                model += terms.Lagged(*options.temperatures, tau_s=_lag(options.lag))
        if options.linear:
            model += terms.Linear(*options.linear)
        if options.trend:
            model += terms.Trend(options.trend)
        if options.steps:
            model += terms.Steps(tuple(options.steps))
        if options.period_s:
            model += terms.Fourier(options.period_s, options.harmonics)
        folds = options.folds
        if folds not in (None, "year"):
            if not str(folds).isdigit():
                raise ValueError(f"--folds must be a whole number or year, got {folds!r}")
            folds = int(folds)
        lines = write_identification(
            series, model, results, solver=options.solver, folds=folds, made=made
        )
    if not options.quiet:
        print("\n".join(lines))
    return 0


def _lag(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
