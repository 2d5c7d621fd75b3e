"""The pages of a reproduction that no notebook makes: the ledger, and the index that leads to
everything.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from urllib.parse import quote

from losbench.workbench.ledger.claims import VERDICTS

__all__ = ["index_page", "ledger_page"]


def index_page(notebooks: Iterable[Path], build: Path) -> str:
    """Return the page ``html/index.html`` of a build folder, which lists the notebooks' pages
    beside it.
    """
    items = "".join(
        f'<li><a href="{_url(path.stem)}.html">{escape(_title(path))}</a></li>\n'
        for path in notebooks
    )
    tables = [path.name for path in sorted((build / "tables").glob("*.csv"))]
    listed = (
        ", ".join(f'<a href="../tables/{_url(name)}">{escape(name)}</a>' for name in tables)
        or "none"
    )
    figures = [path.name for path in sorted((build / "figures").glob("*.png"))]
    pictures = "".join(
        f'<figure><a href="../figures/{_url(name)}"><img src="../figures/{_url(name)}" '
        f'alt="{escape(name)}"></a>'
        f"<figcaption>{escape(name)}</figcaption></figure>\n"
        for name in figures
    )
    return _INDEX.format(notebooks=items, tables=listed, pictures=pictures)


def ledger_page(rows: list[dict[str, str]], pages: Iterable[str] = ()) -> str:
    """Return the ledger as a page of its own that asks for nothing from outside and links to the
    notebooks' pages.
    """
    page_of = {name.partition("-")[0]: f"html/{name}.html" for name in pages}
    counts = Counter(row["verdict"] for row in rows)
    key = "".join(
        f'<tr><td class="{escape(verdict)}">{escape(verdict)}</td><td>{counts[verdict]}</td><td>{escape(meaning)}</td></tr>'
        for verdict, meaning in VERDICTS.items()
    )
    body = "\n".join(_row(row, page_of) for row in rows)
    return _LEDGER.format(key=key, body=body, total=len(rows))


def _row(row: Mapping[str, str], page_of: Mapping[str, str]) -> str:
    text = {name: escape(value) for name, value in row.items()}
    judged = re.match(r"Notebook (\d+)", row["evidence"])
    if judged and judged[1] in page_of:
        text["id"] = f'<a href="{_url(page_of[judged[1]])}">{text["id"]}</a>'
    error = f" ± {text['uncertainty']}" if text["uncertainty"] not in ("", "0") else ""
    cells = {
        "id": text["id"],
        "where": f"{text['paper']}, {text['where']}",
        "quantity": f"{text['quantity']}<small>{text['note']}</small>",
        "claimed": f"{text['relation']} {text['claimed']} {text['unit']}",
        "ours": text["ours"] + error,
        row["verdict"]: text["verdict"],
        "reading": text["reading"],
        "evidence": text["evidence"],
    }
    return (
        f'<tr id="{row["id"]}">'
        + "".join(f'<td class="{escape(kind)}">{cell}</td>' for kind, cell in cells.items())
        + "</tr>"
    )


def _title(path: Path) -> str:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    heading = re.search(r"^# (.+)$", text, re.MULTILINE)
    return heading[1].strip() if heading else path.stem


_INDEX = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>losbench: the reproduction</title><style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222 }}
figure {{ display: inline-block; width: 18rem; margin: 0 1rem 1rem 0; vertical-align: top }}
img {{ max-width: 100%; border: 1px solid #ddd }} figcaption {{ font-size: .85rem }}
</style></head><body>
<h1>losbench: the reproduction</h1>
<p>Every printed number with its verdict: <a href="../ledger.html">the ledger of claims</a>.</p>
<h2>Notebooks</h2>
<ul>
{notebooks}</ul>
<h2>Tables</h2>
<p>{tables}</p>
<h2>Figures</h2>
{pictures}</body></html>
"""

_LEDGER = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>losbench: ledger of claims</title><style>
body {{ font: 15px/1.45 system-ui, sans-serif; margin: 2rem; color: #222; background: #fff }}
table {{ border-collapse: collapse; margin: 1rem 0 }}
th, td {{ text-align: left; vertical-align: top; padding: .3rem .6rem; border-bottom: 1px solid #ddd }}
th {{ position: sticky; top: 0; background: #f4f4f4 }}
.claimed, .ours {{ text-align: right; font-variant-numeric: tabular-nums }}
.id, .claimed, .ours {{ white-space: nowrap }}
.quantity {{ min-width: 12rem }}
.evidence, .reading {{ min-width: 12rem; overflow-wrap: anywhere }}
small {{ display: block; color: #555 }}
.reproduced {{ background: #d6efe5 }} .differs {{ background: #fbe3c0 }} .impossible {{ background: #f6d3c2 }}
.calibrated {{ background: #d8ebf8 }} .untestable, .pending {{ background: #ececec }}
</style></head><body>
<p><a href="html/index.html">All notebooks</a></p>
<h1>Ledger of claims</h1>
<p>{total} printed numbers and statements of three papers, each with our value, its one-sigma sampling error and a
verdict computed by rule. Ids lead to the notebooks; <a href="ledger.csv">ledger.csv</a> holds the same as a
table.</p>
<table><tr><th>verdict</th><th>claims</th><th>meaning</th></tr>{key}</table>
<table><tr><th>id</th><th>where</th><th>quantity</th><th class="claimed">claimed</th><th class="ours">ours</th>
<th>verdict</th><th>reading</th><th>evidence</th></tr>
{body}
</table></body></html>
"""


def _url(name: str) -> str:
    """A name of a file as part of an address within an attribute."""
    return escape(quote(name))
