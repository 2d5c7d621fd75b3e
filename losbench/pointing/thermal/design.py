"""A model bound to a record: its columns for any lags, and which rows may be used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats, Indices
from losbench.checks import finite_or_nan, increasing, shaped
from losbench.pointing.thermal.lag import lagged
from losbench.pointing.thermal.terms import (
    Adds,
    Difference,
    Lagged,
    Linear,
    Model,
    Product,
    Steps,
    Trend,
)

__all__ = ["Design", "bind", "read_series"]

_REMEMBERED = 128  # columns
_NUDGE = 1e-3  # in the logarithm of a lag, for its derivative
_CONSTANT = 1e-9  # of the greatest size: a smaller spread of a sensor is none
_ALIKE = 3.0  # median steps: a lag that all sensors share while columns are compared
_SMALLEST = 1e-9  # singular value of unit columns: a smaller one is none
_PART = 1e-6  # of a direction that has none: a column with less has no part in it


@dataclass(frozen=True)
class Design:
    """A model with its sensors, less their references, over a record.

    Attributes
    ----------
    model : Model
        Trends with their origin set.
    sensors : dict of (n,) arrays
        Gaps filled along straight lines, for lags that run over them.
    reference : dict of float
        What was subtracted from each sensor.
    time_s : (n,) array
    known : (n,) bool array
        Rows in which every sensor was there.
    """

    model: Model
    sensors: Mapping[str, Floats]
    reference: Mapping[str, float]
    time_s: Floats
    known: Bools
    recent: dict[tuple[int, float], Floats] = field(default_factory=dict, repr=False)

    @cached_property
    def lags(self) -> tuple[tuple[int, str], ...]:
        """Term and sensor of each lag that is to be fitted."""
        return tuple(
            (i, name)
            for i, term in enumerate(self.model.terms)
            if isinstance(term, Lagged) and term.free
            for name in term.names
        )

    def matrix(self, tau_s: Floats) -> Floats:
        """All columns (n, p) for lags (l,)."""
        matrix = self.fixed.copy()
        for i, (place, tau) in enumerate(zip(self.places, tau_s, strict=True)):
            matrix[:, place] = self.lagged(i, tau)
        return matrix

    @cached_property
    def fixed(self) -> Floats:
        """All columns (n, p), those of fitted lags left zero."""
        parts = [
            np.zeros((self.time_s.size, len(term.labels)))
            if isinstance(term, Lagged) and term.free
            else term.columns(self.sensors, self.time_s)
            for term in self.model.terms
        ]
        return np.concatenate(parts, axis=1)

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Where in the matrix each fitted lag has its columns."""
        found, at = [], 0
        for term in self.model.terms:
            width = len(term.labels)
            if isinstance(term, Lagged) and term.free:
                found += [
                    slice(at + k * term.degree, at + (k + 1) * term.degree)
                    for k in range(len(term.names))
                ]
            at += width
        return tuple(found)

    def alike(self, rows: Indices | Bools, *, every_lag: bool = False) -> Bools:
        """Which columns (p,) some rows cannot tell from others, such as two sensors that read the
        same, or a step that no row is before.

        Fitted lags are taken to be equal: sensors that differ by their lags alone are alike. So is
        a sensor beside its own lags where ``every_lag`` counts, no lag among them.
        """
        step_s = float(np.median(np.diff(self.time_s))) if self.time_s.size > 1 else 0.0
        columns = self.matrix(np.full(len(self.lags), 0.0 if every_lag else _ALIKE * step_s))
        size = np.linalg.norm(columns, axis=0)
        unit = columns[rows] / np.where(size > 0.0, size, 1.0)
        _, values, directions = np.linalg.svd(np.linalg.qr(unit)[1])
        rank = int(np.count_nonzero(values >= _SMALLEST))
        return np.asarray((np.abs(directions[rank:]) > _PART).any(axis=0))

    def lagged(self, lag: int, tau_s: float) -> Floats:
        """Columns (n, degree) of one fitted lag; the last few are remembered, for folds and solves
        come back to them.
        """
        key = lag, float(tau_s)
        if key not in self.recent:
            if len(self.recent) >= _REMEMBERED:
                del self.recent[next(iter(self.recent))]
            i, name = self.lags[lag]
            degree: int = self.model.terms[i].degree
            behind = lagged(self.sensors[name], self.time_s, tau_s)
            self.recent[key] = behind[:, None] ** np.arange(1, degree + 1)
        return self.recent[key]

    def slopes(self, tau_s: Floats, x: Floats) -> Floats:
        """Derivatives (n, l) of the angle in the logarithm of each fitted lag."""
        slopes = [
            (self.lagged(i, tau * np.exp(_NUDGE)) - self.lagged(i, tau * np.exp(-_NUDGE)))
            @ x[place]
            / (2.0 * _NUDGE)
            for i, (tau, place) in enumerate(zip(tau_s, self.places, strict=True))
        ]
        return np.stack(slopes, axis=1) if slopes else np.empty((self.time_s.size, 0))

    def sensitive(self) -> tuple[int, ...]:
        """Columns whose unknown is an angle per degree: first powers of a sensor or difference."""
        found, at = [], 0
        for term in self.model.terms:
            if isinstance(term, Linear | Lagged):
                found += [at + k * term.degree for k in range(len(term.names))]
            elif isinstance(term, Difference):
                found.append(at)
            at += len(term.labels)
        return tuple(found)


