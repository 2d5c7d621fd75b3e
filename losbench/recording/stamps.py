"""One rectangle of a detector through all frames, read on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools

__all__ = ["Stamp", "UnreadableFrame", "as_frame", "first_readable"]

Read = TypeVar("Read")

_DTYPES = (np.uint8, np.uint16, np.float32)


class UnreadableFrame(ValueError):
    """A frame that could not be read, or that does not match the others; the message names it."""


@dataclass(frozen=True)
class Stamp:
    """One rectangle of the detector through all frames, read on demand.

    Attributes
    ----------
    name : str
        What the stamp shows: "frame", or the name of its file.
    shape : (rows, cols)
        Its size in pixels.
    origin_px : (x, y)
        Detector position of its first pixel.
    load : callable
        ``load(k)`` returns frame ``k`` as a (rows, cols) array or raises `UnreadableFrame`.
    """

    name: str
    shape: tuple[int, int]
    origin_px: tuple[float, float]
    load: Callable[[int], NDArray[Any]]

    def read(
        self, first: int, last: int, *, skip: bool, skipped: dict[int, str] | None = None
    ) -> tuple[NDArray[Any], Bools]:
        """Return frames ``first`` to ``last`` (excluded) and which of them could be read; others
        are zero.

        What was wrong with the others goes into ``skipped``, by the number of the frame.
        """
        frames: list[NDArray[Any] | None] = []
        for k in range(first, last):
            try:
                frames.append(self.load(k))
            except UnreadableFrame as error:
                if not skip:
                    raise
                frames.append(None)
                if skipped is not None:
                    skipped.setdefault(k, str(error))
        good = np.array([frame is not None for frame in frames])
        dtype = next((frame.dtype for frame in frames if frame is not None), np.dtype(np.uint16))
        stack = np.zeros((len(frames), *self.shape), dtype=dtype)
        for row, frame in zip(stack, frames, strict=True):
            if frame is not None:
                row[...] = frame
        return stack, good


def first_readable(count: int, read: Callable[[int], Read], *, skip: bool) -> tuple[int, Read]:
    """Number and content of the first of ``count`` that can be read; it must be the very first,
    without ``skip``.
    """
    for k in range(count - 1):
        try:
            return k, read(k)
        except UnreadableFrame:
            if not skip:
                raise
    return count - 1, read(count - 1)


def as_frame(array: NDArray[Any], name: str) -> NDArray[Any]:
    """Return a two-dimensional frame of a type that the centroids take; other numbers become
    float32.
    """
    if array.ndim != 2:
        what = f"{array.shape[-1]} colour channels" if array.ndim == 3 else f"shape {array.shape}"
        raise UnreadableFrame(f"{name} must be one grey image (rows, cols), got {what}")
    if array.dtype.kind not in "uif":
        raise UnreadableFrame(f"{name} must hold numbers, got {array.dtype}")
    return array if array.dtype in _DTYPES else array.astype(np.float32)
