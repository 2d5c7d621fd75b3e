"""What the papers claim, what was found, and the tables that hold both."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from decimal import Decimal
from functools import cached_property
from pathlib import Path

import numpy as np

from losbench.resources import data_file, write_whole
from losbench.tables import Dialect, read_table

__all__ = [
    "COLUMNS",
    "VERDICTS",
    "Claim",
    "Finding",
    "accept",
    "accepted_verdicts",
    "as_csv",
    "as_text",
    "read_claims",
]

VERDICTS = {
    "reproduced": "the print lies inside the 99.7 % interval of our value, its rounding included",
    "differs": "it does not",
    "impossible": "it contradicts the paper's own statements or geometry, by a computation",
    "calibrated": "used to set up the twin, so no evidence",
    "untestable": "the paper does not give what a test would need",
    "pending": "not yet examined",
}
_RELATIONS = ("=", "~", "<=", ">=")
COLUMNS = (
    *("id", "paper", "where", "quantity", "relation", "claimed", "unit", "note"),
    *("ours", "uncertainty", "reading", "verdict", "evidence"),
)


@dataclass(frozen=True)
class Claim:
    """One statement of a paper as printed; ``claimed`` stays text, since 0.10 promises more than
    0.1.
    """

    id: str
    paper: str
    where: str
    quantity: str
    relation: str
    claimed: str
    unit: str
    note: str

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


@dataclass(frozen=True)
class Finding:
    """What a notebook found about one claim, as the ledger prints it."""

    verdict: str
    ours: str = ""
    uncertainty: str = ""
    reading: str = ""
    evidence: str = ""


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


def as_text(value: float | np.bool_ | str | None, digits: int = 6) -> str:
    """Six digits: enough for every print, too few for the noise of another BLAS to show."""
    if isinstance(value, bool | np.bool_):
        return str(bool(value)).lower()
    if value is None or isinstance(value, str):
        return value or ""
    return f"{float(value):.{digits}g}"
