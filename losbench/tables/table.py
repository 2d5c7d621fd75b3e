"""A CSV file as named columns of text, and what they say as numbers and times."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TypeAlias

import numpy as np

from losbench.arrays import Floats, Ints
from losbench.tables.cells import BadCell, decimal_comma, kind, parse_numbers, quick_numbers
from losbench.tables.dialect import Dialect, offset_hours
from losbench.tables.layout import Layout, find_layout, rows
from losbench.tables.moments import Moments, Written, read_moments, written
from losbench.tables.units import spelled, unit_of

__all__ = ["Table", "read_table"]

_ROWS = 4_000  # turned into numbers at a time: their text stays in the cache, and no longer
_ZONE_IN_NAME = re.compile(r"\b(?:UTC|GMT)(?:\s*([+-]\s*\d{1,2}(?::?\d\d)?))?(?!\w)")

Chunk: TypeAlias = "Floats | tuple[str, ...]"


@dataclass(frozen=True)
class Table:
    """Columns of a CSV file.

    Attributes
    ----------
    file : str
        Name of the file, which begins every message.
    names : tuple of str
        Of the columns, as the file has them.
    notes : tuple of str
        What was left out or taken for granted.
    """

    file: str
    names: tuple[str, ...]
    notes: tuple[str, ...]
    dialect: Dialect = field(repr=False)
    option: str = field(repr=False)  # of the command line that maps names
    units: tuple[str, ...] = field(repr=False)
    _chunks: tuple[tuple[Chunk, ...], ...] = field(repr=False)  # by column
    _lines: Ints = field(repr=False)

    def __len__(self) -> int:
        return len(self._lines)

    def unit(self, name: str) -> str:
        """The unit of a column: as the user says, else as the row of units or its name does."""
        k = self._index(name)
        given = self.dialect.unit.get(name)
        if given is not None:
            if not spelled(given):
                raise ValueError(
                    f"unit of {name!r} must be one such as degC, K or s, got {given!r}"
                )
            return spelled(given)
        return spelled(self.units[k] if k < len(self.units) else "") or unit_of(name)

    def holds(self, name: str) -> str:
        """What a column holds, by its first cells: "n" numbers, "t" times, "w" words, "." none."""
        for chunk in self._chunks[self._index(name)]:
            if not isinstance(chunk, tuple):
                if np.isfinite(chunk).any():
                    return "n"
                continue
            found = next((k for k in map(kind, chunk) if k != "."), None)
            if found:
                return found
        return "."

    def numbers(self, name: str) -> Floats:
        """Return a column's numbers (n,), NaN where one is missing; ``ValueError`` names the line
        of the first cell that is none.
        """
        chunks = self._chunks[self._index(name)]
        comma = self._comma(chunks)
        parts, at = [], 0
        for chunk in chunks:
            with self._located(name, at):
                parts.append(
                    parse_numbers(chunk, comma=comma) if isinstance(chunk, tuple) else chunk
                )
            at += len(chunk)
        values = np.concatenate(parts)
        return np.where(np.isin(values, self.dialect.sentinel), np.nan, values)

    def moments(self, name: str, *, dates: str | None = None) -> Moments:
        """Return a column's times as moments of UTC; ``dates`` names the column that holds their
        dates, where that is another one.
        """
        parts, at = [], 0
        for k, chunk in enumerate(self._chunks[self._index(name)]):
            if not isinstance(chunk, tuple):
                with self._located(name, at):
                    raise BadCell(
                        0,
                        f"holds numbers where times are expected as 2026-03-01T12:00:00Z; if they "
                        f"are seconds, name the column time_s or map it: "
                        f"{self.mapped('time_s', name)}",
                    )
            cells: Sequence[str] = chunk
            if dates is not None:
                days = self._chunks[self._index(dates)][k]
                if not isinstance(days, tuple):
                    raise ValueError(
                        f"column {dates!r} of {self.file} must hold dates, not numbers"
                    )
                cells = [
                    f"{day.strip()} {time.strip()}" for day, time in zip(days, chunk, strict=True)
                ]
            with self._located(name, at):
                parts.append(written(cells))
            at += len(chunk)
        with self._located(name, 0):
            return read_moments(
                Written.joined(parts),
                date_order=self.dialect.date_order,
                zone=self._zone(name, dates or ""),
            )

    def texts(self, name: str) -> tuple[str, ...]:
        """Return a column's cells as they are, stripped."""
        return tuple(
            str(cell).strip() for chunk in self._chunks[self._index(name)] for cell in chunk
        )

    def line(self, row: int) -> int:
        """The line of the file that holds a row."""
        return int(self._lines[row])

    def mapped(self, standard: str, own: str) -> str:
        """How to say which column is meant, for a message."""
        return f"columns={{{standard!r}: {own!r}}} ({self.option} '{standard}={own}')"

    def listed(self) -> str:
        """The names of the columns, for a message."""
        shown = ", ".join(name[:30] or "(no name)" for name in self.names[:12])
        return shown + f" and {len(self.names) - 12} more" * (len(self.names) > 12)

    def _index(self, name: str) -> int:
        if self.names.count(name) > 1:
            raise ValueError(f"{self.file} has two columns {name!r}: give them different names")
        if name not in self.names:
            raise ValueError(f"{self.file} has no column {name!r}; it has {self.listed()}")
        return self.names.index(name)

    def _zone(self, *names: str) -> float | str | None:
        """Hours that a column's own name tells, as GMT+01:00, else what the user says."""
        for name in names:
            told = _ZONE_IN_NAME.search(name)
            if told:
                return offset_hours((told.group(1) or "0").replace(" ", ""))
            if re.search(r"(?:^|_)utc$", name.lower()):
                return 0.0
        return self.dialect.zone

    def _comma(self, chunks: tuple[Chunk, ...]) -> bool | None:
        """Whether the commas of a column are decimal: as told, or as its own numbers say, or those
        of other columns; None where nothing does.
        """
        if self.dialect.decimal is not None:
            return self.dialect.decimal == ","
        own = decimal_comma(c for chunk in chunks if isinstance(chunk, tuple) for c in chunk)
        if own is not None:
            return own
        first = (column[0] for column in self._chunks)
        others = (decimal_comma(chunk) for chunk in first if isinstance(chunk, tuple))
        return True if any(others) else None

    @contextmanager
    def _located(self, name: str, at: int) -> Iterator[None]:
        """Give a bad cell's message its column, file and line."""
        try:
            yield
        except BadCell as bad:
            raise ValueError(
                f"column {name!r} of {self.file} {bad}, in line {self.line(at + bad.index)}"
            ) from None


