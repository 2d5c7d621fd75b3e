"""The runner on a handful of small notebooks: what it makes, what it names, what it leaves
alone.
"""

import csv
import json
from importlib.resources import files

import jsonschema
import nbformat
import pytest

from losbench.outputs import locked
from losbench.resources import data_file as real
from losbench.workbench.reproduction import reproduce as module
from losbench.workbench.reproduction.reproduce import reproduce

DRAW = """
import matplotlib.pyplot as plt
import losbench as lb
from losbench import figures
figures.use_style()
fig, ax = plt.subplots()
ax.plot([1, 2, 3])
figures.save(fig, "liu2026-fig-{0}", seed={0})
"""
JUDGE = """
import losbench as lb
ledger = lb.Ledger()
ledger.value("irls-13", lb.Value({{"focal": "260 mm"}}, {value}))
ledger.save("{number}")
"""


def write(folder, name, *cells):
    """Write a notebook whose cells have the ids cell-0, cell-1, ..."""
    new = nbformat.v4.new_notebook(
        metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    )
    new.cells = [nbformat.v4.new_markdown_cell(f"# Title of {name}\n\n$x^2$", id="title")]
    new.cells += [
        nbformat.v4.new_code_cell(source, id=f"cell-{i}") for i, source in enumerate(cells)
    ]
    folder.mkdir(exist_ok=True)
    nbformat.write(new, folder / f"{name}.ipynb")


@pytest.fixture
def notebooks(tmp_path):
    folder = tmp_path / "note books"
    write(folder, "01-judge", JUDGE.format(value=4.2278, number="01"))
    return folder


def contents(build, *folders):
    return {
        p.relative_to(build): p.read_bytes()
        for f in folders
        for p in sorted((build / f).rglob("*"))
        if p.is_file()
    }


def test_two_runs_give_the_same_bytes_and_a_third_has_nothing_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "losbench.workbench.reproduction.reproduce._common_inputs",
        lambda: b"as long as nobody edits the library",
    )
    notebooks = tmp_path / "note books"
    write(notebooks, "01-draw", DRAW.format(1), JUDGE.format(value=4.2278, number="01"))
    write(notebooks, "90-end", "import losbench as lb\nlen(lb.Ledger.collect().examined)")
    kept = ("figures", "tables", "ledger", "ledger.csv")
    first, second = tmp_path / "a", tmp_path / "b"
    for build in (first, second):
        result = reproduce(out=build, notebooks=notebooks, workers=1, quiet=True, site=False)
        assert [(run.notebook, run.error, run.reused) for run in result.runs] == [
            ("01-draw", "", False),
            ("90-end", "", False),
        ]
        assert result.counts == {"agrees": 1, "pending": 113}
    assert contents(first, *kept) == contents(second, *kept)
    assert {p.name for p in (first / "figures").iterdir()} == {
        f"liu2026-fig-1.{kind}" for kind in ("png", "svg", "json")
    }
    assert not [p for p in first.iterdir() if p.name.startswith(".")]

    executed = nbformat.read(first / "notebooks" / "90-end.ipynb", as_version=4)
    assert executed.cells[1].outputs[0].data["text/plain"] == "1"
    assert [cell.id for cell in executed.cells] == ["title", "cell-0"]
    assert "timing" not in json.dumps(executed.metadata)
    assert result.summary().endswith(f"Written to {second}; losbench site makes pages of it.")
    with (first / "ledger.csv").open() as file:
        assert sum(row["verdict"] == "agrees" for row in csv.DictReader(file)) == 1

    assert reproduce(["01"], out=first, notebooks=notebooks, quiet=True).runs[0].reused
    (notebooks / "01-draw.ipynb").unlink()
    again = reproduce(out=first, notebooks=notebooks, quiet=True, site=False)
    assert again.counts == {"pending": 114}
    assert not contents(first, "figures", "ledger")


def test_a_failing_cell_is_named_and_the_others_finish(notebooks, tmp_path):
    save = (
        "from losbench.resources import build_folder, write_whole\nwrite_whole(build_folder() / "
        "'tables' / 'a.csv', '')"
    )
    write(notebooks, "02-broken", save, "ledger = None\nledger.judge()")
    build = tmp_path / "build"
    result = reproduce(["01", "02"], out=build, notebooks=notebooks, quiet=True)
    assert not result.ok
    assert {run.notebook: bool(run.error) for run in result.runs} == {
        "01-judge": False,
        "02-broken": True,
    }
    assert (
        "02-broken.ipynb, cell 'cell-1' (number 3): AttributeError: 'NoneType'" in result.summary()
    )
    assert not contents(build, "tables")


