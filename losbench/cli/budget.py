"""``losbench budget``: a pointing budget after ECSS-E-ST-60-10C."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from losbench.cli.arguments import Commands, publishing

__all__ = ["add"]

_WRITTEN = ("budget.csv", "contributions.csv")
_FILE = """\
budget, TOML, arcseconds throughout:
    [[requirement]]
    id = "APE-1"
    index = "APE"              # APE, MPE, RPE, PDE or PRE
    limit = [30.0, 20.0, 20.0] # or one number
    factor = 2                 # or probability = 0.95
    [[source]]
    name = "star sensor noise"
    kind = "noise"             # noise, uniform noise, fast sine, slow sine, bias
    exactly = [3.0, 3.0, 9.0]  # or gaussian = [mean, sigma], uniform = [from, to]; a pair per axis
    [[source]]
    name = "launch"
    [[source.source]]          # a source made of sources
    name = "release of gravity"
    kind = "bias"
    uniform = [-4.0, 4.0]
"""


def add(commands: Commands, quiet: argparse.ArgumentParser) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "budget",
        parents=[quiet],
        help="sum a pointing budget and judge its requirements",
        epilog=_FILE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("budget", type=Path, help="TOML file, see below")
    parser.add_argument("--out", type=Path, help="folder for budget.csv and contributions.csv")
    parser.add_argument(
        "--force", action="store_true", help="write into an existing folder that is not empty"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from losbench.pointing.performance import PointingBudget

    with publishing(options, [options.budget], _WRITTEN) as publish:
        budget = PointingBudget.from_toml(options.budget)
        table, parts = budget.table(), budget.contributions()
        style: Any = {"index": False, "lineterminator": "\n", "float_format": "%.9g"}
        publish(dict(zip(_WRITTEN, (table.to_csv(**style), parts.to_csv(**style)), strict=True)))
    if not options.quiet:
        print(table.round(3).to_string(index=False))
    return 0
