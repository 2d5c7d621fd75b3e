"""Figures and tables: the same bytes every time, and provenance that can be checked."""

import dataclasses
import hashlib
import json
import struct

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from losbench import figures


@dataclasses.dataclass(frozen=True)
class Scenario:
    focal_mm: float = 260.0
    precision_px: tuple[float, ...] = (0.01, 0.1)


@pytest.fixture
def build(tmp_path, monkeypatch):
    monkeypatch.setenv("LOSBENCH_BUILD", str(tmp_path))
    with mpl.rc_context():
        figures.use_style()
        yield tmp_path
    plt.close("all")


def draw(name):
    fig, ax = plt.subplots()
    ax.plot(np.arange(5.0), np.arange(5.0) ** 2, label="a")
    ax.fill_between([0, 4], [0, 1], [2, 9], alpha=0.2)
    ax.set(xlabel="time (s)", ylabel="angle (arcsec)", title=r"$\alpha$")
    ax.legend()
    figures.save(fig, name, parameters=Scenario(), seed=7)


def test_a_figure_saved_twice_is_the_same_to_the_byte(build):
    draw("liu2026-fig-1")
    first = {path.name: path.read_bytes() for path in (build / "figures").iterdir()}
    draw("liu2026-fig-1")
    assert first == {path.name: path.read_bytes() for path in (build / "figures").iterdir()}
    assert set(first) == {"liu2026-fig-1.png", "liu2026-fig-1.svg", "liu2026-fig-1.json"}


def test_the_side_car_says_where_a_figure_comes_from(build):
    draw("liu2026-fig-1")
    record = json.loads((build / "figures" / "liu2026-fig-1.json").read_text())
    for kind, digest in record.pop("sha256").items():
        assert (
            hashlib.sha256((build / "figures" / f"liu2026-fig-1.{kind}").read_bytes()).hexdigest()
            == digest
        )
    assert (record["paper"], record["figure"], record["seed"]) == ("liu2026", "fig-1", 7)
    assert record["parameters"] == {"focal_mm": 260.0, "precision_px": [0.01, 0.1]}
    assert record["versions"]["numpy"] == np.__version__
    assert record["commit"] == figures.commit()
    assert json.loads(png_text(build / "figures" / "liu2026-fig-1.png")["Description"]) == record


def png_text(path):
    """Read the text chunks of a PNG, as its specification lays them out."""
    data, position, found = path.read_bytes(), 8, {}
    while position < len(data):
        length, kind = struct.unpack(">I4s", data[position : position + 8])
        if kind == b"tEXt":
            key, _, value = data[position + 8 : position + 8 + length].partition(b"\0")
            found[key.decode()] = value.decode("latin-1")
        position += length + 12
    return found


def test_a_checkout_without_git_is_of_unknown_commit(monkeypatch):
    monkeypatch.setenv("PATH", "")
    figures.commit.cache_clear()
    assert figures.commit() == "unknown"
    figures.commit.cache_clear()


def test_the_style_overrides_what_the_user_has_set(build):
    plt.rcParams["lines.linewidth"] = 9.0
    plt.rcParams["font.family"] = "monospace"
    figures.use_style()
    assert plt.rcParams["lines.linewidth"] == 1.4
    assert plt.rcParams["font.family"] == mpl.rcParamsDefault["font.family"]


def test_a_table_keeps_a_named_index_and_six_digits(build):
    frame = pd.DataFrame({"rms_px": [1 / 3, 2e-7]}, index=pd.Index(["A", "B"], name="spot"))
    figures.save_table(frame, "liu2026-table-1")
    figures.save_table(frame.reset_index(drop=True), "plain")
    assert (
        build / "tables" / "liu2026-table-1.csv"
    ).read_text() == "spot,rms_px\nA,0.333333\nB,2e-07\n"
    assert (build / "tables" / "plain.csv").read_text() == "rms_px\n0.333333\n2e-07\n"
