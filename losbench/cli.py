"""The command line: ``losbench reproduce | measure | simulate | drift | ledger``.

Exit codes: 0 done; 1 a notebook failed, or a verdict is not the accepted one; 2 wrong arguments or
unusable input, said in one line; 130 interrupted; 141 whoever reads the output has gone.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from losbench.__about__ import __version__

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: print(
                f"losbench {options.command}: {message}", file=sys.stderr
            )
            code = int(options.run(options))
            sys.stdout.flush()
            return code
    except BrokenPipeError:
        _hush()
        return 141
    except (ValueError, OSError, ImportError) as error:
        print(f"losbench {options.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"losbench {options.command}: interrupted", file=sys.stderr)
        return 130


def _hush() -> None:
    """Send what is left to say nowhere: the interpreter would complain when it flushes a closed
    pipe at its end.
    """
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="losbench",
        description=(
            "Where a space camera really points: reproduce the papers, or measure your own frames."
        ),
    )
    parser.add_argument("--version", action="version", version=f"losbench {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    quiet = argparse.ArgumentParser(add_help=False)
    quiet.add_argument(
        "--quiet",
        action="store_true",
        help="no progress bars, no report; errors and exit code only",
    )

    one = commands.add_parser(
        "reproduce", parents=[quiet], help="run the notebooks: every figure, table and verdict"
    )
    one.add_argument(
        "select", nargs="*", metavar="NN", help="numbers of notebooks, e.g. 03 90; default all"
    )
    one.add_argument("--out", type=Path, help="where to write; default the build folder")
    one.add_argument("--workers", type=int, default=2, help="notebooks at a time (%(default)s)")
    one.add_argument("--force", action="store_true", help="run unchanged notebooks too")
    one.add_argument(
        "--accept", action="store_true", help="take the verdicts found as the accepted ones"
    )
    one.set_defaults(run=_reproduce)

    two = commands.add_parser(
        "measure", parents=[quiet], help="your own frames to a table of shifts and angles"
    )
    two.add_argument(
        "frames",
        type=Path,
        help="folder of PNG/TIFF or target pixel files; or a TIFF, .npy, .npz, FITS file",
    )
    two.add_argument("--out", type=Path, required=True, help="folder to write to")
    two.add_argument(
        "--force", action="store_true", help="write into an existing folder that is not empty"
    )
    two.add_argument(
        "--camera", type=Path, help="TOML with focal_mm, pixel_um, shape; without it shifts only"
    )
    two.add_argument(
        "--temperature",
        type=Path,
        metavar="LOG.csv",
        help="temperature log, matched to the frames' times",
    )
    two.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="STANDARD=OWN",
        help="name of a log column, e.g. temperature_degC=T1",
    )
    two.add_argument("--times", type=Path, metavar="CSV", help="frame times, column time_s or time")
    two.add_argument("--period-s", type=float, help="time between frames, if there is no such file")
    two.add_argument("--start", metavar="UTC", help="time of the first frame, with --period-s")
    two.add_argument(
        "--spots",
        metavar="X,Y ...",
        help='spot positions in the first frame, "690,539 1230,539"; default found',
    )
    two.add_argument(
        "--n-spots", type=int, help="how many spots to find; default all that stand out"
    )
    two.add_argument(
        "--method",
        default="eiwa",
        choices=["eiwa", "grey", "weighted", "gaussian"],
        help="centroid (%(default)s)",
    )
    two.add_argument(
        "--window", type=int, help="window side in pixels, odd; default 6 sigma of the spot"
    )
    two.add_argument(
        "--background", default="ring", choices=["ring", "none"], help="background (%(default)s)"
    )
    two.add_argument(
        "--reference",
        default="first",
        metavar="first|K",
        help="shifts count from the first frame or the mean of K",
    )
    two.add_argument(
        "--smooth", choices=["kalman"], help="smooth the positions before taking shifts"
    )
    two.add_argument(
        "--model", default="pinhole", choices=["pinhole", "paper"], help="geometry (%(default)s)"
    )
    two.add_argument(
        "--solver", default="auto", choices=["auto", "irls", "ls"], help="angles (%(default)s)"
    )
    two.add_argument(
        "--unreadable",
        default="stop",
        choices=["stop", "skip"],
        help="what a broken frame does (%(default)s)",
    )
    two.set_defaults(run=_measure)

    three = commands.add_parser(
        "simulate", parents=[quiet], help="write a digital twin's recording, with its truth"
    )
    three.add_argument("--out", type=Path, required=True, help="folder to write to")
    three.add_argument(
        "--paper",
        default="liu2026",
        choices=["liu2026", "ren2023"],
        help="frames of two spots, or telemetry of a star-camera pair (%(default)s)",
    )
    three.add_argument(
        "--frames", type=int, default=200, help="number of frames, liu2026 (%(default)s)"
    )
    three.add_argument("--seed", type=int, default=0, help="seed of the noise (%(default)s)")
    three.add_argument(
        "--force", action="store_true", help="replace an earlier simulation in an existing folder"
    )
    three.set_defaults(run=_simulate)

    five = commands.add_parser(
        "drift",
        parents=[quiet],
        help="take boresight drift out of a star-camera pair's quaternions",
    )
    five.add_argument(
        "telemetry", type=Path, help="CSV: times, quaternions of two heads, spot positions"
    )
    five.add_argument("--out", type=Path, required=True, help="folder to write to")
    five.add_argument(
        "--force", action="store_true", help="write into an existing folder that is not empty"
    )
    five.add_argument(
        "--columns",
        type=Path,
        metavar="TOML",
        help="names and conventions; default the CSV's name with .toml",
    )
    five.add_argument(
        "--smooth-s", type=float, help="average the drift over so many seconds before it corrects"
    )
    five.add_argument(
        "--window",
        type=int,
        default=5,
        help="samples of the mean that splits LSFE from NEA (%(default)s)",
    )
    five.add_argument(
        "--track-gap-s",
        type=float,
        default=60.0,
        help="a longer gap begins a new track (%(default)s)",
    )
    five.add_argument(
        "--max-gap-s",
        type=float,
        default=10.0,
        help="interpolate the drift between spots so far apart (%(default)s)",
    )
    five.set_defaults(run=_drift)

    four = commands.add_parser("ledger", parents=[quiet], help="show the claims and their verdicts")
    four.add_argument("--paper", help="one paper only, e.g. liu2026")
    four.set_defaults(run=_ledger)
    return parser


def _reproduce(options: argparse.Namespace) -> int:
    from losbench.workbench.reproduction.reproduce import reproduce

    done = reproduce(
        options.select,
        workers=options.workers,
        out=options.out,
        force=options.force,
        accept_verdicts=options.accept,
        quiet=options.quiet,
    )
    if not (done.ok and options.quiet):
        print(done.summary())
    return 0 if done.ok else 1


def _measure(options: argparse.Namespace) -> int:
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


def _simulate(options: argparse.Namespace) -> int:
    if options.paper == "ren2023":
        from losbench.papers.ren2023.export import write_telemetry

        folder = write_telemetry(options.out, seed=options.seed, force=options.force)
        said = f"Telemetry of the ren2023 pair written to {folder}. To correct it:"
        command = f"losbench drift {folder / 'telemetry.csv'} --out {folder / 'corrected'}"
    else:
        from losbench.papers.liu2026.export import write_recording

        folder = write_recording(
            options.out,
            n_frames=options.frames,
            seed=options.seed,
            force=options.force,
            progress=not options.quiet,
        )
        said = f"{options.frames} frames of the liu2026 twin written to {folder}. To measure them:"
        command = (
            f"losbench measure {folder / 'frames'} --camera {folder / 'camera.toml'} --times "
            f"{folder / 'times.csv'} "
            f"--temperature {folder / 'temperature.csv'} --out {folder / 'measured'}"
        )
    if not options.quiet:
        print(said, command, sep="\n")
    return 0


def _drift(options: argparse.Namespace) -> int:
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
    )
    if not options.quiet:
        print(report.summary())
    return 0


def _ledger(options: argparse.Namespace) -> int:
    from losbench.workbench.ledger.verdicts import Ledger

    rows = [
        row
        for row in Ledger.collect(fall_back=True).rows()
        if options.paper in (None, row["paper"])
    ]
    if not rows:
        raise ValueError(f"--paper must be one of liu2026, lyu2015, ren2023, got {options.paper!r}")
    for row in rows:
        claimed = f"{row['relation']} {row['claimed']} {row['unit']}".strip()
        ours = (
            f"ours {row['ours']}"
            if row["ours"]
            else "accepted, not run here" * row["evidence"].startswith("accepted")
        )
        print(f"{row['id']:<12} {row['verdict']:<12} {claimed:<18} {ours:<20} {row['quantity']}")
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


if __name__ == "__main__":
    sys.exit(main())
