"""When frames were taken, and how warm it was: times and temperature logs as CSV files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats, Indices

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FrameTimes", "TemperatureLog", "read_temperature_log", "read_times"]

_UTC_HINT = "ISO 8601 UTC as 2026-03-01T12:00:00Z"


@dataclass(frozen=True)
class FrameTimes:
    """Times of frames or readings.

    Attributes
    ----------
    seconds : (n,) array
        Seconds since ``start``, or since an origin of the user's own. NaN where unknown.
    start : numpy.datetime64 or None
        The origin in UTC, where it is known.
    """

    seconds: Floats
    start: np.datetime64 | None = None

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
        return self.seconds + (self.start - other.start) / np.timedelta64(1, "ns") * 1e-9


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
    """

    times: FrameTimes
    celsius: Floats
    names: tuple[str, ...]
    utc: FrameTimes | None = None

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


def times_from_utc(texts: list[str | None], name: str) -> FrameTimes:
    """Return times from ISO 8601 texts, since the first that is known; NaN where a text is
    missing.
    """
    utc = utc_times(name, texts)
    known = utc[~np.isnat(utc)]
    if not known.size:
        raise ValueError(f"{name} must hold at least one time")
    return FrameTimes(
        np.where(np.isnat(utc), np.nan, (utc - known[0]) / np.timedelta64(1, "ns") * 1e-9), known[0]
    )


def increasing(times: FrameTimes, name: str) -> FrameTimes:
    """Return times if those that are known increase."""
    if (np.diff(times.seconds[np.isfinite(times.seconds)]) <= 0).any():
        raise ValueError(f"{name} must hold increasing times, one for each frame in order")
    return times


def read_times(
    path: str | Path | None,
    n_frames: int,
    *,
    period_s: float | None = None,
    start: str | None = None,
) -> FrameTimes | None:
    """Return the frames' times from a CSV file or a constant period; None if neither is given."""
    if start is not None and (path is not None or period_s is None):
        raise ValueError(
            "start goes with period_s: without a period, or with a file of times, it says nothing"
        )
    if path is None:
        if period_s is None:
            return None
        return FrameTimes(
            np.arange(n_frames, dtype=np.float64) * period_s,
            None if start is None else utc_times("start", [start])[0],
        )
    table = read_table(path)
    times = _time_columns(table, Path(path).name, {})
    if len(times.seconds) != n_frames:
        raise ValueError(
            f"{Path(path).name} must have one row for each of {n_frames} frames, got "
            f"{len(times.seconds)}"
        )
    return increasing(times, Path(path).name)


def read_temperature_log(
    path: str | Path, *, columns: Mapping[str, str] | None = None
) -> TemperatureLog:
    r"""Read a temperature log.

    Parameters
    ----------
    path : str or Path
        CSV with ``time_s`` (seconds on the frames' clock) or ``time`` (ISO 8601, UTC), and one or
        more columns whose names start with ``temperature`` and end with ``_degC``. Of both clocks,
        that of the frames counts.
    columns : mapping, optional
        Standard name to the file's own: ``{"time_s": "t", "temperature_degC": "Room (C)"}``.

    Returns
    -------
    TemperatureLog
        Sorted by time; of equal times the first kept; sensors with fewer than two readings left
        out. A missing reading is NaN.

    Raises
    ------
    ValueError
        If a column is missing or unreadable; the message lists the columns that there are.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder, "log.csv")
    ...     _ = log.write_text("time_s,temperature_degC\n0,18.0\n60,18.5\n")
    ...     readings = read_temperature_log(log)
    >>> readings.celsius.shape, readings.names
    ((2, 1), ('temperature_degC',))
    """
    table, name, mapping = read_table(path), Path(path).name, dict(columns or {})
    for standard, own in mapping.items():
        if own not in table.columns:
            raise ValueError(
                f"{name} has no column {own!r} for {standard}; it has {_listed(table)}"
            )
    table = table.rename(columns={own: standard for standard, own in mapping.items()})
    names = [c for c in table.columns if c.startswith("temperature") and c.endswith("_degC")]
    if not names:
        raise ValueError(
            f"{name} must have a column such as temperature_degC; it has {_listed(table)} (map "
            "other names)"
        )
    times = _time_columns(table, name, mapping)
    celsius = np.stack([numbers(table, c, name) for c in names], axis=-1)
    keep = np.flatnonzero(np.isfinite(times.seconds) & np.isfinite(celsius).any(axis=-1))
    kept = keep[np.unique(times.seconds[keep], return_index=True)[1]]
    alive = np.isfinite(celsius[kept]).sum(axis=0) >= 2
    if not alive.any():
        raise ValueError(
            f"{name} must hold at least two readings at different times, got {len(kept)}"
        )
    seconds = FrameTimes(times.seconds[kept], times.start)
    utc = _second_clock(table, kept) if times.start is None and "time" in table.columns else None
    return TemperatureLog(
        seconds, celsius[kept][:, alive], tuple(np.array(names)[alive].tolist()), utc
    )


