"""What a sensor adds by itself: to every second row and column, and beyond its middle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from losbench.arrays import Floats, Indices

__all__ = ["FLAT", "Pattern"]


_NEAR = 4  # samples beside the middle of a frame


@dataclass(frozen=True)
class Pattern:
    """What a sensor adds by itself: to every second row and column (2, 2), and beyond its middle
    row and column, where another amplifier reads it, (2,).
    """

    phase: Floats
    tap: Floats
    middle: tuple[float, float]

    @classmethod
    def of(cls, sample: Floats, step: int, shape: tuple[int, ...], least: float) -> Self:
        """Find the pattern in every ``step``-th pixel of a frame; what is below ``least`` is
        none.
        """
        # Of the local mean, in which every phase counts alike and a gradient cancels.
        near = sample[:-2] + 2.0 * sample[1:-1] + sample[2:]
        near = (near[:, :-2] + 2.0 * near[:, 1:-1] + near[:, 2:]) / 16.0
        above = sample[1:-1, 1:-1] - near
        phase = np.zeros((2, 2))
        if min(above.shape) > 1:  # in one row or column alone, two phases have no pixel
            found = np.array(
                [[np.median(above[1 - r :: 2, 1 - c :: 2]) for c in (0, 1)] for r in (0, 1)]
            )
            if np.ptp(found) > least:
                phase = found - found.mean()
        middle = (shape[0] / 2, shape[1] / 2)
        rows, columns = (np.arange(size) for size in sample.shape)
        even = sample - phase[rows[:, None] % 2, columns % 2]
        y, x = (m / step for m in middle)
        tap = np.array([_jump(even, y, x), _jump(even.T, x, y)])
        return cls(phase, np.where(np.abs(tap) > 2.0 * least, tap, 0.0), middle)

    def at(self, row: Indices, column: Indices) -> Floats:
        """What it adds to pixels; rows and columns are broadcast."""
        beyond = self.tap[0] * (row >= self.middle[0]) + self.tap[1] * (column >= self.middle[1])
        return self.phase[row % 2, column % 2] + beyond

    def rows(self, first: int, last: int, width: int) -> Floats:
        """What it adds to whole rows, (rows, width)."""
        row = np.arange(first, last)
        of_row = self.at(np.array([[0], [1]]), np.arange(width))
        added: Floats = of_row[row % 2]
        if self.tap[0]:
            added += self.tap[0] * (row >= self.middle[0])[:, None]
        return added


FLAT = Pattern(np.zeros((2, 2)), np.zeros(2), (np.inf, np.inf))


def _jump(sample: Floats, middle: float, across: float) -> float:
    """How far the rows from the middle on lie above those before, each carried on to there; the
    columns up to ``across`` and beyond each by itself, as they may differ as well.
    """
    first, other = int(np.ceil(middle)), int(np.ceil(across))
    if first < 2 * _NEAR or len(sample) - first < 2 * _NEAR:
        return 0.0
    jumps = []
    for half in (sample[:, :other], sample[:, other:]):
        bands = [half[first + k * _NEAR : first + (k + 1) * _NEAR] for k in (-2, -1, 0, 1)]
        near = [float(np.median(band)) for band in bands]
        jumps.append(1.5 * (near[2] - near[1]) - 0.5 * (near[3] - near[0]))
    return min(jumps, key=abs) if jumps[0] * jumps[1] > 0 else 0.0
