"""How a smeared star is measured: each method an object, found by name in one table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

from losbench.arrays import Bools
from losbench.imaging.detector import Detector
from losbench.imaging.smeared.model import StreakModel
from losbench.imaging.smeared.solvers import Region, Solution, Stop, iterate, least_squares
from losbench.imaging.smeared.windows import Windows

__all__ = ["METHODS", "NARROWEST", "Joint", "MethodName", "Recipe", "Single"]

MethodName = Literal["iterative", "closed_form", "least_squares", "joint"]

NARROWEST = 0.25  # pixels; the iteration for a star at rest contracts above a width of 0.1995 only
_DAMPING = 0.5


@dataclass(frozen=True)
class Recipe:
    """How to measure; the same for all stars of a call."""

    method: Single | Joint
    epoch: int
    detector: Detector | None
    threshold: float | None
    own_region: bool
    stop: Stop


class Single(Protocol):
    """A method for each star on its own."""

    block: ClassVar[int]  # stars at a time: what the method makes of them fits the cache
    slow_if_narrow: ClassVar[bool]  # whether a width below NARROWEST is to be flagged

    def refined(
        self,
        streaks: Callable[[], StreakModel],
        data: Windows,
        how: Recipe,
        first: Solution,
        read: Bools,
    ) -> Solution:
        """Start from the closed form and do better; ``streaks`` makes the model of the stars,
        ``read`` (M, h, w) are the pixels below full scale.
        """


@dataclass(frozen=True)
class ClosedForm:
    """The measured centre, taken back along the path: nothing to refine."""

    block: ClassVar[int] = 1024
    slow_if_narrow: ClassVar[bool] = False

    def refined(
        self,
        streaks: Callable[[], StreakModel],
        data: Windows,
        how: Recipe,
        first: Solution,
        read: Bools,
    ) -> Solution:
        """Return the closed form."""
        return first


@dataclass(frozen=True)
class Iterative:
    """lyu2015, section 1.3."""

    block: ClassVar[int] = 256
    slow_if_narrow: ClassVar[bool] = True

    def refined(
        self,
        streaks: Callable[[], StreakModel],
        data: Windows,
        how: Recipe,
        first: Solution,
        read: Bools,
    ) -> Solution:
        """Move the position until the centres of data and model agree."""
        model = streaks()
        region = (
            Region(read, how.threshold)
            if how.own_region and how.threshold is not None
            else Region(data.used)
        )
        narrow = model.sigma.min() < NARROWEST
        found = iterate(model, data, region, how.stop, first, damping=_DAMPING if narrow else 1.0)
        # What follows the star poorly: a spot inside one pixel, a spot whose core is missing.
        poor = (narrow & ~found.converged) | data.saturated
        if not poor.any():
            return found
        polished = least_squares(model, data, how.stop, found)
        return found.where(~(poor & polished.converged), polished)


@dataclass(frozen=True)
class PixelFit:
    """Least squares on the pixels; lyu2015, eq. (11)-(12)."""

    block: ClassVar[int] = 128
    slow_if_narrow: ClassVar[bool] = False

    def refined(
        self,
        streaks: Callable[[], StreakModel],
        data: Windows,
        how: Recipe,
        first: Solution,
        read: Bools,
    ) -> Solution:
        """Fit position and flux."""
        return least_squares(streaks(), data, how.stop, first)


@dataclass(frozen=True)
class Joint:
    """All stars of an image at once, from where they are predicted."""

    block: ClassVar[int] = 128
    slow_if_narrow: ClassVar[bool] = False


METHODS: dict[str, Single | Joint] = {
    "iterative": Iterative(),
    "closed_form": ClosedForm(),
    "least_squares": PixelFit(),
    "joint": Joint(),
}
