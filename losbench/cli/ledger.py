"""``losbench ledger``: the claims and their verdicts."""

from __future__ import annotations

import argparse

from losbench.cli.arguments import Commands

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "ledger", parents=[quiet], help="show the claims and their verdicts"
    )
    parser.add_argument("--paper", help="one paper only, e.g. liu2026")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.workbench.ledger.verdicts import Ledger

    rows = [
        row
        for row in Ledger.collect(fall_back=True).rows()
        if options.paper in (None, row["paper"])
    ]
    if not rows:
        raise ValueError(f"--paper must be one of liu2026, lyu2015, ren2023, got {options.paper!r}")
    for row in rows:
        claimed = f"{row['relation']} {row['claimed']} {row['unit']}".strip()
        ours = (
            f"ours {row['ours']}"
            if row["ours"]
            else "accepted, not run here" * row["evidence"].startswith("accepted")
        )
        print(f"{row['id']:<12} {row['verdict']:<12} {claimed:<18} {ours:<20} {row['quantity']}")
    return 0
