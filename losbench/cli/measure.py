"""``losbench measure``: frames to a table of shifts and angles."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import (
    Commands,
    add_dialect,
    add_json,
    dialect_options,
    made_by,
    pairs,
    tell,
)
from losbench.cli.choices import (
    add_choices,
    angles_of,
    background_of,
    centroid_of,
    reference_of,
    spots_of,
)
from losbench.cli.frames import add_frames, recording_of
from losbench.cli.workers import add_workers, run_of

__all__ = ["add"]

_COLUMN = "--{}column must be STANDARD=OWN, e.g. temperature_degC=T1"
_FILES = """\
temperature log (--temperature), CSV; seconds on the frames' clock, or moments, or both:
    time_s,temperature_room_degC,temperature_mirror_degC
    0,18.00,18.41
    60,18.02,18.44
  Semicolons, tabs, decimal commas, °F and K, titles above, rows of units are understood:
    Datum;Uhrzeit;Temperatur (°C)
    01.03.2026;13:00:00;18,0
  Times without an offset from UTC are taken as UTC, and it says so: see --utc-offset.
  Other names: --column time=Clock --column temperature_degC=T1

frame times (--times), CSV, one row a frame in order; time_s or time:
    time
    2026-03-01T12:00:00.0Z
    2026-03-01T12:00:05.0Z

camera (--camera), TOML:
    focal_mm = 260.0
    pixel_um = 10.0
    shape = [1080, 1920]          # rows, columns
    principal_px = [959.5, 539.5] # optional: x, y; default the middle
    [detector]                    # optional, for the predicted errors
    gain_e_per_dn = 4.0
    read_noise_e = 5.0
    offset_dn = 100.0
    bits = 12                     # full scale 4095; default 16
    full_well_e = 90000.0         # default none
    prnu = 0.01                   # relative, with prnu_seed = 0; default 0
    hot_pixels = [[812, 40, 9e3]] # x, y, electrons; default none
"""


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "measure",
        parents=[quiet],
        help="your own frames to a table of shifts and angles",
        epilog=_FILES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_frames(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument(
        "--force",
        action="store_true",
        help="write into an existing folder that is not empty, or drop a run that was cut off",
    )
    parser.add_argument(
        "--camera", type=Path, help="TOML with focal_mm, pixel_um, shape; without it shifts only"
    )
    parser.add_argument(
        "--temperature",
        type=Path,
        metavar="LOG.csv",
        help="temperature log, matched to the frames' times",
    )
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="STANDARD=OWN",
        help="name of a log column, e.g. temperature_degC=T1",
    )
    parser.add_argument(
        "--window-s",
        type=float,
        metavar="SECONDS",
        help="windows of the pointing metrics (a tenth of the record)",
    )
    add_choices(parser)
    add_workers(parser)
    add_dialect(parser)
    add_json(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.imaging.detector import Detector
    from losbench.imaging.eiwa import EIWA
    from losbench.imaging.weighted import Weighted
    from losbench.logs import read_temperature_log, read_times
    from losbench.optics.camera import Camera
    from losbench.outputs import claim
    from losbench.recording.measure import measure
    from losbench.recording.report import WRITTEN, write_report
    from losbench.recording.second import second_opinion

    # What can be wrong with the arguments or the folder is found before the frames are read, which
    # may take minutes.
    camera = Camera.from_toml(options.camera) if options.camera else None
    detector = Detector.from_toml(options.camera) if options.camera else None
    dialect = dialect_options(options)
    log = (
        read_temperature_log(
            options.temperature, columns=pairs(options.column, _COLUMN.format("")), **dialect
        )
        if options.temperature
        else None
    )
    named = pairs(options.times_column, _COLUMN.format("times-"))
    times = read_times(options.times, None, columns=named, **dialect) if options.times else None
    calibration = [options.dark, options.flat, options.bad_pixels]
    tables = [options.camera, options.temperature, options.times]
    inputs = [path for path in [*options.frames, *calibration, *tables] if path is not None]
    with (
        claim(options.out, inputs=inputs, writes=WRITTEN, force=options.force) as results,
        run_of(options) as run,
    ):
        made = made_by(options, inputs)
        recording = recording_of(options, detector, times)
        centroid, background = centroid_of(options), background_of(options)
        measurement = measure(
            recording,
            camera,
            spots=spots_of(options),
            temperature=log,
            centroid=centroid,
            background=background,
            solver=angles_of(options),
            reference=reference_of(options),
            run=run,
        )
        chosen = measurement.surveys[0].method
        other = second_opinion(
            recording,
            measurement,
            EIWA(centroid.window) if chosen.template else Weighted(window=centroid.window),
            background=background,
        )
        lines = write_report(
            measurement,
            results,
            recording=recording,
            other=other,
            made=made,
            window_s=options.window_s,
        )
        tell(options, "\n".join(lines))
    return 0
