"""The overlapping Allan deviation, how well it is known, and which noise it shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats, Ints
from losbench.checks import boolean, finite_or_nan, number, positive

__all__ = ["AllanDeviation", "allan_deviation"]

_NOISES = {2: "white phase", 1: "flicker phase", 0: "white", -1: "flicker", -2: "random walk"}
_FEWEST_MEANS = 128  # to tell the noise; longer averaging times keep what was told last


@dataclass(frozen=True)
class AllanDeviation:
    """Allan deviations with intervals.

    Attributes
    ----------
    tau_s, deviation, dof : (k,) arrays
        Averaging times as rounded to whole samples, deviations, degrees of freedom.
    interval : (k, 2) array
        Confidence intervals; NaN where there is no complete pair.
    noise : tuple of str
        Noise of each averaging time: "white" and "random walk" of the readings themselves, flicker
        between them; "white phase" and "flicker phase" where the readings are differences.
    """

    tau_s: Floats
    deviation: Floats
    interval: Floats
    dof: Floats
    noise: tuple[str, ...]


@overload
def allan_deviation(
    series: ArrayLike,
    *,
    rate_hz: float,
    tau_s: ArrayLike,
    errors: Literal[False] = ...,
    confidence: float = ...,
) -> Floats: ...
@overload
def allan_deviation(
    series: ArrayLike,
    *,
    rate_hz: float,
    tau_s: ArrayLike,
    errors: Literal[True],
    confidence: float = ...,
) -> AllanDeviation: ...
def allan_deviation(
    series: ArrayLike,
    *,
    rate_hz: float,
    tau_s: ArrayLike,
    errors: bool = False,
    confidence: float = 0.95,
) -> Floats | AllanDeviation:
    """Overlapping Allan deviation of a series of readings.

    Parameters
    ----------
    series : (n,) array, any unit
        Evenly sampled readings. Pairs of averages that touch a NaN are left out, never
        interpolated.
    rate_hz : float
        Sampling rate.
    tau_s : (k,) array
        Averaging times in seconds, rounded to whole samples.
    errors : bool
        Return an `AllanDeviation` with intervals instead.
    confidence : float
        Of the intervals.

    Returns
    -------
    (k,) array, same unit as ``series``, or AllanDeviation
        NaN for an averaging time with no complete pair. At ``1 / rate_hz`` it is the root mean
        square of successive differences over sqrt(2): the noise equivalent angle of ren2023.

    Raises
    ------
    ValueError
        If ``series`` is empty or not one-dimensional, or a rate or time is not positive.

    Notes
    -----
    Riley, Handbook of Frequency Stability Analysis, NIST SP 1065: eq. (10); degrees of freedom by
    table 5, for the noise that the lag-1 autocorrelation of the averages tells (section 5.5.2).

    Examples
    --------
    >>> allan_deviation([1.0, -1.0, 1.0, -1.0], rate_hz=8.0, tau_s=[0.125]).round(6).tolist()
    [1.414214]
    >>> white = np.random.default_rng(1).standard_normal(4096)
    >>> found = allan_deviation(white, rate_hz=1.0, tau_s=[1, 16], errors=True)
    >>> found.noise, found.interval[0].round(2).tolist()
    (('white', 'white'), [0.98, 1.03])
    """
    y = finite_or_nan("series", series, ndim=1)
    rate = positive("rate_hz", rate_hz)
    samples = np.maximum(1, np.rint(positive("tau_s", tau_s) * rate)).astype(int)
    present = ~np.isnan(y)
    # Running sums make every average one subtraction, whatever tau, of numbers kept small by taking
    # the mean out; counts tell which averages are complete.
    centred = np.where(present, y - (y[present].mean() if present.any() else 0.0), 0.0)
    total = np.concatenate([[0.0], np.cumsum(centred)])
    count = np.concatenate([[0], np.cumsum(present)])
    deviation = np.array([_allan(total, count, m) for m in samples])
    if not boolean("errors", errors):
        return deviation
    level = number("confidence", confidence, low=0.0, high=1.0)
    whole = int(count[-1])
    noise = _noises(centred[present], samples)
    dof = np.array([_freedom(a, whole + 1, m) for a, m in zip(noise, samples, strict=True)])
    dof[np.isnan(deviation)] = np.nan
    from scipy.special import chdtri

    tails = 0.5 + 0.5 * level * np.array([-1.0, 1.0])
    interval = deviation[:, None] * np.sqrt(dof[:, None] / chdtri(dof[:, None], tails))
    names = tuple(_NOISES[a] for a in noise)
    return AllanDeviation(samples / float(rate), deviation, interval, dof, names)


def _allan(total: Floats, count: Ints, m: int) -> float:
    mean = (total[m:] - total[:-m]) / m
    complete = count[m:] - count[:-m] == m
    change = (mean[m:] - mean[:-m])[complete[m:] & complete[:-m]]
    return float(np.sqrt(0.5 * np.mean(change**2))) if change.size else np.nan


def _noises(series: Floats, samples: Ints) -> list[int]:
    """Power-law exponent of each averaging time."""
    found: dict[int, int] = {}
    last = 0
    for m in sorted(set(samples.tolist())):
        blocks = len(series) // m
        if blocks >= _FEWEST_MEANS:
            last = _exponent(series[: blocks * m].reshape(blocks, m).mean(axis=1))
        found[m] = last
    return [found[m] for m in samples.tolist()]


def _exponent(means: Floats) -> int:
    """Exponent by the lag-1 autocorrelation, of differences where it is near that of a walk."""
    half, differenced = _half(means), 0
    if half >= 0.25:
        half, differenced = _half(np.diff(means)), 2
    return int(np.clip(-np.rint(2.0 * half) - differenced, -2, 2))


def _half(means: Floats) -> float:
    """Half the slope of the spectrum, its sign changed, as far as one autocorrelation tells."""
    about = means - means.mean()
    total = float(about @ about)
    r = float(about[1:] @ about[:-1]) / total if total > 0 else 0.0
    return r / (1.0 + r)


def _freedom(exponent: int, n: int, m: int) -> float:
    """Degrees of freedom of ``n`` phases at ``m`` samples an average (SP 1065, table 5)."""
    if n <= 2 * m:
        return np.nan
    if exponent == 2:
        return (n + 1) * (n - 2 * m) / (2 * (n - m))
    if exponent == 1:
        product = np.log((n - 1) / (2 * m)) * np.log((2 * m + 1) * (n - 1) / 4)
        return float(np.exp(np.sqrt(product)))
    if exponent == 0:
        return (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)
    if exponent == -1:
        return 2 * (n - 2) ** 2 / (2.3 * n - 4.9) if m == 1 else 5 * n**2 / (4 * m * (n + 3 * m))
    return (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / (n - 3) ** 2
