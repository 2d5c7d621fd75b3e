"""``losbench simulate``: a twin's recording or telemetry, with its truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands, made_by

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "simulate", parents=[quiet], help="write a digital twin's recording, with its truth"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument(
        "--paper",
        default="liu2026",
        choices=["liu2026", "ren2023"],
        help="frames of two spots, or telemetry of a star-camera pair (%(default)s)",
    )
    parser.add_argument(
        "--frames", type=int, default=200, help="number of frames, liu2026 (%(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the noise (%(default)s)")
    parser.add_argument(
        "--force", action="store_true", help="replace an earlier simulation in an existing folder"
    )
    parser.add_argument(
        "--camera-model",
        type=Path,
        metavar="FILE",
        help="thermo-elastic camera, a TOML file like data/three-mirror-camera.toml, in place of "
        "the five thermal nodes, liu2026",
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    if options.paper == "ren2023":
        if options.camera_model is not None:
            raise ValueError("--camera-model must come with --paper liu2026: ren2023 has no frames")
        from losbench.papers.ren2023.export import write_telemetry

        made = made_by(options, [])
        folder = write_telemetry(options.out, seed=options.seed, force=options.force, made=made)
        said = f"Telemetry of the ren2023 pair written to {folder}. To correct it:"
        command = f"losbench drift {folder / 'telemetry.csv'} --out {folder / 'corrected'}"
    else:
        from losbench.papers.liu2026.camerabench import bench_of
        from losbench.papers.liu2026.export import write_recording
        from losbench.thermoelastic.model import read_camera_model

        path = options.camera_model
        bench = None if path is None else bench_of(read_camera_model(path), where=str(path))
        inputs = [] if path is None else [path]
        folder = write_recording(
            options.out,
            n_frames=options.frames,
            seed=options.seed,
            bench=bench,
            force=options.force,
            progress=not options.quiet,
            inputs=inputs,
            made=made_by(options, inputs),
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
