"""Where the shifts of a recording count from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from losbench.arrays import Floats

__all__ = ["Reference", "shifts_from"]


@dataclass(frozen=True)
class Reference:
    """Positions (n, 2) that shifts count from, their errors, and the first frame that gave them."""

    xy_px: Floats
    sigma_px: Floats
    frame: int

    @classmethod
    def first_whole(cls, xy: Floats, sigma: Floats) -> Self:
        """Return the first frame of (F, n, 2) that shows every spot.

        Raises
        ------
        ValueError
            If there is none.
        """
        seen = ~np.isnan(xy[..., 0])
        if not seen.all(axis=1).any():
            lost = np.flatnonzero(~seen.any(axis=0)) + 1
            why = (
                f"spot {lost.tolist()} is in none"
                if lost.size
                else f"all {xy.shape[1]} at once are in none"
            )
            raise ValueError(f"reference must be a frame that shows every spot; {why} of {len(xy)}")
        first = int(np.argmax(seen.all(axis=1)))
        return cls(xy[first].copy(), sigma[first].copy(), first)

    @classmethod
    def mean(cls, xy: Floats, sigma: Floats) -> Self:
        """Return the mean of some frames (F, n, 2).

        Raises
        ------
        ValueError
            If a spot is in none of them.
        """
        count = np.isfinite(xy).sum(axis=0)
        if not count.all():
            lost = np.flatnonzero((count == 0).any(axis=-1)) + 1
            raise ValueError(
                f"reference must hold a frame that shows every spot; spot {lost.tolist()} is in "
                f"none of {len(xy)}"
            )
        return cls(np.nanmean(xy, axis=0), np.sqrt(np.nansum(sigma**2, axis=0)) / count, 0)

    @property
    def notes(self) -> list[str]:
        """Say which frame it is, unless it is the first."""
        said = f"Shifts count from frame {self.frame}, the first that shows every spot."
        return [said] if self.frame else []


def shifts_from(xy: Floats, sigma: Floats, reference: str | int) -> Reference:
    """Return what "first", or the mean of so many frames, stands for."""
    if reference == "first":
        return Reference.first_whole(xy, sigma)
    return Reference.mean(xy[: int(reference)], sigma[: int(reference)])
