"""One browser, one server and one JupyterLab for all browser tests; without chromium they are
skipped, and say so.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from lab import CHROMIUM, WHY_NOT, chromium, jupyterlab

from losbench.resources import build_folder, notebook_folder


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
    for path in notebook_folder().glob("*.ipynb"):
        (root / path.name).write_bytes(path.read_bytes())
    with jupyterlab(root) as running:
        yield running


@pytest.fixture(scope="session")
def page(browser, lab):
    """JupyterLab, loaded once; it lists what it asks for outside, and its errors."""
    size = {"width": 1280, "height": 800}
    with browser.new_context(viewport=size, has_touch=True) as context:
        page = context.new_page()
        page.asked = []
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("pageerror", lambda problem: page.asked.append(f"error: {problem}"))
        yield page


@pytest.fixture(scope="session")
def screenshots():
    folder = build_folder() / "screenshots"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
