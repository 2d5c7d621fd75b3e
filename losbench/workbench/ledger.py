"""The ledger: every printed number of the papers, ours beside it, and a verdict that a rule has computed.

A claim is an interval (the print with its rounding, or one side of an inequality), a result is another (three sigma
about our value), a proof a third (what the paper's own statements or geometry allow). Verdicts compare intervals.
"""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from decimal import Decimal
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from losbench.checks import boolean, choice, number
from losbench.resources import build_folder, data_file, write_whole

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["VERDICTS", "Claim", "Finding", "Ledger", "accept", "accepted_verdicts"]

VERDICTS = {
    "reproduced": "the print lies inside the 99.7 % interval of our value, its rounding included",
    "differs": "it does not",
    "impossible": "it contradicts the paper's own statements or geometry, by a computation",
    "calibrated": "used to set up the twin, so no evidence",
    "untestable": "the paper does not give what a test would need",
    "pending": "not yet examined",
}
COLUMNS = (
    *("id", "paper", "where", "quantity", "relation", "claimed", "unit", "note"),
    *("ours", "uncertainty", "reading", "verdict", "evidence"),
)
_ALL = (-np.inf, np.inf)


@dataclass(frozen=True)
class Claim:
    """One statement of a paper as printed; ``claimed`` stays text, since 0.10 promises more than 0.1."""

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


