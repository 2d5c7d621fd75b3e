"""Exported pages without a network: every picture and every formula is there, and nothing is asked for outside."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import nbformat
import pytest
from lab import notebook

from losbench.resources import build_folder
from losbench.workbench.reproduction.export import notebook_to_html
from losbench.workbench.reproduction.running import run_notebook

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("browser")]

FORMULAS = r"""# A page

Inline $\alpha = \frac{1}{2}\sum_i w_i r_i^2$ and

$$\mathbf R = \begin{bmatrix} 1 & -\gamma & \beta \\ \gamma & 1 & -\alpha \\ -\beta & \alpha & 1 \end{bmatrix} \tag{1}$$

$$w = \begin{cases} 1 & |r| \le c \\ c / |r| & |r| > c \end{cases}$$
"""


# What is wider than its place and cannot be scrolled to: inside its cell, or beyond the page.
_CUT = """() => [...document.querySelectorAll('.highlight pre, .jp-OutputArea-output, .jp-InputArea-editor, html')]
    .filter(e => e.scrollWidth > e.clientWidth + 2)
    .filter(e => e.tagName === 'HTML' || getComputedStyle(e).overflowX !== 'auto')
    .map(e => `cut: ${e.className} ${e.textContent.slice(0, 60)}`)"""


def drawn_without_a_network(browser, path):
    """Open a page with the network cut off; return what it asked for outside, and what it could not show."""
    with browser.new_context(offline=True, viewport={"width": 1440, "height": 1000}) as context:
        page = context.new_page()
        asked, failed = [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda problem: failed.append(str(problem)))
        page.goto(path.as_uri())
        page.wait_for_load_state("networkidle")
        blank = page.evaluate(
            "() => [...document.images].filter(i => !(i.complete && i.naturalWidth)).map(i => "
            "i.src)"
        )
        flat = page.evaluate(
            "() => [...document.querySelectorAll('math')]"
            ".filter(m => !(m.getBoundingClientRect().width * m.getBoundingClientRect().height))"
            ".map(m => m.textContent)"
        )
        left = page.evaluate(
            r"() => [...document.querySelectorAll('.jp-RenderedMarkdown')].map(m => m.innerText)"
            r".filter(text => /\$[^$]+\$|\\(frac|begin|mathbf|alpha)/.test(text))"
        )
        cut = page.evaluate(_CUT)
        counts = page.evaluate(
            "() => [document.images.length, document.querySelectorAll('math').length]"
        )
        outside = [url for url in asked if not url.startswith(("file:", "data:", "blob:"))]
        return page.screenshot(full_page=True), outside, failed + blank + flat + left + cut, counts


def test_a_page_with_explorer_figure_and_formulas(browser, tmp_path, screenshots):
    source = notebook(
        "from losbench.workbench.explorers import MonteCarloExplorer\nMonteCarloExplorer()",
        "import matplotlib.pyplot as plt\n_ = plt.plot([1, 2])",
        "import pandas as pd\npd.DataFrame([range(40)], columns=['a rather wide column'] * 40)  # "
        f"{'long ' * 60}",
    )
    source.cells.insert(0, nbformat.v4.new_markdown_cell(FORMULAS, id="formulas"))
    nbformat.write(source, tmp_path / "01-page.ipynb")
    with ThreadPoolExecutor(1) as outside_of_the_browsers_event_loop:
        run = outside_of_the_browsers_event_loop.submit(
            run_notebook, tmp_path / "01-page.ipynb", tmp_path / "out", tmp_path / "build"
        ).result()
    assert not run.error
    path = tmp_path / "out/html/01-page.html"
    picture, outside, missing, counts = drawn_without_a_network(browser, path)
    (screenshots / "exported-page.png").write_bytes(picture)
    assert outside == []
    assert missing == []
    assert counts == [2, 3]


def test_a_page_that_asks_outside_would_be_noticed(browser, tmp_path):
    html = notebook_to_html(notebook("1"), "page").replace(
        "</body>", '<img src="https://example.org/a.png"><math></math></body>'
    )
    (tmp_path / "page.html").write_text(html, encoding="utf-8")
    _, outside, missing, _ = drawn_without_a_network(browser, tmp_path / "page.html")
    assert outside == ["https://example.org/a.png"]
    assert missing == ["https://example.org/a.png", ""]


PAGES = sorted([*(build_folder() / "html").glob("*.html"), *build_folder().glob("ledger.html")])


@pytest.mark.skipif(not PAGES, reason="no exported pages yet: make reproduce makes them")
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_exported_page(browser, path: Path):
    _, outside, missing, counts = drawn_without_a_network(browser, path)
    assert outside == []
    assert missing == []
    if "Explorer(" in path.read_text("utf-8"):
        assert counts[0] > 0
