"""What the names of files tell: their order, what is missing, what does not belong, and times."""

from __future__ import annotations

import re
from collections import Counter
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from losbench.logs import FrameTimes
from losbench.tables.dialect import Dialect

__all__ = ["belonging", "in_natural_order", "jump_in_names", "times_in_names"]

_MOST_STRANGERS = 0.2  # of the files; more are no strangers but a second series
_SERIES = 3  # files that make one
_DIRECTIVES = {
    "Y": r"\d{4}", "m": r"\d{2}", "d": r"\d{2}", "j": r"\d{3}", "H": r"\d{2}", "M": r"\d{2}",
    "S": r"\d{2}", "f": r"\d{1,6}", "y": r"\d{2}", "z": r"(?:Z|[+-]\d{2}:?\d{2})",
}  # fmt: skip


def in_natural_order(files: list[Path]) -> list[Path]:
    """Sort by name, with numbers as numbers: frame-9 before frame-10."""
    return sorted(
        files,
        key=lambda p: (
            [int(t) if t.isdecimal() else t.lower() for t in re.split(r"(\d+)", p.name)],
            str(p),
        ),
    )


def belonging(files: list[Path]) -> tuple[list[Path], tuple[str, ...]]:
    """Return the files whose names follow the pattern of most, and a note that names the others.

    Raises ``ValueError`` where two series lie side by side.

    >>> files = [Path(f"frame-{k}.png") for k in range(9)] + [Path("dark.png")]
    >>> kept, notes = belonging(files)
    >>> len(kept), notes
    (9, ('1 of 10 files does not belong to frame-#.png and is left out: dark.png.',))
    """
    patterns = [re.sub(r"\d+", "#", path.name.lower()) for path in files]
    counts = Counter(patterns).most_common()
    if len(counts) == 1 or counts[0][1] < _SERIES:
        return files, ()
    (main, _), *others = counts
    series = [pattern for pattern, count in others if count >= _SERIES]
    strangers = [path.name for path, each in zip(files, patterns, strict=True) if each != main]
    if series and len(strangers) > _MOST_STRANGERS * len(files):
        listed = ", ".join(f"{p} ({n} files)" for p, n in counts if n >= _SERIES)
        raise ValueError(
            f"{files[0].parent.name} holds more than one series, {listed}: choose one, as in "
            f"{files[0].parent.name}/{main.replace('#', '*')}"
        )
    if len(strangers) > _MOST_STRANGERS * len(files):
        return files, ()
    does = "does not belong" if len(strangers) == 1 else "do not belong"
    is_ = "is" if len(strangers) == 1 else "are"
    named = ", ".join(strangers[:3]) + (f" and {len(strangers) - 3} more" * (len(strangers) > 3))
    return [path for path, each in zip(files, patterns, strict=True) if each == main], (
        f"{len(strangers)} of {len(files)} files {does} to {main} and {is_} left out: {named}.",
    )


def jump_in_names(files: list[Path]) -> tuple[str, ...]:
    """Say where the one number that counts these files jumps over others, if it does."""
    numbers = [[int(digits) for digits in re.findall(r"\d+", file.name)] for file in files]
    if len({len(each) for each in numbers}) > 1:
        return ()
    counting = [
        steps
        for column in zip(*numbers, strict=True)
        if (steps := np.diff(np.array(column, dtype=object))).any()
    ]
    if len(counting) != 1:
        return ()
    step = counting[0].min()
    jumps = np.flatnonzero(counting[0] > step)
    even = step > 0 and step == sorted(counting[0])[len(counting[0]) // 2]
    if not even or (counting[0] % step).any() or not jumps.size:
        return ()
    before, after = (files[jumps[0] + k].name for k in (0, 1))
    more = f", the first of {jumps.size} jumps" if jumps.size > 1 else ""
    return (
        f"File names jump from {before} to {after}{more}: if frames are missing, a period puts "
        "later ones early.",
    )


def times_in_names(
    names: list[str], pattern: str, utc_offset: float | str | None = None
) -> FrameTimes:
    """Return the times that names of files hold, by a pattern of strptime's directives; local ones
    by their offset from UTC in hours, or their zone.

    >>> times = times_in_names(
    ...     ["cam_20260301_120000.png", "cam_20260301_120005.png"], "%Y%m%d_%H%M%S"
    ... )
    >>> times.seconds.tolist(), str(times.start)
    ([0.0, 5.0], '2026-03-01T12:00:00.000000')
    """
    parts = re.split(r"%(.)", pattern)
    unknown = [f"%{mark}" for mark in parts[1::2] if mark not in _DIRECTIVES]
    if unknown or len(parts) < 3:
        known = " ".join(f"%{mark}" for mark in _DIRECTIVES)
        raise ValueError(
            f"name_times must be a pattern of {known}, e.g. %Y%m%d_%H%M%S, got {pattern!r}"
        )
    form = "".join(_DIRECTIVES[part] if k % 2 else re.escape(part) for k, part in enumerate(parts))
    zone = Dialect(utc_offset=utc_offset).zone
    try:
        local = ZoneInfo(zone) if isinstance(zone, str) else timezone(timedelta(hours=zone or 0))
    except (KeyError, OSError, ValueError) as error:  # as zoneinfo raises them
        raise ValueError(
            f"utc_offset must be hours or a zone as 'Europe/Berlin', got {utc_offset!r}"
        ) from error
    stamps = []
    for name in names:
        found = re.search(rf"(?<!\d){form}(?!\d)", name)
        try:
            at = None if found is None else datetime.strptime(found[0], pattern)
        except ValueError:
            at = None
        if at is None:
            raise ValueError(f"name_times must fit the name of every file: {name} has no {pattern}")
        at = at.replace(tzinfo=local) if at.tzinfo is None else at
        at = at.astimezone(UTC).replace(tzinfo=None)
        stamps.append(np.datetime64(at, "us"))
    array = np.array(stamps)
    seconds = (array - array[0]) / np.timedelta64(1, "us") * 1e-6
    return FrameTimes(seconds, array[0], zone is None and "%z" not in pattern)
