"""The ledger: every printed number and statement of the papers, under which readings ours meets it,
against which null, and from what.

Notebooks state findings; nobody states a verdict. Classes, odds and dependence are computed when a
row is asked for, so that a rule that changes changes every verdict it should.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, NoReturn

from losbench.resources import build_folder, write_whole
from losbench.workbench.ledger import tables
from losbench.workbench.ledger.entries import Block, Said, entry_from
from losbench.workbench.ledger.findings import Findings
from losbench.workbench.ledger.rules import Verdict, holm, verdict_of
from losbench.workbench.ledger.tracking import calibrated_fields

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Ledger"]

_FORMER = {
    "judge": "value(claim, Value(reading, value, error)) or statement(claim, p, p_null)",
    "impossible": "conflict(name, claims, inequality, slack) or arithmetic(claim, from_, holds)",
    "calibrated": "set(claim, field)",
    "untestable": "open(claim, question)",
}


class Ledger(Findings):
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
        From any method given an id that is no claim, or a value of the wrong kind.

    Examples
    --------
    >>> from losbench.workbench.ledger.entries import Value
    >>> ledger = Ledger()
    >>> ledger.value("irls-05", Value({"statistic": "peak"}, 0.557, error=0.02))
    >>> ledger.value("irls-05", Value({"statistic": "sigma"}, 0.138))
    >>> ledger.verdict("irls-05"), ledger.under("irls-05")
    ('agrees', '2 of 2')
    >>> ledger.value("irls-05", Value({"statistic": "twice that"}, 1.1))
    >>> ledger.verdict("irls-05"), ledger.under("irls-05")
    ('depends', '2 of 3')
    """

    def judged(self) -> dict[str, Verdict]:
        """Return the verdict of every claim by id, as the rules have it now."""
        tests = [e.said for e in self.entries if isinstance(e.said, Block)]
        best = {name: max(b.p_value for b in tests if b.name == name) for name in _names(tests)}
        count = len({claim.block for claim in self.claims.values()} - {""})
        levels, order = holm(best, count), list(self.claims)
        said: dict[str, list[Said]] = {id_: [] for id_ in order}
        for entry in self.entries:
            for id_ in entry.claims:
                said[id_].append(entry.said)
        return {
            id_: verdict_of(
                claim, said[id_], levels=levels, fields=calibrated_fields(), order=order
            )
            for id_, claim in self.claims.items()
        }

    def verdict(self, claim: str) -> str:
        """Return the class of a claim."""
        return self.judged()[self._claim(claim).id].verdict

    def under(self, claim: str) -> str:
        """Return under how many of the readings tried the print stands, e.g. "3 of 5"."""
        return self.judged()[self._claim(claim).id].under

    def odds(self, claim: str) -> float | None:
        """Return the odds of the print, ours over the null's, or None where there is no null."""
        return self.judged()[self._claim(claim).id].odds

    def depends_on(self, claim: str) -> tuple[str, ...]:
        """Return the claims that a verdict rests on."""
        return self.judged()[self._claim(claim).id].depends_on

    def verdicts(self) -> dict[str, str]:
        """Return the class of every claim by id, ``pending`` where nothing was found yet."""
        return {id_: found.verdict for id_, found in self.judged().items()}

    @property
    def examined(self) -> list[str]:
        """Claims of which anything was said that a verdict can rest on."""
        return [id_ for id_, verdict in self.verdicts().items() if verdict != "pending"]

    def rows(self, *, examined: bool = False) -> Iterator[dict[str, str]]:
        """Yield every claim, or only those examined, as a row of the printed ledger."""
        for row in tables.rows(self.claims, self.judged(), self.entries):
            if not examined or row["verdict"] != "pending":
                yield row

    def table(self) -> pd.DataFrame:
        """Return the examined claims as a DataFrame indexed by id, to close a notebook with."""
        import pandas as pd

        columns = ["verdict", "under", "ours", "odds", "conflicts", "depends_on", "reason"]
        rows = [
            {"id": row["id"], "quantity": row["quantity"], "print": self.claims[row["id"]].print}
            | {name: row[name] for name in columns}
            for row in self.rows(examined=True)
        ]
        return pd.DataFrame(rows, columns=["id", "quantity", "print", *columns]).set_index("id")

    def figure(self, paper: str, figure: str) -> str:
        """Return what stands below a figure of a paper, as wide as it: the claims read off it.

        >>> Ledger().figure("lyu2015", "Fig. 6")
        'lyu2015, Fig. 6: claims inertial-20, inertial-21'
        """
        place = re.compile(rf"{re.escape(figure)}(?!\d)")
        ids = [c.id for c in self.claims.values() if c.paper == paper and place.search(c.where)]
        said = f"claims {', '.join(ids)}" if ids else "no number of its own"
        return fill(f"{paper}, {figure}: {said}", 80, break_on_hyphens=False)

    def conflicts(self) -> pd.DataFrame:
        """Return the sets of prints that cannot hold together."""
        return tables.conflicts(self.entries, list(self.claims))

    def blocks(self) -> pd.DataFrame:
        """Return the tests of whole tables and figures, reading by reading."""
        return tables.blocks(self.entries)

    def questions(self) -> dict[str, tuple[str, ...]]:
        """Return the questions to the authors, with the claims that they would settle."""
        return tables.questions(self.entries)

    def save(self, notebook: str) -> pd.DataFrame:
        """Write the findings to ``build/ledger/<notebook>.json`` and return them as a table.

        Raises
        ------
        ValueError
            If a claim belongs to another notebook, by the column of the claims.
        """
        strays = sorted(
            id_
            for id_ in self.examined
            if self.claims[id_].notebook and self.claims[id_].notebook != notebook
        )
        if strays:
            raise ValueError(
                f"{', '.join(strays)} must be examined by notebook "
                f"{self.claims[strays[0]].notebook}, got {notebook}"
            )
        text = json.dumps(
            [entry.as_record() for entry in self.entries], indent=1, ensure_ascii=False
        )
        write_whole(build_folder() / "ledger" / f"{notebook}.json", text + "\n")
        return self.table()

    @classmethod
    def collect(
        cls, folder: str | Path | None = None, *, claims: str | Path | None = None
    ) -> Ledger:
        """Join what the notebooks have saved.

        Parameters
        ----------
        folder : path, optional
            Where the parts lie, by default ``build/ledger``.
        claims : path, optional
            As for :class:`Ledger`.

        Raises
        ------
        ValueError
            If a part cannot be read, or names a claim that does not exist.
        """
        ledger = cls(claims)
        for part in sorted(Path(folder or build_folder() / "ledger").glob("*.json")):
            records = json.loads(part.read_text(encoding="utf-8"))
            if not isinstance(records, list):
                raise ValueError(f"{part} is of an earlier form: run its notebook again")
            for record in records:
                entry = entry_from(record, part.stem)
                for id_ in entry.claims:
                    ledger._claim(id_)
                ledger.entries.append(entry)
        return ledger

    def __getattr__(self, name: str) -> NoReturn:
        """Name the successor of a method of the first form."""
        if name in _FORMER:
            raise AttributeError(f"Ledger.{name} is no more: use {_FORMER[name]}")
        raise AttributeError(f"Ledger has no {name!r}")


def _names(tests: Iterable[Block]) -> list[str]:
    return list(dict.fromkeys(b.name for b in tests))
