"""The site: executed notebooks, how-to pages, API reference, ledger and report, built by Sphinx."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from bs4 import BeautifulSoup

from losbench.resources import build_folder, data_file, documents_folder, notebook_folder
from losbench.workbench.ledger.claims import COLUMNS, as_csv
from losbench.workbench.ledger.ledger import Ledger
from losbench.workbench.reproduction.pages import cell_anchors, ledger_table, page_of_notebook
from losbench.workbench.reproduction.replication import replication_page

__all__ = ["build_site", "can_build"]


def can_build() -> bool:
    """Whether what the pages are made with is installed: the extra ``docs``."""
    return all(find_spec(name) for name in ("myst_nb", "furo"))


def build_site(*, out: str | Path | None = None, notebooks: str | Path | None = None) -> Path:
    """Build the site of a run and return its first page.

    Parameters
    ----------
    out : path, optional
        The folder of the run, by default the build folder; the site is its folder ``site``.
    notebooks : path, optional
        As for `reproduce`. What has not been run is shown without results.

    Raises
    ------
    ImportError
        If the extra ``docs`` is not installed.
    ValueError
        If Sphinx complains, with its first words.
    """
    if not can_build():
        raise ImportError("the site needs Sphinx, furo and myst-nb: pip install 'losbench[docs]'")
    build = Path(out or build_folder()).resolve()
    build.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(
        prefix=".site-", dir=build, ignore_cleanup_errors=True
    ) as spare:
        source, made = Path(spare, "source"), Path(spare, "site")
        shutil.copytree(documents_folder(), source)
        _take_notebooks(Path(notebooks or notebook_folder()), build, source / "notebooks")
        _take_ledger(build, source)
        _take_rest(build, source / "_made")
        _run_sphinx(source, made, Path(spare, "doctrees"))
        site, old = build / "site", Path(spare, "old")
        if site.exists():
            site.rename(old)
        made.rename(site)
    return site / "index.html"


def _take_notebooks(notebooks: Path, build: Path, folder: Path) -> None:
    folder.mkdir()
    for path in sorted(notebooks.glob("[0-9]*.ipynb")):
        executed = build / "notebooks" / path.name
        run = executed.is_file()
        text = (executed if run else path).read_text(encoding="utf-8")
        page = page_of_notebook(json.loads(text), run=run)
        (folder / path.name).write_text(json.dumps(page), encoding="utf-8")


def _take_ledger(build: Path, source: Path) -> None:
    made = source / "_made"
    made.mkdir()
    ledger = Ledger.collect(build / "ledger")
    rows, anchors = list(ledger.rows()), cell_anchors(build)
    (made / "ledger.html").write_text(ledger_table(rows, anchors), encoding="utf-8")
    (made / "replication.html").write_text(
        replication_page(ledger, build, anchors), encoding="utf-8"
    )
    (source / "_static" / "ledger.csv").write_text(as_csv(COLUMNS, rows), encoding="utf-8")


def _take_rest(build: Path, made: Path) -> None:
    shutil.copy(data_file("three-mirror-camera.toml"), made)
    report = build / "benchmarks.html"
    said = "<p>They have not been run here.</p>"
    if report.is_file():
        said = _without_its_own_look(report.read_text(encoding="utf-8"))
    (made / "benchmarks.html").write_text(said, encoding="utf-8")


def _without_its_own_look(page: str) -> str:
    """Return what a page says, to stand within another one."""
    soup = BeautifulSoup(page, "html.parser")
    for part in soup(["style", "title", "meta", "h1", "script"]):
        part.decompose()
    for drawing in soup("svg"):
        drawing["role"], drawing["aria-label"] = "img", "Processor time for each, over size"
    inner = soup.body or soup.html or soup
    return f'<div class="made">{inner.decode_contents()}</div>'


def _run_sphinx(source: Path, made: Path, doctrees: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    done = subprocess.run(
        [*command, "-d", doctrees, source, made],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONHASHSEED": "0", "SOURCE_DATE_EPOCH": "0", "NO_COLOR": "1"},
    )
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.strip()]
        raise ValueError("the site: " + " ".join(said[:5]).replace(f"{source}{os.sep}", ""))
