"""Open files, kept by path: frames hold no handle themselves, so that they pickle."""

from __future__ import annotations

import atexit
import bz2
import gzip
import os
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.protocol import UnreadableFrame, fits_in

__all__ = ["file_size", "fill", "opened", "plain_file", "quiet_opencv"]

Handle = TypeVar("Handle")

_MOST_OPEN = 4
_PACKED: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open}
_CHUNK = 2**20


class _Kept(threading.local):
    def __init__(self) -> None:
        self.handles: OrderedDict[tuple[Any, ...], Any] = OrderedDict()


_KEPT = _Kept()


def opened(opener: Callable[[Path], Handle], path: Path) -> Handle:
    """Return ``opener(path)``, the one from before if the file is still the same.

    Handles are a thread's own, and of this process: a forked child would share the place in the
    file with its parent.
    """
    stat = path.stat()
    key = (os.getpid(), opener, str(path), stat.st_mtime_ns, stat.st_size)
    kept = _KEPT.handles
    if key not in kept:
        kept[key] = opener(path)
        while len(kept) > _MOST_OPEN:
            _close(kept.popitem(last=False)[1])
    kept.move_to_end(key)
    handle: Handle = kept[key]
    return handle


def plain_file(path: Path) -> BinaryIO:
    """Open a file; a .gz or .bz2 is unpacked once, on disk, so that late frames come as fast."""
    unpacker = _PACKED.get(path.suffix.lower())
    if unpacker is None:
        return path.open("rb", buffering=0)
    unpacked: BinaryIO = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - `opened` closes it
    try:
        with unpacker(path) as packed:
            while chunk := packed.read(_CHUNK):
                unpacked.write(chunk)
                fits_in(path.name, unpacked.tell(), path.stat().st_size)
    except BaseException:
        unpacked.close()
        raise
    return unpacked


def file_size(file: BinaryIO) -> int:
    """Return the length of an open file in bytes."""
    return os.fstat(file.fileno()).st_size


def fill(file: BinaryIO, offset: int, array: NDArray[Any], label: str) -> None:
    """Fill an array with the bytes from ``offset`` on, or raise that the file is cut short."""
    room = memoryview(array.reshape(-1).view(np.uint8).data)
    file.seek(offset)
    while room:
        got = file.readinto(room)  # type: ignore[attr-defined]
        if not got:
            raise UnreadableFrame(f"{label} cannot be read: the file is cut short")
        room = room[got:]


class quiet_opencv:
    """OpenCV prints its complaints; here they become errors with the file's name."""

    def __enter__(self) -> None:
        import cv2

        # FFmpeg asks the environment how loud to be.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        self._log = getattr(cv2.utils, "logging", cv2)  # where OpenCV 5 and 4 have it
        self._level = self._log.getLogLevel()
        self._log.setLogLevel(0)

    def __exit__(self, *_: object) -> None:
        self._log.setLogLevel(self._level)


def _close(handle: Any) -> None:
    for name in ("close", "release"):
        if hasattr(handle, name):
            getattr(handle, name)()
            return


@atexit.register
def _close_all() -> None:
    while _KEPT.handles:
        _close(_KEPT.handles.popitem()[1])
