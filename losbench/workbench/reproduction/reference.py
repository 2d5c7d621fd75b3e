"""The API reference: a page for each room, from the public names and their docstrings."""

from __future__ import annotations

import inspect
import os
import re
from importlib import import_module
from pathlib import Path

__all__ = ["public_names", "write_commands", "write_reference"]

_FACE = import_module("losbench")  # what is documented, not what is built on
_ROOMS = {
    "estimation": "Estimation: least squares, robust fits, what they survive",
    "imaging": "Imaging: spots, detector, finder, centroids",
    "optics": "Optics: camera, star catalogue, motion",
    "pointing": "Pointing: attitudes, thermal sensitivities, metrics, star cameras",
    "recording": "Recordings: your frames, measured",
    "logs": "Logs and series",
    "telemetry": "Telemetry of star cameras",
    "workbench": "The ledger of claims",
}
_ELSEWHERE = {"series": "logs"}
_MODULES = {
    "losbench.units": "Units",
    "losbench.pointing.thermal.terms": "Terms of a thermal model",
    "losbench.workbench.explorers": "Explorers",
    "losbench.thermoelastic": "Thermo-elastic cameras",
    "losbench.papers.liu2026": "The paper liu2026",
    "losbench.papers.lyu2015": "The paper lyu2015",
    "losbench.papers.ren2023": "The paper ren2023",
}
_NAME = re.compile(r"^from \.(\w+)\S* import (\w+) as \2$", re.MULTILINE)


def public_names() -> dict[str, list[str]]:
    """Return the public names of each room, as ``losbench/__init__.pyi`` lists them."""
    stub = Path(str(_FACE.__file__)).with_suffix(".pyi").read_text(encoding="utf-8")
    found: dict[str, list[str]] = {}
    for room, name in _NAME.findall(stub):
        if not inspect.ismodule(getattr(_FACE, name)):
            found.setdefault(_ELSEWHERE.get(room, room), []).append(name)
    return found


def write_reference(folder: Path) -> None:
    """Write the pages of the reference, as reStructuredText for Sphinx's autodoc."""
    folder.mkdir(parents=True, exist_ok=True)
    names = public_names()
    for room in names:
        title = _ROOMS.get(room, room.capitalize())
        entries = [_entry(f"losbench.{name}", getattr(_FACE, name)) for name in names[room]]
        _write(folder / f"{room}.rst", title, entries)
    for module, title in _MODULES.items():
        _write(folder / f"{module.rpartition('.')[2]}.rst", title, _members(module))
    order = [*(room for room in _ROOMS if room in names), *sorted(set(names) - set(_ROOMS))]
    order += [module.rpartition(".")[2] for module in _MODULES]
    tree = ["Everything public is a name of `losbench`, loaded on first use:", ""]
    tree += ["``import losbench as lb``.", "", ".. toctree::", ""]
    _write(folder / "index.rst", "API reference", [*tree, *(f"   {name}" for name in order)])


def write_commands(path: Path) -> None:
    """Write what each command says of itself."""
    os.environ["COLUMNS"] = "100"
    parser = import_module("losbench.cli").parser()
    (commands,) = (a.choices for a in parser._actions if isinstance(a.choices, dict))  # noqa: SLF001
    parts = [f"## {name}\n\n```text\n{one.format_help()}```\n" for name, one in commands.items()]
    path.write_text("\n".join(parts), encoding="utf-8")


def _members(module: str) -> list[str]:
    thing = import_module(module)
    entries = [(inspect.getdoc(thing) or "").partition("\n\n")[0], ""]
    for name in thing.__all__:
        value = getattr(thing, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            entries.append(_entry(f"{module}.{name}", value))
    return entries


def _entry(name: str, value: object) -> str:
    if not inspect.isclass(value):
        return f".. autofunction:: {name}"
    return f".. autoclass:: {name}\n   :members:"


def _write(path: Path, title: str, entries: list[str]) -> None:
    head = [title, "=" * len(title), "", ".. currentmodule:: losbench", ""]
    path.write_text("\n".join([*head, *entries, ""]), encoding="utf-8")
