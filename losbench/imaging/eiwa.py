"""EIWA, a window that moves until it is centred on its own centroid (liu2026, eq. 13-15).

It is the virtual-window centre of mass of Berglund et al. 2008 (Opt. Express 16, 14064). A window
of N x N pixels is centred on the last centroid; its edges fall between pixel borders, and an edge
pixel counts by the fraction that lies inside. The centroid of the window is the next centre, until
it moves no more.

Here M spots move at once. Positions are counted from the middle of each stamp, x first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats
from losbench.checks import choice, integer, number
from losbench.imaging.background import Background, Ring
from losbench.imaging.common import check_fields
from losbench.imaging.engine import Engine
from losbench.imaging.places import as_stack, as_starts, in_frame
from losbench.imaging.protocols import Estimate, Window, Windows
from losbench.imaging.sizes import window_sides
from losbench.imaging.window import NEWTON_LIMIT, Look, WindowFit, look, window_estimate

__all__ = ["EIWA"]


_RING = Ring()
_LONGEST_STEP = 1.0  # pixels
_NEWTON_LEAVES = (
    0.1  # part of a Newton step that may be left after it: the contraction's own change and noise
)


def _newton(step: Floats, ahead: Floats, near: Bools) -> tuple[Floats, Floats, Floats]:
    """A safeguarded step to the fixed point; what is left is what decides."""
    move = np.clip(np.where(near, ahead, step), -_LONGEST_STEP, _LONGEST_STEP)
    left = ahead - move + _NEWTON_LEAVES * ahead
    return move, left, left


def _paper(step: Floats, ahead: Floats, _near: Bools) -> tuple[Floats, Floats, Floats]:
    """The centroid is the next centre, and the step itself decides, eq. (15)."""
    return step, ahead - step, step


@dataclass(frozen=True)
class _Rule:
    """Tolerance in pixels, and ``step(step, ahead, near)``: how far to move, what is then left, and
    what is held against the tolerance, each (M, 2).
    """

    tolerance: float
    step: Callable[[Floats, Floats, Bools], tuple[Floats, Floats, Floats]]


_RULES = {"error": _Rule(1e-3, _newton), "step": _Rule(5e-3, _paper)}


@dataclass(frozen=True)
class EIWA:
    """Move a window until it is centred on its own centroid (liu2026, eq. 13-15).

    It takes a spot of any shape.

    Parameters
    ----------
    window : odd int or (n,) of them, pixels, optional
        Side N of the window, or of that of each spot; see `centroid` for the default.
    stop : "error" or "step"
        "step" is the paper to the letter, eq. (15): replace the centre by the centroid, and stop
        once it moves by less than the tolerance. What is left then is contraction / (1 -
        contraction) times the last step. "error" takes safeguarded Newton steps to the same fixed
        point, step / (1 - contraction), and stops once what is left is below the tolerance. On a
        `Ring`, pixels that stand out of a template are replaced by it, and by what the other side
        of the spot has more than it.
    tolerance : float, pixels, optional
        By default 0.001 for "error" and the paper's 0.005 for "step".
    max_iter : int
        Evaluations of a window before it counts as not converged.
    centre : "start" or "peak", optional
        Where the first window stands: on the start, or on the brightest pixel within a quarter of a
        window of it, frame by frame. By default "start", and "peak" in `measure`.
    hot_pixel_gate : bool
        Replace pixels that stand out of their 3 x 3 median. Not for spots with a sigma below 0.9
        pixels.
    smooth : "kalman", optional
        Smooth the places over the frames with a local linear trend (liu2026, section 3.2).

    Raises
    ------
    ValueError
        If the window is even, or another field is out of range.

    Examples
    --------
    >>> import losbench as lb
    >>> image = lb.render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> found = lb.centroid(image, [[19, 17]], method=lb.EIWA(13, stop="step"))
    >>> found.xy.round(2).tolist(), found.n_iter.tolist()
    ([[20.3, 15.8]], [3])
    """

    window: Window | None = None
    stop: str = "error"
    tolerance: float | None = None
    _: KW_ONLY
    max_iter: int = 50
    centre: str | None = None
    hot_pixel_gate: bool = False
    smooth: str | None = None

    stays: ClassVar[bool] = False
    template: ClassVar[bool] = False
    width: ClassVar[None] = None

    def __post_init__(self) -> None:
        check_fields(self)
        choice("stop", self.stop, _RULES)
        if self.tolerance is not None:
            number("tolerance", self.tolerance, low=1e-12)
        integer("max_iter", self.max_iter, low=1)

    def measure(self, windows: Windows) -> Estimate:
        """Move each window to where it rests.

        Bad pixels are those that the engine has replaced; the paper's window knows none.
        """
        if windows.healed is not None and self.stop == "error":
            windows = replace(windows, signal=windows.healed)
        *_, rest = self.steps(windows)
        return window_estimate(windows, rest, moved=True)

    def steps(self, windows: Windows) -> Iterator[WindowFit]:
        """Yield where M windows stand after each evaluation of those that still move.

        The arrays are filled on from one to the next. A window that leaves the middle pixel of its
        stamp by more than a pixel stops there, not converged.
        """
        pixels, centre = windows.signal, windows.start.copy()
        remaining, contraction = np.full_like(centre, np.nan), np.full_like(centre, np.nan)
        total = np.full(len(pixels), np.nan)
        n_iter = np.zeros(len(pixels), dtype=np.int64)
        converged = np.zeros(len(pixels), dtype=bool)
        rule = _RULES[self.stop]
        tolerance = rule.tolerance if self.tolerance is None else self.tolerance
        moving = np.arange(len(pixels))
        for k in range(self.max_iter):
            some = slice(None) if moving.size == len(pixels) else moving
            seen = look(pixels[some], centre[some], windows.side)
            step = seen.centroid - centre[some]
            with np.errstate(invalid="ignore"):  # light that adds up to nothing
                ahead = step / np.maximum(1.0 - seen.contraction, 1.0 - NEWTON_LIMIT)
            # The derivative is worth having only near the fixed point and away from the pole.
            near = (k > 0) & (np.abs(seen.contraction) < NEWTON_LIMIT)
            move, left, small = rule.step(step, ahead, near)
            centre[some] += move
            remaining[some] = left
            contraction[some], total[some] = seen.contraction, seen.total
            n_iter[some] += 1
            rest: Bools = np.hypot(small[:, 0], small[:, 1]) < tolerance
            converged[some] = rest
            moving = moving[~rest & (np.abs(centre[some]) <= 1.0).all(axis=1)]
            yield WindowFit(centre, remaining, n_iter, converged, Look(total, centre, contraction))
            if not moving.size:
                break

    def path(
        self,
        image: ArrayLike,
        start: ArrayLike,
        *,
        background: Background = _RING,
    ) -> Floats:
        """Centres that the window takes on its way to one spot, from the start to where it rests.

        Parameters
        ----------
        image : (H, W) array, DN
        start : (2,) array, pixels
        background : Ring or Level

        Returns
        -------
        (k + 1, 2) array, pixels
            After 0 ... k evaluations.

        Raises
        ------
        ValueError
            As `centroid`, and if the start lies outside the image.

        Examples
        --------
        >>> import losbench as lb
        >>> image = lb.render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
        >>> lb.EIWA(13, stop="step").path(image, [19, 17])[[0, 1, -1]].round(2).tolist()
        [[19.0, 17.0], [20.27, 15.82], [20.3, 15.8]]
        """
        stack = as_stack(image)
        place = as_starts("start", np.asarray(start, dtype=np.float64).reshape(-1, 2), 1)
        side = int(window_sides(self.window, stack, place)[0])
        watched = _Watched(**vars(self))
        engine = Engine.of_stack(stack, watched, background, side)
        frame, _, middle = in_frame(stack, place)
        if len(frame) != 1 or len(stack) != 1:
            raise ValueError(
                f"start must be one point within one image, got {np.asarray(start).tolist()}"
            )
        engine.measure(stack, frame, middle, place[0], width=np.full((1, 2), np.nan))
        return np.concatenate(watched.centres)


@dataclass(frozen=True)
class _Watched(EIWA):
    """EIWA that notes where in the frame the window of its one spot has stood."""

    centres: list[Floats] = field(default_factory=list)

    def measure(self, windows: Windows) -> Estimate:
        first = [windows.start] if not self.centres else []
        for fit in self.steps(windows):
            self.centres.extend(windows.middle + centre for centre in (*first, fit.centroid))
            first = []
        return window_estimate(windows, fit, moved=True)
