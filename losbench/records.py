"""Frozen records of arrays, taken apart and put together field by field.

A field that holds no array (a flag, a unit, None) belongs to the whole record and is handed on as
it is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

__all__ = ["changed", "join", "put", "stack", "take"]

Record = TypeVar("Record", bound=Any)  # a dataclass
_ARRAYS = (np.ndarray, np.generic)
Array = Any  # NDArray[Any], or a NumPy scalar where a record has no axes


def changed(
    record: Record, change: Callable[[Array], Array], *, only: Collection[str] | None = None
) -> Record:
    """Return the record with every array, or ``only`` those of these names, passed through
    ``change``.
    """
    return replace(record, **{name: change(array) for name, array in _arrays(record, only).items()})


def take(record: Record, chosen: Any, *, axis: int = 0) -> Record:
    """Return some elements of every array: an index, a slice, or arrays of indices or bools.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Spots:
    ...     xy: Array
    ...     unit: str
    >>> take(Spots(np.eye(3), "px"), [0, 2])
    Spots(xy=array([[1., 0., 0.], [0., 0., 1.]]), unit='px')
    """
    index: tuple[Any, ...] = (*(slice(None),) * axis, chosen)
    return changed(record, lambda array: array[index])


def put(record: Record, where: Any, part: Record, *, only: Collection[str] | None = None) -> None:
    """Write the arrays of ``part`` into places of those of the record, which change."""
    for name, array in _arrays(record, only).items():
        array[where] = getattr(part, name)


def join(records: Sequence[Record], *, axis: int = 0) -> Record:
    """Return one record with the arrays of all, end to end; the rest is that of the first.

    Parameters of one shape, as of records made in parts.
    """
    return _together(records, lambda arrays: np.concatenate(arrays, axis=axis))


def stack(records: Sequence[Record], *, axis: int = 0) -> Record:
    """Return one record with the arrays of all along a new axis; the rest is that of the first."""
    return _together(records, lambda arrays: np.stack(arrays, axis=axis))


def _together(records: Sequence[Record], gather: Callable[[list[Array]], Array]) -> Record:
    first = records[0]
    columns = {name: [getattr(each, name) for each in records] for name in _arrays(first, None)}
    return replace(first, **{name: gather(arrays) for name, arrays in columns.items()})


def _arrays(record: Any, only: Collection[str] | None) -> dict[str, Array]:
    names = [each.name for each in fields(record)] if only is None else only
    held = ((name, getattr(record, name)) for name in names)
    return {name: value for name, value in held if isinstance(value, _ARRAYS)}
