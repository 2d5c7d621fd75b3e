"""Executed notebooks as HTML pages that show pictures and formulas without a network."""

from __future__ import annotations

import re
from html import escape

import nbformat
from bs4 import BeautifulSoup
from latex2mathml.converter import convert
from nbconvert.exporters import HTMLExporter
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath

from losbench.workbench.reproduction.mathfont import math_font

__all__ = ["formula_to_mathml", "notebook_to_html"]

_TAG = re.compile(r"\\tag\*?\{([^{}]*)\}")
_NOT_CONVERTED = re.compile(r"<mi>(\\[^<]*|&)</mi>")
_NUMBER = re.compile(
    r"[<>≤≥~±]?\s*[-+−]?(\d[\d.,\s]*(e[-+−]?\d+)?|nan|inf|true|false)(\s*±\s*[\d.,]+)?\s*%?"
    r"|[-–—…]?|\.\.\.",
    re.IGNORECASE,
)


def notebook_to_html(notebook: nbformat.NotebookNode, name: str) -> str:
    """Return a notebook as one page; ``ValueError`` names the formula that MathML cannot be made
    of.
    """
    html, _ = _Offline().from_notebook_node(_described(notebook), {"metadata": {"name": name}})
    return re.sub(r'href="([^":/]+)\.ipynb"', r'href="\1.html"', html)


def formula_to_mathml(latex: str, *, block: bool = False) -> str:
    r"""Turn a LaTeX formula into MathML, which browsers draw themselves.

    Parameters
    ----------
    latex : str
        Without its dollars. Matrices, cases, align, aligned and ``\tag`` are known.
    block : bool
        Displayed on a line of its own, a tag at its right.

    Returns
    -------
    str
        HTML.

    Raises
    ------
    ValueError
        If a command is not known.

    Examples
    --------
    >>> formula_to_mathml("x^2")[-50:]
    'ow><msup><mi>x</mi><mn>2</mn></msup></mrow></math>'
    """
    tags = _TAG.findall(latex)
    body = _TAG.sub(r"&\\quad\\text{(\1)}" if len(tags) > 1 else "", latex)
    # latex2mathml knows split, which is the same, and sets upright letters only as text.
    body = body.replace("{aligned}", "{split}").replace("{align}", "{align*}")
    body = re.sub(r"\\mathbf\{(\w)\}", r"\\mathbf \1", body)
    body = re.sub(r"\\mathrm\{([A-Za-z ]+)\}", r"\\text{\1}", body)
    mathml = convert(body.strip(), display="block" if block else "inline")
    unknown = _NOT_CONVERTED.search(mathml)
    if unknown:
        raise ValueError(f"no MathML for {unknown[1]} in the formula {latex.strip()}")
    if not block:
        return mathml
    number = f"<span>({escape(tags[0])})</span>" if len(tags) == 1 else ""
    return f'<div class="equation">{mathml}{number}</div>'


class _MathML(IPythonRenderer):  # type: ignore[misc]
    def block_math(self, body: str) -> str:
        return formula_to_mathml(body, block=True)

    def latex_environment(self, name: str, body: str) -> str:
        return formula_to_mathml(f"\\begin{{{name}}}{body}\\end{{{name}}}", block=True)

    def inline_math(self, body: str) -> str:
        return formula_to_mathml(body)


class _Offline(HTMLExporter):  # type: ignore[misc]
    """nbconvert's page without the scripts that it would fetch: require.js, MathJax, mermaid."""

    def __init__(self) -> None:
        super().__init__(
            raw_template=_TEMPLATE.replace("MATH_FONT", math_font()), exclude_anchor_links=True
        )
        self.register_filter("markdown2html", _markdown_to_html)


def _markdown_to_html(source: str) -> str:
    return str(
        MarkdownWithMath(renderer=_MathML(escape=False, exclude_anchor_links=True)).render(source)
    )


def _described(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Give every picture the heading that it stands under as alternative text, and mark the tables'
    words.
    """
    copy = nbformat.from_dict(notebook)
    heading = ""
    for cell in copy.cells:
        if cell.cell_type == "markdown":
            heading = (re.findall(r"^#+ (.+)$", cell.source, re.MULTILINE) or [heading])[-1]
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):
                output.metadata["alt"] = f"Figure: {heading}"
            if "dataframe" in output.get("data", {}).get("text/html", ""):
                output.data["text/html"] = _words_marked(output.data["text/html"])
    return copy


def _words_marked(html: str) -> str:
    """Mark the columns of a pandas table that hold words: they stand left, the others right, as
    pandas has them all.
    """
    soup = BeautifulSoup(html, "html.parser")
    for table in soup.select("table.dataframe"):
        # From the right, since an index level that goes on from the row above has no cell.
        rows = [row.find_all(["td", "th"])[::-1] for row in table.select("tbody tr")]
        heads = [
            row.find_all("th")[::-1]
            for row in table.select("thead tr")
            if not row.select("[colspan]")
        ]
        for k in range(max(map(len, rows), default=0)):
            cells = [row[k] for row in rows if k < len(row)]
            if not all(_NUMBER.fullmatch(cell.get_text().strip()) for cell in cells):
                for cell in [*cells, *(head[k] for head in heads if k < len(head))]:
                    cell["class"] = "words"
    return str(soup)


_TEMPLATE = """{%- extends 'lab/index.html.j2' -%}
{%- block html_head_js_requirejs -%}{%- endblock -%}
{%- block html_head_js_mathjax -%}{%- endblock -%}
{%- block html_head_js_mermaidjs -%}{%- endblock -%}
{%- block html_head_css -%}
<style>
.equation { display: flex; align-items: center; margin: .8em 0 }
.equation math { flex: 1 }
@font-face { font-family: formula; src: url(MATH_FONT) }
math { font-family: formula, math }
mtable[displaystyle="true"] mtd { math-style: normal }
mtable[columnspacing^="0em"] mtd { padding-left: 0; padding-right: .1em }
mtd[columnalign="left"] { text-align: left }
mtd[columnalign="right"] { text-align: right }
mi[mathvariant^="bold"], mn[mathvariant="bold"] { font-weight: bold }
mi[mathvariant="bold"] { text-transform: none }
.jp-RenderedHTMLCommon td { vertical-align: top }
.jp-RenderedMarkdown td, .jp-RenderedMarkdown th,
.jp-RenderedHTMLCommon .dataframe .words { text-align: left }
.dataframe tbody th { white-space: nowrap !important }
.jp-Notebook { max-width: 76rem; margin: 0 auto }
.jp-MarkdownCell { max-width: 62rem }
.highlight pre, .jp-OutputArea-output { overflow-x: auto }
.site, .still { font: .85rem var(--jp-content-font-family); margin: .3rem 0 }
</style>
{%- endblock -%}
{%- block body_header -%}
{{ super() }}
<nav class="site jp-RenderedHTMLCommon">
<a href="index.html">All notebooks</a> · <a href="../ledger.html">Ledger of claims</a>
</nav>
{%- endblock -%}
{% block data_png scoped %}
<div class="jp-RenderedImage jp-OutputArea-output">
<img src="data:image/png;base64,{{ output.data['image/png'] }}"
alt="{{ output.metadata.alt | escape_html }}">
{%- if 'application/vnd.jupyter.widget-view+json' in output.data %}
<p class="still">A still picture. Explorers are live in JupyterLab: <code>make lab</code></p>
{%- endif %}
</div>
{%- endblock data_png %}
"""
