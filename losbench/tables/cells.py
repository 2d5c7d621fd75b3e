"""What one cell of a CSV file says: a number, a time, a word, or nothing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from losbench.arrays import Floats

__all__ = ["BadCell", "decimal_comma", "kind", "missing", "parse_numbers", "quick_numbers"]

_MISSING = {"", *("nan", "na", "n/a", "#n/a", "#na", "null", "none", "nil")}
_MISSING |= {"-", "--", "---", ".", "?", "missing", "error", "err", "over", "ovr", "ol"}
_MISSING |= {"#value!", "#div/0!", "#ref!", "#num!", "*", "**", "***", "****"}
_ENDLESS = {"inf", "infinity"}  # no word, though no number either
_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)*|[.,]\d+)(?:[eE][+-]?\d+)?")
_TIME = re.compile(
    r"\d{1,4}[-/.](?:\d{1,2}|[A-Za-z]{3,9})[-/.]\d{1,4}(?:[T ].*)?"
    r"|\d{8}T\d{4}.*|\d{1,2}:\d\d(?::\d\d.*)?(?: ?[AaPp][Mm])?"
)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
_DECIMAL = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")
_PLAIN = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_MINUS = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " "})


class BadCell(ValueError):
    """A cell, by its place among the cells given, that does not say what it must."""

    def __init__(self, index: int, message: str) -> None:
        super().__init__(message)
        self.index = index


def missing(cells: Sequence[str]) -> list[bool]:
    """Whether each of stripped cells says that there is no reading."""
    return [cell.lower() in _MISSING for cell in cells]


def kind(cell: str) -> str:
    """Return "." for nothing, "n" for a number, "t" for a time, "w" for words.

    >>> "".join(map(kind, ["18,5", "2026-03-01 12:00", "#N/A", "Door opened"]))
    'nt.w'
    """
    text = cell.strip().translate(_MINUS)
    if text.lower() in _MISSING:
        return "."
    if _TIME.fullmatch(text):  # before numbers, since 01.03.2026 looks like one
        return "t"
    return "n" if _NUMBER.fullmatch(text) or text.lower().strip("+-") in _ENDLESS else "w"


def quick_numbers(cells: Sequence[str]) -> Floats | None:
    """Plain numbers and blanks as floats; None where any cell says anything else."""
    try:
        values = np.array(list(map(float, cells)))
    except ValueError:
        try:
            values = np.array([float(cell or "nan") for cell in cells])
        except ValueError:
            return None
    # float() reads 1_000 and inf, which no logger means as a number
    return None if np.isinf(values).any() or "_" in "".join(cells) else values


def decimal_comma(cells: Iterable[str]) -> bool | None:
    """Whether commas in these cells are decimal: True if one of them can be nothing else, None if
    each may as well part thousands, False where there are none.
    """
    commas = [c for c in (c.strip().translate(_MINUS) for c in cells) if "," in c]
    if any(_DECIMAL.fullmatch(c) and not _THOUSANDS.fullmatch(c) for c in commas):
        return True
    return None if any(map(_THOUSANDS.fullmatch, commas)) else False


def parse_numbers(cells: Sequence[str], *, comma: bool | None) -> Floats:
    """Return the numbers of a column's cells, NaN for a missing one.

    Raises
    ------
    BadCell
        At the first cell that is no number, or could be two.
    """
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        text = cell.strip().translate(_MINUS)
        if text.lower() in _MISSING:
            continue
        plain = text.replace(",", ".") if comma and "." not in text else text
        if not _PLAIN.fullmatch(plain):
            raise BadCell(k, _why(cell))
        values[k] = float(plain)
        if np.isinf(values[k]):
            raise BadCell(k, f"must hold numbers, got {_shown(cell)}, too large for one")
    return values


def _why(cell: str) -> str:
    text = cell.strip()
    if _THOUSANDS.fullmatch(text) or ("," in text and "." in text and _NUMBER.fullmatch(text)):
        return (
            f"has {text!r}, whose comma may be a decimal one or part thousands: say decimal=',' "
            "(--decimal ,) or write it without marks for thousands"
        )
    return f"must hold numbers, got {_shown(text)}"


def _shown(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...")
