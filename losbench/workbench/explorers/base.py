"""The base of all explorers: controls, one picture that follows them, its numbers as text, and its
code to copy.
"""

from __future__ import annotations

import base64
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from math import ceil
from typing import Any, ClassVar
from weakref import WeakSet

import ipywidgets as widgets
import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from losbench.workbench.explorers.controls import Control
from losbench.workbench.explorers.copied import copied
from losbench.workbench.explorers.picture import Picture, style

__all__ = ["Explorer"]

_LINE = 80  # characters of code that fit into a line of a narrow page


class Explorer(widgets.VBox):  # type: ignore[misc]
    """Sliders over a picture that follows them.

    An explorer names its ``controls`` and its ``experiment``, a function of the settings at the top
    of its module, builds its figure once, and moves the artists of that figure to what the
    experiment gives. "Copy as code" shows the source of that same function, and prints the
    ``answer``, an expression in ``seen``. A ``ValueError`` or a warning on the way is a message in
    the widget. Every picture carries in its PNG description which settings it
    shows, the text of ``stated``.

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
    _picture: Picture | None = None
    _built: frozenset[str] = frozenset()
    _paused = False
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
        self.image = widgets.Image(
            format="png", layout={"width": f"{100 * self.size_in[0]:.0f}px", "max_width": "100%"}
        )
        self.message, self.numbers = widgets.HTML(), widgets.HTML()
        self.copy_as_code = widgets.Textarea(
            description="copy as code",
            rows=1,
            style={"description_width": "7em"},
            layout={"width": "98%"},
        )
        super().__init__([self._panel(), self.message, self.image, self.numbers, self.copy_as_code])
        self._draw_once()
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

    def code(self, *args: Any, **settings: Any) -> str:
        """Return Python that computes the same with the library."""
        return copied(self.experiment, settings, self.answer)

    @property
    def settings(self) -> dict[str, Any]:
        """The value of every control by name; ``ValueError`` where a field holds nonsense."""
        return {
            name: control.read(self.inputs[name].value) for name, control in self.controls.items()
        }

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
        self._picture = None
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
        return {**bundle, "image/png": base64.b64encode(self.image.value).decode("ascii")}

    def _panel(self) -> Any:
        reset = widgets.Button(description="reset", tooltip="back to the first settings")
        reset.on_click(self.reset)
        buttons = [reset]
        for name in self.presets:
            buttons.append(widgets.Button(description=name, layout={"width": "auto"}))
            buttons[-1].on_click(lambda _, name=name: self.preset(name))
        if "seed" in self.controls:
            buttons.append(widgets.Button(description="new noise", tooltip="the next seed"))
            buttons[-1].on_click(self.new_noise)
        wrap = {"flex_flow": "row wrap"}
        return widgets.VBox(
            [
                widgets.Box(list(self.inputs.values()), layout=wrap),
                widgets.Box(buttons, layout=wrap),
            ]
        )

    def _put(self, values: Mapping[str, Any]) -> None:
        """Set several widgets, and draw once."""
        self._paused = True
        try:
            for name, value in values.items():
                self.inputs[name].value = value
        finally:
            self._paused = False
        self._follow()

    def _draw_once(self) -> None:
        with mpl.rc_context(style()):
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
        self._picture = Picture(figure, moving, fixed=fixed)
        self._follow()

    def _follow(self, _change: Any = None) -> None:
        """Bring picture, numbers and code to the present settings, or say what is wrong with
        them.
        """
        if self._paused or self._picture is None:
            return
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
        self.image.value = self._picture.png(self.stated)
        self.numbers.value = _readout(numbers)
        self.copy_as_code.value = code = self.code(**settings)
        self.copy_as_code.rows = sum(max(1, ceil(len(line) / _LINE)) for line in code.split("\n"))


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
