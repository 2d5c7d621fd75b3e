"""What a reader can turn: sliders, choices and fields, each with its label, unit and way of reading
its value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any, Protocol

import ipywidgets as widgets
import traitlets

from losbench.checks import integer, number

__all__ = [
    "Choice",
    "Control",
    "Field",
    "LogSlider",
    "Slider",
    "moved_spots",
    "numbers",
    "typed",
    "whole_number",
]

_ROUND = (1, 1.1, 1.2, 1.4, 1.6, 1.8, 2, 2.2, 2.5, 2.8, 3, 3.5, 4, 4.5, 5, 5.5, 6, 7, 8, 9)
_WIDE_PX, _READOUT_PX = 276, 52  # three columns in the output of a cell, 1280 px with a sidebar
_LABEL = {"description_width": "126px"}
_WIDTHS = {"style": _LABEL, "layout": {"width": f"{_WIDE_PX}px"}}
_SHORT = 12  # characters of a label that leaves a list or a field more room


class Control(Protocol):
    """One setting of an explorer."""

    @property
    def label(self) -> str:
        """Its name on the screen."""

    @property
    def value(self) -> Any:
        """Its default."""

    def held(self, value: Any) -> Any:
        """Return what the widget holds for this setting, or raise ``ValueError``."""

    def widget(self, value: Any) -> Any:
        """Make the widget, set to ``value``."""

    def read(self, value: Any) -> Any:
        """Turn the widget's value into the setting, or raise ``ValueError``."""

    def stated(self, value: Any) -> str:
        """Say label and value, with the unit."""


@dataclass(frozen=True)
class Slider:
    """A number between ``low`` and ``high``; whole numbers if all of them are."""

    label: str
    value: float
    low: float
    high: float
    step: float
    unit: str = ""

    def held(self, value: float) -> float:
        """Return the number, if it is within the range."""
        number(self.label, value, low=self.low, high=self.high)
        return value

    def nearest(self, value: float) -> float:
        """Return the step next to a number."""
        steps = round((min(max(value, self.low), self.high) - self.low) / self.step)
        return self.read(min(self.low + steps * self.step, self.high))

    def widget(self, value: float) -> Any:
        """Make the slider."""
        whole = all(isinstance(n, int) for n in (self.low, self.high, self.step))
        kind = widgets.IntSlider if whole else widgets.FloatSlider
        form = {} if whole else {"readout_format": f".{_decimals(self.step)}f"}
        ends = {"min": self.low, "max": self.high, "step": self.step}
        return kind(value=self.held(value), description=_named(self), **ends, **form, **_WIDTHS)

    def read(self, value: float) -> float:
        """Return the number without the rounding errors of the slider's steps."""
        return round(value, _decimals(self.step)) if isinstance(value, float) else value

    def stated(self, value: float) -> str:
        """Say label, number and unit."""
        return f"{self.label} {value:g} {self.unit}".strip()


@dataclass(frozen=True)
class LogSlider:
    """A positive number from ``low`` to ``high`` in about equal ratios, twenty round numbers in a
    factor of ten.
    """

    label: str
    value: float
    low: float
    high: float
    unit: str = ""

    def held(self, value: float) -> float:
        """Return the number, if it is within the range."""
        number(self.label, value, low=self.low, high=self.high)
        return float(value)

    def nearest(self, value: float) -> float:
        """Return the round number next to another, by ratio."""
        held = max(value, self.low)
        return min(self._round_numbers(), key=lambda n: abs(log10(n / held)))

    def widget(self, value: float) -> Any:
        """Make the slider; ``value`` need not be one of the round numbers."""
        begin = self.held(value)
        return _Stepped(sorted(self._round_numbers() | {begin}), begin, _named(self))

    def _round_numbers(self) -> set[float]:
        decades = range(floor(log10(self.low)), ceil(log10(self.high)) + 1)
        every = {float(f"{digits}e{decade}") for decade in decades for digits in _ROUND}
        return {n for n in every if self.low <= n <= self.high}

    def read(self, value: float) -> float:
        """Return the number."""
        return value

    def stated(self, value: float) -> str:
        """Say label, number and unit."""
        return f"{self.label} {value:g} {self.unit}".strip()


@dataclass(frozen=True)
class Choice:
    """One of several names, each with what it stands for."""

    label: str
    options: Mapping[str, Any]
    value: Any

    def __post_init__(self) -> None:
        if None in self.options.values():
            raise ValueError(
                f"{self.label} must not offer None, which a list shows as nothing selected"
            )

    def held(self, value: Any) -> Any:
        """Return what the name stands for, if it is offered."""
        if value not in self.options.values():
            offered = ", ".join(repr(option) for option in self.options.values())
            raise ValueError(f"{self.label} must be one of {offered}, got {value!r}")
        return value

    def widget(self, value: Any) -> Any:
        """Make the drop-down list."""
        offered = list(self.options.items())
        return widgets.Dropdown(
            options=offered,
            value=self.held(value),
            description=self.label,
            **_fitted(self.label),
        )

    def read(self, value: Any) -> Any:
        """Return what the name stands for."""
        return value

    def stated(self, value: Any) -> str:
        """Say label and name."""
        return (
            f"{self.label} {next(name for name, option in self.options.items() if option == value)}"
        )