class Ledger:
    """The claims of the three papers and what was found about them.

    A notebook makes one, states its findings, and closes with :meth:`save`; :meth:`collect` joins the notebooks' parts.

    Parameters
    ----------
    claims : path, optional
        A CSV table with the columns of ``data/claims.csv``, which is the default.

    Raises
    ------
    ValueError
        From any method given an id that is no claim, a second verdict other than the first, or a value of the wrong
        kind.

    Examples
    --------
    >>> ledger = Ledger()
    >>> ledger.judge("irls-13", 4.2278, reading="260 mm, 10 um").verdict
    'reproduced'
    >>> ledger.impossible("irls-08", at_least=0.79, proof="Y >= 75/475 Z, and irls-11 wants Z >= 5").verdict
    'impossible'
    >>> ledger.verdicts()["irls-15"]
    'pending'
    """

    def __init__(self, claims: str | Path | None = None) -> None:
        with open(claims or data_file("claims.csv"), encoding="utf-8", newline="") as file:
            self.claims = {row["id"]: Claim(**row) for row in csv.DictReader(file)}
        self.findings: dict[str, Finding] = {}

    def judge(
        self, claim: str, ours: float, *, uncertainty: float = 0.0, reading: str = "", evidence: str = ""
    ) -> Finding:
        """Compare our value with the print: ``reproduced`` where the intervals meet, else ``differs``.

        Parameters
        ----------
        claim : str
            Id, e.g. "irls-15".
        ours : float, in the claim's unit, or bool
            A bool for the claims whose relation is "is".
        uncertainty : float, same unit
            One-sigma sampling error of our value at the paper's sample size; three of them are allowed.
        reading : str
            The reading of the paper that the value rests on.
        evidence : str
            What else speaks for or against: other readings, the check that was made.

        Returns
        -------
        Finding
            Its ``verdict`` is the result.
        """
        one = self._claim(claim)
        if one.relation == "is":
            agrees = boolean("ours", ours) == (one.claimed == "true")
            return self._enter(claim, "reproduced" if agrees else "differs", ours, None, reading, evidence)
        margin = 3.0 * number("uncertainty", uncertainty, low=0.0)
        value = number("ours", ours)
        agrees = _meet(one.interval, (value - margin, value + margin))
        return self._enter(claim, "reproduced" if agrees else "differs", value, uncertainty, reading, evidence)

    def calibrated(self, claim: str, ours: float | None = None, *, reading: str, evidence: str = "") -> Finding:
        """State that the claim was used to set up the twin or to choose an example: no evidence either way."""
        return self._enter(claim, "calibrated", ours, None, reading, evidence)

    def untestable(self, claim: str, *, reason: str, ours: float | None = None, reading: str = "") -> Finding:
        """State that the paper does not give what a test would need; our own value may stand beside it."""
        return self._enter(claim, "untestable", ours, None, reading, reason)

    def impossible(
        self,
        claim: str,
        *,
        proof: str,
        at_least: float | None = None,
        at_most: float | None = None,
        contradiction: bool | None = None,
        ours: float | None = None,
        reading: str = "",
    ) -> Finding:
        """Show that the claim contradicts the paper's own statements or geometry.

        Give the computed bounds of the quantity, or for a claim that is no number the computed ``contradiction``.

        Parameters
        ----------
        claim : str
            Id, e.g. "irls-44".
        proof : str
            The argument in one line; the computation stands in the notebook.
        at_least, at_most : float, in the claim's unit
            What the quantity can be.
        contradiction : bool
            True where the computation contradicts the claim.
        ours : float, same unit, or bool
            The twin's own value, to stand beside the print.
        reading : str
            The reading of the paper that the proof rests on.

        Raises
        ------
        ValueError
            If the bounds leave room for the claim, or the contradiction is not one.
        """
        one = self._claim(claim)
        if one.relation == "is":
            if at_least is not None or at_most is not None or contradiction is None:
                raise ValueError(f"{claim} is no number: give contradiction, not bounds")
            if not boolean("contradiction", contradiction):
                raise ValueError(f"{claim} is not impossible: the computation does not contradict it")
            return self._enter(claim, "impossible", ours, None, reading, proof)
        if contradiction is not None or (at_least is None and at_most is None):
            raise ValueError(f"{claim} is a number: give at_least or at_most, not contradiction")
        low = _ALL[0] if at_least is None else number("at_least", at_least)
        high = _ALL[1] if at_most is None else number("at_most", at_most, low=low)
        bound = " and ".join(f"{sign} {_text(b)}" for sign, b in ((">=", at_least), ("<=", at_most)) if b is not None)
        if _meet(one.interval, (low, high)):
            stated = f"{one.relation} {one.claimed} {one.unit}"
            raise ValueError(f"{claim} is not impossible: {stated} agrees with the bound {bound}")
        return self._enter(claim, "impossible", ours, None, reading, f"bound {bound} {one.unit}: {proof}")

    def verdicts(self) -> dict[str, str]:
        """Return the verdict of every claim by id, ``pending`` where nothing was found yet."""
        return {id_: self.findings[id_].verdict if id_ in self.findings else "pending" for id_ in self.claims}

    def rows(self, *, judged: bool = False) -> Iterator[dict[str, str]]:
        """Yield every claim, or only those judged, as a row of the printed ledger."""
        for id_, claim in self.claims.items():
            if id_ in self.findings or not judged:
                yield {**asdict(claim), **asdict(self.findings.get(id_, Finding("pending")))}

    def table(self) -> pd.DataFrame:
        """Return the judged claims as a DataFrame indexed by id, to close a notebook with."""
        import pandas as pd

        columns = [
            "id",
            "where",
            "quantity",
            "relation",
            "claimed",
            "unit",
            "ours",
            "uncertainty",
            "verdict",
            "reading",
        ]
        return pd.DataFrame(list(self.rows(judged=True)), columns=columns).set_index("id")

    def save(self, notebook: str) -> pd.DataFrame:
        """Write the findings to ``build/ledger/<notebook>.json`` and return them as a table."""
        found = {id_: asdict(self.findings[id_]) for id_ in self.claims if id_ in self.findings}
        text = json.dumps(found, indent=1, ensure_ascii=False)
        write_whole(build_folder() / "ledger" / f"{notebook}.json", text + "\n")
        return self.table()

    @classmethod
    def collect(
        cls, folder: str | Path | None = None, *, fall_back: bool = False, claims: str | Path | None = None
    ) -> Ledger:
        """Join what the notebooks have saved.

        Parameters
        ----------
        folder : path, optional
            Where the parts lie, by default ``build/ledger``.
        fall_back : bool
            Show the accepted verdict where a claim's notebook has not run here.
        claims : path, optional
            As for :class:`Ledger`.

        Raises
        ------
        ValueError
            If two notebooks give one claim different verdicts, or a part cannot be read.
        """
        ledger = cls(claims)
        for part in sorted(Path(folder or build_folder() / "ledger").glob("*.json")):
            for id_, found in json.loads(part.read_text(encoding="utf-8")).items():
                finding = Finding(**found)
                said = ". ".join(filter(None, [f"Notebook {part.stem}", finding.evidence]))
                ledger._enter(id_, finding.verdict, finding.ours, finding.uncertainty, finding.reading, said)
        if fall_back:
            for id_, verdict in accepted_verdicts().items():
                if id_ not in ledger.findings and verdict != "pending":
                    ledger._enter(id_, verdict, None, None, "", "accepted verdict; its notebook has not run here")
        return ledger

    def to_csv(self) -> str:
        """Return the whole ledger as CSV text, one row per claim."""
        return _csv(COLUMNS, self.rows())

    def to_html(self) -> str:
        """Return the whole ledger as a page of its own that asks for nothing from outside."""
        counts = Counter(self.verdicts().values())
        key = "".join(
            f'<tr><td class="{verdict}">{verdict}</td><td>{counts[verdict]}</td><td>{escape(meaning)}</td></tr>'
            for verdict, meaning in VERDICTS.items()
        )
        head = "".join(f"<th>{name}</th>" for name in COLUMNS)
        body = "\n".join(_html_row(row) for row in self.rows())
        return _PAGE.format(key=key, head=head, body=body, total=len(self.claims))

    def summary(self, verdict: str | None = None) -> str:
        """Return one line per claim, or per claim of one verdict, and how many there are of each, as text."""
        rows = [row for row in self.rows() if verdict in (None, row["verdict"])]
        lines = [
            f"{row['id']:<12} {row['verdict']:<11} {row['quantity']}: {row['relation']} {row['claimed']} {row['unit']}"
            + f", ours {row['ours']}" * bool(row["ours"])
            for row in rows
        ]
        counts = Counter(row["verdict"] for row in rows)
        return "\n".join([*lines, "", ", ".join(f"{counts[name]} {name}" for name in VERDICTS if counts[name])])

    def _claim(self, id_: str) -> Claim:
        if id_ not in self.claims:
            raise ValueError(f"no claim {id_!r}; ids run from {next(iter(self.claims))} to {list(self.claims)[-1]}")
        return self.claims[id_]

    def _enter(
        self,
        id_: str,
        verdict: str,
        ours: float | str | None,
        uncertainty: float | str | None,
        reading: str,
        evidence: str,
    ) -> Finding:
        self._claim(id_)
        finding = Finding(choice("verdict", verdict, VERDICTS), _text(ours), _text(uncertainty, 2), reading, evidence)
        before = self.findings.get(id_, finding)
        if before.verdict != verdict:
            raise ValueError(f"{id_} is judged twice: {before.verdict}, then {verdict}")
        self.findings[id_] = finding
        return finding


