"""Which columns of a table hold times, and which temperatures, by name and unit."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from losbench.arrays import Floats
from losbench.tables.moments import Moments
from losbench.tables.table import Table
from losbench.tables.units import slug, to_celsius, without_unit

__all__ = ["celsius", "moments_of", "renamed", "seconds_of", "temperature_columns"]

_CLOCK = {
    *("time", "datetime", "date time", "date/time", "date_time", "timestamp", "utc", "time_utc"),
    *("zeit", "uhrzeit", "zeitstempel", "datum/zeit", "datum uhrzeit", "clock", "time of day"),
}
_DATE = {"date", "datum", "day"}
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0, "d": 86400.0}
_DEGREES = ("degC", "degF", "K")
_STANDARD = re.compile(r"temperature(?:_.*)?_degC")
# What loggers write for a sensor that does not answer: DS18B20, Campbell, 16-bit counters.
_NO_READING = (
    *(-127.0, -999.0, -999.9, -9999.0, 999.0, 9999.0, -99999.0, 99999.0),
    *(-6999.0, 6999.0, -7999.0, 7999.0, -32768.0, 32767.0),
)
_COLDEST = -273.15
_HOTTEST = 150.0  # degC; beyond, a bench reads kelvin or a fault
_KELVIN = (200.0, 400.0)


def renamed(table: Table, columns: Mapping[str, str] | None) -> dict[str, str]:
    """Check a mapping of standard name to the file's own; ``ValueError`` lists what there is."""
    mapping = dict(columns or {})
    for standard, own in mapping.items():
        if own not in table.names:
            raise ValueError(
                f"{table.file} has no column {own!r} for {standard}; it has {table.listed()}"
            )
    return mapping


def seconds_of(table: Table, mapping: Mapping[str, str]) -> Floats | None:
    """Seconds of the rows, from a column in any unit of time; None if there is no such column."""
    name = mapping.get("time_s")
    if name is None and "time" in mapping:
        return None
    if name is None:
        own = [n for n in table.names if n == "time_s"]
        united = [
            n for n in table.names if _base(n) in {*_CLOCK, "t"} and table.unit(n) in _SECONDS
        ]
        name = next(iter([*own, *united]), None)
    if name is None:
        return None
    if table.holds(name) == "t":
        raise ValueError(
            f"column {name!r} of {table.file} must hold seconds, but holds times: map it as "
            f"{table.mapped('time', name)}"
        )
    return table.numbers(name) * _SECONDS.get(table.unit(name), 1.0)


def moments_of(table: Table, mapping: Mapping[str, str]) -> tuple[str, Moments] | None:
    """Name and moments of the column of times; None if there is no such column."""
    name = mapping.get("time")
    dates = mapping.get("date")
    if name is None:
        found = [n for n in table.names if _base(n) in _CLOCK and table.unit(n) not in _SECONDS]
        days = [n for n in table.names if _base(n) in _DATE and table.holds(n) == "t"]
        if len(found) > 1 and "time" in found:
            found = ["time"]
        if len(found) > 1:
            raise ValueError(
                f"{table.file} has more than one column of times, {', '.join(found)}: choose by "
                f"{table.mapped('time', found[0])}"
            )
        name = next(iter([*found, *days]), None)
        if found and days and _is_clock_only(table, found[0]):
            dates = days[0]
    return None if name is None else (name, table.moments(name, dates=dates))


def temperature_columns(table: Table, mapping: Mapping[str, str]) -> dict[str, str]:
    """Standard name, ``temperature_..._degC``, to the file's own, for each column of temperatures:
    those that are mapped or have such a name, else those with a unit of temperature.
    """
    mapped = {s: own for s, own in mapping.items() if s.startswith("temperature")}
    own = {n: n for n in table.names if _STANDARD.fullmatch(n) and n not in mapped.values()}
    if mapped or own:
        return mapped | own
    found: dict[str, str] = {}
    for name in table.names:
        if table.unit(name) in _DEGREES or _base(name) in ("temperature", "temperatur", "temp"):
            words = re.sub(r"^(?:temperature?|temp|t)(?:_|$)", "", slug(without_unit(name)))
            standard = "_".join(filter(None, ("temperature", words, "degC")))
            while standard in found:
                standard = standard.replace("_degC", "_2_degC")
            found[standard] = name
    return found


def celsius(table: Table, own: str, mapping: Mapping[str, str]) -> tuple[Floats, list[str]]:
    """Temperatures of a column in degC, and what is to be said about them.

    Raises
    ------
    ValueError
        If no unit is known, or the values cannot be in it.
    """
    unit = table.unit(own) or ("degC" if own in mapping.values() else "")
    if unit not in _DEGREES:
        raise ValueError(
            f"column {own!r} of {table.file} has no unit of temperature: say unit={{{own!r}: "
            f"'degC'}} (--unit '{own}=degC')"
        )
    raw = table.numbers(own)
    silent = np.isin(raw, _NO_READING)
    notes = [
        f"{table.file}: {np.count_nonzero(silent)} readings of {own!r} are "
        f"{', '.join(f'{v:g}' for v in np.unique(raw[silent]))}, which stands for none."
    ] * bool(silent.any())
    values = to_celsius(np.where(silent, np.nan, raw), unit)
    with np.errstate(invalid="ignore"):
        _refuse(table, own, unit, values, values < _COLDEST, "lies below absolute zero")
        if own not in table.dialect.unit:
            middle = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
            kelvin = _KELVIN[0] <= middle <= _KELVIN[1]
            likely = "K" if kelvin else unit
            why = (
                f"is no temperature of a bench{', is it kelvin?' * kelvin}: say unit={{{own!r}: "
                f"{likely!r}}} (--unit '{own}={likely}')"
            )
            _refuse(table, own, unit, values, values > _HOTTEST, why)
    return values, notes


def _refuse(table: Table, own: str, unit: str, values: Floats, bad: np.ndarray, why: str) -> None:
    if bad.any():
        k = int(np.argmax(bad))
        raise ValueError(
            f"{table.file}, line {table.line(k)}: column {own!r} read in {unit} is {values[k]:.6g} "
            f"degC, which {why}"
        )


def _base(name: str) -> str:
    """A column's name without unit, zone and capitals."""
    plain = re.sub(r"[\[(]?\b(?:UTC|GMT)\s*(?:[+-]\s*\d{1,2}(?::?\d\d)?)[\])]?", "", name)
    plain = re.sub(r"[\[(,]\s*(?:UTC|GMT|local)\s*[\])]?$", "", plain, flags=re.IGNORECASE)
    return without_unit(plain).strip(" ,()[]").lower()


def _is_clock_only(table: Table, name: str) -> bool:
    first = next((cell for cell in table.texts(name) if cell), "")
    return re.match(r"\d{1,2}:\d\d", first) is not None
