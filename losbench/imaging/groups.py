"""The spots of a call by the size of their windows: those of one size are measured together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats, Indices, Ints
from losbench.imaging.background import Background
from losbench.imaging.detector import Detector
from losbench.imaging.engine import Engine
from losbench.imaging.noise import Gain
from losbench.imaging.places import in_frame, peak_pixels
from losbench.imaging.protocols import CentroidMethod
from losbench.imaging.results import Measured
from losbench.imaging.stamps import RING

__all__ = ["Group", "grouped", "in_order"]


_BLOCK_PIXELS = 500_000  # of one block of stamps: some 1100 spots of six sigma stay in the cache


@dataclass(frozen=True)
class Group:
    """Spots whose windows are of one size.

    Attributes
    ----------
    engine : Engine
        What holds for all of them.
    numbers : (m,) array of int
        Which spots of the call they are.
    at : (F, m, 2) array, pixels
        Where their windows are first put.
    frame, spot : (M,) arrays of int
        Of the M windows that lie in their frames: frame, and which of the group.
    middle : (M, 2) array of int, pixels
        The pixel that holds the place.
    """

    engine: Engine
    numbers: Indices
    at: Floats
    frame: Indices
    spot: Indices
    middle: Indices

    def of(self, **fields: Any) -> Group:
        """Return the same spots with other fields of the engine."""
        return replace(self, engine=replace(self.engine, **fields))

    def put(self, stack: NDArray[Any], at: Floats) -> Group:
        """Return as many spots with windows at other places (F, m, 2), in frames of their own."""
        frame, spot, middle = in_frame(stack, at)
        return replace(self, at=at, frame=frame, spot=spot, middle=middle)

    def measure(self, stack: NDArray[Any], width: Floats, result: Measured) -> None:
        """Measure all, with templates of their width (m, 2), and put them into the result."""
        pixels = len(self.frame) * (self.engine.ring + 2 * RING) ** 2
        # Alike in size: a block of a few spots that are left over takes half the time of a whole.
        blocks = max(1, round(pixels / _BLOCK_PIXELS))
        ends = len(self.frame) * np.arange(blocks + 1) // blocks
        for begin, end in pairwise(ends.tolist()):
            frame, spot = self.frame[begin:end], self.spot[begin:end]
            number = self.numbers[spot]
            part = self.engine.measure(
                stack,
                frame,
                self.middle[begin:end],
                self.at[frame, spot],
                width=width[spot],
                spot=number,
            )
            result.put((frame, number), part)


def in_order(groups: Sequence[Group], parts: Sequence[Floats]) -> Floats:
    """What each group has for its spots (m, ...), in the order of the call (n, ...)."""
    together = np.empty((sum(len(part) for part in parts), *parts[0].shape[1:]))
    for group, part in zip(groups, parts, strict=True):
        together[group.numbers] = part
    return together


def grouped(
    stack: NDArray[Any],
    places: Floats,
    sides: Ints,
    method: CentroidMethod,
    background: Background,
    noise: Detector | Gain | None,
    full_scale_dn: float | None,
) -> list[Group]:
    """Group the spots at (F, n, 2) of frames (F, H, W) by the side (n,) of their windows.

    Raises
    ------
    ValueError
        As `Engine.of_stack`.
    """
    groups, on_peak = [], (method.centre or ("peak" if method.stays else "start")) == "peak"
    for side in sorted({*sides.tolist()}):
        numbers = np.flatnonzero(sides == side)
        engine = Engine.of_stack(stack, method, background, side, noise, full_scale_dn)
        at = places[:, numbers]
        if on_peak:
            at = peak_pixels(stack, at, max(2, side // 4))
        groups.append(Group(engine, numbers, at, *in_frame(stack, at)))
    return groups
