"""Put what the benches have found on one page: build/benchmarks.html, and .json for other programs.

Every ratio stands beside its peer or physical limit and what was wanted of it; costs are drawn
against size.
"""

from __future__ import annotations

import html
import io
import json

import matplotlib
from records import FOLDER

matplotlib.use("svg")
import matplotlib.pyplot as plt

STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em}
table{border-collapse:collapse;width:100%;margin:.5em 0 1.5em}th{text-align:left;font-weight:600}
td,th{padding:.2em .7em;border-bottom:1px solid #8884;vertical-align:top}td.n{text-align:right;
font-variant-numeric:tabular-nums;white-space:nowrap}.MISSED{color:#b00;font-weight:600}
.about{color:#777;font-size:13px}svg{max-width:100%;height:auto;background:#fff}
@media(prefers-color-scheme:dark){body{background:#111;color:#ddd}}"""
HEADS = ("what", "here", "beside", "there", "ratio", "wanted", "")


def duration(us: float | None) -> str:
    """Return microseconds in a unit that reads well.

    >>> [duration(x) for x in (0.82, 1234.0, 5.6e7, None)]
    ['0.82 us', '1.23 ms', '56 s', '']
    """
    if us is None:
        return ""
    for unit, size in (("s", 1e6), ("ms", 1e3)):
        if us >= size:
            return f"{us / size:.3g} {unit}"
    return f"{us:.3g} us"


def row_of(row: dict) -> str:
    ratio = "" if row.get("ratio") is None else f"{row['ratio']:.3g}"
    verdict = row.get("verdict", "")
    cells = [
        (row["what"], ""),
        (duration(row.get("ours_us")), "n"),
        (row.get("peer", ""), ""),
        (duration(row.get("peer_us")), "n"),
        (ratio, "n"),
        (row.get("target", ""), ""),
        (verdict, verdict),
    ]
    return "".join(f'<td class="{kind}">{html.escape(str(text))}</td>' for text, kind in cells)


def picture(growths: list[dict]) -> str:
    fig, axis = plt.subplots(figsize=(9.0, 4.8))
    for each in growths:
        cost = [1e6 * s / n for s, n in zip(each["seconds"], each["sizes"], strict=True)]
        axis.loglog(each["sizes"], cost, "o-", label=f"{each['what']} ({each['unit']})")
    axis.set_xlabel("size")
    axis.set_ylabel("processor time for each (us)")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    drawn = io.StringIO()
    fig.savefig(drawn, format="svg", bbox_inches="tight", metadata={"Date": None})
    text = drawn.getvalue()
    return text[text.index("<svg") :]


def page(found: list[dict]) -> str:
    parts = ["<!doctype html><html lang=en><meta charset=utf-8><title>losbench: benchmarks</title>"]
    parts.append(f"<style>{STYLE}</style><h1>Benchmarks</h1>")
    growths = [each for bench in found for each in bench["growths"]]
    if growths:
        parts.append("<h2>Cost against size</h2><p>A flat line: twice as much takes twice as long.")
        parts.append(picture(growths))
    for bench in found:
        if not bench["rows"]:
            continue
        load = "" if bench["load"] is None else f", load {bench['load']:.1f}"
        parts.append(f"<h2>{html.escape(bench['name'])}</h2>")
        parts.append(
            f'<p class="about">{html.escape(bench["when"] + ", " + bench["machine"] + load)}'
        )
        head = "".join(f"<th>{head}</th>" for head in HEADS)
        rows = "".join(f"<tr>{row_of(row)}</tr>\n" for row in bench["rows"])
        parts.append(f"<table><tr>{head}</tr>\n{rows}</table>")
    return "\n".join(parts) + "</html>\n"


def main() -> None:
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("*.json"))]
    out = FOLDER.parent
    (out / "benchmarks.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (out / "benchmarks.html").write_text(page(found), encoding="utf-8")
    rows = [row for bench in found for row in bench["rows"]]
    missed = sum(row.get("verdict") == "MISSED" for row in rows)
    print(f"{len(rows)} comparisons, {missed} missed: build/benchmarks.html and .json")


if __name__ == "__main__":
    main()
