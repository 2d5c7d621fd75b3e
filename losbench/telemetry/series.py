"""A series of angles and temperatures from a CSV file of any origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from losbench.arrays import Floats
from losbench.logs import FrameTimes, utc_of
from losbench.tables import Dialect, Table, read_table
from losbench.units import arcsec_to_rad

__all__ = ["AngleSeries", "read_angles"]

_UNITS = {
    "arcsec": float(arcsec_to_rad(1.0)),
    "mas": float(arcsec_to_rad(1e-3)),
    "deg": np.pi / 180.0,
    "urad": 1e-6,
    "mrad": 1e-3,
    "rad": 1.0,
}
_CLOCKS = ("time_s", "time", "t_s", "utc")


@dataclass(frozen=True)
class AngleSeries:
    """Angles and sensors over time.

    Attributes
    ----------
    time_s : (n,) array
        Increasing.
    angles : (n, k) array, radians
    names : tuple of k str
        Columns of the angles.
    sensors : dict of (n,) arrays
        As in the file.
    start : numpy.datetime64 or None
        Where ``time_s`` is zero, if the file has dates.
    notes : tuple of str
    """

    time_s: Floats
    angles: Floats
    names: tuple[str, ...]
    sensors: Mapping[str, Floats]
    start: np.datetime64 | None
    notes: tuple[str, ...]


def read_angles(
    path: str | Path,
    angles: Sequence[str],
    sensors: Sequence[str] = (),
    *,
    time: str | None = None,
    unit: str | None = None,
    dialect: Dialect | None = None,
) -> AngleSeries:
    """Read columns of angles and sensors.

    Parameters
    ----------
    path : path
        CSV file.
    angles, sensors : sequences of str
        Names of columns.
    time : str, optional
        Column of seconds or dates; "time_s", "time", "t_s" or "utc" unless given.
    unit : str, optional
        Of the angles: "arcsec", "mas", "deg", "urad", "mrad" or "rad"; the end of their names
        (``alpha_arcsec``) unless given.
    dialect : Dialect, optional
        What of the file cannot be found out.

    Raises
    ------
    ValueError
        If a column is missing or unreadable, a unit unknown, or times do not increase; the message
        names file and column.
    """
    table, file = read_table(path, dialect), Path(path).name
    clock = time or next((name for name in _CLOCKS if name in table.names), None)
    if clock is None:
        raise ValueError(f"{file} must have a column time_s or time; it has {table.listed()}")
    missing = [name for name in (clock, *angles, *sensors) if name not in table.names]
    if missing:
        raise ValueError(f"{file} has no column {', '.join(missing)}; it has {table.listed()}")
    times = _times(table, clock)
    step = np.diff(times.seconds)
    if np.isnan(times.seconds).any() or (step <= 0).any():
        row = int(np.argmax(~(step > 0))) + 2
        raise ValueError(
            f"{file}: column {clock!r} must increase, but data row {row} does not follow the row "
            "before: sort the file and drop duplicates"
        )
    columns = [table.numbers(name) * _unit(name, unit, file) for name in angles]
    return AngleSeries(
        times.seconds,
        np.stack(columns, axis=1),
        tuple(angles),
        {name: table.numbers(name) for name in sensors},
        times.start,
        (*table.notes, *times.notes),
    )


def _times(table: Table, clock: str) -> FrameTimes:
    if table.holds(clock) == "n":
        return FrameTimes(table.numbers(clock))
    return utc_of(table, clock)


def _unit(name: str, given: str | None, file: str) -> float:
    unit = given or name.rpartition("_")[2]
    if unit not in _UNITS:
        raise ValueError(
            f"{file}: the unit of column {name!r} must be one of {', '.join(_UNITS)}, as the end "
            f"of its name ({name}_arcsec) or by --angle-unit, got {unit!r}"
        )
    return _UNITS[unit]
