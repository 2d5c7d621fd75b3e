"""``losbench reproduce``: run the notebooks."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "reproduce", parents=[quiet], help="run the notebooks: every figure, table and verdict"
    )
    parser.add_argument(
        "select", nargs="*", metavar="NN", help="numbers of notebooks, e.g. 3 90; default all"
    )
    parser.add_argument("--out", type=Path, help="where to write; default the build folder")
    parser.add_argument("--workers", type=int, default=2, help="notebooks at a time (%(default)s)")
    parser.add_argument("--force", action="store_true", help="run unchanged notebooks too")
    parser.add_argument(
        "--accept", action="store_true", help="take the verdicts found as the accepted ones"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.workbench.reproduction.reproduce import reproduce

    done = reproduce(
        options.select,
        workers=options.workers,
        out=options.out,
        force=options.force,
        accept_verdicts=options.accept,
        quiet=options.quiet,
    )
    if not (done.ok and options.quiet):
        print(done.summary())
    return 0 if done.ok else 1
