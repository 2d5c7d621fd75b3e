"""What "copy as code" shows: the very source of an experiment, and all that it needs beside."""

from __future__ import annotations

import ast
import builtins
import inspect
from collections.abc import Callable, Mapping
from functools import cache
from pprint import pformat
from types import FunctionType, ModuleType
from typing import Any

__all__ = ["copied"]

_WIDTH = 88


def copied(experiment: Callable[..., Any], settings: Mapping[str, Any], answer: str) -> str:
    """Return a script that defines the experiment, calls it with these settings, and prints.

    Parameters
    ----------
    experiment : function
        At the top of a module, which imports nothing but public names: numpy, ``losbench as lb``,
        the papers. Functions and plain constants of the same room that it uses come along.
    settings : mapping
        Its keyword arguments.
    answer : str
        What is printed of ``seen``, the value of the experiment.
    """
    arguments = "".join(f"    {name}={value!r},\n" for name, value in settings.items())
    call = f"seen = {experiment.__name__}(\n{arguments})\nprint({answer})"
    return f"{_standing_alone(experiment)}\n\n\n{call}"


@cache
def _standing_alone(experiment: Callable[..., Any]) -> str:
    parts: dict[str, dict[str, str]] = {"imports": {}, "constants": {}, "functions": {}}
    _gather(experiment, parts)
    imports, constants = (sorted(parts[name].values()) for name in ("imports", "constants"))
    blocks = ["\n".join(imports), "\n".join(constants), *parts["functions"].values()]
    return "\n\n\n".join(filter(None, blocks)).replace("\n\n\n", "\n\n", 1)


def _gather(function: Callable[..., Any], parts: dict[str, dict[str, str]]) -> None:
    """Collect what a function uses before the function itself, so that all is defined in order."""
    source = inspect.getsource(function).strip()
    for name in _names(source):
        if name == function.__name__ or name not in function.__globals__:
            continue
        thing = function.__globals__[name]
        if isinstance(thing, ModuleType):
            parts["imports"][name] = _import(thing.__name__, name)
        elif isinstance(thing, FunctionType) and thing.__module__.startswith(__package__):
            _gather(thing, parts)
        elif hasattr(thing, "__module__") and hasattr(thing, "__name__"):
            parts["imports"][name] = f"from {thing.__module__} import {name}"
        else:
            parts["constants"][name] = f"{name} = {pformat(thing, width=_WIDTH, sort_dicts=False)}"
    parts["functions"][function.__name__] = source


def _names(source: str) -> list[str]:
    """Return every name that is read, in the order of the text, but those of the language."""
    read = [node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)]
    return [name for name in dict.fromkeys(read) if not hasattr(builtins, name)]


def _import(module: str, name: str) -> str:
    """Return the line that people write, as ``import numpy as np``."""
    parent, _, last = module.rpartition(".")
    if parent and last == name:
        return f"from {parent} import {name}"
    return f"import {module}" if module == name else f"import {module} as {name}"
