"""What the pages of the site promise: every key of every file, and code that runs."""

import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

import losbench as lb
from losbench.pointing.performance import budget
from losbench.recording.frames.raw import RawLayout
from losbench.resources import data_file, documents_folder
from losbench.telemetry.columns import HeadColumns, TelemetryFormat
from losbench.thermoelastic import model

DOCS = documents_folder()
ROOT = Path(__file__).resolve().parent.parent
TABLE = re.compile(r"^\| key[^|]*\|.*?\n\|[-|]+\n((?:\|.*\n)+)", re.MULTILINE)
SOURCE = {"name", "kind", "source", *budget._LAWS}


def keys(kind):
    return {field.name for field in fields(kind)}


def tables(page):
    """The keys that each table of a page lists in its first column."""
    text = (DOCS / page).read_text(encoding="utf-8")
    for rows in TABLE.findall(text):
        yield {
            key
            for row in rows.splitlines()
            for key in re.findall(r"`\[?(\w+)\]?`", row.split("|")[1])
        }


@pytest.mark.parametrize(
    ("page", "known"),
    [
        ("howto/frames.md", [keys(lb.Camera), keys(lb.Detector), keys(RawLayout)]),
        ("howto/telemetry.md", [keys(TelemetryFormat), keys(HeadColumns)]),
        ("howto/metrics.md", [keys(lb.PointingRequirement), SOURCE]),
    ],
)
def test_a_page_lists_every_key_of_its_files_and_no_other(page, known):
    assert list(tables(page)) == known


def test_the_camera_of_mirrors_and_metal_shows_every_table():
    """Those that the example does without stand in it as comments."""
    text = data_file("three-mirror-camera.toml").read_text(encoding="utf-8")
    page = (DOCS / "howto" / "frames.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\w+", text)) | set(re.findall(r"`(\w+)`", page)) >= model._KEYS


def blocks():
    pages = [*sorted(DOCS.rglob("*.md")), *ROOT.glob("README*.md")]
    for path in pages:
        for k, code in enumerate(
            re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), re.M | re.S)
        ):
            yield pytest.param(code, id=f"{path.name}-{k}")


@pytest.mark.slow
@pytest.mark.parametrize("code", list(blocks()))
def test_code_on_a_page_runs(code, tmp_path):
    (tmp_path / "page.py").write_text(code, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "error", "page.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
