"""Executed notebooks as HTML pages that show pictures and formulas without a network."""

from __future__ import annotations

import re
from html import escape

import nbformat
from latex2mathml.converter import convert
from nbconvert.exporters import HTMLExporter
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath

from losbench.workbench.mathfont import math_font

__all__ = ["formula_to_mathml", "notebook_to_html"]

_TAG = re.compile(r"\\tag\*?\{([^{}]*)\}")
_NOT_CONVERTED = re.compile(r"<mi>(\\[^<]*|&)</mi>")


def notebook_to_html(notebook: nbformat.NotebookNode, name: str) -> str:
    """Return a notebook as one page; ``ValueError`` names the formula that MathML cannot be made of."""
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
        super().__init__(raw_template=_TEMPLATE.replace("MATH_FONT", math_font()), exclude_anchor_links=True)
        self.register_filter("markdown2html", _markdown_to_html)


def _markdown_to_html(source: str) -> str:
    return str(MarkdownWithMath(renderer=_MathML(escape=False, exclude_anchor_links=True)).render(source))


def _described(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Give every picture the heading that it stands under as its alternative text."""
    copy = nbformat.from_dict(notebook)
    heading = ""
    for cell in copy.cells:
        if cell.cell_type == "markdown":
            heading = (re.findall(r"^#+ (.+)$", cell.source, re.MULTILINE) or [heading])[-1]
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):
                output.metadata["alt"] = f"Figure: {heading}"
    return copy


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
table.dataframe td, .jp-RenderedMarkdown td { text-align: left !important; vertical-align: top }
.jp-Notebook { max-width: 62rem; margin: 0 auto }
</style>
{%- endblock -%}
{% block data_png scoped %}
<div class="jp-RenderedImage jp-OutputArea-output">
<img src="data:image/png;base64,{{ output.data['image/png'] }}" alt="{{ output.metadata.alt | escape_html }}">
</div>
{%- endblock data_png %}
"""
