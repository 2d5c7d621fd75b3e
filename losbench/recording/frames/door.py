"""Which format a path holds, and who reads it: readers of your own come first."""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.checks import choice
from losbench.recording.frames.arrays import open_array, open_npy, open_npz
from losbench.recording.frames.develop import develop
from losbench.recording.frames.fits import FITS, open_fits
from losbench.recording.frames.hdf5 import HDF5, open_hdf5
from losbench.recording.frames.images import IMAGES, open_images
from losbench.recording.frames.joined import join
from losbench.recording.frames.names import belonging, in_natural_order
from losbench.recording.frames.protocol import Found, Frames
from losbench.recording.frames.raw import open_raw
from losbench.recording.frames.ser import open_ser
from losbench.recording.frames.tiff import TIFF, open_tiff
from losbench.recording.frames.video import VIDEO, open_video

__all__ = ["How", "Origin", "find_frames", "open_frames", "register_reader"]

Origin = str | Path | Sequence[str | Path] | NDArray[Any]

_GROUP = "losbench.readers"
_KNOWN = (
    "a folder of images, or a TIFF, .npy, .npz, FITS, HDF5, SER or video file, or the .toml of raw "
    "frames"
)
_SUFFIXES = {
    "FITS": FITS,
    "TIFF": TIFF,
    "image": IMAGES,
    "NumPy": (".npy", ".npz"),
    "HDF5": HDF5,
    "SER": (".ser",),
    "raw": (".toml",),
    "video": VIDEO,
}


@dataclass(frozen=True, kw_only=True)
class How:
    """Options of opening.

    Attributes
    ----------
    skip : bool
        Whether what cannot be read is left out.
    channel : str or int, optional
        Which channel of colour frames.
    dataset : str, optional
        Which data set of an HDF5 file.
    own_times : bool
        Whether the times that files bring are wanted.
    """

    skip: bool = False
    channel: str | int | None = None
    dataset: str | None = None
    own_times: bool = True


_registered: list[tuple[Callable[[Path], bool], Callable[[Path], Frames]]] = []


def register_reader(test: Callable[[Path], bool], opener: Callable[[Path], Frames]) -> None:
    """Let `read_recording` read a format of your own, before those that it knows.

    A package does the same by an entry point of the group ``losbench.readers``: a pair (test,
    opener).

    Parameters
    ----------
    test : callable
        Whether a path, a file or a folder, is of this format.
    opener : callable
        Returns its `Frames`, or raises `UnreadableFrame` in one line that names the file.

    Examples
    --------
    >>> import losbench as lb
    >>> frames = lb.open_frames(np.zeros((3, 20, 30), np.uint16))
    >>> register_reader(lambda path: path.suffix == ".mine", lambda path: frames)
    """
    _registered.append((test, opener))


def open_frames(
    path: Origin,
    *,
    channel: str | int | None = None,
    dataset: str | None = None,
    on_unreadable: str = "stop",
) -> Frames:
    """Open frames without times of your own, calibration or stamps; `read_recording` is the door.

    Parameters
    ----------
    path, channel, dataset, on_unreadable
        As for `read_recording`.

    Returns
    -------
    Frames
        Its ``read(i, j)`` gives frames as an array (j - i, rows, cols).

    Raises
    ------
    UnreadableFrame
        If the first frame cannot be read.
    ValueError
        If ``path`` holds no frames, or more than one stamp of a detector.

    Examples
    --------
    >>> frames = open_frames(np.arange(24, dtype=np.uint16).reshape(2, 3, 4))
    >>> frames.n_frames, frames.shape, frames.read(1, 2)[0, 0].tolist()
    (2, (3, 4), [12, 13, 14, 15])
    """
    skip = choice("on_unreadable", on_unreadable, ("stop", "skip")) == "skip"
    found = find_frames(path, How(skip=skip, channel=channel, dataset=dataset))
    if len(found) > 1:
        raise ValueError(
            f"path holds {len(found)} stamps of a detector, each with frames of its own: open one, "
            "or read_recording all"
        )
    return found[0]


