"""How well a variance is known from one record of a series with memory."""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats, Ints

__all__ = ["variance_sampling"]


# the variance of the mean, put back, lengthens the memory, which changes the variance of the mean
_MEAN_ROUNDS = 2


def variance_sampling(series: Floats) -> tuple[Floats, Floats]:
    """Return what the record's own mean took from the variance along axis 0, and the variance's
    standard error.

    With the autocovariance C(k), summed up to where it first turns negative, the mean of n samples
    has the variance v = (C(0) + 2 sum C(k)) / n, and the variance itself the variance 2 (C(0)^2 + 2
    sum C(k)^2) / n for normal errors.

    Parameters
    ----------
    series : (n, ...) array
        NaN marks a missing sample.

    Returns
    -------
    two (...) arrays, unit of ``series`` squared

    Examples
    --------
    >>> white = np.random.default_rng(1).standard_normal(10_000)
    >>> [round(float(v), 4) for v in variance_sampling(white)]
    [0.0001, 0.0141]
    """
    covariance, count = _autocovariance(series)
    lost = np.zeros_like(covariance[0])
    for _ in range(_MEAN_ROUNDS):
        kept = _until_negative(covariance + lost)
        lost = np.minimum((2.0 * kept.sum(axis=0) - kept[0]) / count, covariance[0])
    kept = _until_negative(covariance + lost)
    return lost, np.sqrt(2.0 * (2.0 * (kept**2).sum(axis=0) - kept[0] ** 2) / count)


def _autocovariance(x: Floats) -> tuple[Floats, Ints]:
    """Autocovariance at every lag with pairs in it, and the number of samples."""
    present = ~np.isnan(x)
    products = _lagged_products(np.where(present, x - np.nanmean(x, axis=0), 0.0))
    if present.all():  # no transform is needed to count pairs
        pairs = np.arange(len(x), 0.0, -1.0).reshape(-1, *(1,) * (x.ndim - 1))
    else:
        pairs = _lagged_products(present.astype(np.float64))
    return np.where(pairs > 0.5, products / np.maximum(pairs, 1.0), 0.0), np.count_nonzero(
        present, axis=0
    )


def _lagged_products(series: Floats) -> Floats:
    """Sums over all pairs of samples that are 0, 1, 2 ... samples apart, by FFT."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * len(series) - 1, real=True)
    power = np.abs(rfft(series, size, axis=0)) ** 2
    return irfft(power, size, axis=0)[: len(series)]


def _until_negative(covariance: Floats) -> Floats:
    return np.where(np.logical_and.accumulate(covariance > 0, axis=0), covariance, 0.0)
