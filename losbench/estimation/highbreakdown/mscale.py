"""A scale of residuals that almost half of them cannot carry away."""

from __future__ import annotations

from functools import cache

import numpy as np

from losbench.arrays import Floats
from losbench.estimation.highbreakdown.search import Search, Units
from losbench.estimation.influence import normal_mean
from losbench.estimation.losses import Bisquare
from losbench.estimation.robust.problem import Problem
from losbench.units import MAD_PER_SIGMA

__all__ = ["MScale"]


class MScale:
    """M-scale s of whole units: sum rho(u / s) = (m - p / g) rho(inf) / 2, with Tukey's bisquare; g
    rows to a unit.

    Parameters
    ----------
    problem : Problem
        What the residuals belong to.
    units : Units
        Of which u is the root mean square residual.
    survive : int
        Bad units that must not carry the scale away. Beyond (m - p / g) / 2 of them the right-hand
        side gives way.
    """

    def __init__(self, problem: Problem, units: Units, survive: int = 0) -> None:
        self._units = units
        self._loss = _half(units.rows)
        self._floor = problem.floor[:, None]
        free = np.maximum(len(units.sizes) - problem.rank / units.rows, 0.5)
        # A scale of m residuals of which p / g were fitted to zero: R's lmrob counts likewise.
        self._wanted = (np.maximum(0.5 * free, survive + 0.25) * self._loss.c**2 / 6.0)[:, None]
        self._half = units.majority(int(problem.rank.max())) - 1

    def start(self, residuals: Floats) -> Floats:
        """First guess (B, k) of the scale of residuals (B, k, n): their median, the unknowns
        allowed for.
        """
        sizes = self._sizes(residuals)
        return np.maximum(
            np.partition(sizes, self._half, axis=-1)[..., self._half] / MAD_PER_SIGMA, self._floor
        )

    def better(self, residuals: Floats, size: Floats, rounds: int = 100) -> Floats:
        """Improve the scale (B, k) by fixed-point steps until it settles."""
        sizes = self._sizes(residuals)
        for _ in range(rounds):  # s^2 <- s^2 mean rho / wanted: linear, but from anywhere
            before, size = size, self._next(sizes, size)
            if (np.abs(size - before) <= 1e-12 * size).all():
                break
        return size

    def step(self, search: Search, z: Floats, size: Floats) -> tuple[Floats, Floats]:
        """Return coordinates (B, k, p) reweighted by a better scale, and that scale."""
        sizes = self._sizes(search.residuals(z))
        size = self._next(sizes, size)
        return search.fits(self._units.spread(self._loss.weights(sizes / size[..., None]))), size

    def _sizes(self, residuals: Floats) -> Floats:
        return np.sqrt(self._units.sums(residuals**2) / self._units.sizes)

    def _next(self, sizes: Floats, size: Floats) -> Floats:
        with np.errstate(over="ignore"):
            total = self._loss.rho(sizes / size[..., None]).sum(axis=-1)
        return np.maximum(size * np.sqrt(total / self._wanted), self._floor)


@cache
def _half(rows: int) -> Bisquare:
    """Bisquare whose mean loss on normal errors is half of its greatest: c = 1.5476 for single
    rows.
    """
    from scipy.optimize import brentq

    def excess(c: float) -> float:
        return normal_mean(Bisquare(c).rho, rows=rows, corners=(c,)) - c**2 / 12.0

    return Bisquare(brentq(excess, 0.1, 10.0, xtol=1e-12))
