"""Frozen dataclasses of parameters to TOML tables and back, with every wrong key named."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any, TypeVar

__all__ = ["from_table", "read_toml", "to_table"]

T = TypeVar("T")


def read_toml(path: str | Path) -> dict[str, Any]:
    """Return the tables of a TOML file; an error names the file if it is missing or not TOML."""
    if not Path(path).is_file():
        raise FileNotFoundError(f"no TOML file at {path}")
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not a TOML file: {error}") from None


def from_table(
    kind: type[T], table: dict[str, Any], *, where: str, ignore: Iterable[str] = ()
) -> T:
    """Make a dataclass from a table whose keys are its fields.

    Parameters
    ----------
    kind : dataclass
        What to make; a field without a default must have its key.
    table : dict
        From `read_toml`.
    where : str
        Begins every message, e.g. the file's name.
    ignore : iterable of str
        Keys that belong to somebody else.

    Raises
    ------
    ValueError
        If a key is missing or unknown, or a value does not fit.
    """
    if not isinstance(table, dict):
        raise ValueError(f"{where} must be a table of keys and values, got {table!r}")
    known = {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    given = {key: value for key, value in table.items() if key not in set(ignore)}
    unknown = sorted(set(given) - set(known))
    if unknown:
        named = ", ".join(unknown)[:100]
        raise ValueError(f"{where}: unknown key {named}; known are {', '.join(known)}")
    needed = [
        name for name, f in known.items() if f.default is MISSING and f.default_factory is MISSING
    ]
    missing = [name for name in needed if name not in given]
    if missing:
        raise ValueError(f"{where}: key {', '.join(missing)} is missing")
    try:
        return kind(**given)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{where}: {str(error)[:300]}") from None


def to_table(record: Any) -> str:
    """Return the lines of a TOML table that `from_table` reads back; infinite numbers and empty
    lists are left out.

    >>> from dataclasses import make_dataclass
    >>> print(to_table(make_dataclass("Lens", ["focal_mm", "shape"])(260.0, (1080, 1920))))
    focal_mm = 260.0
    shape = [1080, 1920]
    """
    lines = []
    for key, value in asdict(record).items():
        plain = _lists(value)
        if plain == [] or (isinstance(plain, float) and math.isinf(plain)):
            continue
        lines.append(f"{key} = {plain}")
    return "\n".join(lines)


def _lists(value: Any) -> Any:
    return [_lists(item) for item in value] if isinstance(value, tuple | list) else value
