"""What the papers claim, the classes that a verdict can have, and the tables that hold both."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from losbench.resources import data_file, write_whole
from losbench.tables import Dialect, read_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "CLASSES",
    "COLUMNS",
    "Claim",
    "accept",
    "accepted_counts",
    "accepted_verdicts",
    "as_csv",
    "counted",
    "read_claims",
    "with_error",
]

CLASSES = {
    "agrees": "print and value meet under every reading tried, and doing nothing would not",
    "depends": "they meet under some readings and not under others, which are named",
    "differs": "they meet under none",
    "arithmetic": "the paper's own prints decide; true or false stands in the reason",
    "no power": "they meet, but the print is hardly less likely if the method does nothing",
    "follows": "made of what was set, or of another claim: no evidence of its own",
    "set": "used to set the twin up: no evidence",
    "open": "a test lacks something; the reason asks for it",
}
"""What a verdict can be; `pending` stands where no notebook has examined the claim yet."""

_RELATIONS = ("=", "~", "<=", ">=")
COLUMNS = (
    *("id", "paper", "where", "quantity", "relation", "claimed", "unit", "note"),
    *("verdict", "under", "ours", "odds", "conflicts", "depends_on", "reason"),
    *("notebook", "cell"),
)


@dataclass(frozen=True)
class Claim:
    """One statement of a paper as printed; ``claimed`` stays text, since 0.10 promises more than
    0.1. ``block`` is the table or figure that is tested as a whole, ``notebook`` the one that
    examines it.
    """

    id: str
    paper: str
    where: str
    quantity: str
    relation: str
    claimed: str
    unit: str
    note: str
    block: str = ""
    notebook: str = ""

    @cached_property
    def interval(self) -> tuple[float, float]:
        """The values that the claim allows, half a unit of its last printed digit included.

        >>> Claim("a", "p", "Tab. 1", "RMS", "=", "0.10", "px", "").interval
        (0.095, 0.105)
        """
        printed = Decimal(self.claimed)
        rounding = Decimal((0, (5,), int(printed.as_tuple().exponent) - 1))
        low, high = float(printed - rounding), float(printed + rounding)
        return {"<=": (-np.inf, high), ">=": (low, np.inf)}.get(self.relation, (low, high))

    @property
    def print(self) -> str:
        """The print in one phrase: relation, number and unit."""
        return f"{self.relation} {self.claimed} {self.unit}".strip()


def read_claims(path: str | Path | None = None) -> dict[str, Claim]:
    """Return the claims of a CSV table by id, by default those of ``data/claims.csv``.

    Raises
    ------
    ValueError
        If a column is missing, an id stands twice, or a claim is no number where it must be one.
    """
    table = read_table(path or data_file("claims.csv"), Dialect(delimiter=","), as_text=True)
    names = [field.name for field in fields(Claim)]
    missing = [name for name in names if name not in table.names]
    if missing:
        raise ValueError(
            f"{table.file} has no column {', '.join(missing)}; it has {table.listed()}"
        )
    claims: dict[str, Claim] = {}
    for row, cells in enumerate(zip(*map(table.texts, names), strict=True)):
        claim = Claim(*cells)
        if claim.id in claims or not claim.id:
            raise ValueError(
                f"{table.file}, line {table.line(row)}: the id must be given, and once"
            )
        if not _is_claimed(claim):
            raise ValueError(
                f"{table.file}, line {table.line(row)}: {claim.id} must claim a number by "
                f"{', '.join(_RELATIONS)}, or true or false by 'is', got {claim.relation!r} "
                f"{claim.claimed[:40]!r}"
            )
        claims[claim.id] = claim
    return claims


def _is_claimed(claim: Claim) -> bool:
    if claim.relation == "is":
        return claim.claimed in ("true", "false")
    return (
        claim.relation in _RELATIONS
        and re.fullmatch(r"-?\d{1,15}(\.\d{1,15})?", claim.claimed) is not None
    )


def accepted_verdicts() -> dict[str, str]:
    """Return the verdicts of ``data/verdicts.csv`` by id: what a reproduction is compared with."""
    with data_file("verdicts.csv").open(encoding="utf-8", newline="") as file:
        return {row["id"]: row["verdict"] for row in csv.DictReader(file)}


def counted(verdicts: Iterable[str]) -> str:
    """Return how many verdicts are of which class, as a phrase.

    >>> counted(["set", "agrees", "set"])
    '1 agrees, 2 set'
    """
    every = list(verdicts)
    kinds = [*CLASSES, "pending"]
    return ", ".join(f"{every.count(kind)} {kind}" for kind in kinds if kind in every)


def accepted_counts() -> pd.DataFrame:
    """Return how many claims of each paper have which accepted verdict, as a table."""
    import pandas as pd

    claims = read_claims()
    verdicts = pd.Series(accepted_verdicts(), name="verdict")
    papers = pd.Series({id_: claims[id_].paper for id_ in verdicts.index}, name="paper")
    counts = pd.crosstab(verdicts, papers, margins=True, margins_name="all")
    return counts.reindex([*(kind for kind in CLASSES if kind in counts.index), "all"])


def accept(verdicts: Mapping[str, str]) -> None:
    """Rewrite ``data/verdicts.csv`` with these verdicts."""
    rows = ({"id": id_, "verdict": verdict} for id_, verdict in verdicts.items())
    write_whole(data_file("verdicts.csv"), as_csv(("id", "verdict"), rows))


def as_csv(columns: Iterable[str], rows: Iterable[Mapping[str, str]]) -> str:
    """Return rows as CSV text."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def with_error(value: float, error: float = 0.0) -> str:
    """Return a value with its error to two digits, or to four digits where it has none.

    >>> with_error(13.7612, 6.8213), with_error(0.0110497, 0.00024), with_error(1.1913971)
    ('13.8 ± 6.8', '0.01105 ± 0.00024', '1.191')
    """
    if not error > 0.0:
        return f"{value:.4g}"
    places = max(0, 1 - int(np.floor(np.log10(float(f"{error:.1e}")))))
    return f"{value:.{places}f} ± {error:.{places}f}"
