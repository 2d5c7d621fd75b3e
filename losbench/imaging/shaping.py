"""Which windows of a call tell the shapes of its spots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Indices
from losbench.imaging.eiwa import EIWA
from losbench.imaging.empirical import Empirical
from losbench.imaging.groups import Group
from losbench.imaging.places import evenly
from losbench.imaging.protocols import Windows
from losbench.imaging.results import Measured, SpotFlag
from losbench.imaging.shapefit import fit_shape
from losbench.imaging.splines import SpotShape

__all__ = ["shaped"]


_FRAMES = 64
_FEWEST = 10  # windows
_TOGETHER = 256  # windows of spots that share a shape
_WIDEST = 121  # pixels
_READ = 0.85  # of the pixels of a window


def shaped(method: Empirical, groups: Sequence[Group], stack: NDArray[Any]) -> Empirical:
    """Return the method with a shape for each spot of some groups: what it has, or what their
    windows in frames (F, H, W) tell.

    A spot that stands out in ten frames has its own, by up to 64 of them. The others of one size of
    window share one, if they have ten together.

    Raises
    ------
    ValueError
        If there is none for any spot, a window is wider than 121 pixels, or what is given has
        another window or another number of spots.
    """
    count = sum(len(group.numbers) for group in groups)
    if method.shape is not None:
        return _checked(method, groups, count)
    shapes: list[SpotShape | None] = [None] * count
    most = 0
    for group in groups:
        if group.engine.window > _WIDEST:
            raise ValueError(
                f"window must be at most {_WIDEST} pixels for a shape of splines, got "
                f"{group.engine.window}"
            )
        windows, spot = _telling(group, stack)
        own = np.bincount(spot, minlength=len(group.numbers)) >= _FEWEST
        for k in np.flatnonzero(own).tolist():
            shapes[group.numbers[k]] = fit_shape(windows.of(spot == k))
        rest = np.flatnonzero(~own[spot])
        most = max(most, rest.size)
        if rest.size >= _FEWEST:
            shared = fit_shape(windows.of(rest[evenly(rest.size, _TOGETHER)]))
            for number in group.numbers[~own].tolist():
                shapes[number] = shared
    if not any(shapes):
        raise ValueError(
            f"method=Empirical() needs {_FEWEST} windows of one size in which spots stand out, to "
            f"make a shape of, got {most}: give a shape, or take EIWA"
        )
    return replace(method, shape=tuple(shapes))


def _checked(method: Empirical, groups: Sequence[Group], count: int) -> Empirical:
    """Return the method, if its shapes are for these spots and windows."""
    given = method.shape
    shapes = given if isinstance(given, tuple) else (given,) * count
    if len(shapes) != count:
        raise ValueError(f"shape must be one, or one for each of {count} spots, got {len(shapes)}")
    for group in groups:
        for shape in (shapes[k] for k in group.numbers.tolist()):
            if shape is not None and shape.side != group.engine.window:
                raise ValueError(
                    f"shape must be that of windows of {group.engine.window} pixels, got {shape!r}"
                )
    return method


def _telling(group: Group, stack: NDArray[Any]) -> tuple[Windows, Indices]:
    """Windows of a group in up to 64 frames, in which its spots stand out, and whose they are."""
    chosen = evenly(len(stack), _FRAMES)
    some, count = stack[chosen], len(group.numbers)
    look = replace(group, numbers=np.arange(count)).put(some, group.at[chosen])
    seen = Measured.nothing((len(some), count))
    method = EIWA(group.engine.window)
    look.of(method=method).measure(some, np.full((count, 2), np.nan), seen)
    told = np.isfinite(seen.xy).all(axis=-1) & (seen.flags & SpotFlag.NOT_CONVERGED == 0)
    spot, frame = np.nonzero(told.T)
    xy = seen.xy[frame, spot]
    middle = np.rint(xy).astype(np.intp)
    cut = group.engine.cut(some, frame, middle)
    windows = Windows(
        cut.signal,
        group.engine.window,
        xy - middle,
        middle,
        cut.noise,
        np.full_like(xy, np.nan),
        cut.kept,
    )
    if cut.kept is None:
        return windows, spot
    read = cut.kept[:, 1:-1, 1:-1].mean(axis=(1, 2)) >= _READ
    return windows.of(read), spot[read]
