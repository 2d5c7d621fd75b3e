"""What an angle may depend on: frozen terms that add up to a model.

>>> model = Offset() + Linear("T1", "T2") + Lagged("T3", tau_s=600.0) + Trend(1)
>>> model.labels
('offset', 'T1', 'T2', 'T3 lagged 600 s', 'trend')

Each term has ``labels``, one for each of its p columns, and ``columns(sensors, time_s)``, which
makes them, (n, p), from sensors (n,) by name and times (n,). Sensors come less their reference, the
mean over the record that was fitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from losbench.arrays import Floats
from losbench.checks import finite, integer, number
from losbench.pointing.thermal.lag import lagged

__all__ = [
    "Difference",
    "Fourier",
    "Lagged",
    "Linear",
    "Model",
    "Offset",
    "Product",
    "Steps",
    "Trend",
]

Sensors = Mapping[str, Floats]


class Adds:
    """What lets terms and models be added."""

    def __add__(self, other: Adds) -> Model:
        """Return the model of both."""
        if not isinstance(other, Adds):
            return NotImplemented
        return Model(_terms(self) + _terms(other))


def _terms(thing: Adds) -> tuple[Any, ...]:
    return thing.terms if isinstance(thing, Model) else (thing,)


@dataclass(frozen=True)
class Model(Adds):
    """Terms that add.

    Attributes
    ----------
    terms : tuple of terms
    """

    terms: tuple[Any, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of all p columns."""
        return tuple(label for term in self.terms for label in term.labels)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of all sensors that the terms need."""
        return tuple(dict.fromkeys(name for term in self.terms for name in term.sensors))

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """All columns (n, p)."""
        return np.concatenate([term.columns(sensors, time_s) for term in self.terms], axis=1)


@dataclass(frozen=True)
class Offset(Adds):
    """One number: the angle where all else is zero."""

    labels: ClassVar[tuple[str, ...]] = ("offset",)
    sensors: ClassVar[tuple[str, ...]] = ()

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """Ones, (n, 1)."""
        return np.ones((time_s.size, 1))


@dataclass(frozen=True, init=False)
class Linear(Adds):
    """Sensors as they are, and their powers up to ``degree``."""

    names: tuple[str, ...]
    degree: int

    def __init__(self, *names: str, degree: int = 1) -> None:
        object.__setattr__(self, "names", _named("Linear", names))
        object.__setattr__(self, "degree", integer("degree", degree, low=1, high=5))

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return self.names

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the columns: sensor by sensor, power by power."""
        return tuple(name + _power(k) for name in self.names for k in range(self.degree))

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """Columns (n, sensors x degree)."""
        powers = np.arange(1, self.degree + 1)
        return np.concatenate([sensors[name][:, None] ** powers for name in self.names], axis=1)


@dataclass(frozen=True)
class Difference(Adds):
    """One sensor less another: a gradient."""

    first: str
    second: str

    def __post_init__(self) -> None:
        """Check the names."""
        _named("Difference", (self.first, self.second))

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return self.first, self.second

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the column."""
        return (f"{self.first} - {self.second}",)

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """Difference, (n, 1)."""
        return (sensors[self.first] - sensors[self.second])[:, None]


@dataclass(frozen=True, init=False)
class Lagged(Adds):
    """Sensors behind first-order lags, in equilibrium at the first sample.

    Parameters
    ----------
    *names : str
    tau_s : float, "fit" or "spectrum"
        A known lag for all the sensors. "fit": one lag for each, which the intervals take for the
        law unless a test rejects it; a test sees no misfit that hides in the noise, so that of
        bodies behind bodies they held the truth in 27 to 100 % of records, by noise and law.
        "spectrum": the same prediction, but the sensitivity at rest is the sum over every lag:
        wider, and held the truth in 98 % of the same records or more (`make bench`).
    degree : int
        Powers of the lagged temperature up to this.
    """

    names: tuple[str, ...]
    tau_s: float | str
    degree: int

    def __init__(self, *names: str, tau_s: float | str = "fit", degree: int = 1) -> None:
        if tau_s not in ("fit", "spectrum"):
            if isinstance(tau_s, str):
                raise ValueError(f'tau_s must be a number, "fit" or "spectrum", got {tau_s!r}')
            if number("tau_s", tau_s) <= 0:
                raise ValueError(f"tau_s must be positive, got {tau_s:g}")
        object.__setattr__(self, "names", _named("Lagged", names))
        object.__setattr__(self, "tau_s", tau_s)
        object.__setattr__(self, "degree", integer("degree", degree, low=1, high=5))

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return self.names

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the columns: sensor by sensor, power by power."""
        lag = "" if isinstance(self.tau_s, str) else f" {self.tau_s:g} s"
        return tuple(
            f"{name} lagged{lag}{_power(k)}" for name in self.names for k in range(self.degree)
        )

    @property
    def free(self) -> bool:
        """Whether its lags are to be fitted."""
        return isinstance(self.tau_s, str)

    def columns(self, sensors: Sensors, time_s: Floats, tau_s: Floats | None = None) -> Floats:
        """Columns (n, sensors x degree) for the term's own lag, or for one given for each
        sensor.
        """
        if tau_s is None:
            if isinstance(self.tau_s, str):
                raise ValueError("Lagged must be fitted before it has columns: tau_s is unknown")
            tau_s = np.full(len(self.names), self.tau_s)
        powers = np.arange(1, self.degree + 1)
        return np.concatenate(
            [
                lagged(sensors[name], time_s, float(tau))[:, None] ** powers
                for name, tau in zip(self.names, tau_s, strict=True)
            ],
            axis=1,
        )


