"""Level and noise of a frame between its spots, at every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Floats, Indices, Pixels
from losbench.imaging.pattern import FLAT, Pattern

__all__ = ["Sky"]


@dataclass(frozen=True)
class Sky:
    """Level and noise of a frame: one number each (1, 1), or in the middles of tiles (ty, tx).

    The ``pattern`` of the sensor lies above the level.
    """

    level: Floats
    noise: Floats
    row: Floats
    column: Floats
    pattern: Pattern

    @property
    def flat(self) -> bool:
        """Whether one level and one noise hold for the whole frame."""
        return self.pattern is FLAT

    def at(self, row: Indices, column: Indices) -> tuple[Floats, Floats]:
        """Level and noise of single pixels."""
        if self.flat:
            return np.full(row.shape, self.level[0, 0]), np.full(row.shape, self.noise[0, 0])
        down, part_y = _between(self.row, row)
        right, part_x = _between(self.column, column)
        level, noise = np.zeros(len(row)), np.zeros(len(row))
        for i, of_row in ((0, 1.0 - part_y), (1, part_y)):
            for j, of_column in ((0, 1.0 - part_x), (1, part_x)):
                weight = of_row * of_column
                level += weight * self.level[down + i, right + j]
                noise += weight * self.noise[down + i, right + j]
        return level + self.pattern.at(row, column), noise

    def cut(self, threshold: float, first: int, last: int, width: int) -> Pixels:
        """Level and ``threshold`` noises of some whole rows, (rows, width)."""
        tiles = (self.level + threshold * self.noise).astype(np.float32)
        down, part_y = _between(self.row, np.arange(first, last))
        right, part_x = _between(self.column, np.arange(width))
        part = part_y.astype(np.float32)[:, None]
        each = tiles[down] * (1 - part) + tiles[down + 1] * part
        cut: Pixels = np.diff(each, axis=1)[:, right]
        cut *= part_x.astype(np.float32)
        cut += each[:, right]
        if self.pattern.phase.any() or self.pattern.tap.any():
            cut += self.pattern.rows(first, last, width).astype(np.float32)
        return cut


def _between(at: Floats, wanted: Indices) -> tuple[Indices, Floats]:
    """The tile before each place, and which part of the way to the next it is."""
    left = np.clip(np.searchsorted(at, wanted, side="right") - 1, 0, len(at) - 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (wanted - at[left]) / (at[left + 1] - at[left])
    return left, np.nan_to_num(part)