@dataclass(frozen=True)
class Field:
    """A line of text, read when Enter is pressed or the field is left."""

    label: str
    value: Any
    parse: Callable[[str, str], Any]
    unit: str = ""

    def held(self, value: Any) -> str:
        """Return the text of the value."""
        return typed(value)

    def widget(self, value: Any) -> Any:
        """Make the field."""
        return widgets.Text(
            value=self.held(value),
            continuous_update=False,
            description=_named(self),
            **_fitted(_named(self)),
        )

    def read(self, value: str) -> Any:
        """Parse the text; the message of a ``ValueError`` begins with the label."""
        return self.parse(self.label, value)

    def stated(self, value: Any) -> str:
        """Say label, value and unit."""
        return f"{self.label} {typed(value)} {self.unit}".strip()


class _Stepped(widgets.HBox, widgets.ValueWidget):  # type: ignore[misc]
    """A slider over chosen numbers, with the present one beside it: into its own readout a reader
    can type anything.
    """

    value = traitlets.Float()
    description = traitlets.Unicode()

    def __init__(self, steps: Sequence[float], value: float, description: str) -> None:
        slider = widgets.SelectionSlider(
            options=[(f"{n:g}", n) for n in steps],
            value=value,
            description=description,
            readout=False,
            style=_LABEL,
            layout={"width": f"{_WIDE_PX - _READOUT_PX - 4}px"},
        )
        in_the_middle = {"display": "flex", "justify_content": "center"}
        readout = widgets.Label(layout={"width": f"{_READOUT_PX}px", **in_the_middle})
        super().__init__(
            [slider, readout], value=value, description=description, layout={"margin": "2px"}
        )
        # The readout first: it need not wait for the picture that follows the value.
        traitlets.dlink((slider, "label"), (readout, "value"))
        traitlets.link((slider, "value"), (self, "value"))


def whole_number(label: str, text: str) -> int:
    """Read a whole number of at least 0, as seeds are."""
    return integer(label, _number(label, text), low=0, high=2**53)


def numbers(count: int, *, low: float, high: float) -> Callable[[str, str], tuple[float, ...]]:
    """Return a parser of ``count`` numbers between ``low`` and ``high``, separated by commas."""

    def parse(label: str, text: str) -> tuple[float, ...]:
        parts = [part for part in text.replace(";", ",").split(",") if part.strip()]
        if len(parts) != count:
            raise ValueError(
                f"{label} must be {count} numbers separated by commas, got {len(parts)}"
            )
        return tuple(number(label, _number(label, part), low=low, high=high) for part in parts)

    return parse


def moved_spots(low: float, high: float) -> Callable[[str, str], tuple[tuple[float, ...], ...]]:
    """Return a parser of ``spot x y, ...``, spots counted from 1, places between ``low`` and
    ``high``; or ``none``.
    """

    def parse(label: str, text: str) -> tuple[tuple[float, ...], ...]:
        if text.strip() == "none":
            return ()
        triples = [part.split() for part in text.replace(";", ",").split(",")]
        if any(len(triple) != 3 for triple in triples):
            raise ValueError(f"{label} must be 'none' or 'spot x y, ...', got {text.strip()!r}")
        return tuple(
            (
                integer(label, _number(label, spot), low=1),
                *(number(label, _number(label, each), low=low, high=high) for each in at),
            )
            for spot, *at in triples
        )

    return parse


def _number(label: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{label} must be a number, got {text.strip()!r}") from None


def typed(value: Any) -> str:
    """Return the text that a field holds for a value."""
    if not isinstance(value, tuple):
        return str(value)
    if not value:
        return "none"
    if isinstance(value[0], tuple):
        return ", ".join(" ".join(f"{n:g}" for n in each) for each in value)
    return ", ".join(f"{n:g}" for n in value)


def _named(control: Slider | LogSlider | Field) -> str:
    return f"{control.label} ({control.unit})" if control.unit else control.label


def _fitted(label: str) -> dict[str, Any]:
    return _WIDTHS | ({"style": {"description_width": "initial"}} if len(label) <= _SHORT else {})


def _decimals(step: float) -> int:
    return max(0, len(f"{step:.10f}".rstrip("0").partition(".")[2]))
