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

from losbench.workbench.ledger.cells import cell_digest
from losbench.workbench.ledger.claims import CLASSES

__all__ = ["VERDICT_COLOURS", "cell_anchors", "index_page", "ledger_page"]

VERDICT_COLOURS = """
.agrees { background: #d6efe5 } .depends { background: #e4ecd0 } .differs { background: #fbe3c0 }
.arithmetic { background: #e3dcf2 } .no-power, .follows, .set { background: #ececec }
.open, .pending { background: #d8ebf8 }
"""


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


def ledger_page(rows: list[dict[str, str]], anchors: Mapping[tuple[str, str], str]) -> str:
    """Return the ledger as a page of its own that asks for nothing from outside; ids lead to the
    cells that examine them.
    """
    counts = Counter(row["verdict"] for row in rows)
    classes = dict(CLASSES)
    if counts["pending"]:
        classes["pending"] = "no notebook has examined it here"
    key = "".join(
        f'<tr><td class="{_css(kind)}">{kind}</td><td>{counts[kind]}</td>'
        f"<td>{escape(meaning)}</td></tr>"
        for kind, meaning in classes.items()
    )
    body = "\n".join(_row(row, anchors) for row in rows)
    return _LEDGER.format(key=key, body=body, total=len(rows))


def cell_anchors(build: Path) -> dict[tuple[str, str], str]:
    """Return where each executed cell stands, relative to a build folder.

    Keys are the number of the notebook with the cell's digest, and with "" for the page itself.
    """
    found = {}
    for path in sorted((build / "notebooks").glob("*.ipynb")):
        if not (build / "html" / f"{path.stem}.html").is_file():
            continue
        page = f"html/{_url(path.stem)}.html"
        number = path.stem.partition("-")[0]
        found[number, ""] = page
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "code":
                digest = cell_digest("".join(cell["source"]))
                found[number, digest] = f"{page}#cell-id={_url(cell['id'])}"
    return found


def _row(row: Mapping[str, str], anchors: Mapping[tuple[str, str], str]) -> str:
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
    return (
        f'<tr id="{row["id"]}">'
        + "".join(f'<td class="{escape(kind)}">{cell}</td>' for kind, cell in cells.items())
        + "</tr>"
    )


def _css(kind: str) -> str:
    return kind.replace(" ", "-")


def _title(path: Path) -> str:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    heading = re.search(r"^# (.+)$", text, re.MULTILINE)
    return heading[1].strip() if heading else path.stem


_INDEX = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>losbench: the reproduction</title><style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto;
padding: 0 1rem; color: #222 }}
figure {{ display: inline-block; width: 18rem; margin: 0 1rem 1rem 0; vertical-align: top }}
img {{ max-width: 100%; border: 1px solid #ddd }} figcaption {{ font-size: .85rem }}
</style></head><body>
<h1>losbench: the reproduction</h1>
<p>Three papers in ten minutes: <a href="../replication.html">the replication report</a>. Every
print with its verdict: <a href="../ledger.html">the ledger of claims</a>.</p>
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
th, td {{ text-align: left; vertical-align: top; padding: .3rem .6rem }}
th, td {{ border-bottom: 1px solid #ddd }}
th {{ position: sticky; top: 0; background: #f4f4f4 }}
.claimed, .ours, .odds {{ text-align: right; font-variant-numeric: tabular-nums }}
.id, .odds, .under {{ white-space: nowrap }}
td {{ overflow-wrap: anywhere }}
.quantity {{ min-width: 9rem }}
.reason {{ min-width: 12rem }}
small {{ display: block; color: #555 }}
COLOURS</style></head><body>
<p><a href="html/index.html">All notebooks</a> ·
<a href="replication.html">Replication report</a></p>
<h1>Ledger of claims</h1>
<p>{total} printed numbers and statements of three papers: under how many of the readings tried each
stands, our value with its one-sigma sampling error or its range over the readings, the odds of the
print under our value against a method that does nothing, the sets of prints it cannot hold together
with, what it rests on, and a class that rules compute. Ids lead to the cells;
<a href="ledger.csv">ledger.csv</a> holds the same as a table.</p>
<table><tr><th>class</th><th>claims</th><th>meaning</th></tr>{key}</table>
<table><tr><th>id</th><th>where</th><th>quantity</th><th class="claimed">print</th><th>class</th>
<th>stands under</th><th class="ours">ours</th><th class="odds">odds</th><th>cannot hold with</th>
<th>rests on</th><th>reason</th></tr>
{body}
</table></body></html>
""".replace("COLOURS", VERDICT_COLOURS.replace("{", "{{").replace("}", "}}"))


def _url(name: str) -> str:
    """A name of a file as part of an address within an attribute."""
    return escape(quote(name))
