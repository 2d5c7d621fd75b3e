"""How a CSV file is laid out, from its first 200 lines: encoding, delimiter, header, units."""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, dropwhile, islice
from pathlib import Path
from typing import BinaryIO

from losbench.tables.cells import kind
from losbench.tables.dialect import Dialect
from losbench.tables.units import is_unit_row

__all__ = ["Layout", "find_layout", "rows"]

_PREVIEW = 200
_BLOCK = 1 << 20
_LONGEST_NAME = 100
_LONGEST_DESCRIPTION = 5000
_YAML_BEGINS, _YAML_ENDS = "header:", "# End of YAML header"
_LONGEST_LINE = 1 << 17  # csv's own limit of a field
_BOMS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_UNKNOWN_ENCODING = (
    "{} is in an encoding that cannot be told from it: name it by encoding=, e.g. encoding=gbk"
)


@dataclass(frozen=True)
class Layout:
    """What is where in a CSV file.

    Attributes
    ----------
    names : tuple of str
        Of the columns.
    units : tuple of str
        As the row below the names has them, else empty.
    kinds : str
        What each column holds, letters as of `kind`.
    first_line : int
        Number of the last line above the data.
    skipped : int
        Lines at the top that are no table, but a description in YAML.
    notes : tuple of str
    """

    encoding: str
    delimiter: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinds: str
    first_line: int
    notes: tuple[str, ...]
    skipped: int = 0


@dataclass(frozen=True)
class _Line:
    number: int
    cells: list[str]
    kinds: str

    @property
    def is_data(self) -> bool:
        return "n" in self.kinds or "t" in self.kinds

    @property
    def is_words(self) -> bool:
        return "w" in self.kinds and not self.is_data


def find_layout(file: Path, dialect: Dialect) -> Layout:
    """Find out how a file is laid out; ``ValueError`` if it has no header or no data."""
    encoding = _encoding(file, dialect.encoding)
    skipped = _described(file, encoding)
    texts = _preview(file, encoding, skipped)
    if not any(text.strip() for text in texts):
        raise ValueError(f"{file.name} must be a CSV file with a header line, but is empty")
    delimiter = dialect.delimiter or _delimiter(texts)
    lines = [
        _Line(number, cells, "".join(map(kind, cells)))
        for number, cells in _split(texts, delimiter, file.name)
    ]
    if skipped and delimiter == "," and all(len(line.cells) == 1 for line in lines):
        return find_layout(file, replace(dialect, delimiter=" "))
    data = [line for line in lines if line.is_data]
    if not data:
        raise ValueError(
            f"{file.name} must hold at least one row below its header, but no line of it holds a "
            f"number or a time{_maybe_spaces(texts, delimiter)}"
        )
    kinds = _kinds(data[-3:])
    first = next((line for line in data if _fits(line, kinds)), data[0])
    above = [line for line in lines if line.number < first.number]
    if not dialect.header:
        numbered = tuple(str(k + 1) for k in range(len(first.cells)))
        last = first.number - 1
        return Layout(encoding, delimiter, numbered, (), kinds, last + skipped, (), skipped)
    words = [line for line in above if line.is_words]
    below: list[_Line] = []
    while len(words) > 1 and is_unit_row(words[-1].cells):
        below.insert(0, words.pop())
    header = words[-1] if words else _commented(texts, first, delimiter)
    if header is None:
        raise ValueError(
            f"{file.name} must be a CSV file with a header line that names its columns, got "
            f"{_short(texts[0])} as its first line"
        )
    names = [cell.strip() for cell in header.cells]
    while len(names) > 1 and not names[-1]:
        names.pop()
    if max(map(len, names)) > _LONGEST_NAME:
        raise ValueError(
            f"{file.name} must have names of up to {_LONGEST_NAME} characters in its header"
        )
    left = [line for line in above if line.number < header.number and len(line.cells) > 1]
    units = tuple(cell.strip() for cell in below[0].cells) if below else ()
    end = max([header, *below], key=lambda line: line.number).number
    notes = [f"{file.name}: {len(left)} lines above the header are left out."] * bool(left)
    return Layout(
        encoding, delimiter, tuple(names), units, kinds, end + skipped, tuple(notes), skipped
    )


