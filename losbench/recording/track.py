"""Where spots have been, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from losbench.arrays import Bools, Floats, Ints

__all__ = ["Track"]


@dataclass(frozen=True)
class Track:
    """Positions (F, n, 2), their errors and flags (F, n) of some frames, and why others could not
    be read, by their number.
    """

    xy: Floats
    sigma: Floats
    flags: Ints
    skipped: dict[int, str] = field(default_factory=dict)

    @classmethod
    def one_after_another(cls, parts: list[Track]) -> Self:
        """Join parts of the frames."""
        return cls._joined(parts, axis=0)

    @classmethod
    def side_by_side(cls, parts: list[Track]) -> Self:
        """Join the spots of several stamps."""
        return cls._joined(parts, axis=1)

    @classmethod
    def _joined(cls, parts: list[Track], axis: int) -> Self:
        return cls(
            np.concatenate([part.xy for part in parts], axis=axis),
            np.concatenate([part.sigma for part in parts], axis=axis),
            np.concatenate([part.flags for part in parts], axis=axis),
            {k: why for part in parts for k, why in part.skipped.items()},
        )

    def last_seen(self, before: Floats) -> Floats:
        """Return where each spot was seen last, or ``before`` where it was not seen at all."""
        for frame in self.xy:
            before = np.where(np.isnan(frame), before, frame)
        return before

    def stays_near(self, start: Floats, good: Bools, reach: float) -> bool:
        """Whether each readable frame shows every spot, within reach of the start (F, n, 2)."""
        return bool((np.abs(self.xy - start)[good] < reach).all())
