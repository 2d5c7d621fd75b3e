"""Fits that do not converge: a warning each time, unless somebody counts them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["Tally", "failures_counted", "warn_of_failures"]


class Tally:
    """How many fits have failed since counting began."""

    failed: int = 0


# A context variable, unlike a filter of warnings, is each thread's own.
_COUNTING: ContextVar[Tally | None] = ContextVar("losbench_failures", default=None)


@contextmanager
def failures_counted() -> Iterator[Tally]:
    """Count fits that do not converge, in place of warnings.

    >>> with failures_counted() as tally:
    ...     warn_of_failures(3, "3 of 1000 systems did not converge")
    >>> tally.failed
    3
    """
    tally = Tally()
    before = _COUNTING.set(tally)
    try:
        yield tally
    finally:
        _COUNTING.reset(before)


def warn_of_failures(failed: int, said: str, *, stacklevel: int = 2) -> None:
    """Warn of ``failed`` fits, or add them to whoever counts."""
    tally = _COUNTING.get()
    if tally is None:
        warnings.warn(said, RuntimeWarning, stacklevel=stacklevel + 1)
    else:
        tally.failed += failed
