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

_HEADS = ("head_1", "head_2", "head_3", "head_4")
_UNITS_MM = {"mm": 1.0, "um": 1e-3, "px": None}
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class HeadColumns:
    """Columns and layout of one head.

    Parameters
    ----------
    quaternion : four column names
        In the order that `TelemetryFormat.scalar` says.
    spots : pairs of column names, optional
        x and y of each reference spot, two spots or more; without them no drift is known.
    reference : pairs of numbers, unit of the spots, optional
        Where the spots are without drift; by default their mean over the first track.
    installation : (3, 3)
        Rotation from the axes of the spots to those of the attitude.
    rows : (column name, number), optional
        Where a table has a row for each head in turn: which column tells them, and what it holds
        in this head's.
    """

    quaternion: tuple[str, ...]
    spots: tuple[tuple[str, str], ...] = ()
    reference: tuple[tuple[float, float], ...] = ()
    installation: tuple[tuple[float, ...], ...] = _IDENTITY
    rows: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        if self.rows and not (len(self.rows) == 2 and isinstance(self.rows[0], str)):
            raise ValueError("rows must be a column and the number that it holds in this head's")
        if len(self.quaternion) != 4:
            raise ValueError(f"quaternion must name four columns, got {len(self.quaternion)}")
        if len(self.spots) == 1 or any(len(pair) != 2 for pair in self.spots):
            raise ValueError("spots must name two columns, x and y, for each of two spots or more")
        if self.reference and np.shape(self.reference) != (len(self.spots), 2):
            raise ValueError(f"reference must have x and y of {len(self.spots)} spots")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all its columns."""
        return (*self.quaternion, *(x for xy in self.spots for x in xy), *self.rows[:1])


@dataclass(frozen=True, kw_only=True)
class TelemetryFormat:
    """What the columns of the telemetry of two heads or more mean.

    Heads whose quaternions have the same names stand in a file each, or in rows of their own.
    Columns of a table without a header are named by their number, from 1.

    Parameters
    ----------
    time : one or two column names
        Seconds, or ISO 8601 UTC. Two where each head has its own clock: the second head is
        interpolated.
    time_fraction : (column name, seconds), optional
        A column to be added to seconds, and what one of it is: ``["frac_us", 1e-6]``.
    scalar, direction : str, optional
        As for `QuaternionConvention`; without them what the telemetry speaks for is proposed, and
        nothing is read.
    design_angle_deg : float, optional
        Angle between the boresights of the first two heads as built, by which a mixed-up convention
        is noticed.
    focal_mm : float, optional
        Focal length of the star cameras, which spots need.
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
    temperatures : column names, optional
        Temperatures beside the attitudes, degC; the angle's sensitivity is to the first.
    head_1, head_2, head_3, head_4 : HeadColumns
        The heads, the last two if there are so many.
    """

    time: str | tuple[str, ...]
    time_fraction: tuple[Any, ...] | None = None
    scalar: Any = None
    direction: Any = None
    design_angle_deg: float | None = None
    focal_mm: float | None = None
    head_1: HeadColumns
    head_2: HeadColumns
    head_3: HeadColumns | None = None
    head_4: HeadColumns | None = None
    spot_unit: str = "mm"
    principal: tuple[float, float] = (0.0, 0.0)
    pixel_um: float | None = None
    spot_sigma_um: float | None = None
    boresight: tuple[float, ...] = (0.0, 0.0, 1.0)
    temperatures: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.scalar is None) != (self.direction is None):
            raise ValueError("scalar and direction make a convention together, got one of them")
        _ = self.convention
        if len(self.clocks) not in (1, len(self.heads)):
            raise ValueError(
                f"time must name one column, or one for each head, got {len(self.clocks)}"
            )
        if self.design_angle_deg is not None:
            number("design_angle_deg", self.design_angle_deg, low=0.0, high=180.0)
        if self.focal_mm is not None:
            positive("focal_mm", number("focal_mm", self.focal_mm))
        elif self.head_1.spots:
            raise ValueError("key focal_mm is missing, by which spots tell of angles")
        if choice("spot_unit", self.spot_unit, _UNITS_MM) == "px" and self.pixel_um is None:
            raise ValueError("spot_unit 'px' needs pixel_um")
        if len({len(head.spots) for head in self.heads}) > 1:
            raise ValueError("all heads must have equally many spots")
        if np.shape(self.boresight) != (3,) or not np.any(self.boresight):
            raise ValueError(
                f"boresight must be a direction of three numbers, got {self.boresight}"
            )
        rows = [tuple(head.rows) for head in self.heads]
        if any(rows) and len(set(rows)) < len(rows):
            raise ValueError("all heads must have rows of their own, or none")
        if self.a_file_each or any(rows):
            return
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
    def heads(self) -> tuple[HeadColumns, ...]:
        """The heads that there are."""
        every = (self.head_1, self.head_2, self.head_3, self.head_4)
        return tuple(head for head in every if head is not None)

    @property
    def a_file_each(self) -> bool:
        """Whether the heads have the same names, so that each stands in a file of its own."""
        same = all(head.quaternion == self.head_1.quaternion for head in self.heads)
        return same and not self.head_1.rows

    @property
    def numbered(self) -> bool:
        """Whether columns are named by their number, as in a table without a header."""
        return all(name.isdigit() for name in self.columns)

    @property
    def columns(self) -> list[str]:
        """Names of all columns: clocks, quaternion and spots of each head, temperatures."""
        return [
            *self.clocks,
            *(self.time_fraction or ())[:1],
            *(c for head in self.heads for c in head.columns),
            *self.temperatures,
        ]

    @property
    def convention(self) -> QuaternionConvention | None:
        """The quaternions' order and direction, where they are named."""
        if self.scalar is None:
            return None
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
        table = _named(read_toml(path))
        for head in _HEADS:
            if head in _HEADS[2:] and head not in table:
                continue
            if not isinstance(table.get(head), dict):
                raise ValueError(f"{path}: table [{head}] is missing")
            table[head] = from_table(HeadColumns, table[head], where=f"{path}: [{head}]")
        return from_table(cls, table, where=str(path))

    def to_toml(self) -> str:
        """Return the format as TOML that :meth:`from_toml` reads."""
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _HEADS}
        top = [f"{name} = {_toml(value)}" for name, value in plain.items() if value is not None]
        return (
            "# Columns and conventions of a pair's telemetry, for `losbench drift`.\n"
            + "\n".join(top)
            + "".join(
                f"\n\n[{h}]\n{to_table(head)}" for h, head in zip(_HEADS, self.heads, strict=False)
            )
            + "\n"
        )


def _named(table: Any, key: str = "") -> Any:
    """Columns that are given by number, by its text; numbers of other keys as they are."""
    if isinstance(table, dict):
        return {name: _named(value, name) for name, value in table.items()}
    if key in ("rows", "time_fraction") and isinstance(table, list):
        return [str(each) if k == 0 else each for k, each in enumerate(table)]
    if key in ("time", "quaternion", "spots", "temperatures"):
        return [_named(each, key) for each in table] if isinstance(table, list) else str(table)
    return table


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return (
        f"[{', '.join(_toml(item) for item in value)}]" if isinstance(value, tuple) else repr(value)
    )
