"""The base of all explorers: controls, one picture that follows them, its numbers as text, and its
code to copy.
"""

from __future__ import annotations

import base64
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from typing import Any, ClassVar
from weakref import WeakSet

import ipywidgets as widgets
import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from losbench.workbench.explorers.controls import Control
from losbench.workbench.explorers.copied import copied
from losbench.workbench.explorers.picture import Picture, style
from losbench.workbench.explorers.view import Handle, PictureView

__all__ = ["Explorer"]

_HIGHEST_IN = 3.9  # what sliders and numbers leave of a laptop's screen


class Explorer(widgets.VBox):  # type: ignore[misc]
    """Sliders over a picture that follows them.

    An explorer names its ``controls`` and its ``experiment``, a function of the settings at the top
    of its module, builds its figure once, and moves the artists of that figure to what the
    experiment gives. "Copy as code" copies the source of that same function, and prints the
    ``answer``, an expression in ``seen``. A ``ValueError`` or a warning on the way is a message in
    the widget. Every picture carries in its PNG description and its alternative text which
    settings it shows, the text of ``stated``. Its ``handles`` can be dragged. One that ``settles``
    may leave out what is slow while it is ``moving``; it is asked again when the hand rests.

    Parameters
    ----------
    **start
        Settings to begin with, by name, e.g. ``window_px=11``; reset comes back to them.

    Raises
    ------
    ValueError
        If a setting is unknown or outside its control's range.
    """

    controls: ClassVar[Mapping[str, Control]]
    experiment: ClassVar[Callable[..., Any]]
    answer: ClassVar[str] = "seen"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    size_in: ClassVar[tuple[float, float]] = (8.4, 3.6)
    settles: ClassVar[bool] = False
    _picture: Picture | None = None
    _built: frozenset[str] = frozenset()
    _handles: Sequence[Handle] = ()
    _paused = _watched = False
    _light = True
    moving = False
    stated = ""

    def __init__(self, **start: Any) -> None:
        unknown = sorted(set(start) - set(self.controls))
        if unknown:
            raise ValueError(
                f"{type(self).__name__} has no {', '.join(unknown)}; it has "
                f"{', '.join(self.controls)}"
            )
        first = {name: start.get(name, control.value) for name, control in self.controls.items()}
        self.inputs = {name: control.widget(first[name]) for name, control in self.controls.items()}
        self._begin = {name: each.value for name, each in self.inputs.items()}
        wide, high = self.size_in
        widest = 100 * wide * min(1.0, _HIGHEST_IN / high)
        self.view = PictureView(self.ask, width=f"{widest:.0f}px", max_width="100%")
        self.message, self.numbers = widgets.HTML(), widgets.HTML()
        self.message.add_class("losbench-message")
        super().__init__([self._panel(), self.view, self.numbers])
        self.add_class("losbench-explorer")
        self._draw(light=True)
        for each in self.inputs.values():
            each.observe(self._follow, "value")
        _retire_earlier_runs(self)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw axes and artists into an empty figure, keep the artists, and return those that
        `update` moves.
        """
        raise NotImplementedError

    def update(self, *args: Any, **settings: Any) -> Mapping[str, str]:
        """Move the artists to where the settings put them; return the numbers to be read beside the
        picture.
        """
        raise NotImplementedError

    def handles(self, *args: Any, **settings: Any) -> Sequence[Handle]:
        """What can be dragged in the picture, with these settings."""
        return ()

    def code(self, *args: Any, **settings: Any) -> str:
        """Return Python that computes the same with the library."""
        return copied(self.experiment, settings, self.answer)

    @property
    def settings(self) -> dict[str, Any]:
        """The value of every control by name; ``ValueError`` where a field holds nonsense."""
        return {
            name: control.read(self.inputs[name].value) for name, control in self.controls.items()
        }

    def slides(self, x: str = "", y: str = "") -> Callable[[float, float], dict[str, Any]]:
        """Return what a handle does that moves sliders: along x the one, along y the other."""
        sliders: Mapping[str, Any] = self.controls

        def moved(*at: float) -> dict[str, Any]:
            places = zip((x, y), at, strict=True)
            return {name: sliders[name].nearest(value) for name, value in places if name}

        return moved

    def reset(self, *_: Any) -> None:
        """Go back to the first settings."""
        self._put(self._begin)

    def preset(self, name: str) -> None:
        """Show a preset: the first settings, its own seed and all, with the values of the preset in
        their place.
        """
        values = {
            each: self.controls[each].held(value) for each, value in self.presets[name].items()
        }
        self._put(self._begin | values)

    def new_noise(self, *_: Any) -> None:
        """Draw other random numbers: the next seed, or 0 where the field holds none."""
        try:
            following = self.settings["seed"] + 1
        except ValueError:
            following = 0
        self._put({"seed": str(following)})

    def close(self) -> None:
        """Close every part too, and let go of the figure; nothing is called back any more."""
        self._picture, self._handles = None, ()
        # A notebook's Out keeps the explorer, but need not keep its figure.
        for name in self._built:
            delattr(self, name)
        self._built = frozenset()
        for part in list(_parts(self)):
            part.unobserve_all()
            part.close()
        super().close()

    def __repr__(self) -> str:
        """Name the explorer; its hundred parts would fill a page of exported text."""
        return f"{type(self).__name__}()"

    def _repr_mimebundle_(self, **kwargs: Any) -> dict[str, Any]:
        """Add the picture as it is now, for exported pages and front ends without widgets."""
        bundle: dict[str, Any] = super()._repr_mimebundle_(**kwargs)
        return {**bundle, "image/png": base64.b64encode(self.view.png).decode("ascii")}

    def _panel(self) -> Any:
        reset = _button("reset", "back to the first settings")
        reset.on_click(self.reset)
        buttons = [reset]
        for name in self.presets:
            buttons.append(_button(name))
            buttons[-1].on_click(lambda _, name=name: self.preset(name))
        if "seed" in self.controls:
            buttons.append(_button("new noise", "the next seed"))
            buttons[-1].on_click(self.new_noise)
        wrap = {"flex_flow": "row wrap"}
        return widgets.VBox(
            [
                widgets.Box(list(self.inputs.values()), layout=wrap),
                widgets.Box(buttons, layout=wrap),
                self.message,
            ]
        )

    def _put(self, values: Mapping[str, Any], *, moving: bool = False) -> None:
        """Set several widgets, and draw once."""
        self._paused = True
        try:
            for name, value in values.items():
                self.inputs[name].value = value
        finally:
            self._paused = False
        self._follow(moving=moving)

    def _draw(self, *, light: bool) -> None:
        """Build the figure, and draw it."""
        for name in self._built:
            delattr(self, name)
        with mpl.rc_context(style(light=light)):
            figure = Figure(figsize=self.size_in, dpi=100)
            mine = set(vars(self))
            moving = self.build(figure)
            self._built = frozenset(set(vars(self)) - mine)
            built = {axes: axes.get_ylim() for axes in figure.axes}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                # Laid out for the defaults, wherever it begins: one setting, one picture.
                self.update(**{name: control.value for name, control in self.controls.items()})
        fixed = [axes for axes, limits in built.items() if axes.get_ylim() == limits]
        self._picture, self._light = Picture(figure, moving, fixed=fixed, light=light), light
        self._follow()

    def _follow(self, _change: Any = None, *, moving: bool = False) -> None:
        """Bring picture, numbers and code to the present settings, or say what is wrong with
        them.
        """
        if self._paused or self._picture is None:
            return
        # Only a page asks for what is left out while something moves.
        self.moving = self.settles and self._watched and (moving or _change is not None)
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                settings = self.settings
                numbers = self.update(**settings)
        except ValueError as problem:
            self.message.value = _notes([str(problem)])
            return
        self.message.value = _notes([str(warning.message) for warning in caught])
        self.stated = "; ".join(
            self.controls[name].stated(value) for name, value in settings.items()
        )
        self._handles = self.handles(**settings)
        with self.view.hold_sync():
            self.view.png, self.view.alt = self._picture.png(self.stated), self.stated
            self.view.code, self.view.coarse = self.code(**settings), self.moving
            self.view.handles = [self._placed(handle) for handle in self._handles]
        self.numbers.value = _readout(numbers)

    def _placed(self, handle: Handle) -> dict[str, Any]:
        assert self._picture is not None
        left, top = self._picture.place(handle.axes, handle.x, handle.y)
        words = {"label": handle.label, "text": handle.text, "now": float(handle.x)}
        return {"x": float(left), "y": float(top), **words}

    def ask(self, question: Mapping[str, Any]) -> None:
        """Do what the page asks: another look, handles moved or stepped, all that was left out."""
        if self._picture is None:
            return
        if look := question.get("look"):
            self._watched = True
            if look["light"] != self._light:
                self._draw(light=look["light"])
            self._picture.resize(look["width"] * look["ratio"])
            self._follow()
        values: dict[str, Any] = {}
        for number, place in question.get("moves", {}).items():
            handle = self._handles[int(number)]
            values |= handle.move(*map(float, self._picture.point(handle.axes, *place)))
        for number, steps in question.get("steps", {}).items():
            values |= _stepped(self._handles[int(number)], *steps)
        if any(self.inputs[name].value != value for name, value in values.items()):
            self._put(values, moving=True)
        elif question.get("settle"):
            self._follow()


def _button(name: str, tooltip: str = "") -> Any:
    return widgets.Button(description=name, tooltip=tooltip, layout={"width": "auto"})


def _stepped(handle: Handle, right: float, up: float) -> Mapping[str, Any]:
    """Settings after so many arrow keys, to the right and up on the screen."""
    axes = handle.axes
    keys = (-right if axes.xaxis_inverted() else right, -up if axes.yaxis_inverted() else up)
    scales = (axes.get_xscale(), axes.get_yscale())
    at = [
        place * 10.0 ** (count * step) if scale == "log" else place + count * step
        for place, count, step, scale in zip(
            (handle.x, handle.y), keys, handle.step, scales, strict=True
        )
    ]
    ends = np.sort([axes.get_xlim(), axes.get_ylim()], axis=1)
    return handle.move(*np.clip(at, ends[:, 0], ends[:, 1]).tolist())


def _notes(texts: Sequence[str]) -> str:
    return "".join(
        f'<div role="alert"><b>Note:</b> {escape(text)}</div>' for text in dict.fromkeys(texts)
    )


def _readout(numbers: Mapping[str, str]) -> str:
    cells = "".join(
        '<div style="margin: 0 1.6em .3em 0; line-height: '
        f'1.35"><small>{escape(label)}</small><br>{escape(text)}</div>'
        for label, text in numbers.items()
    )
    return f'<div style="display: flex; flex-wrap: wrap">{cells}</div>'


def _parts(widget: Any) -> Iterator[Any]:
    """Every widget below this one, layouts and styles included, once."""
    for child in getattr(widget, "children", ()):
        yield from _parts(child)
        yield child
    for name in ("layout", "style"):
        part = getattr(widget, name, None)
        if isinstance(part, widgets.Widget):
            yield part


_shown: dict[str, tuple[str, WeakSet[Explorer]]] = {}


def _retire_earlier_runs(explorer: Explorer) -> None:
    """Close the explorers that an earlier run of the same cell made: nobody can see them any
    more.
    """
    cell, run = _running_cell()
    if not cell:
        return
    previous, made = _shown.get(cell, (run, WeakSet()))
    if previous != run:
        for old in list(made):
            old.close()
        made = WeakSet()
    made.add(explorer)
    _shown[cell] = (run, made)


def _running_cell() -> tuple[str, str]:
    """Return the notebook cell that runs and the request that runs it, empty outside of a front end
    that says so.
    """
    from IPython.core.getipython import get_ipython

    kernel = getattr(get_ipython(), "kernel", None)
    parent = kernel.get_parent() if kernel is not None else {}
    return parent.get("metadata", {}).get("cellId", ""), parent.get("header", {}).get("msg_id", "")