def read_table(
    path: str | Path,
    dialect: Dialect | None = None,
    *,
    option: str = "--column",
    as_text: bool = False,
) -> Table:
    """Read a CSV file as people bring them, its cells left as text if asked for.

    Rules on its first 200 lines find encoding, delimiter, header and units; every row below must
    have the header's number of fields, empty ones at its end apart.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is no table, or can be read in two ways; the message names file and line.
    """
    file, own = Path(path), dialect or Dialect()
    if not file.is_file():
        raise FileNotFoundError(f"no CSV file at {path}")
    layout = find_layout(file, own)
    judge = _Judge(file.name, layout)
    chunks: list[list[Chunk]] = [[] for _ in layout.names]
    lines: list[Ints] = []
    kept = judge.kept(rows(file, layout))
    while block := list(islice(kept, _ROWS)):
        lines.append(np.array([line for line, _ in block], dtype=np.int64))
        for column, cells in zip(chunks, zip(*(row for _, row in block), strict=True), strict=True):
            quick = None if as_text else quick_numbers(cells)
            column.append(cells if quick is None else quick)
    if not lines:
        raise ValueError(f"{file.name} must hold at least one row below its header")
    return Table(
        file.name,
        layout.names,
        (*layout.notes, *judge.notes(ended=_ends_its_last_line(file))),
        own,
        option,
        layout.units,
        tuple(map(tuple, chunks)),
        np.concatenate(lines),
    )


class _Judge:
    """Tells rows of data from remarks between them, and refuses what may be either."""

    def __init__(self, file: str, layout: Layout) -> None:
        self.file, self.layout, self.n = file, layout, len(layout.names)
        self.remarks: list[int] = []
        self.headers: list[int] = []
        self.cut: tuple[int, str] | None = None

    def kept(self, given: Iterator[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
        header = [name.lower() for name in self.layout.names]
        n, first = self.n, self.layout.names[0]
        for line, row in given:
            if self.cut is not None and any(row):
                raise ValueError(self.cut[1])
            if len(row) == n and row[-1] and row[0] and row[0] != first:
                yield line, row
                continue
            cells = [cell.strip() for cell in row]
            while len(cells) > self.n and not cells[-1]:
                cells.pop()
            if [cell.lower() for cell in cells] == header:
                self.headers.append(line)
            elif self._is_remark(cells):
                self.remarks.append(line)
            elif len(cells) > self.n:
                raise ValueError(self._said(line, cells))
            elif len(cells) < self.n and any(cells):
                self.cut = (line, self._said(line, cells))
            elif any(cells):
                yield line, cells

    def notes(self, *, ended: bool) -> list[str]:
        """What was left out, and a last line that may be cut."""
        notes = [
            f"{self.file}: {len(lines)} {what}, the first in line {lines[0]}, left out."
            for lines, what in (
                (self.remarks, "lines of words between the data"),
                (self.headers, "repetitions of the header"),
            )
            if lines
        ]
        if self.cut is not None:
            notes.append(f"{self.file}: the last line, {self.cut[0]}, is cut off and left out.")
        elif not ended:
            notes.append(f"{self.file}: the last line has no end; its last number may be cut.")
        return notes

    def _is_remark(self, cells: list[str]) -> bool:
        kinds = "".join(map(kind, cells))
        if len(cells) < self.n:
            return "w" in kinds and not ("n" in kinds or "t" in kinds)
        alone = len(cells) > 1 and kinds[0] == "w" and not any(cells[1:])
        return alone and self.layout.kinds[:1] in ("n", "t")

    def _said(self, line: int, cells: list[str]) -> str:
        count = f"{len(cells)} field{'s' * (len(cells) != 1)}"
        wanted = f"{self.n} field{'s' * (self.n != 1)}"
        text = f"{self.file}, line {line} has {count}, but the header has {wanted}"
        whole = all(re.fullmatch(r"[+-]?\d+", cell) for cell in cells[1:])
        if len(cells) > self.n and whole and self.layout.delimiter == ",":
            return f"{text}: a decimal comma in a file with commas between its columns?"
        return text


def _ends_its_last_line(file: Path) -> bool:
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 4))
        return stream.read().rstrip(b"\0")[-1:] in (b"\n", b"\r")
