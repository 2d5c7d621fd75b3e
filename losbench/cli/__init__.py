"""The command line: ``losbench reproduce | measure | simulate | drift | ledger``.

Exit codes: 0 done; 1 a notebook failed, or a verdict is not the accepted one; 2 wrong arguments or
unusable input, said in one line; 130 interrupted; 141 whoever reads the output has gone.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress

from losbench.__about__ import __version__
from losbench.cli import drift, ledger, measure, reproduce, simulate

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: print(
                f"losbench {options.command}: {message}", file=sys.stderr
            )
            code = int(options.run(options))
            sys.stdout.flush()
            return code
    except BrokenPipeError:
        _hush()
        return 141
    except (ValueError, OSError, ImportError) as error:
        print(f"losbench {options.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"losbench {options.command}: interrupted", file=sys.stderr)
        return 130


def _hush() -> None:
    """Send what is left to say nowhere: the interpreter would complain when it flushes a closed
    pipe at its end.
    """
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="losbench",
        description=(
            "Where a space camera really points: reproduce the papers, or measure your own frames."
        ),
    )
    parser.add_argument("--version", action="version", version=f"losbench {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    quiet = argparse.ArgumentParser(add_help=False)
    quiet.add_argument(
        "--quiet",
        action="store_true",
        help="no progress bars, no report; errors and exit code only",
    )
    for command in (reproduce, measure, simulate, drift, ledger):
        command.add(commands, quiet)
    return parser
