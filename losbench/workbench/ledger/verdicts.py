"""The ledger: every printed number of the papers, ours beside it, and a verdict that a rule has
computed.

A claim is an interval (the print with its rounding, or one side of an inequality), a result is
another (three sigma about our value), a proof a third (what the paper's own statements or geometry
allow). Verdicts compare intervals.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from losbench.checks import boolean, choice, number
from losbench.resources import build_folder, write_whole
from losbench.workbench.ledger.claims import (
    COLUMNS,
    VERDICTS,
    Claim,
    Finding,
    accepted_verdicts,
    as_csv,
    as_text,
    read_claims,
)
from losbench.workbench.reproduction.pages import ledger_page

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Ledger"]


class Ledger:
    """The claims of the three papers and what was found about them.

    A notebook makes one, states its findings, and closes with :meth:`save`; :meth:`collect` joins
    the notebooks' parts.

    Parameters
    ----------
    claims : path, optional
        A CSV table with the columns of ``data/claims.csv``, which is the default.

    Raises
    ------
    ValueError
        From any method given an id that is no claim, a second verdict other than the first, or a
        value of the wrong kind.

    Examples
    --------
    >>> ledger = Ledger()
    >>> ledger.judge("irls-13", 4.2278, reading="260 mm, 10 um").verdict
    'reproduced'
    >>> ledger.impossible(
    ...     "irls-08", at_least=0.79, proof="Y >= 75/475 Z, and irls-11 wants Z >= 5"
    ... ).verdict
    'impossible'
    >>> ledger.verdicts()["irls-15"]
    'pending'
    """

    def __init__(self, claims: str | Path | None = None) -> None:
        self.claims = read_claims(claims)
        self.findings: dict[str, Finding] = {}

    def judge(
        self,
        claim: str,
        ours: float,
        *,
        uncertainty: float = 0.0,
        reading: str = "",
        evidence: str = "",
    ) -> Finding:
        """Compare our value with the print: ``reproduced`` where the intervals meet, else
        ``differs``.

        Parameters
        ----------
        claim : str
            Id, e.g. "irls-15".
        ours : float, in the claim's unit, or bool
            A bool for the claims whose relation is "is".
        uncertainty : float, same unit
            One-sigma sampling error of our value at the paper's sample size; three of them are
            allowed.
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
            return self._enter(
                claim, "reproduced" if agrees else "differs", ours, None, reading, evidence
            )
        margin = 3.0 * number("uncertainty", uncertainty, low=0.0)
        value = number("ours", ours)
        agrees = _meet(one.interval, (value - margin, value + margin))
        return self._enter(
            claim, "reproduced" if agrees else "differs", value, uncertainty, reading, evidence
        )

    def calibrated(
        self, claim: str, ours: float | None = None, *, reading: str, evidence: str = ""
    ) -> Finding:
        """State that the claim was used to set up the twin or to choose an example: no evidence
        either way.
        """
        return self._enter(claim, "calibrated", ours, None, reading, evidence)

    def untestable(
        self, claim: str, *, reason: str, ours: float | None = None, reading: str = ""
    ) -> Finding:
        """State that the paper does not give what a test would need; our own value may stand beside
        it.
        """
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

        Give the computed bounds of the quantity, or for a claim that is no number the computed
        ``contradiction``.

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
                raise ValueError(
                    f"{claim} is not impossible: the computation does not contradict it"
                )
            return self._enter(claim, "impossible", ours, None, reading, proof)
        if contradiction is not None or (at_least is None and at_most is None):
            raise ValueError(f"{claim} is a number: give at_least or at_most, not contradiction")
        low = -np.inf if at_least is None else number("at_least", at_least)
        high = np.inf if at_most is None else number("at_most", at_most, low=low)
        bound = " and ".join(
            f"{sign} {as_text(b)}"
            for sign, b in ((">=", at_least), ("<=", at_most))
            if b is not None
        )
        if _meet(one.interval, (low, high)):
            stated = f"{one.relation} {one.claimed} {one.unit}"
            raise ValueError(f"{claim} is not impossible: {stated} agrees with the bound {bound}")
        return self._enter(
            claim, "impossible", ours, None, reading, f"bound {bound} {one.unit}: {proof}"
        )

    def verdicts(self) -> dict[str, str]:
        """Return the verdict of every claim by id, ``pending`` where nothing was found yet."""
        return {
            id_: self.findings[id_].verdict if id_ in self.findings else "pending"
            for id_ in self.claims
        }

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
        cls,
        folder: str | Path | None = None,
        *,
        fall_back: bool = False,
        claims: str | Path | None = None,
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
                ledger._enter(
                    id_, finding.verdict, finding.ours, finding.uncertainty, finding.reading, said
                )
        if fall_back:
            for id_, verdict in accepted_verdicts().items():
                if id_ not in ledger.findings and verdict != "pending":
                    ledger._enter(
                        id_,
                        verdict,
                        None,
                        None,
                        "",
                        "accepted verdict; its notebook has not run here",
                    )
        return ledger

    def to_csv(self) -> str:
        """Return the whole ledger as CSV text, one row per claim."""
        return as_csv(COLUMNS, self.rows())

    def to_html(self, pages: Iterable[str] = ()) -> str:
        """Return the whole ledger as a page of its own that asks for nothing from outside.

        Parameters
        ----------
        pages : iterable of str
            Names of the notebooks that have a page in the folder ``html`` beside this one, e.g.
            "03-monte-carlo": the claims that they judge link to them.
        """
        return ledger_page(list(self.rows()), pages)

    def _claim(self, id_: str) -> Claim:
        if id_ not in self.claims:
            raise ValueError(
                f"no claim {id_!r}; ids run from {next(iter(self.claims))} to "
                f"{list(self.claims)[-1]}"
            )
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
        finding = Finding(
            choice("verdict", verdict, VERDICTS),
            as_text(ours),
            as_text(uncertainty, 2),
            reading,
            evidence,
        )
        before = self.findings.get(id_, finding)
        if before.verdict != verdict:
            raise ValueError(f"{id_} is judged twice: {before.verdict}, then {verdict}")
        self.findings[id_] = finding
        return finding


def _meet(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return a[0] <= b[1] and b[0] <= a[1]
