"""What a trial and its parameters are, to the last bit: a study goes on with cells of no other."""

from __future__ import annotations

import dis
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

__all__ = ["identity"]

_PLAIN = (str, bytes, int, float, complex, type(None), type(...), np.generic)
# Lists, dicts and other objects that a function reaches may be there to keep account of its calls.
_SETTINGS = (*_PLAIN, tuple, frozenset, np.ndarray, FunctionType, MethodType, partial, type)


def identity(*things: Any) -> str:
    """Return a short name for all that things hold.

    Functions count by their code, their defaults, and the numbers, arrays, records and functions of
    their own module that they close over or find under global names; objects by what pickle would
    keep of them.

    >>> identity(1.0) == identity(1.0), identity([1, 2]) == identity((1, 2.0))
    (True, False)
    """
    found = hashlib.sha256()
    for piece in _pieces(things, []):
        found.update(piece + b"\0")
    return found.hexdigest()[:16]


def _pieces(thing: Any, within: list[Any]) -> Iterator[bytes]:
    yield f"{type(thing).__module__}.{type(thing).__qualname__}".encode()
    if isinstance(thing, _PLAIN):
        yield repr(thing).encode()
    elif isinstance(thing, type | ModuleType):
        yield f"{getattr(thing, '__module__', '')}.{thing.__name__}".encode()
    elif isinstance(thing, np.ndarray) and not thing.dtype.hasobject:
        yield f"{thing.dtype}{thing.shape}".encode() + thing.tobytes()
    elif any(thing is each for each in within):  # it holds itself
        yield b"again"
    else:
        for each in _held(thing, within):
            yield from _pieces(each, [*within, thing])


def _held(thing: Any, within: list[Any]) -> list[Any]:
    if isinstance(thing, partial):
        return [thing.func, thing.args, thing.keywords]
    if isinstance(thing, MethodType):
        return [thing.__func__, thing.__self__]
    if isinstance(thing, FunctionType):
        home = next((each for each in within if isinstance(each, FunctionType)), thing)
        return _of_function(thing, home=home.__module__)
    if isinstance(thing, Mapping):
        return [part for item in thing.items() for part in item]
    if is_dataclass(thing):  # and not what it has reckoned once and kept
        return [getattr(thing, each.name) for each in fields(thing)]
    if isinstance(thing, list | tuple):
        return list(thing)
    if isinstance(thing, set | frozenset):
        return sorted(identity(each) for each in thing)
    try:
        kept = thing.__reduce_ex__(4)
    except Exception:  # what cannot be pickled may raise anything
        return [repr(thing)]
    if isinstance(kept, str):
        return [kept]
    return [kept[:3], *(list(more or ()) for more in kept[3:5])]


def _of_function(function: FunctionType, *, home: str) -> list[Any]:
    if function.__module__ != home:
        return [function.__module__, function.__qualname__]
    code = function.__code__
    cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
    found = {name: cell.cell_contents for name, cell in cells if _is_filled(cell)}
    for name in sorted(_globals_of(code) & function.__globals__.keys()):
        found[name] = function.__globals__[name]
    settings = {
        name: value
        for name, value in found.items()
        if isinstance(value, _SETTINGS) or is_dataclass(value)
    }
    return [*_of_code(code), function.__defaults__, function.__kwdefaults__, settings]


def _of_code(code: CodeType) -> list[Any]:
    inner = [_of_code(each) for each in code.co_consts if isinstance(each, CodeType)]
    plain = [each for each in code.co_consts if not isinstance(each, CodeType)]
    return [code.co_code, code.co_names, code.co_varnames, plain, inner]


def _globals_of(code: CodeType) -> set[str]:
    inner = (_globals_of(each) for each in code.co_consts if isinstance(each, CodeType))
    loaded = {i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL"}
    return loaded.union(*inner)


def _is_filled(cell: Any) -> bool:
    try:
        return cell.cell_contents is cell.cell_contents
    except ValueError:  # a name that is bound later
        return False
