"""What a chunk of frames has cost its worker: bytes and memory, where the system tells."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

__all__ = ["Effort", "with_effort"]

Result = TypeVar("Result")


@dataclass(frozen=True)
class Effort:
    """Bytes read and the most memory that the process has had; zero where the system tells none."""

    bytes_read: int
    memory_bytes: int

    def and_then(self, other: Effort) -> Effort:
        """Return that of both."""
        return Effort(
            self.bytes_read + other.bytes_read, max(self.memory_bytes, other.memory_bytes)
        )

    def __str__(self) -> str:
        """Return it in words.

        >>> str(Effort(3_200_000_000, 139_000_000))
        '3.2 GB read, 139 MB memory'
        """
        return f"{self.bytes_read / 1e9:.1f} GB read, {self.memory_bytes / 1e6:.0f} MB memory"


def with_effort(work: Callable[..., Result], *job: Any) -> tuple[Result, Effort]:
    """Return ``work(*job)`` and what it cost."""
    before = _read_so_far()
    result = work(*job)
    return result, Effort(_read_so_far() - before, _most_memory())


def _read_so_far() -> int:
    """Bytes that this thread has read; Linux tells."""
    with suppress(OSError, ValueError):
        lines = Path("/proc/thread-self/io").read_text().splitlines()
        return int(next(line for line in lines if line.startswith("rchar")).split()[1])
    return 0


def _most_memory() -> int:
    if sys.platform == "win32":
        return 0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else 1024 * peak)
