"""When frames were taken, and how warm it was: times and temperature logs as CSV files.

How such files are written is told, with an example of each, in the README and by ``losbench measure
--help``; `losbench.tables` reads them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats, Indices
from losbench.tables.cells import BadCell
from losbench.tables.dialect import Dialect, DialectOptions
from losbench.tables.moments import Moments, elapsed_s, read_moments, utc_after, written
from losbench.tables.roles import celsius, moments_of, renamed, seconds_of, temperature_columns
from losbench.tables.table import Table, read_table

__all__ = ["FrameTimes", "TemperatureLog", "read_temperature_log", "read_times"]

_HOUR_S = 3600.0
_HINT_AT_ZONE = (
    "; times without an offset were taken as UTC: if they are local, say utc_offset (--utc-offset)"
)
_START_NOTE = ("The start has no offset and is taken as UTC (+01:00 at its end says otherwise).",)
_HINT_AT_HOUR = (
    ", as where local time has an hour twice: name its zone by utc_offset (--utc-offset "
    "Europe/Berlin)"
)
_UTC_HINT = "ISO 8601 UTC as 2026-03-01T12:00:00Z"


@dataclass(frozen=True)
class FrameTimes:
    """Times of frames or readings.

    Attributes
    ----------
    seconds : (n,) array
        Seconds elapsed since ``start``, leap seconds counted, or since an origin of the user's own.
        NaN where unknown.
    start : numpy.datetime64 or None
        The origin in UTC, where it is known.
    assumed_utc : bool
        Whether nothing but the lack of an offset says that it is UTC.
    notes : tuple of str
        What was noticed in the file that they came from.
    """

    seconds: Floats
    start: np.datetime64 | None = None
    assumed_utc: bool = False
    notes: tuple[str, ...] = ()

    @property
    def utc(self) -> NDArray[np.datetime64]:
        """The same as UTC (n,), NaT where unknown; ``ValueError`` if no origin is known."""
        if self.start is None:
            raise ValueError("times must have an origin in UTC to be told in it, but have none")
        return utc_after(self.start, self.seconds)

    def seconds_since(self, other: FrameTimes, name: str) -> Floats:
        """Return these times on the clock of ``other``; both need a UTC origin, or neither."""
        if (self.start is None) != (other.start is None):
            has = "frames" if self.start is None else name
            raise ValueError(
                f"{name} and frames must share a clock, but of the two only {has} came with UTC "
                "times"
            )
        if self.start is None or other.start is None:
            return self.seconds
        return self.seconds + elapsed_s(other.start, self.start)


@dataclass(frozen=True)
class TemperatureLog:
    """Temperature readings.

    Attributes
    ----------
    times : FrameTimes of n readings
    celsius : (n, k) array, degC
    names : tuple of str
        Names of the k sensors.
    utc : FrameTimes or None
        The same times on the other clock, where a log has seconds and UTC.
    notes : tuple of str
        What was noticed in the file.
    """

    times: FrameTimes
    celsius: Floats
    names: tuple[str, ...]
    utc: FrameTimes | None = None
    notes: tuple[str, ...] = ()

    def at(self, frames: FrameTimes, *, max_gap_s: float | None = None) -> Floats:
        """Interpolate linearly to the frames' times.

        Parameters
        ----------
        frames : FrameTimes of F frames
            NaN times give NaN temperatures.
        max_gap_s : float, optional
            Frames inside a longer gap between readings get NaN; default ten times the median step
            of the log.

        Returns
        -------
        (F, k) array, degC
            NaN outside the log and inside its gaps.

        Raises
        ------
        ValueError
            If no frame falls inside the log, or only one of the two knows UTC.
        """
        clock = self.times if frames.start is None or self.utc is None else self.utc
        t = clock.seconds_since(frames, "the temperature log")
        want = frames.seconds
        inside = (want >= t[0]) & (want <= t[-1])
        if not inside.any():
            raise ValueError(
                f"the temperature log must overlap the frames in time: it runs from {t[0]:g} to "
                f"{t[-1]:g} s, "
                f"the frames from {np.nanmin(want):g} to {np.nanmax(want):g} s"
                + _HINT_AT_ZONE
                * (clock.assumed_utc or frames.assumed_utc)
            )
        limit = 10.0 * float(np.median(np.diff(t))) if max_gap_s is None else max_gap_s
        return np.stack(
            [_interpolated(want, t, column, limit) for column in self.celsius.T], axis=-1
        )


def _interpolated(want: Floats, t: Floats, celsius: Floats, limit: float) -> Floats:
    """Interpolate one sensor over its own readings; NaN outside them and in gaps longer than
    ``limit``.
    """
    there = np.isfinite(celsius)
    t, celsius = t[there], celsius[there]
    inside = (want >= t[0]) & (want <= t[-1])
    after = np.clip(np.searchsorted(t, np.where(inside, want, t[0])), 1, len(t) - 1)
    known = inside & ((t[after] - t[after - 1] <= limit) | np.isin(want, t))
    return np.where(known, np.interp(want, t, celsius), np.nan)


def times_from_utc(texts: Sequence[str | None], name: str) -> FrameTimes:
    """Return times from texts, since the first that is known; NaN where a text is missing."""
    try:
        found = read_moments(written([text or "" for text in texts]))
    except BadCell as error:
        raise ValueError(f"{name} {error}") from None
    if found.missing.all():
        raise ValueError(f"{name} must hold at least one time")
    return FrameTimes(found.seconds, found.start, found.assumed_utc)


def increasing(times: FrameTimes, name: str) -> FrameTimes:
    """Return times if those that are known increase."""
    step = np.diff(times.seconds[np.isfinite(times.seconds)])
    if (step <= 0).any():
        again = times.assumed_utc and (step[step <= 0] >= -_HOUR_S).all()
        raise ValueError(
            f"{name} must hold increasing times, one for each frame in order"
            + _HINT_AT_HOUR * bool(again)
        )
    return times


def read_times(
    path: str | Path | FrameTimes | None,
    n_frames: int | None,
    *,
    period_s: float | None = None,
    start: str | None = None,
    columns: Mapping[str, str] | None = None,
    **options: Unpack[DialectOptions],
) -> FrameTimes | None:
    """Return the frames' times from a CSV file or a constant period; None if neither is given.

    The columns are those of `read_temperature_log`, as are the options. Times that were read before
    are checked for the number of frames, which may be None for as many as there are.
    """
    if start is not None and (path is not None or period_s is None):
        raise ValueError(
            "start goes with period_s: without a period, or with a file of times, it says nothing"
        )
    if path is None:
        if period_s is None:
            return None
        origin = None if start is None else times_from_utc([start], "start")
        return FrameTimes(
            np.arange(n_frames or 0, dtype=np.float64) * period_s,
            None if origin is None else origin.start,
            origin is not None and origin.assumed_utc,
            _START_NOTE[: origin is not None and origin.assumed_utc],
        )
    if isinstance(path, FrameTimes):
        times, name = path, "times"
    else:
        table = read_table(path, Dialect(**options), option="--times-column")
        times, name = _clock(table, renamed(table, columns)), table.file
        times = increasing(replace(times, notes=(*table.notes, *times.notes)), name)
    if n_frames not in (None, len(times.seconds)):
        raise ValueError(
            f"{name} must have one row for each of {n_frames} frames, got {len(times.seconds)}"
        )
    return times


def read_temperature_log(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    **options: Unpack[DialectOptions],
) -> TemperatureLog:
    r"""Read a temperature log.

    Parameters
    ----------
    path : str or Path
        CSV with ``time_s`` (seconds on the frames' clock) or ``time`` (a date with a time, as
        2026-03-01T12:00:00Z), and one or more columns with a unit of temperature, as
        ``temperature_degC`` or ``T [K]``. Of both clocks, that of the frames counts.
    columns : mapping, optional
        Standard name to the file's own: ``{"time_s": "t", "temperature_degC": "Room (C)"}``; also
        ``time``, ``date``.
    **options
        What the file does not tell: ``delimiter``, ``decimal`` ("," or "."), ``encoding``,
        ``date_order`` ("dmy", "mdy"), ``utc_offset`` (hours, or a zone as "Europe/Berlin"),
        ``sentinel`` (numbers that stand for none), ``unit`` (``{"T1": "degF"}``).

    Returns
    -------
    TemperatureLog
        Sorted by time; of equal times the first kept; sensors with fewer than two readings left
        out. A missing reading is NaN. ``notes`` say what was taken for granted.

    Raises
    ------
    ValueError
        If a column is missing or unreadable, a number or a time may mean two things, or the times
        go back more than once; the message names file and line, or the columns that there are.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder, "log.csv")
    ...     _ = log.write_text("time_s;temperature_degC\n0;18,0\n60;18,5\n")
    ...     readings = read_temperature_log(log)
    >>> readings.celsius.ravel().tolist(), readings.names
    ([18.0, 18.5], ('temperature_degC',))
    """
    table = read_table(path, Dialect(**options))
    mapping = renamed(table, columns)
    sensors = temperature_columns(table, mapping)
    if not sensors:
        raise ValueError(
            f"{table.file} must have a column such as temperature_degC; it has {table.listed()}; "
            f"map its own name by {table.mapped('temperature_degC', '...')}"
        )
    times = _clock(table, mapping)
    notes = [*table.notes, *times.notes]
    readings = []
    for own in sensors.values():
        values, said = celsius(table, own, mapping)
        readings.append(values)
        notes += said
    read = np.stack(readings, axis=-1)
    keep = np.flatnonzero(np.isfinite(times.seconds) & np.isfinite(read).any(axis=-1))
    notes += _check_order(times, keep, table)
    kept = keep[np.unique(times.seconds[keep], return_index=True)[1]]
    alive = np.isfinite(read[kept]).sum(axis=0) >= 2
    if not alive.any():
        raise ValueError(
            f"{table.file} must hold at least two readings at different times, got {len(kept)}"
        )
    names = tuple(name for name, lives in zip(sensors, alive, strict=True) if lives)
    utc = None if times.start is not None else _second_clock(table, mapping, kept)
    return TemperatureLog(
        replace(times, seconds=times.seconds[kept], notes=()),
        read[kept][:, alive],
        names,
        utc,
        tuple(notes),
    )


def utc_of(table: Table, column: str) -> FrameTimes:
    """Return a column's times, with a note if they are taken as UTC."""
    return _frame_times(table, column, table.moments(column))


