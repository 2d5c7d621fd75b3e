"""Frames that lie in a file byte by byte: uncompressed stacks of several formats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Ints
from losbench.recording.frames.handles import fill, no_read_ahead, opened, plain_file
from losbench.recording.frames.protocol import Spans, decoding

__all__ = ["Contiguous", "fill_rows", "native"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Contiguous:
    """Frames at known places of a file.

    Attributes
    ----------
    path : Path
    offsets : (n,) array or int
        Byte at which each frame begins, or the first of frames that follow each other.
    n_frames : int
    shape : tuple of int
        (rows, cols) or (rows, cols, channels).
    dtype : numpy.dtype
        As stored, byte order included.
    opener : callable
        Opens the path; unpacks what is packed.
    stride : int, optional
        Bytes from frame to frame, where something lies between them.
    """

    path: Path
    offsets: Ints | int
    n_frames: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    opener: Callable[[Path], BinaryIO] = plain_file
    stride: int | None = None

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame."""
        label, raw = self.label(k), np.empty(self.shape, self.dtype)
        with decoding(label):
            fill(opened(self.opener, self.path), self._offset(k), raw, label)
        return native(raw)

    def rows(self, k: int, shape: tuple[int, int], spans: Spans, out: NDArray[Any]) -> bool:
        """Fill ``out`` with some rows of a frame (rows, cols), and read no others; return whether
        that could be done.
        """
        if shape != self.shape:
            return False
        with decoding(self.label(k)):
            file = opened(self.opener, self.path)
            fill_rows(file, self._offset(k), spans, out, self.dtype, self.label(k))
        return True

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return f"frame {k} of {self.path.name}"

    def _offset(self, k: int) -> int:
        if isinstance(self.offsets, int):
            each = self.dtype.itemsize * int(np.prod(self.shape))
            return self.offsets + k * (each if self.stride is None else self.stride)
        return int(self.offsets[k])


def fill_rows(
    file: BinaryIO, offset: int, spans: Spans, out: NDArray[Any], stored: np.dtype[Any], label: str
) -> None:
    """Fill ``out`` with rows of an image that begins at a byte of a file, one band below the
    other.
    """
    no_read_ahead(file)
    row_bytes, at = stored.itemsize * out.shape[1], 0
    room = out if stored == out.dtype and out.flags.c_contiguous else np.empty(out.shape, stored)
    for first, last in spans:
        band = room[at : at + last - first]
        fill(file, offset + first * row_bytes, band, label)
        at += last - first
    if room is not out:
        out[...] = room


def native(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array in the machine's byte order."""
    return array.astype(array.dtype.newbyteorder("="), copy=False)