def bind(
    model: Adds,
    sensors: Mapping[str, ArrayLike],
    time_s: ArrayLike,
    *,
    reference: Mapping[str, float] | None = None,
) -> Design:
    """Check a model against a record and bind it; sensors are taken less their mean, or less the
    ``reference``.
    """
    if not isinstance(model, Adds):
        raise ValueError(f"model must be a sum of terms of lb.terms, got {model!r}")
    t = increasing("time_s", time_s)
    whole = model if isinstance(model, Model) else Model((model,))
    if len(set(whole.labels)) < len(whole.labels):
        twice = next(name for name in whole.labels if whole.labels.count(name) > 1)
        raise ValueError(f"model must hold each term once, got {twice} twice")
    missing = sorted(set(whole.sensors) - set(sensors))
    if missing:
        raise ValueError(
            f"sensors must hold {', '.join(missing)}, got {', '.join(sensors) or 'none'}"
        )
    known = np.ones(t.size, dtype=bool)
    filled, means = {}, {}
    for name in whole.sensors:
        series = finite_or_nan(f"sensor {name}", sensors[name], ndim=1)
        shaped(f"sensor {name}", series, (t.size,), why="to match time_s")
        there = np.isfinite(series)
        if not there.any():
            raise ValueError(f"sensor {name} must hold a reading, got none")
        if reference is None and np.ptp(series[there]) <= _CONSTANT * np.abs(series[there]).max():
            raise ValueError(
                f"sensor {name} must vary to give a sensitivity, got {series[there][0]:g} "
                "throughout"
            )
        means[name] = float(series[there].mean()) if reference is None else reference[name]
        filled[name] = np.interp(t, t[there], series[there]) - means[name]
        known &= there
    if reference is None:
        for term in whole.terms:
            _check_steps(term, t)
    origin = 0.5 * float(t[0] + t[-1])
    return Design(Model(tuple(_set(term, origin) for term in whole.terms)), filled, means, t, known)


def _check_steps(term: Adds, t: Floats) -> None:
    if isinstance(term, Product):
        _check_steps(term.first, t)
        _check_steps(term.second, t)
    for at in term.at_s if isinstance(term, Steps) else ():
        if not t[0] < at <= t[-1]:
            raise ValueError(
                f"Steps must lie within the record, after {t[0]:g} s and until {t[-1]:g} s, got "
                f"{at:g} s"
            )


def _set(term: Adds, origin_s: float) -> Adds:
    """Term with the origin of its trends."""
    if isinstance(term, Trend) and term.origin_s is None:
        return replace(term, origin_s=origin_s)
    if isinstance(term, Product):
        if any(isinstance(part, Lagged) and part.free for part in (term.first, term.second)):
            raise ValueError("Product must be of lags that are known: tau_s a number")
        return Product(_set(term.first, origin_s), _set(term.second, origin_s))
    return term


def read_series(angles: ArrayLike, samples: int) -> Floats:
    """Angles as (n, k), NaN where missing."""
    given = finite_or_nan("angles", angles)
    shaped("angles", given, (samples,) if given.ndim < 2 else (samples, "k"), why="to match time_s")
    return given.reshape(samples, -1)
