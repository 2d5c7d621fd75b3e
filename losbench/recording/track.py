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

    def near(self, places: Floats, reach: Floats) -> Bools:
        """Whether each frame shows every spot, within reach (n,) of its place (F, n, 2)."""
        return (np.abs(self.xy - places).max(axis=2) < reach).all(axis=1)