def test_a_site_that_cannot_be_built_fails_the_run_and_one_that_need_not_does_not(
    tmp_path, monkeypatch
):
    def complain(**_):
        raise ValueError("the site: a.md:1: WARNING: no such page")

    monkeypatch.setattr(module, "build_site", complain)
    monkeypatch.setattr(module, "can_build", lambda: False)
    assert module._site(tmp_path, tmp_path) == (None, "")
    monkeypatch.setattr(module, "can_build", lambda: True)
    first, problem = module._site(tmp_path, tmp_path)
    done = module.Reproduction([], [], tmp_path, {}, first, problem)
    assert not done.ok
    assert "a.md:1: WARNING: no such page" in done.summary()


def test_a_dead_kernel_is_named(tmp_path):
    folder = tmp_path / "notebooks"
    write(folder, "01-dead", "import os\nos._exit(3)")
    summary = reproduce(out=tmp_path / "build", notebooks=folder, quiet=True, site=False).summary()
    assert "01-dead.ipynb, cell 'cell-0' (number 2): Kernel died" in summary


def test_a_verdict_other_than_the_accepted_one_fails_the_run(notebooks, tmp_path, monkeypatch):
    accepted = tmp_path / "verdicts.csv"
    accepted.write_text("id,verdict\nirls-13,differs\n")
    monkeypatch.setattr(
        "losbench.workbench.ledger.claims.data_file",
        lambda name: accepted if name == accepted.name else real(name),
    )
    result = reproduce(["01"], out=tmp_path / "build", notebooks=notebooks, quiet=True)
    assert not result.ok
    assert "irls-13: accepted differs, found agrees" in result.summary()
    (tmp_path / "build" / "ledger" / "01.json").unlink()
    again = reproduce(
        ["01"], out=tmp_path / "build", notebooks=notebooks, accept_verdicts=True, quiet=True
    )
    assert again.ok
    assert not again.runs[0].reused
    assert accepted.read_text() == "id,verdict\nirls-13,agrees\n"


def test_a_selection_that_matches_nothing_is_refused(notebooks, tmp_path):
    with pytest.raises(ValueError, match="no notebook begins with 44"):
        reproduce(["44"], out=tmp_path, notebooks=notebooks)


def test_one_digit_means_the_notebook_of_that_number(notebooks, tmp_path):
    write(notebooks, "10-other", "1 / 0")
    for number in ("1", "01"):
        runs = reproduce([number], out=tmp_path / "build", notebooks=notebooks, quiet=True).runs
        assert [run.notebook for run in runs] == ["01-judge"]


def test_two_runs_do_not_write_to_one_folder(notebooks, tmp_path):
    with (
        locked((tmp_path / "build").resolve()),
        pytest.raises(BlockingIOError, match="another run is writing to build"),
    ):
        reproduce(["01"], out=tmp_path / "build", notebooks=notebooks, quiet=True)


def test_what_a_killed_run_left_is_put_right(notebooks, tmp_path):
    build = tmp_path / "build"
    for name in (".running-a/01", ".site-b/source", ".site-b/old"):
        (build / name).mkdir(parents=True)
    (build / ".site-b/old/index.html").write_text("whole")
    reproduce(["01"], out=build, notebooks=notebooks, quiet=True)
    assert (build / "site/index.html").read_text() == "whole"
    assert [path.name for path in build.iterdir() if path.name.startswith(".")] == []
    (build / ".site-c/old").mkdir(parents=True)
    reproduce(["01"], out=build, notebooks=notebooks, quiet=True)
    assert (build / "site/index.html").read_text() == "whole"


@pytest.mark.slow
def test_a_claim_is_computed_from_scratch_with_its_seconds_and_a_digest(notebooks, tmp_path):
    from losbench.workbench.reproduction.claim import recompute

    first, second = (
        recompute("irls-13", out=out, quiet=True, notebooks=notebooks)
        for out in (tmp_path / "kept", None)
    )
    assert first.row["verdict"] == "agrees"
    assert (first.row, first.digest) == (second.row, second.digest)
    assert first.text().splitlines()[-1].split() == ["sha256", first.digest]
    assert (tmp_path / "kept" / "ledger" / "01.json").is_file()
    report = json.loads((tmp_path / "kept" / "report.json").read_text())
    jsonschema.validate(
        report, json.loads(files("losbench").joinpath("report.schema.json").read_text("utf-8"))
    )
    assert (report["kind"], report["claim"]) == ("claim", "irls-13")
    assert "ledger/01.json" in report["files"]
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    with pytest.raises(FileExistsError, match="is not empty"):
        recompute("irls-13", out=tmp_path / "kept", quiet=True, notebooks=notebooks)
    with pytest.raises(ValueError, match="no notebook begins with 06"):
        recompute("irls-23", quiet=True, notebooks=notebooks)