@dataclass(frozen=True)
class Trend(Adds):
    """Powers of time up to ``degree``, about the middle of the record unless ``origin_s`` is given.

    In units of ``unit_s``, a Julian year unless given.
    """

    degree: int = 1
    origin_s: float | None = None
    unit_s: float = 31_557_600.0
    sensors: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        """Check."""
        integer("degree", self.degree, low=1, high=5)
        number("unit_s", self.unit_s, low=1e-9)

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the columns."""
        return tuple("trend" + _power(k) for k in range(self.degree))

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """Columns (n, degree)."""
        origin = 0.5 * (time_s[0] + time_s[-1]) if self.origin_s is None else self.origin_s
        return ((time_s - origin) / self.unit_s)[:, None] ** np.arange(1, self.degree + 1)


@dataclass(frozen=True)
class Steps(Adds):
    """A step at each of some times, in seconds: 0 before, 1 from there on."""

    at_s: tuple[float, ...]
    sensors: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        """Keep the times in order."""
        times = np.sort(np.atleast_1d(finite("at_s", self.at_s)))
        object.__setattr__(self, "at_s", tuple(float(t) for t in times))

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the columns."""
        return tuple(f"step at {at:g} s" for at in self.at_s)

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """Columns (n, steps)."""
        return (time_s[:, None] >= np.array(self.at_s)).astype(np.float64)


@dataclass(frozen=True)
class Fourier(Adds):
    """Sines and cosines of a period: ``harmonics`` of them, or those named."""

    period_s: float
    harmonics: int | tuple[int, ...] = 1
    sensors: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        """Check."""
        if number("period_s", self.period_s) <= 0:
            raise ValueError(f"period_s must be positive, got {self.period_s:g}")
        for order in self.orders:
            integer("harmonics", order, low=1)

    @property
    def orders(self) -> tuple[int, ...]:
        """Which harmonics."""
        if isinstance(self.harmonics, int):
            return tuple(range(1, integer("harmonics", self.harmonics, low=1) + 1))
        return tuple(self.harmonics)

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the columns."""
        return tuple(
            f"{name} {order} of {self.period_s:g} s"
            for order in self.orders
            for name in ("cos", "sin")
        )

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """Columns (n, 2 x harmonics)."""
        phase = 2.0 * np.pi / self.period_s * time_s[:, None] * np.array(self.orders)
        return np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(time_s.size, -1)


@dataclass(frozen=True)
class Product(Adds):
    """Every column of one term times every column of another: a sensitivity that drifts."""

    first: Any
    second: Any

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors of both."""
        return (*self.first.sensors, *self.second.sensors)

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the columns."""
        return tuple(f"{a} x {b}" for a in self.first.labels for b in self.second.labels)

    def columns(self, sensors: Sensors, time_s: Floats) -> Floats:
        """Columns (n, p1 x p2)."""
        a, b = (term.columns(sensors, time_s) for term in (self.first, self.second))
        return (a[:, :, None] * b[:, None, :]).reshape(time_s.size, -1)


def _power(k: int) -> str:
    return f"^{k + 1}" if k else ""


def _named(term: str, names: tuple[str, ...]) -> tuple[str, ...]:
    if not names or any(not isinstance(name, str) or not name for name in names):
        raise ValueError(f"{term} must name its sensors, got {names!r}")
    if len(set(names)) < len(names):
        raise ValueError(f"{term} must name each sensor once, got {', '.join(names)}")
    return names