def _clock(table: Table, mapping: Mapping[str, str]) -> FrameTimes:
    seconds = seconds_of(table, mapping)
    if seconds is not None:
        return FrameTimes(seconds)
    found = moments_of(table, mapping)
    if found is None:
        raise ValueError(
            f"{table.file} must have a column time_s (seconds) or time ({_UTC_HINT}); it has "
            f"{table.listed()}; map its own name by {table.mapped('time', '...')}"
        )
    return _frame_times(table, *found)


def _frame_times(table: Table, name: str, moments: Moments) -> FrameTimes:
    if moments.missing.all():
        raise ValueError(f"column {name!r} of {table.file} must hold at least one time")
    return FrameTimes(
        moments.seconds,
        moments.start,
        moments.assumed_utc,
        tuple(_zone_notes(table, name, moments)),
    )


def _zone_notes(table: Table, name: str, moments: Moments) -> list[str]:
    """Say that times were taken as UTC, and what speaks against it."""
    if not moments.assumed_utc:
        return []
    notes = [
        f"{table.file}: the times of column {name!r} have no offset and are taken as UTC "
        "(utc_offset says otherwise)."
    ]
    known = np.flatnonzero(~moments.missing)
    step = np.diff(moments.seconds[known])
    usual = float(np.median(step)) if step.size else np.inf
    hour = np.abs(step - usual - _HOUR_S) <= 0.25 * usual
    if 0 < usual < _HOUR_S / 2 and hour.any():
        row = int(known[np.argmax(hour) + 1])
        notes.append(
            f"{table.file}: before line {table.line(row)} an hour is missing, as where local time "
            "changes to summer time."
        )
    return notes


