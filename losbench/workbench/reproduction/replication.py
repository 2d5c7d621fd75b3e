"""The replication report: each paper on two pages, every sentence made from the ledger."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from textwrap import shorten

from losbench.workbench.ledger.claims import CLASSES, counted
from losbench.workbench.ledger.ledger import Ledger

__all__ = ["PAPERS", "REPLICATION", "replication_page"]

REPLICATION = (
    "A <b>replication</b> asks a paper's question again with data and code of one's own, here a "
    "digital twin, and compares what comes out. A <b>reproduction</b> runs the same code on the "
    "same data and expects the same bytes: that is what <code>losbench reproduce</code> does with "
    "this report."
)
PAPERS = {
    "liu2026": (
        "Liu et al., Thermal line-of-sight pointing analysis of a space camera based on the IRLS "
        "algorithm, Chinese Optics, doi 10.37188/CO.2026-0039",
        {
            "liu2026-layouts": "Where the two spots can stand on the sensor for Table 2 to follow.",
            "liu2026-reductions": "By how much EIWA lies below the grey centroid: twin and prints.",
        },
    ),
    "lyu2015": (
        "Lyu et al., Star spot centroiding method with inertial measurement information, Journal "
        "of NUDT 37(2), 2015, doi 10.11887/j.cn.201502029",
        {
            "lyu2015-rate-limit": "Centroid errors under other vibrations than the one assumed.",
            "lyu2015-spread": "Aided errors of eight stars by threshold and mask, and as printed.",
        },
    ),
    "ren2023": (
        "Ren et al., Boresight drift correction and on-orbit evaluation for the high-precision "
        "star camera, Spacecraft Recovery &amp; Remote Sensing 44(4), 2023, doi "
        "10.3969/j.issn.1009-8518.2023.04.002",
        {
            "ren2023-fig-4": "The angle between the cameras over two months, as in Fig. 4.",
            "ren2023-unbiased-split": "What the split into LSFE and NEA finds of the true LSFE.",
        },
    ),
}
_HEADS = {
    "agrees": "What agrees",
    "depends": "What depends, and on what",
    "differs": "What differs",
    "arithmetic": "What the paper's own prints decide",
    "open": "What cannot be tested",
}
_SILENT = ("no power", "follows", "set")


def replication_page(ledger: Ledger, build: Path, anchors: Mapping[tuple[str, str], str]) -> str:
    """Return the report as HTML for a page of the site, which prints on A4.

    Parameters
    ----------
    ledger : Ledger
        Of the notebooks that have run.
    build : Path
        Build folder, whose figures are taken in.
    anchors : mapping
        Of `cell_anchors`.
    """
    rows = list(ledger.rows())
    counts = counted(row["verdict"] for row in rows)
    papers = "\n".join(_paper(name, rows, ledger, build, anchors) for name in PAPERS)
    return _PAGE.format(
        replication=REPLICATION,
        total=len(rows),
        counts=counts,
        papers=papers,
        classes="".join(f"<dt>{k}</dt><dd>{escape(v)}</dd>" for k, v in CLASSES.items()),
        runs=_runs(build),
    )


def _paper(
    name: str,
    rows: list[dict[str, str]],
    ledger: Ledger,
    build: Path,
    anchors: Mapping[tuple[str, str], str],
) -> str:
    citation, pictures = PAPERS[name]
    own = [row for row in rows if row["paper"] == name]
    parts = [
        f"<section><h2>{name}</h2><p class='cite'>{citation}</p>",
        f"<p>Of {len(own)} printed numbers and statements: "
        f"{counted(row['verdict'] for row in own)}.</p>",
        _figures(pictures, build),
    ]
    for kind, head in _HEADS.items():
        some = [row for row in own if row["verdict"] == kind]
        if some:
            items = "".join(_item(row, anchors) for row in _alike(some))
            parts.append(f"<h3>{head} ({len(some)})</h3><ul>{items}</ul>")
    parts.append(_conflicts(name, ledger))
    parts.append(_tests(name, ledger))
    silent = [f"{k}: {_ids(own, k)}" for k in _SILENT if any(r["verdict"] == k for r in own)]
    parts.append(f"<h3>What is no evidence</h3><p>{'; '.join(silent) or 'none'}.</p>")
    parts.append(_questions(name, ledger))
    return "\n".join(parts) + "</section>"


def _alike(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Join rows whose reasons are the same, so that a table takes a line and not twelve."""
    joined: dict[str, dict[str, str]] = {}
    for row in rows:
        key = row["reason"]
        printed = f" {row['relation']} {row['claimed']} {row['unit']}".rstrip()
        said = row["quantity"] + printed * (row["relation"] != "is")
        if key in joined:
            joined[key] = joined[key] | {
                "id": f"{joined[key]['id']}, {row['id']}",
                "said": f"{joined[key]['said']}; {said}",
                "ours": "",
            }
        else:
            joined[key] = row | {"said": said}
    return list(joined.values())


