"""Several files of frames, one after the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.protocol import Found, Source, Spans

__all__ = ["Joined", "join"]


@dataclass(frozen=True)
class Joined:
    """Sources one after the other."""

    sources: tuple[Source, ...]

    @property
    def n_frames(self) -> int:
        """Number of frames of all."""
        return sum(source.n_frames for source in self.sources)

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame."""
        source, at = self._place(k)
        return source.frame(at)

    def rows(self, k: int, shape: tuple[int, int], spans: Spans, out: NDArray[Any]) -> bool:
        """Fill some rows of a frame; return whether that could be done."""
        source, at = self._place(k)
        some = getattr(source, "rows", None)
        return some is not None and bool(some(at, shape, spans, out))

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        source, at = self._place(k)
        return source.label(at)

    def _place(self, k: int) -> tuple[Source, int]:
        ends = np.cumsum([source.n_frames for source in self.sources])
        which = int(np.searchsorted(ends, k, side="right"))
        return self.sources[which], k - int(ends[which] - self.sources[which].n_frames)


def join(parts: list[Found], name: str) -> Found:
    """Put what several files hold one after the other; times go on where all know UTC."""
    if len(parts) == 1:
        return parts[0]
    start = parts[0].start
    seconds = [
        part.time_s + (part.start - start) / np.timedelta64(1, "ns") * 1e-9
        for part in parts
        if part.time_s is not None and part.start is not None and start is not None
    ]
    timed = len(seconds) == len(parts)
    return replace(
        parts[0],
        name=name,
        source=Joined(tuple(part.source for part in parts)),
        time_s=np.concatenate(seconds) if timed else None,
        start=start if timed else None,
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
    )
