"""Percentiles of an error with intervals, and half-cones of a Gaussian one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite_or_nan, number
from losbench.pointing.performance.intervals import mean_variance

__all__ = ["error_percentile", "half_cone"]

_FEWEST_BEYOND = 10.0  # independent samples beyond a percentile, for an interval to hold


def error_percentile(
    error: ArrayLike, probability: float, *, confidence: float = 0.95
) -> tuple[float, Floats]:
    """Value below which a share of the errors lies, and its interval.

    Parameters
    ----------
    error : (n,) array, any unit
        In order of time; NaN marks a missing one.
    probability : float
    confidence : float
        Of the interval: order statistics at the limits of Wilson's interval for as many
        independent samples as the autocorrelation of "below or not" leaves.

    Returns
    -------
    value, (2,) array
        NaN where fewer than ten independent samples lie beyond the percentile: what so few say of
        it is not to be trusted.

    Raises
    ------
    ValueError
        If a probability is not between 0 and 1.

    Examples
    --------
    >>> error = np.abs(np.random.default_rng(1).standard_normal(10_000))
    >>> value, interval = error_percentile(error, 0.95)
    >>> bool(interval[0] < 1.96 < interval[1])
    True
    """
    x = finite_or_nan("error", error, ndim=1)
    x = x[np.isfinite(x)]
    p = number("probability", probability, low=0.0, high=1.0)
    level = number("confidence", confidence, low=0.0, high=1.0)
    if x.size < 2:
        return np.nan, np.full(2, np.nan)
    value = float(np.quantile(x, p))
    beyond = mean_variance((x <= value).astype(np.float64))
    independent = p * (1.0 - p) / beyond if beyond > 0 else 0.0
    if independent * min(p, 1.0 - p) < _FEWEST_BEYOND:
        return np.nan, np.full(2, np.nan)
    from scipy.special import ndtri

    z = float(ndtri(0.5 + 0.5 * level))
    share = 1.0 + z**2 / independent
    centre = (p + 0.5 * z**2 / independent) / share
    half = z / share * np.sqrt(p * (1.0 - p) / independent + 0.25 * (z / independent) ** 2)
    return value, np.quantile(x, [max(centre - half, 0.0), min(centre + half, 1.0)])


def half_cone(sigma: ArrayLike, probability: float = 0.95) -> float:
    """Radius about zero that holds a share of a two-axis Gaussian error.

    Parameters
    ----------
    sigma : (2,) array, any unit
        Standard deviations of the two axes, independent and without a bias.
    probability : float

    Returns
    -------
    float, same unit

    Raises
    ------
    ValueError
        If a sigma is negative or both are zero, or the probability is not between 0 and 1.

    Notes
    -----
    The Gaussian integrated over a circle: across the wide axis by quadrature, across the narrow one
    in closed form (an error function).

    Examples
    --------
    >>> [round(half_cone(s), 5) for s in ((1.0, 1.0), (1.0, 0.5), (1.0, 0.0))]
    [2.44775, 2.03586, 1.95996]
    """
    from scipy.integrate import quad
    from scipy.optimize import brentq
    from scipy.special import erf

    pair = np.sort(np.asarray(sigma, dtype=np.float64))
    if pair.shape != (2,) or not np.isfinite(pair).all() or pair[0] < 0 or pair[1] <= 0:
        raise ValueError(f"sigma must be two numbers, not negative, one positive, got {sigma!r}")
    p = number("probability", probability, low=0.0, high=1.0)
    small, large = pair

    def share(radius: float) -> float:
        """Share within: the narrow axis integrated in closed form, the wide one by quadrature."""

        def slice_at(angle: float) -> float:
            x = radius * np.sin(angle)
            other = radius * np.cos(angle)
            narrow = erf(other / (np.sqrt(2.0) * small)) if small > 0 else 1.0
            return float(narrow * np.exp(-0.5 * (x / large) ** 2) * other)

        whole = quad(slice_at, 0.0, 0.5 * np.pi, epsabs=1e-12, epsrel=1e-12, limit=400)[0]
        return float(np.sqrt(2.0 / np.pi) / large * whole)

    return float(brentq(lambda r: share(r) - p, 0.0, 12.0 * large, xtol=1e-10 * large))