def _item(row: Mapping[str, str], anchors: Mapping[tuple[str, str], str]) -> str:
    page = anchors.get((row["notebook"], row["cell"])) or anchors.get((row["notebook"], ""))
    ids = f'<a href="{page}">{row["id"]}</a>' if page else row["id"]
    told = [
        f"ours {row['ours']}" if row["ours"] else "",
        f"stands under {row['under']}" if row["under"] else "",
        f"odds {row['odds']}" if row["odds"] else "",
    ]
    told = [escape(part) for part in told if part]
    facts = f" ({', '.join(told)})" if told else ""
    reason = f" <small>{escape(shorten(row['reason'], 170))}</small>" if row["reason"] else ""
    return f"<li>{escape(row['said'])}{facts} [{ids}]{reason}</li>"


def _ids(rows: Iterable[Mapping[str, str]], kind: str) -> str:
    return ", ".join(row["id"] for row in rows if row["verdict"] == kind)


def _conflicts(name: str, ledger: Ledger) -> str:
    table = ledger.conflicts()
    own = table[[_of(name, prints, ledger) for prints in table["prints"]]]
    if not len(own):
        return ""
    body = "".join(
        f"<tr><td>{k}</td><td>{escape(row['prints'].replace(';', ' '))}</td>"
        f"<td>{escape(row['would have to hold'])}</td><td>{escape(row['slack'])}</td></tr>"
        for k, row in own.iterrows()
    )
    return (
        "<h3>What cannot hold together</h3><table><tr><th>set</th><th>prints</th>"
        f"<th>would have to hold</th><th>slack</th></tr>{body}</table>"
    )


def _of(name: str, prints: str, ledger: Ledger) -> bool:
    first = prints.partition(";")[0].partition("..")[0]
    return ledger.claims[first].paper == name


def _tests(name: str, ledger: Ledger) -> str:
    """Each table as a whole: how many readings were tried, and what the best of them leaves."""
    table = ledger.blocks()
    own = table[[block.startswith(name) for block in table.index]]
    if not len(own):
        return ""
    body = ""
    for block, some in own.groupby(level="block", sort=False):
        best = some.iloc[some["p"].astype(float).argmax()]
        body += (
            f"<tr><td>{escape(str(block))}</td><td>{len(some)}</td>"
            f"<td>{escape(best['reading'])}</td><td>{best['chi2']} of {best['degrees of freedom']}"
            f"</td><td>{best['p']}</td></tr>"
        )
    return (
        "<h3>Tables as a whole</h3><table><tr><th>table</th><th>readings</th><th>best of them</th>"
        f"<th>chi-square, degrees of freedom</th><th>p</th></tr>{body}</table>"
    )


def _questions(name: str, ledger: Ledger) -> str:
    asked = [
        f"<li>{escape(question)} [{', '.join(claims)}]</li>"
        for question, claims in ledger.questions().items()
        if ledger.claims[claims[0]].paper == name
    ]
    return f"<h3>What would settle it</h3><ol>{''.join(asked)}</ol>" if asked else ""


def _figures(captions: Mapping[str, str], build: Path) -> str:
    pictures = []
    for name, caption in captions.items():
        path = build / "figures" / f"{name}.png"
        if path.is_file():
            data = base64.b64encode(path.read_bytes()).decode()
            pictures.append(
                f'<figure><img src="data:image/png;base64,{data}" alt="Figure: {escape(caption)}">'
                f"<figcaption>{escape(caption)}</figcaption></figure>"
            )
    return f"<div class='figures'>{''.join(pictures)}</div>" if pictures else ""


def _runs(build: Path) -> str:
    rows = []
    for path in sorted((build / "runs").glob("*.json")):
        run = json.loads(path.read_text(encoding="utf-8"))
        rows.append(
            f"<tr><td>{escape(run['notebook'])}</td><td>{run['seconds']:.0f} s</td>"
            f"<td>{run.get('memory_mb', 0.0):.0f} MB</td></tr>"
        )
    return "".join(rows)


_PAGE = """<div class="made replication">
<p>{replication}</p>
<p>{total} printed numbers and statements: {counts}. A class is computed from what the notebooks
found, never typed:</p>
<dl>{classes}</dl>
{papers}
<section><h2>Time and memory</h2>
<table><tr><th>notebook</th><th>time</th><th>memory at most</th></tr>{runs}</table></section>
</div>
"""
