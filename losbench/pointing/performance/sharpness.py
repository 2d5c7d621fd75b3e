"""What motion does to an image, and how quiet a record can be."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite_or_nan, non_negative, number
from losbench.estimation.allan import allan_deviation

__all__ = ["mtf", "noise_floor"]


def mtf(
    frequency: ArrayLike = 0.5,
    *,
    smear: float = 0.0,
    jitter: float = 0.0,
    sine: float = 0.0,
) -> Floats:
    """Modulation that motion during an exposure leaves of a pattern.

    Parameters
    ----------
    frequency : (...) array, cycles per unit of length
        0.5 cycles per pixel, the Nyquist frequency, unless given.
    smear : float
        Length of a steady motion; a line's rms in a window is the length over sqrt(12).
    jitter : float
        Standard deviation of a Gaussian motion.
    sine : float
        Amplitude of a sinusoid of many cycles.

    Returns
    -------
    (...) array
        sinc(s f) exp(-2 (pi f sigma)^2) J0(2 pi f a), the absolute value.

    Examples
    --------
    >>> [round(float(v), 6) for v in (mtf(smear=1.0), mtf(jitter=0.1), mtf(sine=0.2))]
    [0.63662, 0.95185, 0.903713]
    """
    from scipy.special import j0

    f = non_negative("frequency", frequency)
    length, sigma, amplitude = (
        number(name, value, low=0.0)
        for name, value in (("smear", smear), ("jitter", jitter), ("sine", sine))
    )
    return np.abs(
        np.sinc(length * f)
        * np.exp(-2.0 * (np.pi * f * sigma) ** 2)
        * j0(2.0 * np.pi * f * amplitude)
    )


def noise_floor(series: ArrayLike, *, rate_hz: float) -> dict[str, float]:
    """Noise of one sample, and the best that averaging makes of it.

    Parameters
    ----------
    series : (n,) array, any unit
        Evenly sampled; NaN marks a missing sample.
    rate_hz : float

    Returns
    -------
    dict
        ``sample``: rms of successive differences over sqrt(2). ``allan_minimum`` and ``tau_s``: the
        smallest Allan deviation over averaging times in octaves up to a quarter of the record, and
        where it is: longer averages gain nothing.

    Examples
    --------
    >>> floor = noise_floor(np.random.default_rng(1).standard_normal(4096), rate_hz=1.0)
    >>> round(floor["sample"], 2), floor["tau_s"] > 100
    (1.0, True)
    """
    x = finite_or_nan("series", series, ndim=1)
    if len(x) < 8:
        raise ValueError(f"series must hold at least 8 samples for a noise floor, got {len(x)}")
    rate = number("rate_hz", rate_hz, low=0.0)
    octaves = 2 ** np.arange(int(np.log2(len(x) // 4)) + 1)
    deviation = np.asarray(allan_deviation(x, rate_hz=rate, tau_s=octaves / rate))
    if np.isnan(deviation).all():
        raise ValueError("series must hold two neighbouring samples")
    best = int(np.nanargmin(deviation))
    return {
        "sample": float(deviation[0]),
        "allan_minimum": float(deviation[best]),
        "tau_s": float(octaves[best] / rate),
    }
