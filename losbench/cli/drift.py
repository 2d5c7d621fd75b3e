"""``losbench drift``: take boresight drift out of a pair's quaternions."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from losbench.cli.arguments import (
    Commands,
    add_dialect,
    add_json,
    dialect_options,
    made_by,
    tell,
)

if TYPE_CHECKING:
    from losbench.pointing.starcamera import QuaternionConvention

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "drift",
        parents=[quiet],
        help="take boresight drift out of a star-camera pair's quaternions",
    )
    parser.add_argument(
        "telemetry",
        type=Path,
        nargs="+",
        help="CSV: times, quaternions of two heads or more, spot positions if there are any; "
        "or a file for each head",
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
        "--convention",
        metavar="SCALAR,DIRECTION",
        help="of the quaternions, e.g. first,camera_to_inertial; default as the TOML says",
    )
    parser.add_argument(
        "--heads", metavar="J,K", help="which two, of more; default every pair of them"
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
    parser.add_argument(
        "--aem",
        nargs=5,
        metavar=("FRAME", "HEAD1", "HEAD2", "OBJECT", "ID"),
        help="write CCSDS AEM files too: inertial frame, frames of the heads, object and its id",
    )
    add_dialect(parser)
    add_json(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.telemetry.aem import AttitudeMessage
    from losbench.telemetry.correct import correct_telemetry

    given = options.aem
    message = AttitudeMessage(tuple(given[:3]), tuple(given[3:])) if given else None
    described = options.columns or options.telemetry[0].with_suffix(".toml")
    report = correct_telemetry(
        options.telemetry,
        options.out,
        columns=options.columns,
        convention=_convention(options.convention),
        heads=None if options.heads is None else _heads(options.heads),
        smooth_s=options.smooth_s,
        window=options.window,
        track_gap_s=options.track_gap_s,
        max_gap_s=options.max_gap_s,
        message=message,
        force=options.force,
        made=made_by(options, [*options.telemetry, described]),
        **dialect_options(options),
    )
    tell(options, report.summary())
    return 0


def _convention(text: str | None) -> QuaternionConvention | None:
    from losbench.pointing.starcamera import QuaternionConvention

    if text is None:
        return None
    scalar, _, direction = text.partition(",")
    return QuaternionConvention(scalar=scalar, direction=direction)  # type: ignore[arg-type]


def _heads(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-4]),([1-4])", text)
    if found is None or found[1] == found[2]:
        raise ValueError(f"--heads must be two different numbers such as 1,3, got {text!r}")
    return int(found[1]), int(found[2])
