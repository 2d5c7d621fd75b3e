"""What the site takes from a run: the executed notebooks, made ready for Sphinx, and the ledger."""

from __future__ import annotations

import base64
import json
import re
from collections import Counter
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bs4 import BeautifulSoup

from losbench.workbench.ledger.cells import cell_digest
from losbench.workbench.ledger.claims import CLASSES

__all__ = ["cell_anchors", "ledger_table", "page_of_notebook"]

_WIDGET = "application/vnd.jupyter.widget-view+json"
_STILL = "*A still picture: the explorer is live in JupyterLab, by* `make lab`."
_NOT_RUN = ":::{note}\nNot run here: code without its results. `make reproduce` runs it.\n:::"
_DESCRIPTION = b"iTXtDescription\0\0\0\0\0"
_NUMBER = re.compile(
    r"[<>≤≥~±]?\s*[-+−]?(\d[\d.,\s]*(e[-+−]?\d+)?|nan|inf|true|false)(\s*±\s*[\d.,]+)?\s*%?"
    r"|[-–—…]?|\.\.\.",
    re.IGNORECASE,
)


def page_of_notebook(notebook: dict[str, Any], *, run: bool = True) -> dict[str, Any]:
    """Return a notebook as myst-nb needs it to show all of it.

    Code cells get an anchor. Where an explorer stands, its picture stays in place of the widget,
    which no page can run; pictures get a text, the explorer's own or the heading above.
    """
    cells: list[dict[str, Any]] = []
    heading = ""
    for k, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] == "markdown":
            heading = (
                re.findall(r"^#+ (.+)$", "".join(cell["source"]), re.MULTILINE) or [heading]
            )[-1]
            cells.append(cell)
            cells += [_markdown(f"not-run-{k}", _NOT_RUN)] * (k == 0 and not run)
            continue
        cells.append(_markdown(f"anchor-{k}", f'<a id="{escape(cell["id"])}"></a>'))
        outputs = [_shown(output) for output in cell.get("outputs", [])]
        alt = next(filter(None, map(_description, outputs)), f"Figure: {heading}")
        metadata = {**cell["metadata"], "mystnb": {"image": {"alt": alt}}}
        cells.append({**cell, "outputs": outputs, "metadata": metadata})
        if any(_WIDGET in output.get("data", {}) for output in cell.get("outputs", [])):
            cells.append(_markdown(f"still-{k}", _STILL))
    metadata = {**notebook["metadata"], "language_info": {"name": "python"}}
    return {**notebook, "cells": cells, "metadata": metadata}


def ledger_table(rows: list[dict[str, str]], anchors: Mapping[tuple[str, str], str]) -> str:
    """Return the ledger as HTML with its filters; ids lead to the cells that examine them."""
    counts = Counter(row["verdict"] for row in rows)
    classes = dict(CLASSES)
    if counts["pending"]:
        classes["pending"] = "no notebook has examined it here"
    key = "".join(
        f'<tr><td class="{_css(kind)}">{kind}</td><td>{counts[kind]}</td>'
        f"<td>{escape(meaning)}</td></tr>"
        for kind, meaning in classes.items()
    )
    body = "\n".join(_row(k, row, anchors) for k, row in enumerate(rows))
    heads = "".join(
        f'<th class="{css}" aria-sort="none"><button>{head}</button></th>'
        for css, head in _HEADS.items()
    )
    return _LEDGER.format(
        key=key,
        heads=heads,
        body=body,
        papers=_options(sorted({row["paper"] for row in rows})),
        kinds=_options(kind for kind in classes if counts[kind]),
    )


def cell_anchors(build: Path) -> dict[tuple[str, str], str]:
    """Return where each executed cell stands, as an address within the site.

    Keys are the number of the notebook with the cell's digest, and with "" for the page itself.
    """
    found = {}
    for path in sorted((build / "notebooks").glob("*.ipynb")):
        page = f"notebooks/{quote(path.stem)}.html"
        number = path.stem.partition("-")[0]
        found[number, ""] = page
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "code":
                digest = cell_digest("".join(cell["source"]))
                found[number, digest] = f"{page}#{quote(cell['id'])}"
    return found


