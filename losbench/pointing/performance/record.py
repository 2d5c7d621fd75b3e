"""What a record, its windows and its spectrum say of each metric."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Floats
from losbench.pointing.performance.intervals import chi2_interval, freedom
from losbench.pointing.performance.spectrum import spectrum, weights
from losbench.pointing.performance.windows import WindowStatistics

__all__ = ["Metric", "Record"]

_NAMES = ("ape", "mpe", "rpe", "pde", "smear", "jitter")
_FEWEST = 2.5  # degrees of freedom below which no interval is told
_FOR_JITTER = 3  # samples of a window: two lie on their line, whatever they are
_ROUNDING = 1e-15  # of the bias: what a mean of equal numbers may be off by
_LINE = 0.25  # degrees of freedom by spectrum over those by windows, below which a line stands out


@dataclass(frozen=True)
class Metric:
    """One pointing metric of one axis or of k axes.

    Attributes
    ----------
    value : (...) array
        Root mean square, unit of the angles.
    interval : (..., 2) array
        Its confidence interval; NaN where the record cannot tell.
    dof : (...) array
        Degrees of freedom of the square.
    """

    value: Floats
    interval: Floats
    dof: Floats


class Record:
    """A record with its windows and its spectrum, and what they say of every metric."""

    def __init__(
        self,
        series: Floats,
        pieces: list[slice],
        step_s: float,
        samples: int,
        apart: int | None,
        found: WindowStatistics,
        level: float,
    ) -> None:
        self.series, self.pieces, self.step_s = series, pieces, step_s
        self.samples, self.found, self.level = samples, found, level
        self.present = np.concatenate([series[piece] for piece in pieces])
        self.bias = self.present.mean(axis=0)
        frequency, density, self.segments = spectrum(series - self.bias, pieces, step_s, samples)
        self.density = frequency, density
        self.weights = weights(frequency, step_s, samples, apart)
        self.conservative: set[str] = set()

    def metrics(self, route: str) -> dict[str, Metric]:
        """Every metric but the PRE."""
        by_axis = [
            {name: self._metric(name, axis, route) for name in _NAMES}
            for axis in range(self.series.shape[1])
        ]
        return {
            name: Metric(*(np.array([axis[name][i] for axis in by_axis]) for i in range(3)))
            for name in by_axis[0]
        }

    def _metric(self, name: str, axis: int, route: str) -> tuple[float, Floats, float]:
        nothing = (np.nan, np.full(2, np.nan), np.nan)
        if name not in self.weights or (name == "jitter" and self.samples < _FOR_JITTER):
            return nothing
        frequency, density = self.density
        part = density[:, axis] * self.weights[name]
        step_Hz = float(frequency[1] - frequency[0]) if frequency.size > 1 else np.inf
        bias = self.bias[axis] if name in {"ape", "mpe"} else 0.0
        squares: Floats
        if name == "ape":
            squares = (self.present[:, axis] - bias) ** 2
        elif name == "mpe":
            squares = (self.found.mean[:, axis] - bias) ** 2
        else:
            squares = getattr(self.found, name)[:, axis]
        if not len(squares):
            return nothing
        square = float(squares.mean()) if route == "windows" else float(part.sum() * step_Hz)
        if square <= (_ROUNDING * self.bias[axis]) ** 2:
            return float(np.abs(bias)), np.full(2, np.abs(bias)), np.inf
        by_spectrum, by_windows = freedom(
            squares, part, step_Hz, len(self.present) * self.step_s, self.segments
        )
        if by_spectrum < _LINE * by_windows:
            self.conservative.add(name)
        nu = min(by_spectrum, by_windows)
        if bias:
            # The bias adds its square, and its own error, which the spectrum at rest tells.
            error = density[1, axis] / (2.0 * len(self.present) * self.step_s)
            variance = 2.0 * square**2 / nu + 4.0 * bias**2 * error
            square += bias**2
            nu = 2.0 * square**2 / variance
        if not nu > _FEWEST:
            return float(np.sqrt(square)), np.full(2, np.nan), nu
        nu *= 1.0 - 2.0 / nu
        return float(np.sqrt(square)), chi2_interval(square, nu, self.level), nu

    def notes(self) -> tuple[str, ...]:
        """What the reader of the metrics must know."""
        short = (
            ("Windows of two samples have no jitter: both lie on their line.",)
            if self.samples < _FOR_JITTER
            else ()
        )
        if not self.conservative:
            return short
        names = ", ".join(name for name in self.weights if name in self.conservative)
        return (
            *short,
            f"The intervals of {names} are conservative: one line of the spectrum holds most of "
            "their power, and it is known better than noise of that width would be.",
        )
