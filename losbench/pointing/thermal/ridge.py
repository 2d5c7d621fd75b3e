"""The sensitivity at rest when one lag is the wrong law: all lags at once, each kept small.

An angle that follows a temperature through many bodies is a sum of many lags with gains of either
sign. Which lags they are a record hardly tells; what their gains add up to, it may.
"""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats
from losbench.pointing.thermal.correlated import Noise

__all__ = ["Ridge", "ridge_sums"]

from dataclasses import dataclass

_GRID = 60  # of the prior's variance
_ROUNDING = 1e-13
_REACH = 7.0  # in its natural logarithm, to either side of the best


@dataclass(frozen=True)
class Ridge:
    """Sums of gains with their errors, (m,) each, and the degrees of freedom of both."""

    total: Floats
    sigma: Floats
    dof: float


def ridge_sums(
    base: Floats, bank: Floats, sums: Floats, y: Floats, time_s: Floats, noise: Noise
) -> Ridge:
    """Sums (m,) of gains over a bank of lagged columns.

    Parameters
    ----------
    base : (n, p) array
        Columns that are free.
    bank : (n, b) array
        Lagged columns, whose gains have one prior N(0, s^2).
    sums : (m, b) array
        Which gains each sum takes.
    y : (n,) array
    time_s : (n,) array
    noise : Noise

    Returns
    -------
    Ridge
        Averaged over s, weighed by its restricted likelihood, so that not knowing s is in sigma.
    """
    unit = np.linalg.norm(base, axis=0)
    size = np.linalg.norm(bank, axis=0).max()
    together = np.column_stack([base / np.where(unit > 0, unit, 1.0), bank / size, y])
    gram, _ = noise.gram(together, time_s)
    p, b = base.shape[1], bank.shape[1]
    values, vectors = np.linalg.eigh(gram[:p, :p])
    keep = values > 1e-13 * values[-1]
    across = gram[p:, :p] @ vectors[:, keep]
    left = gram[p:, p:] - (across / values[keep]) @ across.T  # base projected out
    power, axes = np.linalg.eigh(left[:b, :b])
    # Below the rounding of a sum of squares a direction tells nothing, and must not be believed.
    real = power > _ROUNDING * power[-1]
    power = np.where(real, power, 0.0)
    seen = np.where(real, axes.T @ left[:b, b], 0.0)
    nu = float(y.size - int(keep.sum()))

    def at(log_prior: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """-2 log-likelihood, residual sums, totals and their variances for log(s^2 / sigma^2)."""
        bound = np.exp(-log_prior)[:, None]
        rss = np.maximum(left[b, b] - (seen**2 / (power + bound)).sum(axis=1), 1e-300)
        cost = nu * np.log(rss) + np.log1p(power / bound).sum(axis=1)
        rows = (sums / size) @ axes
        total = (seen / (power + bound)) @ rows.T
        variance = (rss / nu)[:, None] * ((1.0 / (power + bound)) @ (rows**2).T)
        return cost, rss, total, variance

    centre = -np.log(max(power[-1], 1e-300))
    wide = np.linspace(centre - 8.0, centre + 80.0, 177)
    best = wide[int(np.argmin(at(wide)[0]))]
    grid = np.linspace(best - _REACH, best + _REACH, _GRID)
    cost, _, total, variance = at(grid)
    weight = np.exp(-0.5 * (cost - cost.min()))
    weight /= weight.sum()
    mean = weight @ total
    spread = weight @ (variance + (total - mean) ** 2)
    return Ridge(mean, np.sqrt(spread), nu)
