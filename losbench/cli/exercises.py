"""``losbench exercises mark``: mark notebooks of exercises by hidden seeds."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "exercises", parents=[quiet], help="mark notebooks of exercises by hidden seeds"
    )
    parser.add_argument("action", choices=["mark"], help="runs the code of the notebooks")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="notebooks as handed in")
    parser.add_argument("--seeds", type=int, default=3, help="hidden seeds (%(default)s)")
    parser.add_argument("--first", type=int, help="the first of them; default drawn, and told")
    parser.add_argument("--out", type=Path, default=Path("marks.csv"), help="(%(default)s)")
    parser.add_argument(
        "--seconds", type=float, default=120.0, help="limit for a notebook (%(default)s)"
    )
    parser.add_argument(
        "--memory-mb", type=int, default=4096, help="limit for a notebook (%(default)s)"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    import secrets

    from losbench.checks import integer
    from losbench.resources import write_whole
    from losbench.workbench.exercises.marking import mark_folder
    from losbench.workbench.ledger.claims import as_csv

    count = integer("seeds", options.seeds, low=1)
    first = secrets.randbelow(10**9) if options.first is None else integer("first", options.first)
    limits = {"seconds": options.seconds, "memory_mb": options.memory_mb}
    rows = []
    for mark in mark_folder(options.folder, range(first, first + count), **limits):
        rows.append(mark.row())
        if not options.quiet:
            print(f"{mark.right:6.2f}  {mark.notebook}  {mark.problem}".rstrip())
    write_whole(options.out, as_csv(tuple(rows[0]), rows))
    if not options.quiet:
        print(f"Seeds {first} to {first + count - 1}; marks in {options.out}.")
    return 1 if any(not row["right"] for row in rows) else 0
