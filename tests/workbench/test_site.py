"""The site: what of a notebook a page shows, the ledger's table, and a small site as Sphinx builds it."""

import base64
import inspect
import json
import re

import nbformat
import numpy as np
import pandas as pd
import pytest
from bs4 import BeautifulSoup, SoupStrainer

import losbench as lb
from losbench.cli import main
from losbench.workbench.explorers.picture import _described
from losbench.workbench.ledger.cells import cell_digest
from losbench.workbench.reproduction import site as module
from losbench.workbench.reproduction.pages import cell_anchors, ledger_table, page_of_notebook
from losbench.workbench.reproduction.reference import public_names
from losbench.workbench.reproduction.replication import PAPERS
from losbench.workbench.reproduction.site import build_site

PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg=="
FIRST = "01-geometry-and-least-squares"
WIDGET = "application/vnd.jupyter.widget-view+json"


def shown(*data):
    """Make a notebook of a heading and a cell for each output."""
    new = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell("# Fig. 1", id="title")])
    for k, each in enumerate(data):
        output = nbformat.v4.new_output("display_data", each, metadata={})
        cell = nbformat.v4.new_code_cell(f"draw({k})", id=f"cell-{k}", outputs=[output])
        new.cells.append(cell)
    return json.loads(nbformat.writes(new))


def test_an_explorer_shows_its_picture_and_says_that_it_stands_still():
    page = page_of_notebook(
        shown({"image/png": PNG, WIDGET: {"model_id": "1"}}, {"image/png": PNG})
    )
    assert WIDGET not in json.dumps(page)
    assert json.dumps(page).count("live in JupyterLab") == 1
    assert json.dumps(page).count('"image/png"') == 2


def test_a_picture_has_the_text_of_its_explorer_or_of_its_heading():
    told = _described(base64.b64decode(PNG), "window = 11 px, σ = 2")
    page = page_of_notebook(
        shown({"image/png": base64.b64encode(told).decode()}, {"image/png": PNG})
    )
    alts = [c["metadata"]["mystnb"]["image"]["alt"] for c in page["cells"] if "outputs" in c]
    assert alts == ["window = 11 px, σ = 2", "Figure: Fig. 1"]


def test_what_has_not_been_run_says_so():
    assert "Not run here" in page_of_notebook(shown({}), run=False)["cells"][1]["source"]
    assert "Not run here" not in json.dumps(page_of_notebook(shown({})))


def test_words_stand_left_and_numbers_right_their_headings_with_them():
    table = pd.DataFrame(
        {
            "error (px)": [0.1, np.nan],
            "bound": ["−3 ± 0.5", "<1e-3"],
            "verdict": ["differs", "12 of 13"],
        },
        index=pd.MultiIndex.from_tuples([("A", 1), ("A", 2)], names=["spot", "run"]),
    )
    page = page_of_notebook(shown({"text/html": table.to_html()}))
    html = "".join(page["cells"][-1]["outputs"][0]["data"]["text/html"])
    words = re.findall(r'class="words"[^>]*>([^<]*)<', html)
    assert sorted(filter(None, words)) == ["12 of 13", "A", "differs", "spot", "verdict"]


def test_the_ledger_sorts_by_numbers_and_names_what_it_filters_by():
    rows = list(lb.Ledger().rows())
    rows[0] |= {"claimed": "0.5", "relation": "<=", "odds": "12 : 1", "verdict": "no power"}
    soup = BeautifulSoup(ledger_table(rows, {}), "html.parser")
    first = soup.select_one("table.ledger tbody tr")
    assert first.select_one(".claimed")["data-value"] == "0.5"
    assert first.select_one(".odds")["data-value"] == "12"
    assert (first["data-paper"], first["data-kind"]) == ("liu2026", "no power")
    assert {option.text for option in soup.select("#paper option")} == {
        "all",
        "liu2026",
        "lyu2015",
        "ren2023",
    }
    assert {option.text for option in soup.select("#kind option")} == {"all", "no power", "pending"}
    assert all(head["aria-sort"] == "none" for head in soup.select("table.ledger thead th"))


