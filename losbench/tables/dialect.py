"""What only its owner knows of a CSV file."""

from __future__ import annotations

import codecs
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict

from losbench.checks import choice, number

__all__ = ["Dialect", "DialectOptions"]

_NAMED = {"tab": "\t", "\\t": "\t", "space": " ", "comma": ",", "semicolon": ";"}
_OFFSET = re.compile(r"(?:UTC|GMT)?\s*([+-]?)(\d{1,2})(?::?([0-5]\d))?")


class DialectOptions(TypedDict, total=False):
    """The parameters of `Dialect` as keywords of a reading function."""

    delimiter: str | None
    decimal: str | None
    encoding: str | None
    date_order: str | None
    utc_offset: float | str | None
    sentinel: float | tuple[float, ...]
    unit: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """What rules cannot find out about a CSV file; by default they look for it.

    Parameters
    ----------
    delimiter : one character, "tab" or "space", optional
        What stands between columns.
    decimal : "," or ".", optional
        What 18,000 means, where no other number of the file tells.
    encoding : str, optional
        Such as "gbk" or "cp1250".
    date_order : "dmy", "mdy" or "ymd", optional
        How 03/04/2026 is meant.
    utc_offset : hours, "+01:00" or a zone as "Europe/Berlin", optional
        For times that carry no offset of their own.
    sentinel : float or tuple of float
        Numbers that stand for a missing reading.
    header : bool
        False for a file whose columns have no names: they are "1", "2" and so on.
    unit : mapping
        Column to unit, where the file does not tell: ``{"T1": "degC"}``.
    """

    delimiter: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    date_order: str | None = None
    utc_offset: float | str | None = None
    sentinel: float | tuple[float, ...] = ()
    header: bool = True
    unit: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.delimiter is not None:
            mark = _NAMED.get(self.delimiter, self.delimiter)
            if len(mark) != 1 or mark in '"\r\n#' or mark.isalnum():
                raise ValueError(
                    f"delimiter must be one character, 'tab' or 'space', got {self.delimiter!r}"
                )
            object.__setattr__(self, "delimiter", mark)
        if self.decimal is not None:
            choice("decimal", self.decimal, (",", "."))
        if self.encoding is not None:
            try:
                "".encode(codecs.lookup(self.encoding).name)
            except (LookupError, ValueError):
                raise ValueError(
                    f"encoding must be one that Python knows, such as 'gbk', got {self.encoding!r}"
                ) from None
        if self.date_order is not None:
            order = choice("date_order", str(self.date_order).lower(), ("dmy", "mdy", "ymd"))
            object.__setattr__(self, "date_order", order)
        given = self.sentinel if isinstance(self.sentinel, tuple | list) else (self.sentinel,)
        object.__setattr__(self, "sentinel", tuple(number("sentinel", value) for value in given))
        _ = self.zone

    @property
    def zone(self) -> float | str | None:
        """Hours east of UTC, the name of a zone, or None where neither is given."""
        if self.utc_offset is None:
            return None
        if not isinstance(self.utc_offset, str):
            return number("utc_offset", self.utc_offset, low=-14.0, high=14.0)
        text = self.utc_offset.strip()
        if text in ("Z", "UTC", "GMT"):
            return 0.0
        hours = offset_hours(text)
        return number("utc_offset", hours, low=-14.0, high=14.0) if hours is not None else text


def offset_hours(text: str) -> float | None:
    """Read "+01:00", "UTC-3" or "5.5" as hours east of UTC; None for anything else."""
    found = _OFFSET.fullmatch(text)
    if found:
        sign, hours, minutes = found.groups()
        return (-1.0 if sign == "-" else 1.0) * (int(hours) + int(minutes or 0) / 60.0)
    return float(text) if re.fullmatch(r"[+-]?\d{1,2}\.\d{1,4}", text) else None
