"""Lags found: a coarse search with all else projected out, then Gauss-Newton in logarithms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Indices
from losbench.estimation.robust import RobustFit
from losbench.estimation.solvers import Solver
from losbench.pointing.thermal.design import Design
from losbench.pointing.thermal.lag import lag_grid

__all__ = ["PointFit", "fit_point", "profile"]

_GRID = 12  # lags tried for each sensor
_SWEEPS = 2
_ROUNDS, _STEPS = 50, 8
_LONGEST_STEP = 0.7  # in the logarithm of a lag
_SETTLED = 1e-6
_SHORTEST = 0.1  # median steps, of the lags tried
_NONE = 1e-3  # of that: a lag so short is none, and Gauss-Newton may get there
_LEAST_LEFT = 1e-13  # share of the sum of squares, below which a fit is perfect


@dataclass(frozen=True)
class PointFit:
    """Unknowns of one axis without their errors.

    ``rows`` (m,) are the samples used, ``fit`` is the solver's at the lags ``tau_s`` (l,). Not
    ``converged`` where the solver is not, or where weights and lags went on changing each other.
    """

    tau_s: Floats
    rows: Indices
    fit: RobustFit
    converged: bool


def fit_point(design: Design, y: Floats, solver: Solver, *, use: Bools | None = None) -> PointFit:
    """Fit one axis (n,) over the rows in ``use``; lags follow the whole record."""
    allowed = design.known & np.isfinite(y)
    rows = np.flatnonzero(allowed if use is None else allowed & use)
    lags = len(design.lags)
    unknowns = len(design.model.labels) + lags
    if rows.size <= unknowns:
        raise ValueError(
            f"angles must hold more than {unknowns} samples with every sensor, to fit as many "
            f"unknowns, got {rows.size}"
        )
    tau = np.zeros(lags)
    fit = solver.fit(design.matrix(tau)[rows], y[rows])
    if not lags:
        return PointFit(tau, rows, fit, bool(fit.converged))
    grid = lag_grid(design.time_s, _GRID, shortest=_SHORTEST)
    tried = [[design.lagged(i, float(tau_s))[rows] for tau_s in grid] for i in range(lags)]
    for _ in range(_SWEEPS):
        for i in range(lags):
            left = _left_over(design, tau, i, y, rows, fit.weights)
            tau[i] = grid[int(np.argmin([left(columns) for columns in tried[i]]))]
        fit = solver.fit(design.matrix(tau)[rows], y[rows])
    limits = np.log([_NONE * grid[0], grid[-1]])
    for _ in range(_ROUNDS):
        before = tau
        tau = _gauss_newton(design, tau, y, rows, fit, limits)
        fit = solver.fit(design.matrix(tau)[rows], y[rows])
        settled = bool(np.abs(np.log(tau / before)).max() < _SETTLED)
        if settled:
            break
    return PointFit(tau, rows, fit, settled and bool(fit.converged))


def profile(
    design: Design, point: PointFit, y: Floats, lag: int, grid: Floats, weights: Floats
) -> Floats:
    """Weighted residual sum of squares (g,) over lags (g,) of one sensor, the others held."""
    left = _left_over(design, point.tau_s, lag, y, point.rows, weights)
    return np.array([left(design.lagged(lag, float(tau))[point.rows]) for tau in grid])


def _left_over(design: Design, tau: Floats, lag: int, y: Floats, rows: Indices, weights: Floats):  # type: ignore[no-untyped-def]
    """Function of one lag's columns (m, d): the sum of squares that a fit with them leaves."""
    place = design.places[lag]
    matrix = design.matrix(tau)[rows]
    root = np.sqrt(weights)
    base = np.delete(matrix, np.r_[place], axis=1) * root[:, None]
    q = np.linalg.qr(base)[0]
    r = y[rows] * root
    r = r - q @ (q.T @ r)
    total = float(r @ r)

    def left(columns: Floats) -> float:
        own = columns * root[:, None]
        own = own - q @ (q.T @ own)
        if own.shape[1] == 1:
            power = float(own[:, 0] @ own[:, 0])
            gained = float(own[:, 0] @ r) ** 2 / power if power > 0 else 0.0
            return total - gained
        return float(np.sum((r - own @ np.linalg.lstsq(own, r)[0]) ** 2))

    return left


def _gauss_newton(
    design: Design, tau: Floats, y: Floats, rows: Indices, fit: RobustFit, limits: Floats
) -> Floats:
    """Lags that leave the least under the weights of a fit."""
    root = np.sqrt(fit.weights)
    right = y[rows] * root
    size = float(right @ right)

    def solve(at: Floats) -> tuple[Floats, float]:
        matrix = design.matrix(at)[rows] * root[:, None]
        unit = np.linalg.norm(matrix, axis=0)
        x = _solve(matrix / unit, right) / unit
        return x, float(np.sum((right - matrix @ x) ** 2))

    x, cost = solve(tau)
    for _ in range(_STEPS):
        if cost <= _LEAST_LEFT**2 * size:
            break
        slopes = design.slopes(tau, x)[rows] * root[:, None]
        both = np.column_stack([design.matrix(tau)[rows] * root[:, None], slopes])
        unit = np.linalg.norm(both, axis=0)
        unit[unit == 0.0] = 1.0
        step = (_solve(both / unit, right) / unit)[-tau.size :]
        step = np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        for _ in range(6):
            new = np.exp(np.clip(np.log(tau) + step, *limits))
            new_x, new_cost = solve(new)
            if new_cost <= cost:
                break
            step = 0.5 * step
        else:
            break
        moved = float(np.abs(np.log(new / tau)).max())
        tau, x, cost = new, new_x, new_cost
        if moved < _SETTLED:
            break
    return tau


def _solve(A: Floats, y: Floats) -> Floats:
    """Least squares through the small triangle: columns of a search may be all but parallel."""
    q, r = np.linalg.qr(A)
    x: Floats = np.linalg.lstsq(r, q.T @ y, rcond=1e-13)[0]
    return x
