"""Imports point one way, and the package costs little until something is asked of it."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import losbench

PACKAGE = Path(losbench.__file__).parent
ROOMS = ["", "estimation", "imaging", "pointing", "figures", "recording", "papers", "workbench", "cli"]
GROUND = {"__about__", "units", "checks", "parameters", "resources"}
HEAVY = ["statsmodels", "matplotlib", "cv2", "pandas", "scipy.stats"]


def room(module):
    """Return the place of ``losbench.<room>...`` in the order; ground floor modules come first."""
    first = module.split(".")[1] if "." in module else ""
    return ROOMS.index("" if first in GROUND else first)


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            whole = [f"losbench.{alias.name}" for alias in node.names] if node.module == "losbench" else [node.module]
            yield from whole


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_room_imports_only_from_those_before_it(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    if parts == ("losbench", "__init__"):
        return
    for module in imported(path):
        assert module != "losbench", f"{path.name} imports the package that it is part of"
        if module.startswith("losbench."):
            assert room(module) <= room(".".join(parts)), f"{path.name} imports {module}, which lies further down"


def test_importing_the_package_loads_nothing_heavy():
    code = f"import sys, json, losbench; print(json.dumps([m for m in {HEAVY} if m in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