def test_the_reference_has_every_public_name():
    listed = {name for names in public_names().values() for name in names}
    assert listed == {name for name in lb.__all__ if not inspect.ismodule(getattr(lb, name))}


def test_without_the_extra_the_command_names_it(monkeypatch, capsys):
    monkeypatch.setattr(module, "can_build", lambda: False)
    assert main(["site"]) == 2
    assert "pip install 'losbench[docs]'" in capsys.readouterr().err


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    if not module.can_build():
        pytest.skip("needs the extra docs")
    build = tmp_path_factory.mktemp("site") / "build"
    (build / "notebooks").mkdir(parents=True)
    drawn = json.dumps(shown({"image/png": PNG}))
    (build / "notebooks" / f"{FIRST}.ipynb").write_text(drawn, encoding="utf-8")
    (build / "figures").mkdir()
    for _, pictures in PAPERS.values():
        for name in pictures:
            (build / "figures" / f"{name}.png").write_bytes(base64.b64decode(PNG))
    report = (
        "<!doctype html><html><title>t</title><style>p{}</style><h1>B</h1><table><tr><td>MISSED"
    )
    (build / "benchmarks.html").write_text(report, encoding="utf-8")
    return build_site(out=build)


@pytest.mark.slow
def test_a_site_is_built_without_a_warning_and_every_link_leads_somewhere(built):
    pages = sorted(built.parent.rglob("*.html"))
    assert {"index.html", "ledger.html", "replication.html", "search.html"} <= {
        page.name for page in built.parent.glob("*.html")
    }
    leading = SoupStrainer(["a", "img", "link", "script", "source", "iframe"])
    for page in pages:
        text = page.read_text(encoding="utf-8")
        soup = BeautifulSoup(text, "html.parser", parse_only=leading)
        for tag in soup.select("[href], [src]"):
            target = (tag.get("href") or tag.get("src")).partition("#")[0]
            if target and not target.startswith(("https:", "data:")):
                assert (page.parent / target.partition("?")[0]).exists(), (page.name, target)
        for tag in soup.select("script[src], link[href], img[src]"):
            assert not (tag.get("href") or tag["src"]).startswith("http"), page.name
    for image in BeautifulSoup(
        (built.parent / "notebooks" / f"{FIRST}.html").read_text(encoding="utf-8"), "html.parser"
    ).select("article img"):
        assert image["alt"] == "Figure: Fig. 1"
    page, _, anchor = cell_anchors(built.parents[1])["01", cell_digest("draw(0)")].partition("#")
    assert f'id="{anchor}"' in (built.parent / page).read_text(encoding="utf-8")


@pytest.mark.slow
def test_what_the_benches_found_is_taken_in(built):
    page = BeautifulSoup((built.parent / "benchmarks.html").read_text("utf-8"), "html.parser")
    assert page.select_one(".made td").text.strip() == "MISSED"
    assert len(page.select("h1")) == 1


@pytest.mark.slow
def test_pictures_of_the_report_have_captions_and_no_file_names(built):
    page = BeautifulSoup((built.parent / "replication.html").read_text("utf-8"), "html.parser")
    for _, pictures in PAPERS.values():
        for name, caption in pictures.items():
            assert page.find("figcaption", string=caption).parent.img["alt"] == f"Figure: {caption}"
            assert name not in page.get_text() + str([img["alt"] for img in page("img")])


@pytest.mark.slow
def test_the_reference_shows_formulas_and_search_knows_its_names(built):
    folder = built.parent
    text = (folder / "api" / "estimation.html").read_text(encoding="utf-8")
    assert r"\hat x = (A^T W A)^{-1}" in text
    assert 'id="losbench.irls"' in text
    assert "irls" in (folder / "searchindex.js").read_text(encoding="utf-8")
    assert (folder / "_static" / "tex-svg-full.js").stat().st_size > 2e6
