"""The ledger: every printed number and statement of the papers, under which readings ours meets it,
against which null, and from what.

Notebooks state findings; nobody states a verdict. Classes, odds and dependence are computed when a
row is asked for, so that a rule that changes changes every verdict it should.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from losbench.arrays import Floats
from losbench.checks import boolean
from losbench.resources import build_folder, write_whole
from losbench.workbench.ledger import tables
from losbench.workbench.ledger.claims import (
    Claim,
    read_claims,
)
from losbench.workbench.ledger.entries import (
    Arithmetic,
    Block,
    Conflict,
    Ends,
    Entry,
    Open,
    Question,
    Said,
    Set,
    Statement,
    Value,
    entry_from,
)
from losbench.workbench.ledger.rules import Verdict, holm, verdict_of
from losbench.workbench.ledger.tracking import calibrated_fields

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Ledger", "cell_digest"]

_FORMER = {
    "judge": "value(claim, Value(reading, value, error)) or statement(claim, p, p_null)",
    "impossible": "conflict(name, claims, inequality, slack) or arithmetic(claim, from_, holds)",
    "calibrated": "set(claim, field)",
    "untestable": "open(claim, question)",
}


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
        From any method given an id that is no claim, or a value of the wrong kind.

    Examples
    --------
    >>> ledger = Ledger()
    >>> ledger.value("irls-05", Value({"statistic": "peak"}, 0.557, error=0.02))
    >>> ledger.value("irls-05", Value({"statistic": "sigma"}, 0.138))
    >>> ledger.verdict("irls-05"), ledger.under("irls-05")
    ('agrees', '2 of 2')
    >>> ledger.value("irls-05", Value({"statistic": "twice that"}, 1.1))
    >>> ledger.verdict("irls-05"), ledger.under("irls-05")
    ('depends', '2 of 3')
    """

    def __init__(self, claims: str | Path | None = None) -> None:
        self.claims = read_claims(claims)
        self.entries: list[Entry] = []

    def value(self, claim: str, value: Value) -> None:
        """State our number under one reading; repeat it for each reading that was tried.

        Parameters
        ----------
        claim : str
            Id, e.g. "irls-15".
        value : Value
        """
        one = self._claim(claim)
        truth = isinstance(value.value, bool | np.bool_)
        if truth != (one.relation == "is") and value.printed is None:
            wanted = "True or False, or statement()" if one.relation == "is" else "a number"
            raise ValueError(f"{claim} is '{one.print}': its value must be {wanted}")
        self._say((claim,), value)

    def values(self, table: pd.DataFrame, reading: Mapping[str, str], **about: Any) -> None:
        """State a table of values: columns claim, value, error and perhaps null, null_error, low,
        high (the print in the value's terms) and unit; ``about`` goes to every `Value`.
        """
        for claim, value in _rows(table, reading, about):
            self.value(claim, value)

    def values_at_ends(self, field: str, low: pd.DataFrame, high: pd.DataFrame) -> None:
        """State two tables of values, at both ends of a calibrated field, as `ends` does one."""
        pairs = zip(_rows(low, {}, {}), _rows(high, {}, {}), strict=True)
        for (claim, below), (_, above) in pairs:
            self.ends(claim, field, below, above)

    def statement(
        self,
        claim: str,
        p: float,
        p_null: float | None = None,
        reading: Mapping[str, str] | None = None,
        **about: Any,
    ) -> None:
        """State how often a claim is true: under the twin, and where the method does nothing."""
        if self._claim(claim).relation != "is":
            raise ValueError(f"{claim} is a number, no statement: use value()")
        self._say((claim,), Statement(reading or {}, p, p_null, **about))

    def ends(self, claim: str, field: str, low: Value | Statement, high: Value | Statement) -> None:
        """State the value at both ends of what the paper allows a calibrated field.

        If the verdict turns, the claim hangs on what was set, and is called so.
        """
        self._field(field)
        self._say((self._claim(claim).id,), Ends(field, low, high))

    def allowed(self, field: str) -> tuple[Any, Any]:
        """Return both ends of what the paper allows a calibrated field, to compute them."""
        self._field(field)
        how = calibrated_fields()[field]
        if how.low is None or how.high is None:
            raise ValueError(f"{field} has no range that the paper allows")
        return how.low, how.high

    def arithmetic(
        self, claim: str, from_: Iterable[str], holds: bool | np.bool_, note: str = ""
    ) -> None:
        """State that the paper's own prints decide, and how."""
        prints = tuple(self._claim(one).id for one in from_)
        self._say((self._claim(claim).id,), Arithmetic(prints, boolean("holds", holds), note))

    def open(self, claim: str, question: str, note: str = "") -> None:
        """State that a test lacks something, as a question to the authors."""
        if not question.rstrip().endswith("?"):
            raise ValueError(f"{claim}: question must end with '?', got {question!r}")
        self._say((self._claim(claim).id,), Open(question, note))

    def ask(self, question: str, about: Iterable[str]) -> None:
        """State a question to the authors whose answer would settle claims that have verdicts."""
        if not question.rstrip().endswith("?"):
            raise ValueError(f"question must end with '?', got {question!r}")
        self._say(tuple(self._claim(one).id for one in about), Question(question))

    def set(self, claim: str, field: str) -> None:
        """State that the claim set a field of the twin; the field must name the claim."""
        if self._claim(claim).id not in self._field(field):
            raise ValueError(f"{field} was not set to {claim}, but to {self._field(field)}")
        self._say((claim,), Set(field))

    def block(
        self,
        name: str,
        claims: Iterable[str],
        pull: Floats,
        covariance: Floats | None = None,
        *,
        fitted: int = 0,
        reading: Mapping[str, str] | None = None,
        uses: Iterable[str] = (),
        note: str = "",
    ) -> None:
        """State one test of a whole table or figure.

        Parameters
        ----------
        name : str
            As in the column ``block`` of the claims.
        claims : iterable of str
            Cells of the block.
        pull : (n,) array
            Print less value; over sigma where there is no covariance.
        covariance : (n, n) array, optional
            Of the pulls, rounding included; the unit matrix unless given.
        fitted : int
            Parameters that were fitted to these cells: then they are judged as a block alone.
        reading : mapping
        uses : iterable of str
            Claims whose prints went in.
        note : str
        """
        cells = tuple(self._claim(one).id for one in claims)
        known = {claim.block for claim in self.claims.values()} - {""}
        if name not in known:
            raise ValueError(f"no claim is of block {name!r}; there are {', '.join(sorted(known))}")
        rest = np.asarray(pull, dtype=np.float64)
        spread = np.eye(len(rest)) if covariance is None else np.asarray(covariance)
        if len(rest) <= fitted:
            raise ValueError(f"block {name}: {len(rest)} cells cannot judge {fitted} parameters")
        chi2 = float(rest @ np.linalg.solve(spread, rest))
        pulls = tuple(float(p) for p in rest / np.sqrt(np.diag(spread)))
        self._say(
            cells, Block(name, reading or {}, chi2, len(rest), fitted, pulls, tuple(uses), note)
        )

    def conflict(
        self, name: str, claims: Iterable[str], inequality: str, slack: float, unit: str = ""
    ) -> None:
        """State that prints cannot hold together.

        Parameters
        ----------
        name : str
            E.g. "K4".
        claims : iterable of str
            The prints.
        inequality : str
            What would have to hold.
        slack : float
            Its right side less its left, every print rounded to its favour: negative.
        unit : str
            Of the slack.

        Raises
        ------
        ValueError
            If the slack is not negative: then they can.
        """
        cells = tuple(self._claim(one).id for one in claims)
        if not slack < 0.0:
            raise ValueError(f"{name} is no conflict: its slack is {slack:.4g}, not negative")
        self._say(cells, Conflict(name, inequality, float(slack), unit))

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

    def _claim(self, id_: str) -> Claim:
        if id_ not in self.claims:
            raise ValueError(
                f"no claim {id_!r}; ids run from {next(iter(self.claims))} to "
                f"{list(self.claims)[-1]}"
            )
        return self.claims[id_]

    @staticmethod
    def _field(name: str) -> tuple[str, ...]:
        fields = calibrated_fields()
        if name not in fields:
            raise ValueError(
                f"field must be a calibrated one, {', '.join(sorted(fields))}, got {name!r}"
            )
        return fields[name].to

    def _say(self, claims: tuple[str, ...], said: Said) -> None:
        self.entries.append(Entry(claims, said, cell=_cell()))

    def __getattr__(self, name: str) -> NoReturn:
        """Name the successor of a method of the first form."""
        if name in _FORMER:
            raise AttributeError(f"Ledger.{name} is no more: use {_FORMER[name]}")
        raise AttributeError(f"Ledger has no {name!r}")


def _rows(
    table: pd.DataFrame, reading: Mapping[str, str], about: Mapping[str, Any]
) -> Iterator[tuple[str, Value]]:
    for row in table.to_dict("records"):
        yield (
            str(row["claim"]),
            Value(
                reading,
                float(row["value"]),
                float(row["error"]),
                null=float(row["null"]) if "null" in row else None,
                null_error=float(row["null_error"]) if "null_error" in row else None,
                printed=(row["low"], row["high"]) if "low" in row else None,
                unit=row.get("unit", ""),
                **about,
            ),
        )


def _names(tests: Iterable[Block]) -> list[str]:
    return list(dict.fromkeys(b.name for b in tests))


def _cell() -> str:
    """Digest of the notebook cell that is running, by which pages find it; else nothing."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    history = getattr(getattr(shell, "history_manager", None), "input_hist_raw", None)
    return cell_digest(history[-1]) if history else ""


def cell_digest(source: str) -> str:
    """Short name of a cell's source.

    >>> cell_digest("1 + 1 ") == cell_digest("1 + 1")
    True
    """
    return hashlib.sha256(source.strip().encode()).hexdigest()[:12]
