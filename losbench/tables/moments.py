"""Times as people write them, as moments of UTC, leap seconds counted."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Ints
from losbench.tables.cells import BadCell, missing

__all__ = ["Moments", "Written", "elapsed_s", "read_moments", "utc_after", "written"]

_SECOND = 1_000_000_000
# A second was inserted just before each of these (IERS Bulletin C; none since).
_LEAPS = np.array(
    [
        *("1981-07", "1982-07", "1983-07", "1985-07", "1988-01", "1990-01", "1991-01", "1992-07"),
        *("1993-07", "1994-07", "1996-01", "1997-07", "1999-01", "2006-01", "2009-01", "2012-07"),
        *("2015-07", "2017-01"),
    ],
    dtype="datetime64[ns]",
).astype(np.int64)
_MONTHS = [*("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")]
_NO_OFFSET = 10_000
_LONGEST = 48
_MOST_SHAPES = 400
_EARLIEST, _LATEST = 1980, 2100

# Read on a cell's shape, in which every digit is a 0.
_DATE = (
    r"(?P<y>0000)(?P<sep>[-/.])(?P<m>00?)(?P=sep)(?P<d>00?)"
    r"|(?P<cy>0000)(?P<cm>00)(?P<cd>00)(?=T|$)"
    r"|(?P<one>00?)(?P<mark>[-/.])(?P<two>00?)(?P=mark)(?P<year>0000|00)"
    r"|(?P<day>00?)[- ](?P<name>[A-Za-z]{3})[a-z]*[- ](?P<yr>0000|00)"
)
_CLOCK = (
    r"(?P<H>00?):(?P<M>00)(?::(?P<S>00)(?:[.,](?P<f>0+))?)?(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
    r"|(?P<cH>00)(?P<cM>00)(?:(?P<cS>00)(?:[.,](?P<cf>0+))?)?"
)
_ZONE = r" ?(?P<utc>Z|z|UTC|GMT)|(?P<sign>[-+\u2212])(?P<zh>00)(?::?(?P<zm>00))?"
_WHOLE = re.compile(f"(?:(?:{_DATE})(?:[T ] *|$))?(?:(?:{_CLOCK})(?:{_ZONE})?)?")


@dataclass(frozen=True)
class Written:
    """Times as written, one row a cell: date parts (year, month, day; or year, first, second where
    their order is open), nanoseconds of the day, seconds of 60, offset in minutes.
    """

    date: Ints  # (n, 3)
    open_order: Bools  # which of its two numbers is the month
    point: Bools  # 01.03.2026, day first wherever it is used
    of_day: Ints
    leap: Bools
    offset: Ints
    missing: Bools

    @staticmethod
    def joined(parts: Sequence[Written]) -> Written:
        """Return the rows of several, one after the other."""
        return Written(
            date=np.concatenate([part.date for part in parts]),
            open_order=np.concatenate([part.open_order for part in parts]),
            point=np.concatenate([part.point for part in parts]),
            of_day=np.concatenate([part.of_day for part in parts]),
            leap=np.concatenate([part.leap for part in parts]),
            offset=np.concatenate([part.offset for part in parts]),
            missing=np.concatenate([part.missing for part in parts]),
        )


@dataclass(frozen=True)
class Moments:
    """Moments of UTC.

    Attributes
    ----------
    ns : (n,) array of int
        Since 1970 as POSIX counts, without leap seconds.
    leap : (n,) array of bool
        Whether it lies in a leap second, which POSIX gives to the next day.
    missing : (n,) array of bool
    assumed_utc : bool
        Whether nothing said that these are UTC.
    """

    ns: Ints
    leap: Bools
    missing: Bools
    assumed_utc: bool

    @property
    def start(self) -> np.datetime64:
        """The first known moment; the second before it if that is a leap second."""
        k = int(np.argmin(self.missing))
        return np.datetime64(int(self.ns[k] - _SECOND * self.leap[k]), "ns")

    @property
    def seconds(self) -> Floats:
        """Seconds elapsed since ``start``; NaN where missing."""
        total = _counted(self.ns) - _SECOND * self.leap
        since = total - _counted(np.asarray(self.start.astype(np.int64)))
        return np.where(self.missing, np.nan, since * 1e-9)


def elapsed_s(start: np.datetime64, end: np.datetime64) -> float:
    """Seconds from one moment of UTC to another, leap seconds counted.

    >>> elapsed_s(np.datetime64("2016-12-31T23:59:58"), np.datetime64("2017-01-01T00:00:02"))
    5.0
    """
    one, two = (
        _counted(np.asarray(t.astype("datetime64[ns]").astype(np.int64))) for t in (start, end)
    )
    return float(two - one) * 1e-9


def utc_after(start: np.datetime64, seconds: Floats) -> np.ndarray:
    """UTC (n,) so many seconds after ``start``; NaT where seconds are NaN."""
    known = np.isfinite(seconds)
    first = int(_counted(np.asarray(start.astype("datetime64[ns]").astype(np.int64))))
    total = first + np.rint(np.where(known, seconds, 0.0) * 1e9).astype(np.int64)
    inserted = np.searchsorted(_LEAPS + _SECOND * np.arange(1, len(_LEAPS) + 1), total, "right")
    utc = (total - _SECOND * inserted).astype("datetime64[ns]")
    return np.where(known, utc, np.datetime64("NaT", "ns"))


def _counted(ns: Ints) -> Ints:
    return ns + _SECOND * np.searchsorted(_LEAPS, ns, side="right")


def written(cells: Sequence[str]) -> Written:
    """Read cells digit by digit, all those of one shape at a time.

    Raises
    ------
    BadCell
        At the first that is neither a time nor missing.
    """
    texts = [cell.strip() for cell in cells]
    gone = np.array(missing(texts), dtype=np.bool_)
    long = next((k for k, text in enumerate(texts) if len(text) > _LONGEST), None)
    if long is not None:
        raise BadCell(long, _unread(texts[long]))
    n = len(texts)
    given = np.array(texts, dtype=f"U{max(map(len, texts), default=1) or 1}")
    codes = given.view(np.uint32).reshape(n, -1)
    digits = (codes >= 48) & (codes <= 57)
    shapes = np.ascontiguousarray(np.where(digits, np.uint32(48), codes)).view(given.dtype).ravel()
    values = np.where(digits, codes - 48, 0).astype(np.int64)
    found = Written(
        date=np.zeros((n, 3), np.int64),
        open_order=np.zeros(n, np.bool_),
        point=np.zeros(n, np.bool_),
        of_day=np.zeros(n, np.int64),
        leap=np.zeros(n, np.bool_),
        offset=np.full(n, _NO_OFFSET, np.int64),
        missing=gone,
    )
    left = ~gone
    for _ in range(_MOST_SHAPES):
        if not left.any():
            return found
        k = int(np.argmax(left))
        here = left & (shapes == shapes[k])
        _fill(found, here, str(shapes[k]), values[here], k, texts[k])
        left &= ~here
    raise BadCell(int(np.argmax(left)), "is written in too many ways to be a column of times")


def _fill(found: Written, here: Bools, shape: str, values: Ints, k: int, text: str) -> None:
    match = _WHOLE.fullmatch(shape)
    if not shape or match is None:
        raise BadCell(k, _unread(text))

    def number(*names: str) -> Ints:
        for name in names:
            first, last = match.span(name)
            if first >= 0:
                return values[:, first:last] @ 10 ** np.arange(last - first)[::-1]
        return np.zeros(len(values), np.int64)

    year = number("y", "cy", "year", "yr")
    if any(match[name] and len(match[name]) == 2 for name in ("year", "yr")):
        year += np.where(year < 80, 2000, 1900)
    month = number("m", "cm", "one")
    if match["name"]:
        name = match["name"].lower()
        if name not in _MONTHS:
            raise BadCell(k, _unread(text))
        month = np.full(len(values), _MONTHS.index(name) + 1)
    found.date[here] = np.stack([year, month, number("d", "cd", "two", "day")], axis=-1)
    found.open_order[here] = match["one"] is not None
    found.point[here] = match["mark"] == "."
    hour, minute, second = number("H", "cH"), number("M", "cM"), number("S", "cS")
    if match["half"]:
        wrong = (hour < 1) | (hour > 12)
        hour = hour % 12 + 12 * (match["half"] in "Pp")
    else:
        wrong = hour > 23
    wrong |= (minute > 59) | (second > 60)
    if wrong.any():
        row = int(np.flatnonzero(here)[np.argmax(wrong)])
        raise BadCell(row, "holds a time of day that no clock shows")
    name = "f" if match["f"] else "cf"
    first, last = match.span(name)
    places = min(last - first, 9)
    fraction = values[:, first : first + places] @ 10 ** np.arange(8, 8 - places, -1)
    found.of_day[here] = ((hour * 60 + minute) * 60 + second) * _SECOND + fraction
    found.leap[here] = second == 60
    if match["utc"]:
        found.offset[here] = 0
    elif match["sign"]:
        found.offset[here] = (number("zh") * 60 + number("zm")) * (
            1 if match["sign"] == "+" else -1
        )


def _unread(text: str) -> str:
    shown = text if len(text) <= 40 else text[:40] + "..."
    return (
        f"must be ISO 8601 UTC as 2026-03-01T12:00:00Z, or another date with a time, got {shown!r}"
    )


def read_moments(
    times: Written, *, date_order: str | None = None, zone: float | str | None = None
) -> Moments:
    """Turn times as written into moments.

    Parameters
    ----------
    times : Written
    date_order : "dmy", "mdy", "ymd" or None
        Where the file leaves it open.
    zone : hours east of UTC, name of a zone, or None
        For times without an offset.

    Raises
    ------
    BadCell
        At a time that does not exist, may mean two days or two moments, or lies outside 1980 to
        2100.
    """
    known = ~times.missing
    ns = _posix(times, date_order)
    has = times.offset != _NO_OFFSET
    if (has & known).any() and (~has & known).any():
        k = int(np.argmax(~has & known))
        raise BadCell(k, "has an offset from UTC in some rows only, and none here")
    plain = not (has & known).any()
    if not plain:
        ns = ns - np.where(known, times.offset, 0) * 60 * _SECOND
    elif isinstance(zone, str):
        ns = _from_zone(ns, known, zone)
    elif zone is not None:
        ns = ns - round(zone * 3600) * _SECOND
    false = times.leap & known & ~np.isin(ns // _SECOND * _SECOND, _LEAPS)
    if false.any():
        raise BadCell(int(np.argmax(false)), "holds a second 60, but there was no leap second then")
    return Moments(ns, times.leap, times.missing, plain and zone is None)


def _posix(times: Written, date_order: str | None) -> Ints:
    """Nanoseconds since 1970 of the clock that is written."""
    known = ~times.missing
    year, month, day = times.date.T.copy()
    swap = times.open_order & known
    if swap.any() and _day_first(times, date_order):
        month[swap], day[swap] = day[swap], month[swap].copy()
    undated = known & (year == 0) & (month == 0) & (day == 0)
    if undated.any():
        raise BadCell(int(np.argmax(undated)), "has a time of day without a date")
    outside = known & ((year < _EARLIEST) | (year > _LATEST))
    if outside.any():
        k = int(np.argmax(outside))
        raise BadCell(
            k,
            f"has the year {year[k]:04d}, outside {_EARLIEST} to {_LATEST}: was the clock not set?",
        )
    good = known & (month >= 1) & (month <= 12)
    months = ((year - 1970) * 12 + month - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]") + (day - 1)
    wrong = known & ~(good & (days.astype("datetime64[M]") == months))
    if wrong.any():
        k = int(np.argmax(wrong))
        raise BadCell(
            k, f"has a day that no calendar has, {year[k]:04d}-{month[k]:02d}-{day[k]:02d}"
        )
    posix = days.astype(np.int64) * 86_400 * _SECOND + times.of_day
    return np.where(known, posix, 0)


def _day_first(times: Written, date_order: str | None) -> bool:
    """Whether 03/04/2026 is the third of April: as told, as a point says, or as some other row
    shows.
    """
    if date_order is not None:
        return date_order == "dmy"
    asked = times.open_order & ~times.missing
    if (times.point & asked).any():
        return True
    first, second = times.date[asked, 1], times.date[asked, 2]
    if (first > 12).any() and (second > 12).any():
        k = int(np.flatnonzero(asked)[np.argmax(second > 12)])
        raise BadCell(k, "has day and month in another order than other rows")
    if not ((first > 12).any() or (second > 12).any()):
        k = int(np.argmax(asked))
        raise BadCell(
            k, "has dates whose day and month cannot be told apart: say date_order=dmy or mdy"
        )
    return bool((first > 12).any())


def _from_zone(ns: Ints, known: Bools, zone: str) -> Ints:
    import pandas as pd

    local = pd.DatetimeIndex(ns[known].astype("datetime64[ns]"))
    rows = np.flatnonzero(known)
    try:
        skipped = local.tz_localize(zone, ambiguous=np.zeros(len(local), bool), nonexistent="NaT")
    except Exception as error:  # zoneinfo's and its back-ends' errors have no common base
        raise ValueError(
            f"utc_offset must be hours, '+01:00' or a zone as 'Europe/Berlin', got {zone!r}"
        ) from error
    if skipped.isna().any():
        k = int(rows[np.argmax(skipped.isna())])
        raise BadCell(k, f"holds a time that does not exist in {zone}: clocks were set over it")
    try:
        there = local.tz_localize(zone, ambiguous="infer")
    except ValueError as error:
        raise BadCell(
            int(rows[0]),
            f"has an hour that {zone} has twice, and their order does not tell which: {error}",
        ) from None
    found = ns.copy()
    found[known] = there.tz_convert(None).to_numpy().astype("datetime64[ns]").astype(np.int64)
    return found
