"""What the columns of a star-camera pair's telemetry mean, as a TOML file."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from losbench.checks import choice, number, positive
from losbench.parameters import from_table, read_toml, to_table
from losbench.pointing.starcamera import QuaternionConvention

__all__ = ["HeadColumns", "TelemetryFormat"]

_UNITS_MM = {"mm": 1.0, "um": 1e-3, "px": None}
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class HeadColumns:
    """Columns and layout of one head.

    Parameters
    ----------
    quaternion : four column names
        In the order that `TelemetryFormat.scalar` says.
    spots : pairs of column names
        x and y of each reference spot; two spots or more.
    reference : pairs of numbers, unit of the spots, optional
        Where the spots are without drift; by default their mean over the first track.
    installation : (3, 3)
        Rotation from the axes of the spots to those of the attitude.
    """

    quaternion: tuple[str, ...]
    spots: tuple[tuple[str, str], ...]
    reference: tuple[tuple[float, float], ...] = ()
    installation: tuple[tuple[float, ...], ...] = _IDENTITY

    def __post_init__(self) -> None:
        if len(self.quaternion) != 4:
            raise ValueError(f"quaternion must name four columns, got {len(self.quaternion)}")
        if len(self.spots) < 2 or any(len(pair) != 2 for pair in self.spots):
            raise ValueError("spots must name two columns, x and y, for each of two spots or more")
        if self.reference and np.shape(self.reference) != (len(self.spots), 2):
            raise ValueError(f"reference must have x and y of {len(self.spots)} spots")


@dataclass(frozen=True, kw_only=True)
class TelemetryFormat:
    """What the columns of a pair's telemetry mean; nothing about a quaternion is guessed.

    Parameters
    ----------
    time : one or two column names
        Seconds, or ISO 8601 UTC. Two where each head has its own clock: the second head is
        interpolated.
    scalar, direction
        As for `QuaternionConvention`.
    design_angle_deg : float
        Angle between the boresights as built, by which a mixed-up convention is noticed.
    focal_mm : float
        Focal length of the star cameras.
    spot_unit : "mm", "um" or "px"
        Unit of the spot positions; "px" needs ``pixel_um``.
    principal : (float, float)
        Where the optical axis meets the detector, in that unit.
    pixel_um : float, optional
        Pixel pitch.
    spot_sigma_um : float, optional
        Standard deviation of a spot position, for the drift's uncertainty.
    boresight : (float, float, float)
        Line of sight in the axes of the attitude.
    head_1, head_2 : HeadColumns
        The two heads.
    """

    time: str | tuple[str, ...]
    scalar: Any
    direction: Any
    design_angle_deg: float
    focal_mm: float
    head_1: HeadColumns
    head_2: HeadColumns
    spot_unit: str = "mm"
    principal: tuple[float, float] = (0.0, 0.0)
    pixel_um: float | None = None
    spot_sigma_um: float | None = None
    boresight: tuple[float, ...] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        QuaternionConvention(scalar=self.scalar, direction=self.direction)
        if len(self.clocks) not in (1, 2):
            raise ValueError(
                f"time must name one column, or one for each head, got {len(self.clocks)}"
            )
        number("design_angle_deg", self.design_angle_deg, low=0.0, high=180.0)
        positive("focal_mm", number("focal_mm", self.focal_mm))
        if choice("spot_unit", self.spot_unit, _UNITS_MM) == "px" and self.pixel_um is None:
            raise ValueError("spot_unit 'px' needs pixel_um")
        if len(self.head_1.spots) != len(self.head_2.spots):
            raise ValueError("both heads must have equally many spots")
        if np.shape(self.boresight) != (3,) or not np.any(self.boresight):
            raise ValueError(
                f"boresight must be a direction of three numbers, got {self.boresight}"
            )
        twice = [name for name, count in Counter(self.columns).items() if count > 1]
        if twice:
            raise ValueError(
                f"every column must have one meaning, but {', '.join(twice)} is named twice"
            )

    @property
    def clocks(self) -> tuple[str, ...]:
        """Names of the time columns, one or two."""
        return (self.time,) if isinstance(self.time, str) else tuple(self.time)

    @property
    def columns(self) -> list[str]:
        """Names of all columns: clocks, then quaternion and spots of each head."""
        heads = (self.head_1, self.head_2)
        return [
            *self.clocks,
            *(
                c
                for head in heads
                for c in (*head.quaternion, *(x for xy in head.spots for x in xy))
            ),
        ]

    @property
    def convention(self) -> QuaternionConvention:
        """The quaternions' order and direction."""
        return QuaternionConvention(scalar=self.scalar, direction=self.direction)

    @property
    def unit_mm(self) -> float:
        """Millimetres per unit of the spot positions."""
        return (
            (self.pixel_um or 0.0) * 1e-3
            if self.spot_unit == "px"
            else float(_UNITS_MM[self.spot_unit] or 0.0)
        )

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """Read a format; ``ValueError`` names the file and the key that is missing, unknown or
        wrong.
        """
        table = read_toml(path)
        for head in ("head_1", "head_2"):
            if not isinstance(table.get(head), dict):
                raise ValueError(f"{path}: table [{head}] is missing")
            table[head] = from_table(HeadColumns, table[head], where=f"{path}: [{head}]")
        return from_table(cls, table, where=str(path))

    def to_toml(self) -> str:
        """Return the format as TOML that :meth:`from_toml` reads."""
        heads = ("head_1", "head_2")
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in heads}
        top = [f"{name} = {_toml(value)}" for name, value in plain.items() if value is not None]
        return (
            "# Columns and conventions of a pair's telemetry, for `losbench drift`.\n"
            + "\n".join(top)
            + "".join(f"\n\n[{h}]\n{to_table(getattr(self, h))}" for h in heads)
            + "\n"
        )


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return (
        f"[{', '.join(_toml(item) for item in value)}]" if isinstance(value, tuple) else repr(value)
    )
