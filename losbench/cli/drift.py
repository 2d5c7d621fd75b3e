"""``losbench drift``: take boresight drift out of a pair's quaternions."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands, add_dialect, dialect_options

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "drift",
        parents=[quiet],
        help="take boresight drift out of a star-camera pair's quaternions",
    )
    parser.add_argument(
        "telemetry", type=Path, help="CSV: times, quaternions of two heads, spot positions"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument(
        "--force", action="store_true", help="write into an existing folder that is not empty"
    )
    parser.add_argument(
        "--columns",
        type=Path,
        metavar="TOML",
        help="names and conventions; default the CSV's name with .toml",
    )
    parser.add_argument(
        "--smooth-s", type=float, help="average the drift over so many seconds before it corrects"
    )
    parser.add_argument(
        "--window",
        type=int,
        default=5,
        help="samples of the mean that splits LSFE from NEA (%(default)s)",
    )
    parser.add_argument(
        "--track-gap-s",
        type=float,
        default=60.0,
        help="a longer gap begins a new track (%(default)s)",
    )
    parser.add_argument(
        "--max-gap-s",
        type=float,
        default=10.0,
        help="interpolate the drift between spots so far apart (%(default)s)",
    )
    add_dialect(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.telemetry.correct import correct_telemetry

    report = correct_telemetry(
        options.telemetry,
        options.out,
        columns=options.columns,
        smooth_s=options.smooth_s,
        window=options.window,
        track_gap_s=options.track_gap_s,
        max_gap_s=options.max_gap_s,
        force=options.force,
        **dialect_options(options),
    )
    if not options.quiet:
        print(report.summary())
    return 0
