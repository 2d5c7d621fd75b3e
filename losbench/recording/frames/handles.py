"""Open files, kept by path: frames hold no handle themselves, so that they pickle."""

from __future__ import annotations

import atexit
import bz2
import gzip
import itertools
import os
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.protocol import UnreadableFrame, fits_in

__all__ = ["file_size", "fill", "no_read_ahead", "opened", "plain_file", "quiet_opencv"]

Handle = TypeVar("Handle")

_MOST_OPEN = 4
_TICK_NS = 50_000_000
_NUMBERS = itertools.count()
_PACKED: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open}
_CHUNK = 2**20


class _Handles(OrderedDict[tuple[Any, ...], Any]):
    """Open files of one thread, the one used last at the end; closed when the thread ends."""

    def close_first(self) -> None:
        handle = self.popitem(last=False)[1]
        for name in ("close", "release"):
            if hasattr(handle, name):
                getattr(handle, name)()
                return

    def close(self) -> None:
        while self:
            self.close_first()

    __del__ = close


class _Kept(threading.local):
    def __init__(self) -> None:
        self.handles = _Handles()


_KEPT = _Kept()


def opened(opener: Callable[[Path], Handle], path: Path) -> Handle:
    """Return ``opener(path)``, the one from before if the file is still the same.

    Handles are a thread's own, and of this process: a forked child would share the place in the
    file with its parent.
    """
    stat = path.stat()
    key: tuple[Any, ...] = (os.getpid(), opener, str(path), stat.st_mtime_ns, stat.st_size)
    kept = _KEPT.handles
    if key not in kept:
        handle: Handle = opener(path)
        # Two changes within one tick of the file system's clock would look the same: what was
        # changed just now is opened again the next time.
        if time.time_ns() - stat.st_mtime_ns < _TICK_NS:
            key = (*key, next(_NUMBERS))
        kept[key] = handle
        while len(kept) > _MOST_OPEN:
            kept.close_first()
    kept.move_to_end(key)
    kept_handle: Handle = kept[key]
    return kept_handle


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
    while room:
        got = _read_at(file, offset, room)
        if not got:
            raise UnreadableFrame(f"{label} cannot be read: the file is cut short")
        room, offset = room[got:], offset + got


def no_read_ahead(file: BinaryIO) -> None:
    """Tell the system that what follows in the file is not wanted: of a few rows of every frame it
    would read all.
    """
    if hasattr(os, "posix_fadvise"):
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_RANDOM)


def _read_at(file: BinaryIO, offset: int, room: memoryview) -> int:
    if hasattr(os, "preadv"):
        return os.preadv(file.fileno(), [room], offset)
    file.seek(offset)
    got: int = file.readinto(room)  # type: ignore[attr-defined]
    return got


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


@atexit.register
def _close_all() -> None:
    _KEPT.handles.close()
