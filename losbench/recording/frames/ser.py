"""SER, the video format of planetary cameras: frames one after the other, then their times.

Header and trailer as in "SER format description version 3" (Grischa Hahn, 2014).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.contiguous import Contiguous, native
from losbench.recording.frames.handles import file_size, fill, opened, plain_file
from losbench.recording.frames.protocol import Found, Source, UnreadableFrame, cut_short, decoding

__all__ = ["BlueFirst", "open_ser"]

_HEADER = "<14s7i40s40s40s2q"
_HEADER_BYTES = 178
_RGB, _BGR = 100, 101
_TICKS_1970 = 621_355_968_000_000_000  # of 100 ns, from the year 1


@dataclass(frozen=True, eq=False)
class BlueFirst:
    """Frames of a SER file in which blue comes first."""

    stored: Contiguous

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.stored.n_frames

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame."""
        return self.stored.frame(k)[..., ::-1]

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return self.stored.label(k)


def open_ser(path: Path, *, skip: bool) -> Found:
    """Return the frames of a SER file, with the UTC of each where the file has it."""
    name = path.name
    with decoding(name):
        file = opened(plain_file, path)
        head = np.empty(_HEADER_BYTES, np.uint8)
        fill(file, 0, head, name)
        magic, _, colour, _, columns, rows, depth, claimed, *_ = struct.unpack(
            _HEADER, head.tobytes()
        )
    if magic != b"LUCAM-RECORDER":
        raise UnreadableFrame(f"{name} cannot be read: not a SER file")
    if not (rows > 0 and columns > 0 and claimed > 0 and 1 <= depth <= 16):
        raise UnreadableFrame(
            f"{name} cannot be read: its header claims {claimed} frames of {rows}x{columns} pixels "
            f"with {depth} bits"
        )
    shape = (rows, columns, 3) if colour in (_RGB, _BGR) else (rows, columns)
    dtype = np.dtype(np.uint8 if depth <= 8 else "<u2")
    each = int(np.prod(shape)) * dtype.itemsize
    held = file_size(file) - _HEADER_BYTES
    n_frames, notes = cut_short(name, claimed, held // each, skip=skip)
    stored = Contiguous(
        path=path, offsets=_HEADER_BYTES, n_frames=n_frames, shape=shape, dtype=dtype
    )
    if dtype.itemsize == 2:
        stored = replace(stored, dtype=_order(stored, depth))
    source: Source = BlueFirst(stored) if colour == _BGR else stored
    found = Found(name=name, source=source, bits=depth, notes=notes)
    return _timed(found, path, _HEADER_BYTES + claimed * each, n_frames)


def _order(stored: Contiguous, depth: int) -> np.dtype[Any]:
    """Return the byte order that the numbers themselves tell: writers disagree on what the flag of
    the header means.
    """
    little = stored.frame(0).astype(np.int64)
    big = native(stored.frame(0).byteswap()).astype(np.int64)
    if depth < 16 and (little.max() < 2**depth) != (big.max() < 2**depth):
        swapped = bool(big.max() < 2**depth)
    else:  # an image is smoother the right way round
        swapped = bool(np.abs(np.diff(big)).mean() < np.abs(np.diff(little)).mean())
    return np.dtype(">u2" if swapped else "<u2")


def _timed(found: Found, path: Path, trailer: int, n_frames: int) -> Found:
    file = opened(plain_file, path)
    ticks = np.empty(n_frames, "<i8")
    if file_size(file) < trailer + ticks.nbytes:
        return found
    with decoding(path.name):
        fill(file, trailer, ticks, path.name)
    ticks = ticks.astype(np.int64) - _TICKS_1970
    sane = (ticks > 0).all() and (ticks < 2**62 // 100).all() and (np.diff(ticks) > 0).all()
    if not sane:
        said = f"The times in {path.name} do not increase, or are no dates: they are not used."
        return replace(found, notes=(*found.notes, said))
    start = np.datetime64(0, "ns") + np.timedelta64(int(ticks[0]) * 100, "ns")
    return replace(found, time_s=(ticks - ticks[0]) * 1e-7, start=start)
