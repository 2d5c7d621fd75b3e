"""What a record tells of a lag, and whether its law fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats
from losbench.pointing.thermal.correlated import Noise

__all__ = ["LackOfFit", "lack_of_fit", "lag_set", "lag_state"]

_DEVIANCE = 3.841458820694124  # chi-square of one degree of freedom, 95 %
_WEAK = 1.0 / 3.0  # of the record


def lag_set(rss: Floats, n: int, correlation: float) -> Bools:
    """Which lags of a profile (g,) the data allow at 95 %; correlated residuals count for less."""
    deviance = n * np.log(np.maximum(rss, 1e-300) / max(float(rss.min()), 1e-300))
    return deviance * (1.0 - correlation) / (1.0 + correlation) < _DEVIANCE


def lag_state(allowed: Bools, grid: Floats) -> str:
    """State from the set of allowed lags: grid (g,) runs from 0 to the record's length."""
    if allowed[-1]:
        return "not identifiable"
    if allowed[0]:
        return "no lag seen"
    return "weak" if grid[allowed].max() >= _WEAK * grid[-1] else "identified"


@dataclass(frozen=True)
class LackOfFit:
    """Two tests of the law.

    Attributes
    ----------
    f_p_value : float
        Of an F test: do lags beside the fitted one explain more? NaN without a fitted lag.
    neumann_p_value : float
        Of von Neumann's ratio of what the law leaves: is it smooth? NaN under errors with memory,
        which are.
    """

    f_p_value: float
    neumann_p_value: float

    @property
    def rejects(self) -> bool:
        """Whether either rejects the law at 5 % in all."""
        told = [p for p in (self.f_p_value, self.neumann_p_value) if p == p]
        return any(p < 0.05 / len(told) for p in told)


def lack_of_fit(law: Floats, more: Floats, y: Floats, time_s: Floats, noise: Noise) -> LackOfFit:
    """Test a law (n, p) against lags beside it (n, m), under white noise or what it left.

    Under the noise that more lags leave, the test would reject a right law with slow errors in one
    of five records instead of one of twenty.
    """
    from scipy.special import fdtrc, ndtr

    n, p = law.shape
    everything = np.column_stack([law, more, y])
    unit = np.linalg.norm(everything, axis=0)
    gram, _ = noise.gram(everything / np.where(unit > 0, unit, 1.0), time_s)
    plain, rank = _left(gram, p, -1)
    rich, full = _left(gram, p + more.shape[1], -1)
    extra, rest = full - rank, n - full
    f = np.nan
    if extra > 0 and rest > 0 and rich > 0:
        f = float(fdtrc(extra, rest, max(plain - rich, 0.0) / extra / (rich / rest)))
    left = y - law @ np.linalg.lstsq(law, y)[0]
    change = float(np.sum(np.diff(left) ** 2) / np.sum(left**2)) if (left != 0).any() else 2.0
    # Ratio 2 for white residuals, with a variance of 4 (n - 2) / (n^2 - 1).
    neumann = float(ndtr((change - 2.0) / np.sqrt(4.0 * (n - 2) / (n**2 - 1))))
    return LackOfFit(f, neumann if noise.tau_s <= 0.0 else np.nan)


def _left(gram: Floats, p: int, y: int) -> tuple[float, int]:
    """Residual sum of squares of the first p columns, and their rank."""
    values, vectors = np.linalg.eigh(gram[:p, :p])
    keep = values > 1e-12 * values[-1]
    seen = vectors[:, keep].T @ gram[:p, y]
    return max(float(gram[y, y] - np.sum(seen**2 / values[keep])), 0.0), int(keep.sum())
