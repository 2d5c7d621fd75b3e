"""The page of a report: whole in itself, every text escaped, every table and picture named."""

import hashlib
import re
from html.parser import HTMLParser

import pytest
from matplotlib.figure import Figure

import losbench.made as module
from losbench.made import Made, Source
from losbench.page import QUESTIONS, Answer, Picture, page, section, sentences, table

BAD = "<script>alert(1)</script> \" ' & $T_1$"


class Checked(HTMLParser):
    """Every element is closed in turn; addresses, names and ids are gathered."""

    VOID = ("meta", "br", "wbr", "img", "link")

    def __init__(self, text):
        super().__init__()
        self.open, self.addresses, self.seen = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        for name, value in attrs:
            if name in ("href", "src", "xlink:href"):
                self.addresses.append(value)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def all(self, tag):
        return [attrs for name, attrs in self.seen if name == tag]


@pytest.fixture(scope="module")
def whole():
    pictures = []
    for title in (BAD, "another"):
        figure = Figure()
        figure.subplots().plot([1, 2], color="black")
        pictures.append(Picture(title, BAD, figure).html())
    made = Made(command=BAD, settings={BAD: BAD, "none": None}, inputs=())
    chapters = {
        QUESTIONS[0]: [section(BAD, sentences([BAD, BAD]), table([BAD], [[BAD]], caption=BAD))],
        QUESTIONS[1]: [section("", *pictures), section("nothing", "")],
        QUESTIONS[2]: [""],
    }
    return page(BAD, BAD, [Answer(BAD, BAD, "care")], chapters, made=made, files=[BAD])


def test_no_text_is_markup_and_nothing_is_asked_for_outside(whole):
    found = Checked(whole)
    assert "<script" not in whole and found.all("script") == []
    assert all(address.startswith(("#", "data:")) for address in found.addresses)
    assert "default-src 'none'" in whole
    assert whole.count("alert(1)") >= 15


def test_pictures_are_named_for_who_cannot_see_them_and_do_not_share_names(whole):
    found = Checked(whole)
    assert [svg["role"] for svg in found.all("svg")] == ["img", "img"]
    assert all(svg["aria-label"] for svg in found.all("svg"))
    ids = [attrs["id"] for _, attrs in found.seen if "id" in attrs]
    assert len(set(ids)) == len(ids)
    used = [address[1:] for address in found.addresses if address.startswith("#")]
    used += re.findall(r"url\(#([^)]+)\)", whole)
    assert used and set(used) <= set(ids)
    assert "currentColor" in whole and "#000000" not in whole


def test_tables_name_their_rows_and_columns(whole):
    found = Checked(whole)
    assert {th["scope"] for th in found.all("th")} == {"col", "row"}
    assert len(found.all("caption")) == len(found.all("table")) == 3


def test_settings_that_were_not_given_are_named_in_a_line():
    made = Made(settings={"b": None, "a": [], "files": ["x", "y"], "fast": False, "count": 0})
    whole = page("", "", [], {}, made=made)
    assert "<p>Not given: a, b.</p>" in whole
    for name, value in {"files": "x, y", "fast": "no", "count": "0"}.items():
        assert f'<th scope="row">{name}</th><td>{value}</td>' in whole


def test_a_chapter_without_a_word_is_left_out(whole):
    assert [h2["id"] for h2 in Checked(whole).all("h2")] == [
        "did-it-work",
        "may-i-believe-it",
        "how-was-it-made",
    ]
    assert "nothing</h3>" not in whole


def test_an_input_is_known_by_its_sum_and_a_folder_by_that_of_its_list(tmp_path):
    for name, content in {"b": b"2", "a": b"1"}.items():
        (tmp_path / name).write_bytes(content)
    one = Source.of(tmp_path / "a")
    assert one.sha256 == hashlib.sha256(b"1").hexdigest()
    listed = "".join(
        f"{hashlib.sha256(c).hexdigest()}  {n}\n" for n, c in (("a", b"1"), ("b", b"2"))
    )
    both = Source.of(tmp_path)
    assert (both.n_files, both.size_bytes) == (2, 2)
    assert both.sha256 == hashlib.sha256(listed.encode()).hexdigest()
    assert Source.of(tmp_path / "?").sha256 == both.sha256
    assert Source.of(tmp_path / "c") is None


@pytest.mark.parametrize(("size", "whole"), [(100, True), (101, False)])
def test_a_large_input_is_known_by_its_ends(tmp_path, monkeypatch, size, whole):
    monkeypatch.setattr(module, "_LARGEST", 100)
    monkeypatch.setattr(module, "_END", 40)
    content = bytes(range(size))
    (tmp_path / "big").write_bytes(content)
    found = Source.of(tmp_path / "big")
    if whole:
        assert found.sha256 == hashlib.sha256(content).hexdigest() and found.sha256_of_ends is None
    else:
        ends = hashlib.sha256(content[:40] + content[-40:]).hexdigest()
        assert found.sha256 is None and found.sha256_of_ends == ends
