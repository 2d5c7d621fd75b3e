"""The command line: ``losbench reproduce | site | measure | simulate | drift | identify | metrics |
budget | ledger | claim | notebooks | exercises``.

Exit codes: 0 done; 1 a notebook failed, or a verdict is not the accepted one; 2 wrong arguments or
unusable input, said in one line; 130 interrupted; 141 whoever reads the output has gone. A defect
of losbench itself ends with Python's traceback.
"""

from __future__ import annotations

import argparse
import dis
import os
import sys
import warnings
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor
from contextlib import suppress

from losbench.__about__ import __version__
from losbench.cli import (
    budget,
    drift,
    exercises,
    identify,
    ledger,
    measure,
    metrics,
    notebooks,
    reproduce,
    simulate,
    site,
)

__all__ = ["is_for_the_user", "main", "parser"]

_RAISE = dis.opmap["RAISE_VARARGS"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = parser().parse_args(arguments)
    options.given = list(sys.argv[1:] if arguments is None else arguments)
    said = f"losbench {options.command}:"
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: print(
                said, _in_one_line(str(message)), file=sys.stderr
            )
            code = int(options.run(options))
            sys.stdout.flush()
            return code
    except BrokenPipeError:
        _hush()
        return 141
    except KeyboardInterrupt as stopped:
        print(said, _with_notes("interrupted", stopped), file=sys.stderr)
        return 130
    except Exception as error:
        if options.debug or not is_for_the_user(error):
            raise
        told = _in_one_line(str(error)) or type(error).__name__
        print(said, _with_notes(told, error), file=sys.stderr)
        return 2


def is_for_the_user(error: Exception) -> bool:
    """Whether an error tells of an argument, a file or the machine, and not of losbench itself: of
    errors of value only those that a check of losbench raised, by a ``raise`` of its own.
    """
    if isinstance(error, OSError | ImportError | MemoryError | BrokenExecutor):
        return True
    if not isinstance(error, ValueError):
        return False
    at = error.__traceback__
    while at is not None and at.tb_next is not None:
        at = at.tb_next
    if at is None:
        return False
    code, module = at.tb_frame.f_code, str(at.tb_frame.f_globals.get("__name__"))
    return module.partition(".")[0] == "losbench" and code.co_code[at.tb_lasti] == _RAISE


def _in_one_line(text: str) -> str:
    return " ".join(text.split())


def _with_notes(told: str, error: BaseException) -> str:
    return "; ".join([told, *(_in_one_line(note) for note in getattr(error, "__notes__", ()))])


def _hush() -> None:
    """Send what is left to say nowhere: the interpreter would complain when it flushes a closed
    pipe at its end.
    """
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    root = argparse.ArgumentParser(
        prog="losbench",
        description=(
            "Where a space camera really points: replicate the papers, or measure your own frames."
        ),
    )
    root.add_argument("--version", action="version", version=f"losbench {__version__}")
    commands = root.add_subparsers(dest="command", required=True, metavar="COMMAND")
    quiet = argparse.ArgumentParser(add_help=False)
    quiet.add_argument(
        "--quiet",
        action="store_true",
        help="no progress bars, no report; errors and exit code only",
    )
    quiet.add_argument(
        "--debug", action="store_true", help="show where an error comes from, with its traceback"
    )
    for command in (
        reproduce,
        site,
        measure,
        simulate,
        drift,
        identify,
        metrics,
        budget,
        ledger,
        notebooks,
        exercises,
    ):
        command.add(commands, quiet)
    ledger.add_claim(commands, quiet)
    return root
