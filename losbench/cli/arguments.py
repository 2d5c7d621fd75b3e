"""What every command of the command line is made with."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from losbench.made import Made
    from losbench.tables.dialect import DialectOptions

__all__ = ["Commands", "add_dialect", "dialect_options", "made_by", "pairs", "publishing"]

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"  # noqa: SLF001 - its only name

_NO_SETTINGS = ("command", "debug", "given", "json", "quiet", "run")


def add_dialect(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how CSV files are written, where they leave it open."""
    group = parser.add_argument_group("how the CSV files are written, where they leave it open")
    group.add_argument("--delimiter", metavar="C", help="one character, tab or space")
    group.add_argument("--decimal", choices=[",", "."], help="what 18,000 means")
    group.add_argument("--encoding", metavar="NAME", help="e.g. gbk")
    group.add_argument(
        "--date-order", choices=["dmy", "mdy", "ymd"], help="how 03/04/2026 is meant"
    )
    group.add_argument(
        "--utc-offset",
        metavar="HOURS|ZONE",
        help="of times without an offset: 1, +05:30 or Europe/Berlin; else they are taken as UTC",
    )
    group.add_argument(
        "--sentinel",
        action="append",
        type=float,
        default=[],
        metavar="X",
        help="a number that stands for no reading",
    )
    group.add_argument(
        "--unit",
        action="append",
        default=[],
        metavar="COLUMN=UNIT",
        help="unit of a column whose name does not tell: degC, degF, K, s, ms ...",
    )


def dialect_options(options: argparse.Namespace) -> DialectOptions:
    """Return what `add_dialect` took as the keywords of a reading function."""
    return {
        "delimiter": options.delimiter,
        "decimal": options.decimal,
        "encoding": options.encoding,
        "date_order": options.date_order,
        "utc_offset": options.utc_offset,
        "sentinel": tuple(options.sentinel),
        "unit": pairs(options.unit, "--unit must be COLUMN=UNIT, e.g. T1=degF"),
    }


def made_by(options: argparse.Namespace, inputs: Iterable[str | Path]) -> Made:
    """Return how the results of a command are made, with a look at what it reads."""
    from losbench.made import Made

    settings = {name: value for name, value in vars(options).items() if name not in _NO_SETTINGS}
    return Made.by(shlex.join(["losbench", *options.given]), settings, inputs)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option of `tell`."""
    parser.add_argument(
        "--json", action="store_true", help="print report.json, and all that is said to stderr"
    )


def tell(options: argparse.Namespace, text: str) -> None:
    """Say what came of a command, or with ``--json`` print its report for a program to read."""
    if options.json:
        print((options.out / "report.json").read_text(encoding="utf-8"), end="")
    if not options.quiet:
        print(text, file=sys.stderr if options.json else sys.stdout)


@contextmanager
def publishing(
    options: argparse.Namespace, inputs: Iterable[str | Path], writes: Iterable[str]
) -> Iterator[Callable[[Mapping[str, str]], None]]:
    """Claim the folder ``--out``, if it is given, and yield what writes files to it and their
    report.
    """
    from losbench.made import head_of
    from losbench.outputs import claim

    if options.out is None:
        yield lambda _: None
        return
    inputs = list(inputs)
    with claim(options.out, inputs=inputs, writes=writes, force=options.force) as results:
        made = made_by(options, inputs)

        def publish(files: Mapping[str, str]) -> None:
            for name, content in files.items():
                results.write(name, content)
            results.publish(head_of(options.command, made))

        yield publish


def pairs(given: list[str], expected: str) -> dict[str, str]:
    """Split NAME=VALUE at its last equals sign; ``ValueError`` says what was expected."""
    for pair in given:
        if "=" not in pair:
            raise ValueError(f"{expected}, got {pair!r}")
    return dict(pair.rsplit("=", 1) for pair in given)
