"""One browser and one server for all browser tests; without chromium they are skipped, and say
so.
"""

import sys
from pathlib import Path

import nbformat
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from lab import CHROMIUM, WHY_NOT, chromium, jupyterlab, notebook

from losbench.resources import build_folder, notebook_folder
from losbench.workbench import explorers

WITH_EXPLORERS = [
    path
    for path in sorted(notebook_folder().glob("*.ipynb"))
    if "Explorer(" in path.read_text("utf-8")
]


def pytest_generate_tests(metafunc):
    if "explorer_notebook" in metafunc.fixturenames:
        names = [
            *(f"{kind}.ipynb" for kind in explorers.__all__),
            *(path.name for path in WITH_EXPLORERS),
        ]
        metafunc.parametrize("explorer_notebook", names, scope="module")


@pytest.fixture(scope="session")
def browser():
    if CHROMIUM is None:
        pytest.skip(WHY_NOT)
    pytest.importorskip("playwright", reason="playwright is missing: pip install losbench[browser]")
    with chromium() as running:
        yield running


@pytest.fixture(scope="session")
def lab(browser, tmp_path_factory):
    root = tmp_path_factory.mktemp("notebooks")
    for kind in explorers.__all__:
        nbformat.write(
            notebook(f"from losbench.workbench.explorers import {kind}\n{kind}()"),
            root / f"{kind}.ipynb",
        )
    for path in WITH_EXPLORERS:
        (root / path.name).write_bytes(path.read_bytes())
    with jupyterlab(root) as running:
        yield running


@pytest.fixture(scope="session")
def screenshots():
    folder = build_folder() / "screenshots"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
