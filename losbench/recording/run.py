"""How a recording is worked through, apart from what is measured in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from losbench.checks import boolean, integer

__all__ = ["Run"]


@dataclass(frozen=True, kw_only=True)
class Run:
    """How `measure` works through a recording; the numbers do not depend on it, to the last bit.

    Parameters
    ----------
    executor : optional
        Who measures: None, this process; anything with the ``submit`` or ``map`` of
        concurrent.futures, processes rather than threads; or what a dask client's
        ``get_executor()`` returns, whose workers must see the files by the same path. Frames of an
        array in memory are sent along with every chunk: better save them.
    chunk : int
        Frames handed out at a time, rounded up to what is in memory at a time anyway.
    out : path, optional
        Folder that keeps a part for each chunk that is done, so that a run that was killed goes on.
    resume : bool
        Go on with the parts in ``out``; those of other settings are refused.
    progress : bool
        Show a progress bar where it takes longer than two seconds: frames of all workers, time
        left, bytes read, and memory of the largest worker.

    Raises
    ------
    ValueError
        If the chunk holds no frame.

    Examples
    --------
    >>> Run(chunk=256).out is None
    True
    """

    executor: Any = None
    chunk: int = 64
    out: str | Path | None = None
    resume: bool = False
    progress: bool = False

    def __post_init__(self) -> None:
        integer("chunk", self.chunk, low=1)
        boolean("resume", self.resume)
        boolean("progress", self.progress)
