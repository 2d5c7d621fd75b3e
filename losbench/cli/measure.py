"""``losbench measure``: frames to a table of shifts and angles."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "measure", parents=[quiet], help="your own frames to a table of shifts and angles"
    )
    parser.add_argument(
        "frames",
        type=Path,
        help="folder of PNG/TIFF or target pixel files; or a TIFF, .npy, .npz, FITS file",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument(
        "--force", action="store_true", help="write into an existing folder that is not empty"
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
        "--times", type=Path, metavar="CSV", help="frame times, column time_s or time"
    )
    parser.add_argument(
        "--period-s", type=float, help="time between frames, if there is no such file"
    )
    parser.add_argument("--start", metavar="UTC", help="time of the first frame, with --period-s")
    parser.add_argument(
        "--spots",
        metavar="X,Y ...",
        help='spot positions in the first frame, "690,539 1230,539"; default found',
    )
    parser.add_argument(
        "--n-spots", type=int, help="how many spots to find; default all that stand out"
    )
    parser.add_argument(
        "--method",
        default="eiwa",
        choices=["eiwa", "grey", "weighted", "gaussian"],
        help="centroid (%(default)s)",
    )
    parser.add_argument(
        "--window", type=int, help="window side in pixels, odd; default 6 sigma of the spot"
    )
    parser.add_argument(
        "--background", default="ring", choices=["ring", "none"], help="background (%(default)s)"
    )
    parser.add_argument(
        "--reference",
        default="first",
        metavar="first|K",
        help="shifts count from the first frame or the mean of K",
    )
    parser.add_argument(
        "--smooth", choices=["kalman"], help="smooth the positions before taking shifts"
    )
    parser.add_argument(
        "--model", default="pinhole", choices=["pinhole", "paper"], help="geometry (%(default)s)"
    )
    parser.add_argument(
        "--solver", default="auto", choices=["auto", "irls", "ls"], help="angles (%(default)s)"
    )
    parser.add_argument(
        "--unreadable",
        default="stop",
        choices=["stop", "skip"],
        help="what a broken frame does (%(default)s)",
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.imaging.detector import Detector
    from losbench.logs import read_temperature_log
    from losbench.optics.camera import Camera
    from losbench.recording.measure import measure
    from losbench.recording.readers import read_recording
    from losbench.recording.report import write_report
    from losbench.resources import free_folder

    # What can be wrong with the arguments is found before the frames are read, which may take
    # minutes.
    folder = free_folder(options.out, force=options.force)
    camera = Camera.from_toml(options.camera) if options.camera else None
    detector = Detector.from_toml(options.camera) if options.camera else None
    log = (
        read_temperature_log(options.temperature, columns=_columns(options.column))
        if options.temperature
        else None
    )
    recording = read_recording(
        options.frames,
        times=options.times,
        period_s=options.period_s,
        start=options.start,
        on_unreadable=options.unreadable,
    )
    measurement = measure(
        recording,
        camera,
        spots=_spots(options.spots),
        n_spots=options.n_spots,
        temperature=log,
        detector=detector,
        method=options.method,
        window=options.window,
        background=options.background,
        reference=options.reference
        if options.reference == "first"
        else _whole("reference", options.reference),
        smooth=options.smooth,
        model=options.model,
        solver=options.solver,
        progress=not options.quiet,
    )
    lines = write_report(measurement, folder, recording=recording)
    if not options.quiet:
        print("\n".join(lines))
    return 0


def _columns(pairs: list[str]) -> dict[str, str]:
    for pair in pairs:
        if "=" not in pair:
            raise ValueError(
                f"--column must be STANDARD=OWN, e.g. temperature_degC=T1, got {pair!r}"
            )
    return dict(pair.split("=", 1) for pair in pairs)


def _spots(text: str | None) -> list[list[float]] | None:
    if text is None:
        return None
    try:
        return [[float(x), float(y)] for x, y in (pair.split(",") for pair in text.split())]
    except ValueError:
        raise ValueError(
            f'--spots must be X,Y pairs in pixels, e.g. "690.3,539.1 1229.8,538.6", got {text!r}'
        ) from None


def _whole(name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"--{name} must be 'first' or a whole number, got {text!r}") from None