def rows(file: Path, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of its last line and the cells of every row below the header."""
    with open(file, encoding=layout.encoding, newline="") as stream:
        every = _split(islice(stream, layout.skipped, None), layout.delimiter, file.name)
        numbered = ((number + layout.skipped, cells) for number, cells in every)
        yield from dropwhile(lambda row: row[0] <= layout.first_line, numbered)


def _described(file: Path, encoding: str) -> int:
    """How many lines at the top describe the data in YAML, as those of GRACE-FO do."""
    with open(file, encoding=encoding, newline="") as stream:
        if not stream.readline(_LONGEST_LINE).startswith(_YAML_BEGINS):
            return 0
        for number, text in enumerate(islice(stream, _LONGEST_DESCRIPTION), 2):
            if text.startswith(_YAML_ENDS):
                return number
    return 0


def _preview(file: Path, encoding: str, skipped: int) -> list[str]:
    """The first lines of a file below its description, their ends included."""
    with open(file, encoding=encoding, newline="") as stream:
        deque(islice(stream, skipped), maxlen=0)
        texts = list(islice(iter(lambda: stream.readline(_LONGEST_LINE), ""), _PREVIEW))
    long = next((k for k, text in enumerate(texts, 1) if len(text) == _LONGEST_LINE), None)
    if long is not None:
        raise ValueError(f"{file.name}: line {long} is too long for one of a table")
    return texts


def _split(texts: Iterable[str], delimiter: str, name: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells of the lines that are neither empty nor begin with # or sep=."""
    lines = iter(texts)
    first = next(lines, "")
    kept = ("\n" if text.startswith("#") else text for text in lines)
    opening = "\n" if _is_remark(0, first) else first
    reader = csv.reader(chain([opening], kept), delimiter=delimiter, skipinitialspace=True)
    try:
        for cells in reader:
            if cells:
                yield reader.line_num, cells
    except csv.Error as error:
        raise ValueError(f"{name}: line {reader.line_num} cannot be read: {error}") from None


def _is_remark(k: int, text: str) -> bool:
    return text.startswith("#") or (k == 0 and text.lower().startswith("sep="))


def _encoding(file: Path, given: str | None) -> str:
    with file.open("rb") as stream:
        head = stream.read(4096)
        stream.seek(0)
        if given is not None:
            return _decodes(stream, given, file.name)
        for mark, name in _BOMS.items():
            if head.startswith(mark):
                return _decodes(stream, name, file.name)
        for parity, name in ((0, "utf-16-be"), (1, "utf-16-le")):
            half = head[parity::2]
            if len(half) > 1 and half.count(0) * 2 > len(half):
                return _decodes(stream, name, file.name)
        try:
            return _decodes(stream, "utf-8", file.name)
        except UnicodeDecodeError:
            stream.seek(0)
        tail = b""
        for block in iter(lambda: stream.read(_BLOCK), b""):
            if re.search(rb"[\x80-\xff]{3}", tail + block):
                raise ValueError(_UNKNOWN_ENCODING.format(file.name))
            tail = block[-2:]
        stream.seek(0)
        return _decodes(stream, "cp1252", file.name)


def _decodes(stream: BinaryIO, encoding: str, name: str) -> str:
    """Return ``encoding`` if the file is text in it; UTF-8 alone may fail, to try another."""
    decoder = codecs.getincrementaldecoder(encoding)()
    try:
        for block in iter(lambda: stream.read(_BLOCK), b""):
            if "\0" in decoder.decode(block):
                raise ValueError(f"{name} holds null bytes, so it is no CSV file")
        decoder.decode(b"", final=True)
    except UnicodeError:
        if encoding == "utf-8":
            raise
        if encoding == "cp1252":
            raise ValueError(_UNKNOWN_ENCODING.format(name)) from None
        raise ValueError(f"{name} is not text in the encoding {encoding}") from None
    return encoding


def _delimiter(texts: list[str]) -> str:
    """The one of ``sep=``, else a mark that most lines of the lower half, where the data are, have
    equally often; a comma gives way, since it may be a decimal one.
    """
    declared = re.fullmatch(r"sep=(.)\s*", texts[0], re.IGNORECASE)
    if declared:
        return declared.group(1)
    lines = [text for k, text in enumerate(texts) if text.strip() and not _is_remark(k, text)]
    lower = lines[len(lines) // 2 :]
    for mark in ";\t|":
        counts = Counter(text.rstrip("\r\n").count(mark) for text in lower)
        counts.pop(0, None)
        if counts and counts.most_common(1)[0][1] * 2 > len(lower):
            return mark
    return ","


def _maybe_spaces(texts: list[str], delimiter: str) -> str:
    split = [text.split() for text in texts if text.strip()]
    apart = delimiter != " " and any(
        len(cells) > 1 and "n" in map(kind, cells) for cells in split[1:]
    )
    return "; if spaces part its columns, say so by delimiter=space" if apart else ""


def _kinds(data: list[_Line]) -> str:
    """What each column holds, by the last lines of data, of which the very last may be cut."""
    n = max(len(line.kinds) for line in data)
    full = [line.kinds for line in data if len(line.kinds) == n]
    return "".join(
        next((k for k in "tn" if k in column), "w" if "w" in column else ".")
        for column in zip(*full, strict=True)
    )


def _fits(line: _Line, kinds: str) -> bool:
    """Whether a line holds no word where the data have numbers or times."""
    return line.is_data and all(
        not (k in "nt" and given == "w") and not (k == "w" and given in "nt")
        for k, given in zip(kinds, line.kinds, strict=False)
    )


def _commented(texts: list[str], first: _Line, delimiter: str) -> _Line | None:
    """The header of a file that NumPy wrote: the last remark above the data, if it has a name for
    each column.
    """
    remarks = [k for k, text in enumerate(texts[: first.number - 1]) if text.startswith("#")]
    if not remarks:
        return None
    text = texts[remarks[-1]].lstrip("# ")
    cells = next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])
    found = _Line(remarks[-1] + 1, cells, "".join(map(kind, cells)))
    return found if found.is_words and len(cells) == len(first.cells) else None


def _short(text: str) -> str:
    return repr(text.strip()[:60])
