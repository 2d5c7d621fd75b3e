"""How a recording is worked through, apart from what is measured in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tqdm import tqdm

from losbench.checks import boolean, integer

__all__ = ["Run"]


@dataclass(frozen=True, kw_only=True)
class Run:
    """How `measure` works through a recording; the numbers do not depend on it.

    Parameters
    ----------
    block : int
        Frames in memory at a time.
    progress : bool
        Show a progress bar where it takes longer than two seconds.

    Raises
    ------
    ValueError
        If the block holds no frame.

    Examples
    --------
    >>> Run(block=64)
    Run(block=64, progress=False)
    """

    block: int = 32
    progress: bool = False

    def __post_init__(self) -> None:
        integer("block", self.block, low=1)
        boolean("progress", self.progress)

    def bar(self, n_frames: int) -> tqdm[Any]:
        """Return the progress bar for so many frames."""
        return tqdm(total=n_frames, unit="frame", delay=2, disable=not self.progress)