def find_frames(path: Origin, how: How) -> tuple[Frames, ...]:
    """Return the frames of a path: one for whole frames, one for each stamp of a detector."""
    if isinstance(path, np.ndarray):
        return (develop(open_array(path), channel=how.channel),)
    if isinstance(path, str | Path):
        for test, opener in (*_registered, *_installed()):
            if test(Path(path)):
                return (opener(Path(path)),)
    name, files, notes = _files(path)
    files = [Path(os.path.abspath(file)) for file in files]  # a worker may stand in another folder
    first, *others = _open(files, name, how)
    stamps = (replace(first, notes=(*notes, *first.notes)), *others)
    return tuple(develop(stamp, channel=how.channel, skip=how.skip) for stamp in stamps)


@cache
def _installed() -> tuple[tuple[Callable[[Path], bool], Callable[[Path], Frames]], ...]:
    return tuple(entry.load() for entry in entry_points(group=_GROUP))


def _files(path: str | Path | Sequence[str | Path]) -> tuple[str, list[Path], tuple[str, ...]]:
    """Return what to call a source, its files in natural order, and what is to be said of them."""
    if not isinstance(path, str | Path):
        if not len(path):
            raise ValueError("path must name at least one file, got none")
        files = [file for one in path for file in _files(one)[1]]
        return f"{files[0].name} and {len(files) - 1} more", in_natural_order(files), ()
    source = Path(path)
    if source.is_dir():
        there = [p for p in source.iterdir() if p.is_file() and not p.name.startswith(".")]
        frames = [p for p in there if _kind(p) not in (None, "raw")]
        if not frames:
            raise ValueError(
                f"{source.name or source} holds no frames: expected PNG, TIFF or FITS files or "
                f"the like, got {len(there)} other files"
            )
        files, notes = belonging(in_natural_order(frames))
        return source.name or str(source), files, notes
    if source.exists():
        return source.name, [source], ()
    matches = [Path(match) for match in glob.glob(str(path)) if Path(match).is_file()]
    if not matches:
        raise FileNotFoundError(f"no recording at {path}: expected {_KNOWN}")
    return source.name, in_natural_order(matches), ()


def _kind(path: Path) -> str | None:
    name = path.name.lower()
    return next((kind for kind, ends in _SUFFIXES.items() if name.endswith(ends)), None)


def _open(files: list[Path], name: str, how: How) -> tuple[Found, ...]:
    kinds = {_kind(path): path for path in files}
    if None in kinds:
        raise ValueError(f"{kinds[None].name} is no recording: expected {_KNOWN}")
    if len(kinds) > 1 and kinds.keys() != {"image", "TIFF"}:
        raise ValueError(
            f"{name} must hold files of one kind, got {', '.join(p.name for p in kinds.values())}"
        )
    if kinds.keys() == {"FITS"}:
        return open_fits(files, name, skip=how.skip, own_times=how.own_times)
    if "image" in kinds or (kinds.keys() == {"TIFF"} and len(files) > 1 and not _stacks(files)):
        return (open_images(files, name),)
    return (join([_open_one(path, how) for path in files], name),)


def _stacks(files: list[Path]) -> bool:
    """Whether TIFF files hold several pages each, judged by the first that can be read."""
    for path in files:
        try:
            return open_tiff(path, skip=True).source.n_frames > 1
        except ValueError:
            continue
    return False


def _open_one(path: Path, how: How) -> Found:
    kind = _kind(path)
    if kind == "TIFF":
        return open_tiff(path, skip=how.skip)
    if kind == "NumPy":
        npz = path.suffix.lower() == ".npz"
        return open_npz(path) if npz else open_npy(path, skip=how.skip)
    if kind == "HDF5":
        return open_hdf5(path, how.dataset)
    if kind == "SER":
        return open_ser(path, skip=how.skip)
    if kind == "raw":
        return open_raw(path, skip=how.skip)
    return open_video(path)
