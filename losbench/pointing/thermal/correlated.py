"""Least squares under errors with memory: an Ornstein-Uhlenbeck process and white noise on top.

Both may stand on any times. With the process of unit variance, whose precision Q is tridiagonal,
and white noise of variance q: C = Q^-1 + q I, so that C^-1 A = (I + q Q)^-1 Q A, all in O(n).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpotrf, dpttrf, dpttrs

from losbench.arrays import Floats

__all__ = ["CorrelatedFit", "Noise", "fit_noise", "generalised", "has_memory"]

_SUBSET, _RUN = 12_288, 512  # rows that tell the noise of a longer record, in runs of so many
_PRIOR_SIGMA = 3.0  # of the logarithms of the noise's parameters, where the record says nothing
_CLEARLY = 9.2  # twice the gain in log-likelihood: 1 % for two parameters more
_AS_WELL = 4.6  # the same of two memories, of which neither is ten times as likely
_DEPENDENT = 1e-10  # relative singular value of a direction of columns that rounding alone makes
_SIMPLEX = np.array([[0.0, 0.0], [0.7, 0.0], [0.0, 1.5]])  # half as far as the starts lie apart
_STEP = 0.1  # in those logarithms, for derivatives


@dataclass(frozen=True)
class Noise:
    """An Ornstein-Uhlenbeck process and white noise.

    Attributes
    ----------
    tau_s : float
        Correlation time; 0 for white noise alone.
    white : float
        Variance of the white noise over that of the process.
    """

    tau_s: float = 0.0
    white: float = 0.0

    def gram(self, columns: Floats, time_s: Floats) -> tuple[Floats, float]:
        """A' C^-1 A and log |C| for columns (n, p)."""
        if self.tau_s <= 0.0:
            return columns.T @ columns, 0.0
        step = np.diff(time_s)
        decay, kept = np.exp(-step / self.tau_s), -np.expm1(-2.0 * step / self.tau_s)
        diagonal, off = np.ones(time_s.size), -decay / kept
        diagonal[:-1] += decay**2 / kept
        diagonal[1:] += 1.0 / kept - 1.0
        product = diagonal[:, None] * columns
        product[:-1] += off[:, None] * columns[1:]
        product[1:] += off[:, None] * columns[:-1]
        factor, lower, _ = dpttrf(1.0 + self.white * diagonal, self.white * off)
        solved, _ = dpttrs(factor, lower, product)
        return columns.T @ solved, float(np.log(factor).sum() + np.log(kept).sum())


@dataclass(frozen=True)
class CorrelatedFit:
    """Generalised least squares and what it rests on.

    Attributes
    ----------
    x, sigma, dof : (p,) arrays
        Unknowns, standard errors, degrees of freedom by Satterthwaite's rule.
    cov : (p, p) array
    noise : Noise
    scale : float
        Standard deviation of the process, or of white noise alone.
    """

    x: Floats
    sigma: Floats
    dof: Floats
    cov: Floats
    noise: Noise
    scale: float


