"""One claim, computed from scratch: the notebook that examines it, in an empty folder."""

from __future__ import annotations

import hashlib
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from losbench import outputs
from losbench.made import Made, head_of
from losbench.workbench.ledger.claims import COLUMNS, accepted_verdicts, as_csv, read_claims
from losbench.workbench.ledger.ledger import Ledger
from losbench.workbench.reproduction.reproduce import reproduce

__all__ = ["Recomputed", "recompute"]


@dataclass(frozen=True)
class Recomputed:
    """A row of the ledger that was just computed, and the seconds that its notebook took."""

    row: dict[str, str]
    seconds: float

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the row as CSV: the same for all who compute it alike."""
        return hashlib.sha256(as_csv(COLUMNS, [self.row]).encode()).hexdigest()

    @property
    def as_accepted(self) -> bool:
        """Return whether the verdict is the accepted one."""
        return accepted_verdicts().get(self.row["id"]) == self.row["verdict"]

    def text(self) -> str:
        """Return the row, line by line, then seconds and digest."""
        names = [name for name in COLUMNS if self.row[name]]
        width = max(len(name) for name in (*names, "seconds"))
        lines = [f"{name:<{width}}  {self.row[name]}" for name in names]
        lines += [
            f"{'seconds':<{width}}  {self.seconds:.1f}",
            f"{'sha256':<{width}}  {self.digest}",
        ]
        return "\n".join(lines)


def recompute(
    claim: str,
    *,
    out: str | Path | None = None,
    quiet: bool = False,
    notebooks: str | Path | None = None,
    made: Made | None = None,
) -> Recomputed:
    """Run the notebook of one claim in a folder of its own and return the claim's row.

    Parameters
    ----------
    claim : str
        Id, e.g. "irls-44".
    out : path, optional
        An empty folder that keeps what the notebook writes; by default none does.
    quiet : bool
        No progress bar.
    notebooks : path, optional
        As for `reproduce`.
    made : Made, optional
        The command and its settings, for the ``report.json`` of ``out``.

    Raises
    ------
    ValueError
        If there is no such claim, or its notebook fails.
    """
    claims = read_claims()
    if claim not in claims:
        raise ValueError(
            f"no claim {claim!r}; ids run from {next(iter(claims))} to {list(claims)[-1]}"
        )
    with ExitStack() as stack:
        spare = stack.enter_context(tempfile.TemporaryDirectory(prefix="losbench-claim-"))
        kept = stack.enter_context(outputs.claim(out)) if out else None
        folder = kept.draft if kept else Path(spare)
        done = reproduce(
            [claims[claim].notebook], out=folder, workers=1, quiet=quiet, notebooks=notebooks
        )
        for run in done.runs:
            if run.error:
                raise ValueError(run.error)
        rows = {row["id"]: row for row in Ledger.collect(folder / "ledger").rows()}
        if kept:
            kept.gather()
            head = head_of("claim", made or Made.by(None, {"claim": claim}, []))
            kept.publish({**head, "claim": claim})
    return Recomputed(rows[claim], sum(run.seconds for run in done.runs))
