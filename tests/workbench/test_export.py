"""Formulas that browsers draw themselves, and pages that ask for nothing."""

import base64
import io
import re

import nbformat
import numpy as np
import pandas as pd
import pytest
from fontTools.ttLib import TTFont

from losbench.workbench.reproduction.export import formula_to_mathml, notebook_to_html
from losbench.workbench.reproduction.mathfont import math_font


@pytest.mark.parametrize(
    ("latex", "rows"),
    [
        (r"\begin{pmatrix}1 & 2\\ 3 & 4\end{pmatrix}", 2),
        (r"w = \begin{cases}1, & |r| \le c\\ c/|r|, & \text{else}\end{cases}", 2),
        (r"\begin{aligned}a &= b\\ c &= d\\ e &= f\end{aligned}", 3),
        (r"\begin{align}a &= b \tag{1}\\ c &= d \tag{2}\end{align}", 2),
    ],
)
def test_rows_survive(latex, rows):
    assert formula_to_mathml(latex, block=True).count("<mtr>") == rows


def test_a_tag_stands_beside_its_formula_once():
    assert formula_to_mathml(r"a = b \tag{7}", block=True).endswith("<span>(7)</span></div>")
    rows = formula_to_mathml(r"\begin{align}a &= b \tag{1}\\ c &= d \tag{2}\end{align}", block=True)
    assert (rows.count("(1)"), rows.count("(2)")) == (1, 1)


def test_a_command_that_is_not_known_is_named():
    with pytest.raises(ValueError, match=r"no MathML for \\nosuch in the formula x \\nosuch"):
        formula_to_mathml(r"x \nosuch")


def test_bold_and_primes_are_the_same_however_they_are_typed():
    assert formula_to_mathml(r"\mathbf{A}_1 x") == formula_to_mathml(r"\mathbf A_1 x")
    assert 'mathvariant="bold"' in formula_to_mathml(r"\mathbf{A}")
    assert formula_to_mathml(r"\psi'") == formula_to_mathml(r"\psi^\prime")


def test_words_stand_left_and_numbers_right_their_headings_with_them():
    table = pd.DataFrame(
        {
            "error (px)": [0.1, np.nan],
            "bound": ["−3 ± 0.5", "<1e-3"],
            "verdict": ["differs", "12 of 13"],
        },
        index=pd.MultiIndex.from_tuples([("A", 1), ("A", 2)], names=["spot", "run"]),
    )
    output = nbformat.v4.new_output("display_data", {"text/html": table.to_html()}, metadata={})
    page = notebook_to_html(
        nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("t", outputs=[output])]), "1"
    )
    words = re.findall(r'class="words"[^>]*>([^<]*)<', page)
    assert sorted(filter(None, words)) == ["12 of 13", "A", "differs", "spot", "verdict"]


def test_a_page_leads_to_the_others_and_says_what_is_still():
    notebook = nbformat.v4.new_notebook()
    live = {"image/png": "", "application/vnd.jupyter.widget-view+json": {"model_id": "1"}}
    for data in (live, {"image/png": ""}):
        output = nbformat.v4.new_output("display_data", data, metadata={})
        notebook.cells.append(nbformat.v4.new_code_cell("Explorer()", outputs=[output]))
    page = notebook_to_html(notebook, "03")
    assert page.count("Explorers are live in JupyterLab") == 1
    assert {"index.html", "../ledger.html"} <= set(re.findall(r'href="([^"]+)"', page))


def test_a_page_is_whole_without_a_network():
    png = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg=="
    notebook = nbformat.v4.new_notebook()
    notebook.cells = [
        nbformat.v4.new_markdown_cell(
            "# Fig. 1\n\nInline $a < b$, see [02](02-irls.ipynb), and\n\n$$c^2$$"
        ),
        nbformat.v4.new_code_cell(
            "fig", outputs=[nbformat.v4.new_output("display_data", {"image/png": png}, metadata={})]
        ),
    ]
    page = notebook_to_html(notebook, "03")
    assert not re.findall(r"<script|<link|@import|src=\"http|url\(\s*['\"]?http", page)
    assert page.count("<math ") == 2
    assert 'alt="Figure: Fig. 1"' in page
    assert 'href="02-irls.html"' in page
    assert "$" not in re.sub(r"<style.*?</style>", "", page, flags=re.DOTALL)


def test_the_font_of_formulas_knows_how_to_stretch_a_bracket():
    kind, _, content = math_font().partition(",")
    assert kind == "data:font/woff;base64"
    table = TTFont(io.BytesIO(base64.b64decode(content)))["MATH"].table
    assert {"parenleft", "bracketleft", "braceleft", "radical"} <= set(
        table.MathVariants.VertGlyphCoverage.glyphs
    )
    assert table.MathConstants.SubscriptShiftDown.Value > 0


def test_a_prime_is_as_large_as_a_superscript():
    _, _, content = math_font().partition(",")
    font = TTFont(io.BytesIO(base64.b64decode(content)))
    one, two = (font["glyf"][font.getBestCmap()[ord(prime)]] for prime in "′″")
    digit = font["glyf"]["two"]
    assert 0 < one.yMin < one.yMax
    assert one.yMax - one.yMin > 0.4 * digit.yMax
    assert (two.yMin, two.yMax) == (one.yMin, one.yMax)
    assert one.xMax - one.xMin < two.xMax - two.xMin <= font["hmtx"]["second"][0]