def accepted_verdicts() -> dict[str, str]:
    """Return the verdicts of ``data/verdicts.csv`` by id: what a reproduction is compared with."""
    with data_file("verdicts.csv").open(encoding="utf-8", newline="") as file:
        return {row["id"]: row["verdict"] for row in csv.DictReader(file)}


def accept(verdicts: Mapping[str, str]) -> None:
    """Rewrite ``data/verdicts.csv`` with these verdicts."""
    rows = ({"id": id_, "verdict": verdict} for id_, verdict in verdicts.items())
    write_whole(data_file("verdicts.csv"), _csv(("id", "verdict"), rows))


def _meet(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return a[0] <= b[1] and b[0] <= a[1]


def _text(value: float | np.bool_ | str | None, digits: int = 6) -> str:
    """Six digits: enough for every print, too few for the noise of another BLAS to show."""
    if isinstance(value, bool | np.bool_):
        return str(bool(value)).lower()
    if value is None or isinstance(value, str):
        return value or ""
    return f"{float(value):.{digits}g}"


def _csv(columns: Iterable[str], rows: Iterable[Mapping[str, str]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _html_row(row: Mapping[str, str]) -> str:
    classes = {**{column: column for column in COLUMNS}, "verdict": row["verdict"]}
    cells = "".join(f'<td class="{classes[column]}">{escape(row[column])}</td>' for column in COLUMNS)
    return f'<tr id="{row["id"]}">{cells}</tr>'


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>losbench: ledger of claims</title><style>
body {{ font: 15px/1.45 system-ui, sans-serif; margin: 2rem; color: #222; background: #fff }}
table {{ border-collapse: collapse; margin: 1rem 0 }}
th, td {{ text-align: left; vertical-align: top; padding: .3rem .6rem; border-bottom: 1px solid #ddd }}
th {{ position: sticky; top: 0; background: #f4f4f4 }}
.claimed, .ours, .uncertainty {{ text-align: right; font-variant-numeric: tabular-nums }}
.evidence, .reading {{ min-width: 16rem }}
.reproduced {{ background: #d6efe5 }} .differs {{ background: #fbe3c0 }} .impossible {{ background: #f6d3c2 }}
.calibrated {{ background: #d8ebf8 }} .untestable, .pending {{ background: #ececec }}
</style></head><body>
<h1>Ledger of claims</h1>
<p>{total} printed numbers and statements of three papers, each with our value and a verdict computed by rule.</p>
<table><tr><th>verdict</th><th>claims</th><th>meaning</th></tr>{key}</table>
<table><tr>{head}</tr>
{body}
</table></body></html>
"""
