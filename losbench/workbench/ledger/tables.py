"""What the ledger shows: rows, sets of prints that exclude each other, tests of whole tables, and
questions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from losbench.workbench.ledger.claims import Claim, accepted_verdicts
from losbench.workbench.ledger.entries import Block, Conflict, Entry, Open, Question
from losbench.workbench.ledger.rules import Verdict, ids

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["blocks", "conflicts", "questions", "rows", "with_accepted"]


def rows(
    claims: Mapping[str, Claim], verdicts: Mapping[str, Verdict], entries: Sequence[Entry]
) -> Iterator[dict[str, str]]:
    """Yield every claim as a row of the printed ledger."""
    sets, where = _sets(entries), _where(entries)
    for id_, found in verdicts.items():
        row = asdict(claims[id_])
        row.pop("block")
        at = where.get(id_)
        yield row | {
            "verdict": found.verdict,
            "under": found.under,
            "ours": found.ours,
            "odds": _odds(found.odds),
            "conflicts": ";".join(sets.get(id_, ())),
            "depends_on": ";".join(found.depends_on),
            "reason": found.reason,
            "notebook": (at.notebook if at else "") or row["notebook"],
            "cell": at.cell if at else "",
        }


def _where(entries: Sequence[Entry]) -> dict[str, Entry]:
    """Return the entry that each claim's row leads to: its first own one, else one of a set."""
    found: dict[str, Entry] = {}
    for shared in (False, True):
        for entry in entries:
            if isinstance(entry.said, Conflict | Block | Question) == shared:
                for id_ in entry.claims:
                    found.setdefault(id_, entry)
    return found


def _sets(entries: Sequence[Entry]) -> dict[str, list[str]]:
    found: dict[str, set[str]] = {}
    for entry in entries:
        if isinstance(entry.said, Conflict):
            for id_ in entry.claims:
                found.setdefault(id_, set()).add(entry.said.name)
    return {id_: sorted(names) for id_, names in found.items()}


def with_accepted(rows: Sequence[dict[str, str]]) -> list[dict[str, str]]:
    """Fill rows that no notebook has examined here with the accepted verdict, which they say."""
    accepted = accepted_verdicts()
    return [
        row
        if row["verdict"] != "pending"
        else row
        | {
            "verdict": accepted.get(row["id"], "pending"),
            "reason": f"accepted verdict; notebook {row['notebook']} has not run here",
        }
        for row in rows
    ]


def conflicts(entries: Iterable[Entry], order: Sequence[str]) -> pd.DataFrame:
    """Return the sets of prints that cannot hold together."""
    import pandas as pd

    rows = [
        {
            "set": entry.said.name,
            "prints": ";".join(ids(entry.claims, order)),
            "would have to hold": entry.said.inequality,
            "slack": f"{entry.said.slack:.3g} {entry.said.unit}".strip(),
        }
        for entry in entries
        if isinstance(entry.said, Conflict)
    ]
    columns = ["set", "prints", "would have to hold", "slack"]
    return pd.DataFrame(rows, columns=columns).sort_values("set", kind="stable").set_index("set")


def blocks(entries: Iterable[Entry]) -> pd.DataFrame:
    """Return the tests of whole tables and figures, reading by reading."""
    import pandas as pd

    rows = [
        {
            "block": b.name,
            "reading": ", ".join(f"{axis}: {choice}" for axis, choice in b.reading.items()),
            "chi2": f"{b.chi2:.3g}",
            "degrees of freedom": b.cells - b.fitted,
            "p": f"{b.p_value:.2g}",
        }
        for entry in entries
        if isinstance(b := entry.said, Block)
    ]
    columns = ["block", "reading", "chi2", "degrees of freedom", "p"]
    return pd.DataFrame(rows, columns=columns).set_index("block")


def questions(entries: Iterable[Entry]) -> dict[str, tuple[str, ...]]:
    """Return the questions to the authors, with the claims that they would settle."""
    asked: dict[str, tuple[str, ...]] = {}
    for entry in entries:
        if isinstance(entry.said, Open | Question):
            before = asked.get(entry.said.question, ())
            asked[entry.said.question] = (*before, *entry.claims)
    return asked


def _odds(odds: float | None) -> str:
    if odds is None:
        return ""
    if not 1.01e-6 < odds < 0.99e6:
        return "> 1e6" if odds > 1 else "< 1e-6"
    return f"{odds:.2g}" if odds < 1e3 else f"{odds:.0e}".replace("e+0", "e")
