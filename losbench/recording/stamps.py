"""One rectangle of a detector through all frames, read on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools
from losbench.recording.frames.protocol import Frames, Spans, UnreadableFrame

__all__ = ["Block", "Stamp", "UnreadableFrame"]


@dataclass(frozen=True, eq=False)
class Block:
    """Some frames of a stamp.

    Attributes
    ----------
    frames : (n, rows, cols) array
        Zero where a frame could not be read; NaN where a pixel is bad.
    good : (n,) array of bool
        Which frames could be read, and are not left out by their file.
    skipped : dict of int to str
        By number of the frame, why it could not be read.
    """

    frames: NDArray[Any]
    good: Bools
    skipped: dict[int, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Stamp:
    """One rectangle of the detector through all frames, read on demand.

    Attributes
    ----------
    name : str
        What the stamp shows: "frame", or the name of its file.
    frames : Frames
        Where its pixels come from.
    origin_px : (x, y)
        Detector position of its first pixel.
    whole : (rows, cols) or None
        Size of the frame that it was cut from, where that is known.
    """

    name: str
    frames: Frames
    origin_px: tuple[float, float] = (0.0, 0.0)
    whole: tuple[int, int] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Its size in pixels, (rows, cols)."""
        return self.frames.shape

    def label(self, k: int) -> str:
        """Return the name of a frame: its file, and which of that."""
        label = getattr(self.frames, "label", None)
        return f"frame {k} of {self.frames.name}" if label is None else str(label(k))

    def read(self, first: int, last: int, *, skip: bool, spans: Spans | None = None) -> Block:
        """Return frames ``first`` to ``last`` (excluded), or only some rows of them, one band below
        the other.

        Raises
        ------
        UnreadableFrame
            If one cannot be read, unless ``skip``.
        """
        bands = [slice(*span) for span in spans or [(0, self.shape[0])]]
        rows = sum(band.stop - band.start for band in bands)
        stack = np.zeros((last - first, rows, self.shape[1]), self.frames.dtype)
        good = np.ones(len(stack), bool)
        skipped: dict[int, str] = {}
        left_out = getattr(self.frames, "left_out", None)
        if left_out is not None:
            good &= ~left_out[first:last]
        read = self.frames.read if spans is None else partial(self._read_rows, spans)
        try:
            read(first, last, stack)
        except UnreadableFrame:
            if not skip:
                raise
            skipped = _one_by_one(read, first, stack)
            good[[k - first for k in skipped]] = False
        bad = self.frames.bad
        if bad is not None and bad.any():
            stack = stack.astype(np.float32, copy=False)
            stack[:, np.concatenate([bad[band] for band in bands])] = np.nan
        return Block(stack, good, skipped)

    def _read_rows(self, spans: Spans, first: int, last: int, out: NDArray[Any]) -> None:
        some = getattr(self.frames, "read_rows", None)
        if some is not None:
            some(first, last, spans, out)
            return
        for k in range(first, last):
            whole = self.frames.read(k, k + 1)[0]
            np.concatenate([whole[begin:end] for begin, end in spans], out=out[k - first])

    def load(self, k: int) -> NDArray[Any]:
        """Return one frame, (rows, cols)."""
        frame: NDArray[Any] = self.read(k, k + 1, skip=False).frames[0]
        return frame


def _one_by_one(read: Callable[..., object], first: int, stack: NDArray[Any]) -> dict[int, str]:
    skipped = {}
    for k, row in enumerate(stack, first):
        try:
            read(k, k + 1, row[None])
        except UnreadableFrame as error:
            row[...] = 0
            skipped[k] = str(error)
    return skipped