def _time_columns(table: pd.DataFrame, name: str, mapping: Mapping[str, str]) -> FrameTimes:
    if "time_s" in table.columns:
        return FrameTimes(numbers(table, "time_s", name))
    if "time" in table.columns:
        return times_from_utc(
            table["time"].tolist(), f"column {mapping.get('time', 'time')!r} of {name}"
        )
    raise ValueError(
        f"{name} must have a column time_s (seconds) or time ({_UTC_HINT}); it has {_listed(table)}"
    )


def _second_clock(table: pd.DataFrame, kept: Indices) -> FrameTimes | None:
    """Return the UTC times of the rows kept, if the column ``time`` has them, one after the
    other.
    """
    try:
        utc = times_from_utc(table["time"].iloc[kept].tolist(), "time")
    except ValueError:
        return None
    return utc if (np.diff(utc.seconds) > 0).all() else None


def utc_times(name: str, texts: list[str | None]) -> NDArray[np.datetime64]:
    import pandas as pd

    try:
        stamps = pd.to_datetime(pd.Series(texts, dtype="str"), utc=True, format="ISO8601")
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{name} must be {_UTC_HINT}, got: {str(error).splitlines()[0].split('. You')[0]}"
        ) from None
    return stamps.dt.tz_localize(None).to_numpy().astype("datetime64[ns]")


def numbers(table: pd.DataFrame, column: str, name: str) -> Floats:
    import pandas as pd

    given = table[column]
    values = pd.to_numeric(given, errors="coerce")
    faulty = np.flatnonzero(values.isna() & given.notna())
    if faulty.size:
        first = faulty[0]
        raise ValueError(
            f"column {column!r} of {name} must hold numbers, got {given.iloc[first]!r} in row "
            f"{first + 1}"
        )
    return values.to_numpy(dtype=np.float64)


def read_table(path: str | Path) -> pd.DataFrame:
    import pandas as pd

    if not Path(path).is_file():
        raise FileNotFoundError(f"no CSV file at {path}")
    try:
        try:
            table = pd.read_csv(path, skipinitialspace=True, comment="#")
        except UnicodeDecodeError:  # the degree sign of a Windows logger
            table = pd.read_csv(path, skipinitialspace=True, comment="#", encoding="cp1252")
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise ValueError(
            f"{Path(path).name} must be a CSV file with a header line, got: {error}"
        ) from None
    if len(table.columns) == 1 and any(mark in str(table.columns[0]) for mark in ";\t"):
        raise ValueError(
            f"{Path(path).name} must have commas between its columns, got {str(table.columns[0])!r}"
        )
    if table.empty:
        raise ValueError(f"{Path(path).name} must hold at least one row below its header")
    return table


def _listed(table: pd.DataFrame) -> str:
    return ", ".join(map(str, table.columns))
