"""``losbench site``: build the site of what the notebooks have written."""

from __future__ import annotations

import argparse
from pathlib import Path

from losbench.cli.arguments import Commands

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "site", parents=[quiet], help="build the pages of the last run, without running anything"
    )
    parser.add_argument("--out", type=Path, help="folder of the run; default the build folder")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.outputs import locked
    from losbench.resources import build_folder
    from losbench.workbench.reproduction.site import build_site

    folder = Path(options.out or build_folder()).resolve()
    with locked(folder):
        first = build_site(out=folder)
    if not options.quiet:
        print(f"Open {first}")
    return 0
