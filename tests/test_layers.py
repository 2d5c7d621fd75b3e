"""Imports point one way, and the package costs little until something is asked of it."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import losbench

PACKAGE = Path(losbench.__file__).parent
GROUND = {path.stem for path in PACKAGE.glob("*.py")} | {"tables"}
FLOORS = [
    GROUND,
    {"estimation"},
    {"optics"},
    {"thermoelastic"},
    {"imaging", "pointing"},
    {"recording", "telemetry"},
    {"papers"},
    {"workbench"},
    {"cli"},
]
USERS = "losbench/workbench/explorers"  # they show code as their reader would write it
HEAVY = ["statsmodels", "matplotlib", "cv2", "pandas", "scipy.stats"]


def room(module):
    """Return the room of ``losbench.<room>...``; modules of the ground are rooms of their own."""
    return module.split(".")[1]


def floor(module):
    return next(k for k, rooms in enumerate(FLOORS) if room(module) in rooms)


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            whole = (
                [f"losbench.{alias.name}" for alias in node.names]
                if node.module == "losbench"
                else [node.module]
            )
            yield from whole


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE))
)
def test_a_room_imports_only_from_the_floors_below(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    if parts == ("losbench", "__init__"):
        return
    for module in imported(path):
        if module == "losbench":
            assert "/".join(parts).startswith(USERS), f"{path.name} imports its own package"
        if module.startswith("losbench."):
            here = ".".join(parts)
            assert floor(module) <= floor(here), f"{path.name} imports {module}, from a floor above"
            neighbours = floor(module) == floor(here) > 0 and room(module) != room(here)
            assert not neighbours, f"{path.name} imports {module}, from the room next door"


def test_importing_the_package_loads_nothing_heavy():
    code = (
        f"import sys, json, losbench; print(json.dumps([m for m in {HEAVY} if m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
