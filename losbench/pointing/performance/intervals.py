"""How well a mean square is known from one record."""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats

__all__ = ["chi2_interval", "freedom", "mean_variance"]

_SOKAL = 6.0  # times the autocorrelation time: where its own sum ends
_VALUES = 2**15


def mean_variance(series: Floats) -> float:
    """Variance of the mean of a correlated series (n,), by Sokal's window.

    Sokal, Monte Carlo Methods in Statistical Mechanics (1989): the autocovariances are summed up to
    the first lag of six autocorrelation times.
    """
    # Means of blocks have the same mean, and few of them tell its variance as well as all samples.
    block = max(len(series) // _VALUES, 1)
    about = series[: len(series) // block * block].reshape(-1, block).mean(axis=1)
    about = about - about.mean()
    size = 1 << (2 * len(about) - 1).bit_length()
    power = np.abs(np.fft.rfft(about, size)) ** 2
    covariance = np.fft.irfft(power, size)[: len(about)] / len(about)
    if covariance[0] <= 0:
        return 0.0
    time = 2.0 * np.cumsum(covariance / covariance[0]) - 1.0
    # All lags of a series about its own mean add up to nothing, so there is an end.
    ends = np.arange(len(time)) >= 0.5 * _SOKAL * time
    blocks = float(max(time[np.argmax(ends)], 1.0))
    return float(covariance[0]) * blocks / len(about)


def freedom(
    squares: Floats, density: Floats, step_Hz: float, record_s: float, k: int
) -> tuple[float, float]:
    """Degrees of freedom of a mean square by its spectrum and by its windows.

    The first knows long memories that a record shows few times, for Gaussian errors; the second
    knows heavy tails. The smaller of both is the one to use.

    Parameters
    ----------
    squares : (windows,) array
        The square of each window.
    density : (f,) array
        Weighted one-sided spectrum.
    step_Hz, record_s : float
        Step of the frequencies, length of the record.
    k : int
        Segments that the spectrum is a mean of.
    """
    power, square = density.sum() * step_Hz, (density**2).sum() * step_Hz
    # The square of an estimated density is too large by its own variance. Hann windows that overlap
    # by half have a correlation of 1/6, their powers of its square (Welch 1967).
    square /= 1.0 + (1.0 + 2.0 / 36.0) / k
    by_spectrum = 2.0 * record_s * power**2 / square if square > 0 else np.inf
    mean, error = float(squares.mean()), mean_variance(squares)
    by_windows = 2.0 * mean**2 / error if error > 0 else np.inf
    return by_spectrum, by_windows


def chi2_interval(square: float, nu: float, confidence: float) -> Floats:
    """Interval of the root of a mean square with ``nu`` degrees of freedom; to infinity below 2."""
    from scipy.special import chdtri, gammaincinv

    if not np.isfinite(nu):
        return np.array([np.sqrt(square)] * 2)
    tail = 0.5 * (1.0 - confidence)
    low = square * nu / chdtri(nu, tail)
    bottom = 2.0 * gammaincinv(0.5 * nu, tail)
    return np.sqrt(np.array([low, square * nu / bottom if bottom > 0 else np.inf]))
