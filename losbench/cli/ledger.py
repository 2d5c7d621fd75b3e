"""``losbench ledger`` and ``losbench claim``: the claims and their verdicts."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands, made_by

__all__ = ["add", "add_claim"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "ledger", parents=[quiet], help="show the claims and their verdicts"
    )
    parser.add_argument("--paper", help="one paper only, e.g. liu2026")
    parser.set_defaults(run=_run)


def add_claim(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command that recomputes one claim."""
    parser = commands.add_parser(
        "claim", parents=[quiet], help="compute one claim from scratch and show its row"
    )
    parser.add_argument("id", help="e.g. irls-44")
    parser.add_argument("--out", type=Path, help="keep what its notebook writes, here")
    parser.set_defaults(run=_run_claim)


def _run(options: argparse.Namespace) -> int:
    from losbench.workbench.ledger.ledger import Ledger
    from losbench.workbench.ledger.tables import with_accepted

    rows = [
        row
        for row in with_accepted(list(Ledger.collect().rows()))
        if options.paper in (None, row["paper"])
    ]
    if not rows:
        raise ValueError(f"--paper must be one of liu2026, lyu2015, ren2023, got {options.paper!r}")
    for row in rows:
        claimed = f"{row['relation']} {row['claimed']} {row['unit']}".strip()
        ours = "; ".join(
            part
            for part in (
                f"ours {row['ours']}" if row["ours"] else "",
                row["under"],
                f"odds {row['odds']}" if row["odds"] else "",
                "accepted, not run here" * row["reason"].startswith("accepted"),
            )
            if part
        )
        print(f"{row['id']:<12} {row['verdict']:<11} {claimed:<18} {ours:<42} {row['quantity']}")
    return 0


def _run_claim(options: argparse.Namespace) -> int:
    from losbench.workbench.reproduction.claim import recompute

    made = made_by(options, [])
    done = recompute(options.id, out=options.out, quiet=options.quiet, made=made)
    print(done.text())
    return 0 if done.as_accepted else 1
