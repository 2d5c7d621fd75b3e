"""The site from file:// without a network: all there, nothing asked for outside, and fit for all readers."""

import re
from pathlib import Path

import nbformat
import pytest

from losbench.resources import build_folder, notebook_folder
from losbench.workbench import explorers
from losbench.workbench.explorers import lab as scenes

pytestmark = pytest.mark.browser

SITE = build_folder() / "site"
PAGES = sorted(path.relative_to(SITE).as_posix() for path in SITE.rglob("*.html"))
needs_site = pytest.mark.skipif(not PAGES, reason="no site yet: make reproduce builds it")
FOR_ALL = [
    *("index.html", "ledger.html", "replication.html", "search.html", "commands.html"),
    *(
        "notebooks/00-start-here.html",
        "notebooks/02-irls.html",
        "class.html",
        "api/estimation.html",
        "howto/frames.html",
    ),
]
axe = pytest.importorskip("axe_playwright_python", reason="pip install losbench[browser]")
AXE = next(Path(axe.__file__).parent.rglob("axe.min.js"))

# Formulas that MathJax has not drawn, or drawn as an error; pictures that are not there, or are
# named by a file; what is wider than its place and cannot be scrolled to.
_MISSING = r"""async () => {
    await window.MathJax?.startup?.promise;
    const all = selector => [...document.querySelectorAll(selector)];
    const said = (kind, found) => found.map(e => `${kind}: ${e.outerHTML.slice(0, 120)}`);
    const wide = all('pre, .cell_output, .made, html').filter(e => e.scrollWidth > e.clientWidth + 2);
    return [
        ...said('formula', all('.math').filter(e => !e.querySelector('mjx-container'))),
        ...said('formula', all('mjx-merror, [data-mjx-error]')),
        ...said('picture', [...document.images].filter(e => !(e.complete && e.naturalWidth))),
        ...said('no words', all('article img').filter(e => !e.alt || /\.(png|svg)$|^_images/.test(e.alt))),
        ...said('cut', wide.filter(e => !['auto', 'scroll'].includes(getComputedStyle(e).overflowX))),
    ];
}"""

# What the pictures say that stand above a note that they stand still.
_STILLS = """() => [...document.querySelectorAll('article em')]
    .filter(note => note.innerText.startsWith('A still picture'))
    .map(note => {
        const cells = [...document.querySelectorAll('article .cell')]
            .filter(cell => cell.compareDocumentPosition(note) & Node.DOCUMENT_POSITION_FOLLOWING);
        return cells.at(-1)?.querySelector('img')?.alt ?? '';
    })"""


@pytest.fixture(scope="module")
def page(browser):
    """One page with the network cut off; it lists what it asks for outside."""
    with browser.new_context(offline=True, viewport={"width": 1440, "height": 1000}) as context:
        page = context.new_page()
        page.asked = []
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("pageerror", lambda problem: page.asked.append(f"error: {problem}"))
        yield page


def missing(page, url):
    """Open a page; return what it asked for outside, and what it could not show."""
    page.asked.clear()
    page.goto(url)
    found = page.evaluate(_MISSING)
    return [url for url in page.asked if not url.startswith(("file:", "data:", "blob:"))], found


@needs_site
@pytest.mark.parametrize("name", PAGES)
def test_every_page_is_whole_and_asks_for_nothing(page, name):
    assert missing(page, (SITE / name).as_uri()) == ([], [])


@needs_site
def test_exported_pages_show_every_explorer_with_its_settings_in_words(page):
    kinds = [*explorers.__all__, *(name for name in dir(scenes) if name[0].isupper())]
    called = re.compile(rf"\b({'|'.join(kinds)})\(")
    shown = 0
    for path in sorted(notebook_folder().glob("[0-9]*.ipynb")):
        cells = [cell.source for cell in nbformat.read(path, 4).cells if cell.cell_type == "code"]
        page.goto((SITE / "notebooks" / f"{path.stem}.html").as_uri())
        if page.get_by_text("Not run here").count():
            pytest.skip(f"{path.name} has not been run: make reproduce")
        words = page.evaluate(_STILLS)
        assert len(words) == sum(bool(called.search(source)) for source in cells)
        assert not [alt for alt in words if not alt or alt.startswith("Figure: ")]
        shown += len(words)
    assert shown >= len(kinds)


def test_a_page_that_is_not_whole_would_be_noticed(page, tmp_path):
    (tmp_path / "page.html").write_text(
        '<!doctype html><html><body><article><img src="https://example.org/a.png" alt="a.png">'
        '<span class="math">x</span></article></body></html>',
        encoding="utf-8",
    )
    outside, found = missing(page, (tmp_path / "page.html").as_uri())
    assert outside == ["https://example.org/a.png"]
    assert [line.partition(":")[0] for line in found] == ["formula", "picture", "no words"]


@needs_site
@pytest.mark.parametrize("name", FOR_ALL)
def test_no_serious_violation_of_accessibility(page, name):
    page.goto((SITE / name).as_uri())
    page.wait_for_load_state()
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate("() => axe.run({resultTypes: ['violations']})")["violations"]
    assert [
        (each["id"], each["nodes"][0]["html"])
        for each in found
        if each["impact"] in ("serious", "critical")
    ] == []


@needs_site
def test_search_finds_irls_without_a_server(page):
    page.goto((SITE / "search.html").as_uri() + "?q=irls")
    page.wait_for_selector("#search-results li a")
    titles = page.locator("#search-results li a").all_inner_texts()
    assert any("losbench.irls" in title for title in titles)


@needs_site
def test_the_ledger_filters_and_sorts(page, screenshots):
    page.goto((SITE / "ledger.html").as_uri())
    shown = "tr[data-paper]:not([hidden])"
    page.select_option("#paper", "ren2023")
    count = page.locator(shown).count()
    assert 0 < count < 114
    assert page.locator(f"{shown}[data-paper=ren2023]").count() == count
    assert page.locator("#shown").inner_text() == f"{count} of 114 claims"
    page.select_option("#paper", "")
    page.fill("#words", "table 1 rms")
    texts = page.locator(shown).all_inner_texts()
    assert texts
    assert all(word in text.lower() for text in texts for word in ("table", "1", "rms"))
    page.fill("#words", "")
    for direction in ("ascending", "descending"):
        page.click("th.claimed button")
        assert page.locator("th.claimed").get_attribute("aria-sort") == direction
        printed = page.evaluate(
            "() => [...document.querySelectorAll('td.claimed')].map(e => +e.dataset.value)"
            ".filter(Number.isFinite)"
        )
        ordered = sorted(printed, reverse=direction == "descending")
        assert printed == ordered
    page.screenshot(path=screenshots / "ledger.png")
