"""What a camera's body is told in: bricks of its parts, the points it stands on, optical faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats
from losbench.checks import finite, number, shaped

__all__ = ["Box", "Face", "Foot"]


@dataclass(frozen=True)
class Box:
    """A brick of one part, or a hole in one.

    Parameters
    ----------
    part : str
        What it belongs to; a part may have many boxes.
    low_mm, high_mm : (3,) floats
        Its corners.
    replaces : tuple of str
        Parts that it may cut into.
    """

    part: str
    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    replaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the corners."""
        low, high = finite("low_mm", self.low_mm), finite("high_mm", self.high_mm)
        shaped("low_mm", low, (3,))
        shaped("high_mm", high, (3,))
        if (low >= high).any():
            raise ValueError(
                f"high_mm of part {self.part!r} must lie above low_mm on all axes, got "
                f"{list(self.low_mm)} and {list(self.high_mm)}"
            )
        _listed(f"replaces of part {self.part!r}", self.replaces)

    def holds(self, points_mm: Floats) -> Bools:
        """Which points (n, 3) lie inside."""
        return np.all((points_mm > self.low_mm) & (points_mm < self.high_mm), axis=-1)


@dataclass(frozen=True)
class Foot:
    """A point on the table, and the directions in which it is held.

    >>> Foot((0.0, -85.0, -30.0), "xyz").axes
    [0, 1, 2]
    """

    mm: tuple[float, float, float]
    held: str

    def __post_init__(self) -> None:
        """Check the directions."""
        shaped("mm", finite("mm", self.mm), (3,))
        if not isinstance(self.held, str) or not self.held or set(self.held) - set("xyz"):
            raise ValueError(f"held must be letters of 'xyz', got {self.held!r}")

    @property
    def axes(self) -> list[int]:
        """Numbers of the held axes."""
        return ["xyz".index(letter) for letter in sorted(set(self.held))]


@dataclass(frozen=True)
class Face:
    """The flat rectangle whose nodes stand for an optic's surface: corners (x, y) and height z."""

    low_mm: tuple[float, float]
    high_mm: tuple[float, float]
    z_mm: float

    def __post_init__(self) -> None:
        """Check the corners."""
        shaped("low_mm", finite("low_mm", self.low_mm), (2,))
        shaped("high_mm", finite("high_mm", self.high_mm), (2,))
        number("z_mm", self.z_mm)


def _listed(name: str, value: object) -> None:
    # Of a text each letter would count as a name, and each part of it as listed.
    if not isinstance(value, tuple | list):
        raise ValueError(f"{name} must be a list of parts, got {value!r}")