def _markdown(name: str, source: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "id": name, "metadata": {}, "source": source}


def _shown(output: dict[str, Any]) -> dict[str, Any]:
    """Drop the widget that would hide its picture, and mark the words of tables."""
    data = {kind: value for kind, value in output.get("data", {}).items() if kind != _WIDGET}
    if "dataframe" in "".join(data.get("text/html", "")):
        data["text/html"] = _words_marked("".join(data["text/html"]))
    return {**output, "data": data} if data else output


def _description(output: Mapping[str, Any]) -> str:
    """Return what an explorer's picture says of itself."""
    png = base64.b64decode("".join(output.get("data", {}).get("image/png", "")))
    at = png.find(_DESCRIPTION)
    if at < 0:
        return ""
    length = int.from_bytes(png[at - 4 : at], "big") - len(_DESCRIPTION) + 4
    return png[at + len(_DESCRIPTION) :][:length].decode()


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


def _row(order: int, row: Mapping[str, str], anchors: Mapping[tuple[str, str], str]) -> str:
    text = {name: escape(value) for name, value in row.items()}
    page = anchors.get((row["notebook"], row["cell"])) or anchors.get((row["notebook"], ""))
    cells = {
        "id": f'<a href="{page}">{text["id"]}</a>' if page else text["id"],
        "where": f"{text['paper']}, {text['where']}",
        "quantity": f"{text['quantity']}<small>{text['note']}</small>",
        "claimed": f"{text['relation']} {text['claimed']} {text['unit']}",
        _css(row["verdict"]): text["verdict"],
        "under": text["under"],
        "ours": text["ours"],
        "odds": text["odds"],
        "sets": text["conflicts"].replace(";", " "),
        "rests": text["depends_on"].replace(";", " "),
        "reason": text["reason"],
    }
    numbers = {kind: _first_number(row[kind]) for kind in ("ours", "odds")}
    sorted_by = {"claimed": text["claimed"], **numbers}
    return (
        f'<tr id="{row["id"]}" data-order="{order}" data-paper="{text["paper"]}" '
        f'data-kind="{text["verdict"]}">'
        + "".join(
            f'<td class="{escape(kind)}"'
            + (f' data-value="{sorted_by[kind]}"' if kind in sorted_by else "")
            + f">{cell}</td>"
            for kind, cell in cells.items()
        )
        + "</tr>"
    )


def _first_number(text: str) -> str:
    found = re.search(r"[-−]?\d[\d.e+-]*", text)
    return found[0] if found else ""


def _css(kind: str) -> str:
    return kind.replace(" ", "-")


def _options(values: Any) -> str:
    return "".join(f"<option>{escape(value)}</option>" for value in values)


_HEADS = {
    "id": "id",
    "where": "where",
    "quantity": "quantity",
    "claimed": "print",
    "class": "class",
    "under": "stands under",
    "ours": "ours",
    "odds": "odds",
    "sets": "cannot hold with",
    "rests": "rests on",
    "reason": "reason",
}
_LEDGER = """<div class="made">
<table><thead><tr><th>class</th><th>claims</th><th>meaning</th></tr></thead>
<tbody>{key}</tbody></table>
<form class="filters" onsubmit="return false">
<label>paper <select id="paper"><option value="">all</option>{papers}</select></label>
<label>class <select id="kind"><option value="">all</option>{kinds}</select></label>
<label>words <input id="words" type="search"></label>
<output id="shown" role="status"></output>
</form>
<div class="scrolls" tabindex="0" role="region" aria-label="The claims">
<table class="ledger"><thead><tr>{heads}</tr></thead>
<tbody>
{body}
</tbody></table></div></div>
"""
