"""codecheck.yml against the rules of CODECHECK's specification 2.0 that need no network; the ids are
theirs.
"""

import json
import re
from pathlib import Path

import yaml

from losbench.resources import notebook_folder

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "codecheck.yml").read_text(encoding="utf-8")
CONFIG = yaml.safe_load(TEXT)


def test_the_document_is_explicit_and_names_its_specification():
    assert TEXT.startswith("---\n")  # CC-CFG-002
    assert re.fullmatch(r"https://codecheck\.org\.uk/spec/config/\d\.\d/", CONFIG["version"])


def test_the_manifest_has_relative_files_with_comments():
    assert CONFIG["manifest"]  # CC-CFG-004
    for item in CONFIG["manifest"]:
        assert set(item) == {"file", "comment"}  # CC-CFG-005, -007
        assert not Path(item["file"]).is_absolute()  # CC-CFG-006
        assert ".." not in Path(item["file"]).parts


def test_every_file_of_the_manifest_is_written_by_a_notebook_or_the_runner():
    sources = "".join(
        "".join(cell["source"])
        for path in notebook_folder().glob("*.ipynb")
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
    )
    for item in CONFIG["manifest"]:
        path = Path(item["file"])
        if path.parent.name in ("figures", "tables"):
            assert f'"{path.stem}"' in sources, path
        else:
            assert path.name in ("ledger.csv", "replication.html")


def test_the_paper_is_named_and_referred_to_by_doi():
    paper = CONFIG["paper"]
    assert len(paper["title"]) > 20  # CC-CFG-017
    assert all(author["name"] for author in paper["authors"])  # CC-CFG-018, -019
    for reference in (paper["reference"], *paper["reference-other"]):  # CC-CFG-021, -027 to -030
        assert re.fullmatch(r"https://doi\.org/10\.\d{4,}/\S+", reference)
    assert len(CONFIG["summary"]) > 40  # CC-CFG-024


def test_nothing_is_a_placeholder():
    assert not re.search("FIXME|TODO|XXXX", TEXT)  # CC-CFG-023
    # What only a check can give is left out rather than made up.
    assert not {"codechecker", "certificate", "report"} & set(CONFIG)


def test_the_citation_has_what_its_format_asks_for_and_refers_to_the_papers_by_doi():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(cited)  # its required keys
    assert cited["cff-version"] == "1.2.0"
    assert all("name" in author or "family-names" in author for author in cited["authors"])
    dois = {each["doi"] for each in cited["references"]}
    paper = CONFIG["paper"]
    wanted = {paper["reference"], *paper["reference-other"]}
    assert {f"https://doi.org/{doi}" for doi in dois} == wanted
    for each in cited["references"]:
        assert {"type", "title", "authors", "year", "journal"} <= set(each)
    of_paper = next(e for e in cited["references"] if paper["reference"].endswith(e["doi"]))
    assert [f"{a['given-names']} {a['family-names']}" for a in of_paper["authors"]] == [
        author["name"] for author in paper["authors"]
    ]
    assert of_paper["title"] == paper["title"]
