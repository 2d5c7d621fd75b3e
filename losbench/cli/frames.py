"""Arguments that say which frames to read, and how: shared by every command that reads a
recording.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from losbench.imaging.detector import Detector
    from losbench.logs import FrameTimes
    from losbench.recording.readers import Recording

__all__ = ["add_frames", "recording_of"]


def add_frames(parser: argparse.ArgumentParser) -> None:
    """Add them to a parser."""
    parser.add_argument(
        "frames",
        nargs="+",
        help="folder or files of images (PNG, TIFF, BMP, PGM, JPEG) or target pixel files, a "
        "pattern in quotes; or a TIFF, .npy, .npz, FITS, HDF5, SER or video file, or the .toml "
        "that describes raw frames",
    )
    group = parser.add_argument_group("frames")
    group.add_argument(
        "--times", type=Path, metavar="CSV", help="frame times, column time_s or time"
    )
    group.add_argument(
        "--times-column",
        action="append",
        default=[],
        metavar="STANDARD=OWN",
        help="name of a column of the frame times, e.g. time=Clock",
    )
    group.add_argument(
        "--period-s", type=float, help="time between frames, if there is no such file"
    )
    group.add_argument("--start", metavar="UTC", help="time of the first frame, with --period-s")
    group.add_argument(
        "--name-times",
        metavar="PATTERN",
        help="times stand in the files' names, e.g. %%Y%%m%%d_%%H%%M%%S",
    )
    group.add_argument(
        "--name-utc-offset", metavar="HOURS|ZONE", help="of these times; default UTC, and said so"
    )
    group.add_argument(
        "--unreadable",
        default="stop",
        choices=["stop", "skip"],
        help="what a broken frame does (%(default)s)",
    )
    group.add_argument(
        "--channel", help="which channel of colour frames: red, green, blue or a number"
    )
    group.add_argument("--dataset", metavar="NAME", help="which data set of an HDF5 file")
    group.add_argument("--dark", metavar="FRAMES", help="taken off, the mean of several")
    group.add_argument(
        "--flat", metavar="FRAMES", help="divided by, scaled to a mean of one; less its own dark"
    )
    group.add_argument(
        "--bad-pixels", metavar="MASK", help="mask, or CSV of pixels x,y, that are left out"
    )
    group.add_argument(
        "--roi", metavar="X,Y,COLUMNS,ROWS", help="part of the frames to read, in pixels"
    )


def recording_of(
    options: argparse.Namespace, detector: Detector | None, times: FrameTimes | None
) -> Recording:
    """Open what the arguments name, with times that were read before."""
    from losbench.recording.readers import read_recording

    frames = options.frames
    return read_recording(
        frames[0] if len(frames) == 1 else frames,
        times=times,
        period_s=options.period_s,
        start=options.start,
        name_times=options.name_times,
        utc_offset=options.name_utc_offset,
        on_unreadable=options.unreadable,
        channel=_channel(options.channel),
        dataset=options.dataset,
        detector=detector,
        dark=options.dark,
        flat=options.flat,
        bad_pixels=options.bad_pixels,
        roi=_roi(options.roi),
    )


def _channel(text: str | None) -> Any:
    return int(text) if text is not None and text.isdecimal() else text


def _roi(text: str | None) -> tuple[int, int, int, int] | None:
    if text is None:
        return None
    try:
        x, y, columns, rows = (int(part) for part in text.split(","))
    except ValueError:
        raise ValueError(
            f"--roi must be X,Y,COLUMNS,ROWS in whole pixels, e.g. 100,80,640,480, got {text!r}"
        ) from None
    return x, y, columns, rows
