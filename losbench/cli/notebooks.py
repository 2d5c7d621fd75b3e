"""``losbench notebooks``: a copy of the notebooks to work in."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from losbench.cli.arguments import Commands

__all__ = ["add"]


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "notebooks", parents=[quiet], help="copy the notebooks to a folder to work in"
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="a new or empty folder")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.resources import notebook_folder

    folder = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise FileExistsError(f"{folder} is not empty: choose another folder")
    for path in sorted(notebook_folder().glob("[0-9]*.ipynb")):
        shutil.copy(path, folder)
    if not options.quiet:
        print(f"Open them: jupyter lab {folder}")
    return 0
