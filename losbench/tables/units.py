"""Units in the names of columns, or in the row below them."""

from __future__ import annotations

import re

from losbench.arrays import Floats

__all__ = ["is_unit_row", "slug", "to_celsius", "unit_of", "without_unit"]

_SPELLED = {
    "degC": ("c", "degc", "deg c", "celsius", "grad c", "gradc", "oc"),
    "degF": ("f", "degf", "deg f", "fahrenheit"),
    "K": ("k", "kelvin", "degk"),
    "s": ("s", "sec", "secs", "second", "seconds", "sekunden"),
    "ms": ("ms", "msec", "milliseconds"),
    "us": ("us", "microseconds"),
    "min": ("min", "minute", "minutes"),
    "h": ("h", "hr", "hour", "hours"),
    "d": ("d", "day", "days"),
}
_UNITS = {word: unit for unit, words in _SPELLED.items() for word in words}
# What stands below names besides these: other units, and how Campbell's loggers sample.
_BELOW_NAMES = {
    *("", "-", "1", "%", "%rh", "none", "count", "counts", "dn", "e", "e-", "px", "hz", "ts", "rn"),
    *("arcsec", "arcmin", "deg", "rad", "mrad", "urad", "nm", "um", "mm", "cm", "m", "km", "v"),
    *("mv", "a", "ma", "w", "pa", "hpa", "mbar", "bar", "utc", "gmt", "quaternion", "avg", "smp"),
    *("min", "max", "std", "tot"),
}
_DEGREE = re.compile(
    "(?:[\N{DEGREE SIGN}\N{MASCULINE ORDINAL INDICATOR}]\\s?|\\bdeg[ .]?)([CFK])\\b", re.IGNORECASE
)
_MARKED = re.compile(r"(?:[\[(]\s*([^\])]*?)\s*[\])]|[,/]\s*([A-Za-z ]+)|_([A-Za-z]+))\s*$")
_SIGNS = {"\N{DEGREE CELSIUS}": " \N{DEGREE SIGN}C", "\N{DEGREE FAHRENHEIT}": " \N{DEGREE SIGN}F"}


def unit_of(name: str) -> str:
    """The unit that a column's name ends with, as losbench spells it, or nothing.

    >>> [unit_of(n) for n in ("T [K]", "temp_F", "Room (C)", "time, s", "frame")]
    ['K', 'degF', 'degC', 's', '']
    """
    name = _plain(name)
    degree = _DEGREE.search(name)
    if degree:
        return _UNITS[degree.group(1).lower()]
    marked = _MARKED.search(name)
    return _UNITS.get(next(filter(None, marked.groups()), "").lower(), "") if marked else ""


def spelled(unit: str) -> str:
    """A unit as losbench spells it, or nothing if it is none that it knows."""
    text = _plain(unit).strip(" []()")
    degree = _DEGREE.fullmatch(text)
    return _UNITS.get((degree.group(1) if degree else text).lower(), "")


def without_unit(name: str) -> str:
    """A column's name without its unit."""
    if not unit_of(name):
        return name.strip()
    name = _plain(name)
    degree = _DEGREE.search(name)
    kept = name[: degree.start()] if degree else _MARKED.sub("", name)
    return kept.strip(" ,/[(_")


def slug(text: str) -> str:
    """Lower-case words joined by underscores, for the name of a column.

    >>> slug("Room 2, left")
    'room_2_left'
    """
    return "_".join(re.findall(r"\w+", text.lower().replace("_", " ")))


def is_unit_row(cells: list[str]) -> bool:
    """Whether a row holds units, or what loggers write beside them, and nothing else."""
    words = [cell.strip() for cell in cells]
    bare = [re.sub(r"^[\[(](.*)[\])]$", r"\1", word) for word in words]
    return any(words) and all(w.lower() in _BELOW_NAMES or spelled(w) for w in bare)


def to_celsius(values: Floats, unit: str) -> Floats:
    """Temperatures in degC from degC, degF or K."""
    if unit == "degF":
        return (values - 32.0) / 1.8
    return values - 273.15 if unit == "K" else values


def _plain(name: str) -> str:
    for sign, text in _SIGNS.items():
        name = name.replace(sign, text)
    return name
