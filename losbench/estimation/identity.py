"""What a trial and its parameters are, to the last bit: a study goes on with cells of no other."""

from __future__ import annotations

import copyreg
import dis
import hashlib
from collections import deque
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import partial
from types import (
    BuiltinMethodType,
    CodeType,
    FunctionType,
    MappingProxyType,
    MethodType,
    ModuleType,
)
from typing import Any

import numpy as np

__all__ = ["identity"]

_PLAIN = {str, bytes, int, float, complex, bool, type(None)}
# What a function reaches of these may be there to keep account of its calls.
_ACCOUNTS = (
    *(list, dict, set, deque, Iterator),
    *(np.random.Generator, np.random.BitGenerator, np.random.RandomState),
)


def identity(*things: Any) -> str:
    """Return a short name for all that things hold, the same in every process.

    Functions count by their code, their defaults, and all that they close over or find under global
    names, but for what may keep account of their calls: lists, dicts, sets, deques, iterators and
    generators of random numbers. Functions of another module than the first that is met count by
    their names, as do classes and modules; behind `functools.wraps` and `functools.lru_cache` the
    function within counts too. Objects count by what pickle would keep of them, dataclasses by
    their fields, objects that can be called by their ``__call__`` besides (by no other method), and
    what cannot be pickled by the name of its type.

    >>> identity(1.0) == identity(1.0), identity([1, 2]) == identity((1, 2.0))
    (True, False)
    """
    return _Digests().of(things, None).hex()[:16]


class _Digests:
    def __init__(self) -> None:
        # With the things themselves, so that no other is given their id.
        self.known: dict[tuple[int, str | None], tuple[Any, bytes]] = {}
        self.within: list[tuple[int, str | None]] = []

    def of(self, thing: Any, home: str | None) -> bytes:
        """Return 32 bytes for a thing that a function of the module home reaches."""
        kind = type(thing)
        name = _name(kind)
        if kind in _PLAIN:
            return _digest(name, repr(thing).encode())
        if isinstance(thing, type | ModuleType):
            return _digest(name, _name(thing))
        if kind is np.ndarray and not thing.dtype.hasobject:
            return _digest(name, f"{thing.dtype}{thing.shape}".encode(), thing.tobytes())
        if home is None and callable(thing) and not isinstance(thing, partial):
            home = getattr(thing, "__module__", None)
        key = id(thing), home
        if key in self.within:  # it holds itself
            return _digest(b"again", str(self.within.index(key)).encode())
        if key not in self.known:
            self.within.append(key)
            held = [self.of(each, home) for each in _held(thing, home)]
            self.within.pop()
            if isinstance(thing, set | frozenset):  # its order is another in every process
                held.sort()
            self.known[key] = thing, _digest(name, *held)
        return self.known[key][1]


def _digest(*parts: bytes) -> bytes:
    return hashlib.sha256(b"\0".join(parts)).digest()


def _name(thing: Any) -> bytes:
    name = getattr(thing, "__qualname__", None) or thing.__name__
    return f"{getattr(thing, '__module__', '')}.{name}".encode()


def _held(thing: Any, home: str | None) -> list[Any]:
    if isinstance(thing, MethodType):
        return [thing.__func__, thing.__self__]
    if isinstance(thing, FunctionType):
        return _of_function(thing) if thing.__module__ == home else [_name(thing)]
    if type(thing) in (dict, MappingProxyType):
        return [part for item in thing.items() for part in item]
    if type(thing) in (list, tuple) or isinstance(thing, set | frozenset):
        return list(thing)
    if isinstance(thing, np.ma.MaskedArray):  # whose pickle has a fill value only once asked for
        return [thing.data, np.ma.getmaskarray(thing), thing.fill_value]
    call = getattr(type(thing), "__call__", None)  # noqa: B004
    wrapped = getattr(thing, "__dict__", {}).get("__wrapped__")
    return [*_kept(thing), wrapped, call if _is_function(call) else None]


def _kept(thing: Any) -> list[Any]:
    if is_dataclass(thing):  # and not what it has reckoned once and kept
        return [getattr(thing, each.name) for each in fields(thing)]
    try:
        registered = copyreg.dispatch_table.get(type(thing))
        kept = registered(thing) if registered else thing.__reduce_ex__(4)
    except Exception:  # what cannot be pickled may raise anything
        return []
    if isinstance(kept, str):
        return [getattr(thing, "__module__", ""), kept]
    maker = _name(kept[0]) if isinstance(kept[0], FunctionType) else kept[0]
    return [maker, *kept[1:3], *(list(more or ()) for more in kept[3:5])]


def _is_function(thing: Any) -> bool:
    return isinstance(thing, FunctionType) or hasattr(thing, "__wrapped__")


def _of_function(function: FunctionType) -> list[Any]:
    code = function.__code__
    cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
    found = {name: cell.cell_contents for name, cell in cells if _is_filled(cell)}
    for name in sorted(_globals_of(code) & function.__globals__.keys()):
        found[name] = function.__globals__[name]
    settings = {name: value for name, value in found.items() if not _keeps_account(value)}
    wrapped = function.__dict__.get("__wrapped__")
    return [*_of_code(code), function.__defaults__, function.__kwdefaults__, settings, wrapped]


def _keeps_account(value: Any) -> bool:
    """Return whether a value, or what it is a method of, may change with every call."""
    return isinstance(value.__self__ if isinstance(value, BuiltinMethodType) else value, _ACCOUNTS)


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
