"""What the commands share that read a series of angles."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from losbench.cli.arguments import add_dialect, dialect_options

if TYPE_CHECKING:
    from losbench.telemetry.series import AngleSeries

__all__ = ["add_series", "series_of"]


def add_series(parser: argparse.ArgumentParser) -> None:
    """Add the file and its columns."""
    parser.add_argument("series", type=Path, help="CSV: times and angles, as measurement.csv")
    parser.add_argument(
        "--angles",
        nargs="+",
        required=True,
        metavar="COLUMN",
        help="columns of angles, their unit at the end of the name: alpha_arcsec",
    )
    parser.add_argument("--time", metavar="COLUMN", help="times: seconds or dates (time_s, time)")
    parser.add_argument("--angle-unit", metavar="UNIT", help="arcsec, mas, deg, urad, mrad or rad")
    add_dialect(parser)


def series_of(options: argparse.Namespace, sensors: Sequence[str] = ()) -> AngleSeries:
    """Read what `add_series` took."""
    from losbench.tables import Dialect
    from losbench.telemetry.series import read_angles

    return read_angles(
        options.series,
        options.angles,
        sensors,
        time=options.time,
        unit=options.angle_unit,
        dialect=Dialect(**dialect_options(options)),
    )
