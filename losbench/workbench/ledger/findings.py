"""What a notebook states of claims: values, statements, tests of whole tables, sets, questions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from losbench.arrays import Floats
from losbench.checks import boolean
from losbench.workbench.ledger.cells import running_cell
from losbench.workbench.ledger.claims import Claim, read_claims
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
)
from losbench.workbench.ledger.tracking import calibrated_fields

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Findings"]


class Findings:
    """Entries about the claims of a table; every method adds one, and none holds a verdict."""

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
        self.entries.append(Entry(claims, said, cell=running_cell()))


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
