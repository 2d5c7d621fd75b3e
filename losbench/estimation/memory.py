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
    centred = np.where(present, x - np.nanmean(x, axis=0), 0.0)
    size = 1 << (2 * len(x) - 1).bit_length()
    products, pairs = (
        np.fft.irfft(np.abs(np.fft.rfft(series, size, axis=0)) ** 2, size, axis=0)[: len(x)]
        for series in (centred, present.astype(np.float64))
    )
    return np.where(pairs > 0.5, products / np.maximum(pairs, 1.0), 0.0), np.count_nonzero(
        present, axis=0
    )


def _until_negative(covariance: Floats) -> Floats:
    return np.where(np.logical_and.accumulate(covariance > 0, axis=0), covariance, 0.0)
