"""The rows of a frame around its spots, laid one band below the other: all that measuring needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from losbench.arrays import Floats
from losbench.imaging.background import RING
from losbench.imaging.protocols import Window
from losbench.recording.frames.protocol import Spans

__all__ = ["Bands"]

_SPARE = 4  # rows
_MOST_ROWS = 0.6  # of a frame; beyond, all are read


@dataclass(frozen=True, eq=False)
class Bands:
    """Some rows of frames, and how many are left out above each spot.

    Attributes
    ----------
    spans : sequence of (first, last), or None
        The rows; None for all.
    above : (n,) array
    low, high : (n,) arrays
        Rows between which each spot may be looked for in them.
    """

    spans: Spans | None
    above: Floats
    low: Floats
    high: Floats

    @classmethod
    def around(cls, places: Floats, window: Window | None, side: int | None, rows: int) -> Self:
        """Rows that the windows of spots (F, n, 2) and the rings around ``side`` pixels can come
        upon: a spot sees neither an end of its band, unless it is the frame's, nor another band.
        """
        nothing = np.zeros(places.shape[1])
        whole = cls(None, nothing, nothing - np.inf, nothing + np.inf)
        if window is None:
            return whole
        # Half a window each way to look for a peak, to move, and to see; then the ring around it.
        sides = np.asarray(window)
        reach = (
            np.maximum(2, sides // 4) + sides + np.maximum(sides, side or 0) // 2 + RING + _SPARE
        )
        low, high = places[..., 1].min(axis=0), places[..., 1].max(axis=0)
        first = np.clip(np.floor(low) - reach, 0, rows).astype(int)
        last = np.clip(np.ceil(high) + reach + 1, 0, rows).astype(int)
        spans: list[tuple[int, int]] = []
        for begin, end in sorted(zip(first.tolist(), last.tolist(), strict=True)):
            if spans and begin <= spans[-1][1]:
                spans[-1] = (spans[-1][0], max(end, spans[-1][1]))
            else:
                spans.append((begin, end))
        read = np.array([end - begin for begin, end in spans])
        if read.sum() > _MOST_ROWS * rows or not read.all():
            return whole
        left_out = np.array([begin for begin, _ in spans]) - np.cumsum(read) + read
        band = np.searchsorted([end for _, end in spans], first, side="right")
        return cls(spans, left_out[band].astype(np.float64), low - _SPARE, high + _SPARE)

    def hold(self, xy: Floats) -> bool:
        """Whether spots may be looked for at the places (n, 2) of the frame."""
        return bool(((self.low <= xy[:, 1]) & (xy[:, 1] <= self.high)).all())

    def within(self, xy: Floats) -> Floats:
        """Return places (..., n, 2) of the frame in the bands."""
        return xy - self._down

    def outside(self, xy: Floats) -> Floats:
        """Return places (..., n, 2) of the bands in the frame."""
        return xy + self._down

    @property
    def _down(self) -> Floats:
        return np.stack([np.zeros_like(self.above), self.above], axis=-1)
