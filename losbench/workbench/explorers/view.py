"""The picture of an explorer on the page: what can be dragged in it, and what the page asks."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anywidget
import traitlets
from matplotlib.axes import Axes

from losbench.arrays import Floats
from losbench.workbench.explorers.controls import typed

__all__ = ["Handle", "PictureView", "spot_handles"]

_REMEMBERED = 32  # questions; the page repeats one that a busy kernel has not answered in time


@dataclass(frozen=True)
class Handle:
    """Something in the picture that a hand can move.

    Attributes
    ----------
    label : str
        What it is.
    axes : Axes
        Where it lies.
    x, y : float
        Its place there, in the units of the axes.
    move : callable
        (x, y) to the settings that put it there.
    step : (float, float)
        What an arrow key moves it by; on a logarithmic axis in decades.
    text : str
        Its place in words.
    """

    label: str
    axes: Axes
    x: float
    y: float
    move: Callable[[float, float], Mapping[str, Any]]
    step: tuple[float, float] = (1.0, 1.0)
    text: str = ""


class PictureView(anywidget.AnyWidget):  # type: ignore[misc]
    """A PNG with handles over it, and a button that copies code.

    Parameters
    ----------
    answer : callable
        What to do about a question of the page: ``look`` (width, ratio, light), ``moves`` and
        ``steps`` by handle, ``settle``.
    **layout
        Of the widget, as in CSS.
    """

    _esm = Path(__file__).with_name("view.js").read_text(encoding="utf-8")
    _css = Path(__file__).with_name("view.css").read_text(encoding="utf-8")
    png = traitlets.Bytes().tag(sync=True)
    alt = traitlets.Unicode().tag(sync=True)
    code = traitlets.Unicode().tag(sync=True)
    handles = traitlets.List().tag(sync=True)
    coarse = traitlets.Bool().tag(sync=True)
    answered = traitlets.Unicode().tag(sync=True)

    def __init__(self, answer: Callable[[Mapping[str, Any]], None], **layout: str) -> None:
        super().__init__(layout=layout)
        self._answer = answer
        self._done: deque[str] = deque(maxlen=_REMEMBERED)
        self.on_msg(self._asked)

    def _asked(self, _: Any, question: Mapping[str, Any], _buffers: Any) -> None:
        """Answer every question once, also if nothing changes: the page waits for it."""
        if question["id"] in self._done:
            self.send_state("answered")
            return
        self._done.append(question["id"])
        with self.hold_sync():
            try:
                self._answer(question)
            finally:
                self.answered = question["id"]


def spot_handles(
    axes: Axes, places: Floats, moved: tuple[tuple[float, ...], ...], *, decimals: int
) -> list[Handle]:
    """Handles of spots at ``places`` (n, 2) that a setting ``moved`` puts elsewhere, to so many
    decimals.
    """
    step = 10.0**-decimals

    def to(spot: int) -> Callable[[float, float], Mapping[str, Any]]:
        def put(x: float, y: float) -> Mapping[str, Any]:
            others = [each for each in moved if each[0] != spot]
            at = (spot, round(x, decimals), round(y, decimals))
            return {"moved": typed((*sorted([*others, at]),))}

        return put

    return [
        Handle(
            label=f"spot {k}",
            axes=axes,
            x=float(x),
            y=float(y),
            move=to(k),
            step=(step, step),
            text=f"x {x:.{decimals}f}, y {y:.{decimals}f}",
        )
        for k, (x, y) in enumerate(places, start=1)
    ]