def _check_order(times: FrameTimes, keep: Indices, table: Table) -> list[str]:
    """Refuse times that go back more than once, or by the hour that local time has twice."""
    step = np.diff(times.seconds[keep])
    back = np.flatnonzero(step < 0)
    if not back.size:
        return []
    line = table.line(int(keep[back[0] + 1]))
    if times.assumed_utc and back.size == 1 and step[back[0]] >= -_HOUR_S:
        raise ValueError(f"{table.file}, line {line}: the times go back{_HINT_AT_HOUR}")
    if back.size == len(step) > 1:
        return [f"{table.file}: the last reading stands first; the rows are turned round."]
    if back.size > 1:
        raise ValueError(
            f"{table.file}: the times go back {back.size} times, first in line {line}: sort it, or "
            "part what was joined"
        )
    return [f"{table.file}: the times go back once, in line {line}; the rows are sorted."]


def _second_clock(table: Table, mapping: Mapping[str, str], kept: Indices) -> FrameTimes | None:
    """Return the UTC times of the rows kept, if a column has them, one after the other."""
    try:
        found = moments_of(table, mapping)
    except ValueError:
        return None
    if found is None or found[1].missing[kept].any():
        return None
    utc = found[1]
    seconds = utc.seconds[kept]
    times = FrameTimes(seconds, utc.start, utc.assumed_utc)
    return times if (np.diff(seconds) > 0).all() else None