def fit_noise(columns: Floats, y: Floats, time_s: Floats) -> Noise:
    """Noise of y (n,) about columns (n, p) by restricted maximum likelihood.

    Where a short memory and a long one explain the record about as well, the long one is taken: its
    intervals are the wider ones. A record beyond 12 288 rows is judged by runs of 512 rows spread
    over it: rows left out change nothing of the law that the others obey.
    """
    from scipy.optimize import minimize

    n = y.size
    if n > _SUBSET:
        starts = np.linspace(0, n - _RUN, _SUBSET // _RUN).astype(int)
        rows = (starts[:, None] + np.arange(_RUN)).ravel()
        columns, y, time_s = columns[rows], y[rows], time_s[rows]
    both = _upright(columns, y)
    step, span = float(np.median(np.diff(time_s))), float(time_s[-1] - time_s[0])
    low = np.log([0.2 * step, 1e-6])
    high = np.log([max(span, step), 1e6])

    def cost(at: Floats) -> float:
        inside = np.clip(at, low, high)
        beyond = float(np.sum((at - inside) ** 2))
        return _reml(both, time_s, Noise(*np.exp(inside))) + 10.0 * beyond

    taus = np.log(np.geomspace(0.7 * step, max(span / 5.0, step), 6))
    options: Any = {"xatol": 3e-3, "fatol": 1e-3, "maxfev": 200}
    found = []
    for some in (taus[:3], taus[3:]):
        tried = [np.array([tau, ratio]) for tau in some for ratio in (-5.0, 0.0, 3.0)]
        start = min(tried, key=cost)
        options["initial_simplex"] = start + _SIMPLEX
        found.append(minimize(cost, start, method="Nelder-Mead", options=options))
    short, long = sorted(found, key=lambda one: float(one.x[0]))
    best = long if long.fun - short.fun < _AS_WELL else short
    return Noise(*(float(v) for v in np.exp(np.clip(best.x, low, high))))


def has_memory(columns: Floats, y: Floats, time_s: Floats, noise: Noise) -> bool:
    """Whether a noise explains what columns leave of y clearly better than white noise does."""
    both = _upright(columns, y)
    return _reml(both, time_s, Noise()) - _reml(both, time_s, noise) > _CLEARLY


def generalised(
    columns: Floats, y: Floats, time_s: Floats, noise: Noise, *, freedom: bool = True
) -> CorrelatedFit:
    """Solve columns (n, p) x = y (n,) under a noise; its own uncertainty by Satterthwaite's rule.

    dof = 2 v^2 / (g' V g): v the variance of an unknown, g its gradient in the logarithms of scale,
    correlation time and white share, V the inverse Hessian of the restricted likelihood there.
    """
    both, (unit, start) = _safe(columns, y)
    p = columns.shape[1]
    scale2, x, inverse = _solved(*noise.gram(both, time_s), y.size, p)[:3]
    plain = float(y.size - p)
    dof = np.full(p, plain)
    if noise.tau_s > 0.0 and freedom:
        dof = np.minimum(2.0 / _relative_variance(both, time_s, noise, scale2), plain)
    cov = scale2 * inverse / np.outer(unit, unit)
    x = x / unit + start
    return CorrelatedFit(
        x, np.sqrt(np.diag(cov)), np.maximum(dof, 2.0), cov, noise, float(np.sqrt(scale2))
    )


def _safe(columns: Floats, y: Floats) -> tuple[Floats, tuple[Floats, Floats]]:
    """Unit columns with what least squares leaves of y beside them, and how to undo it.

    Products of small remainders lose no digits, which those of y itself would.
    """
    unit = np.linalg.norm(columns, axis=0)
    unit[unit == 0.0] = 1.0
    scaled = columns / unit
    x = np.linalg.lstsq(scaled, y)[0]
    return np.column_stack([scaled, y - scaled @ x]), (unit, x / unit)


def _upright(columns: Floats, y: Floats) -> Floats:
    """Orthonormal columns of the same span with what they leave of y beside them.

    A direction that rounding makes would enter a likelihood by the logarithm of its size.
    """
    unit = np.linalg.norm(columns, axis=0)
    axes, size, _ = np.linalg.svd(columns / np.where(unit > 0, unit, 1.0), full_matrices=False)
    axes = axes[:, size > _DEPENDENT * size[0]]
    return np.column_stack([axes, y - axes @ (axes.T @ y)])


def _solved(gram: Floats, log_det: float, n: int, p: int) -> tuple[float, Floats, Floats, float]:
    """Variance, unknowns, inverse normal matrix, and the restricted -2 log-likelihood."""
    normal, right = gram[:p, :p], gram[:p, p]
    values, vectors = np.linalg.eigh(normal)
    values = np.maximum(values, 1e-13 * values[-1])
    inverse = (vectors / values) @ vectors.T
    x = inverse @ right
    rss = max(float(gram[p, p] - right @ x), 1e-300)
    cost = (n - p) * np.log(rss) + log_det + float(np.log(values).sum())
    return rss / (n - p), x, inverse, cost


def _reml(both: Floats, time_s: Floats, noise: Noise) -> float:
    """The restricted -2 log-likelihood of `_solved`, three times as fast: the Cholesky factor of
    columns and y together ends in the root of what is left.
    """
    n, p = both.shape[0], both.shape[1] - 1
    gram, log_det = noise.gram(both, time_s)
    factor, failed, *_ = dpotrf(gram, lower=True)
    if failed:
        return _solved(gram, log_det, n, p)[3]
    size = np.log(np.diagonal(factor))
    return float(2.0 * ((n - p) * size[p] + size[:p].sum())) + log_det


def _relative_variance(both: Floats, time_s: Floats, noise: Noise, scale2: float) -> Floats:
    """Relative variance (p,) of the variance of each unknown."""
    n, p = both.shape[0], both.shape[1] - 1
    centre = np.log([noise.tau_s, max(noise.white, 1e-9)])

    def at(tau: float, white: float) -> tuple[float, Floats, float]:
        other = Noise(*np.exp(centre + _STEP * np.array([tau, white])))
        found = _solved(*other.gram(both, time_s), n, p)
        rss = found[0] * (n - p)
        return rss, np.log(np.diag(found[2])), found[3] - (n - p) * np.log(rss)

    around = {(i, j): at(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)}

    def minus_log(size: float, i: int, j: int) -> float:
        """Half the restricted -2 log-likelihood at log scale^2 + ``size``."""
        rss, _, rest = around[i, j]
        log_scale = np.log(scale2) + size
        return 0.5 * ((n - p) * log_scale + rss * np.exp(-log_scale) + rest)

    e = np.eye(3, dtype=int)
    centre_value = minus_log(0.0, 0, 0)

    def value(v: Floats) -> float:
        return minus_log(_STEP * float(v[0]), int(v[1]), int(v[2]))

    hessian = np.empty((3, 3))
    for a in range(3):
        hessian[a, a] = value(e[a]) - 2.0 * centre_value + value(-e[a])
        for b in range(a):
            mixed = value(e[a] + e[b]) - value(e[a] - e[b]) - value(e[b] - e[a])
            hessian[a, b] = hessian[b, a] = 0.25 * (mixed + value(-e[a] - e[b]))
    hessian /= _STEP**2
    # Where the record cannot tell process from white noise the likelihood is flat, or no bowl at
    # all: a weak prior keeps the uncertainty of the noise finite.
    values, vectors = np.linalg.eigh(hessian)
    prior = 1.0 / _PRIOR_SIGMA**2
    variance = (vectors / (np.maximum(values, 0.0) + prior)) @ vectors.T
    gradient = np.stack(
        [
            np.ones(p),
            (around[1, 0][1] - around[-1, 0][1]) / (2 * _STEP),
            (around[0, 1][1] - around[0, -1][1]) / (2 * _STEP),
        ]
    )
    return np.einsum("ap,ab,bp->p", gradient, variance, gradient)
