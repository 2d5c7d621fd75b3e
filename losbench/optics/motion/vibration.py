"""Body rates of a shaking camera: a constant and a sinusoid on each axis, or a rate series that
somebody measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import (
    choice,
    finite,
    generator,
    integer,
    named_twice,
    number,
    positive,
    shaped,
)

__all__ = ["Motion", "RateSeries", "Vibration", "random_vibration"]


class Motion(Protocol):
    """Anything that tells body rates and their integral; time 0 is the start of the exposure."""

    def rate(self, time_s: ArrayLike) -> Floats:
        """Return the rates (..., t, 3) in rad/s at times (t,)."""

    def angle(self, time_s: ArrayLike) -> Floats:
        """Return the integral of the rates from time 0, (..., t, 3) in rad: what an ideal gyro adds
        up.
        """


@dataclass(frozen=True)
class Vibration:
    """A constant rate and a sinusoid about each axis of the camera: w = constant + amplitude cos(2
    pi f t + phase).

    Parameters
    ----------
    constant_rad_s, amplitude_rad_s : (..., 3) array, rad/s
    frequency_hz : float or array that broadcasts to (..., 3), Hz
    phase_rad : float or array that broadcasts to (..., 3), rad

    Raises
    ------
    ValueError
        If a number is not finite, a frequency not positive, or a shape does not fit.

    Examples
    --------
    >>> shake = Vibration(amplitude_rad_s=[0.0, np.radians(3.0), 0.0], frequency_hz=20.0)
    >>> np.degrees(shake.rate([0.0, 0.025])).round(9).tolist()
    [[0.0, 3.0, 0.0], [0.0, -3.0, 0.0]]
    >>> float(abs(shake.angle([0.05])).max().round(12))  # a whole period leads back
    0.0
    """

    constant_rad_s: ArrayLike = (0.0, 0.0, 0.0)
    amplitude_rad_s: ArrayLike = (0.0, 0.0, 0.0)
    frequency_hz: ArrayLike = 1.0
    phase_rad: ArrayLike = 0.0

    def __post_init__(self) -> None:
        """Check the numbers and give all four one shape."""
        names = ("constant_rad_s", "amplitude_rad_s", "frequency_hz", "phase_rad")
        arrays = [
            (positive if name == "frequency_hz" else finite)(name, getattr(self, name))
            for name in names
        ]
        try:
            together = np.broadcast_arrays(*arrays, np.empty(3))
        except ValueError:
            shapes = ", ".join(str(array.shape) for array in arrays)
            raise ValueError(
                f"{', '.join(names)} must broadcast to one shape (..., 3), got {shapes}"
            ) from None
        for name, array in zip(names, together, strict=False):
            object.__setattr__(self, name, array)

    def rate(self, time_s: ArrayLike) -> Floats:
        """Return the rates (..., t, 3) in rad/s at times (t,)."""
        constant, amplitude, omega, phase = self._parts()
        return constant + amplitude * np.cos(omega * finite("time_s", time_s)[:, None] + phase)

    def angle(self, time_s: ArrayLike) -> Floats:
        """Return the integral of the rates from time 0, (..., t, 3) in rad."""
        constant, amplitude, omega, phase = self._parts()
        time = finite("time_s", time_s)[:, None]
        return constant * time + amplitude / omega * (np.sin(omega * time + phase) - np.sin(phase))

    def _parts(self) -> list[Floats]:
        omega = 2.0 * np.pi * np.asarray(self.frequency_hz)
        return [
            np.asarray(a)[..., None, :]
            for a in (self.constant_rad_s, self.amplitude_rad_s, omega, self.phase_rad)
        ]


@dataclass(frozen=True)
class RateSeries:
    """Body rates as somebody measured them, taken to be linear between the samples.

    Parameters
    ----------
    time_s : (m,) array, seconds
        Increasing; time 0 is the start of the exposure.
    rate_rad_s : (..., m, 3) array, rad/s

    Raises
    ------
    ValueError
        If the shapes do not match, a rate is not finite, or times do not increase; when asked for a
        time outside.

    Examples
    --------
    >>> turn = RateSeries([0.0, 0.5, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, 0.2]])
    >>> turn.angle([0.5, 1.0])[:, 2].round(12).tolist()
    [0.05, 0.15]
    """

    time_s: ArrayLike
    rate_rad_s: ArrayLike

    def __post_init__(self) -> None:
        """Check times and rates."""
        time = finite("time_s", self.time_s, ndim=1)
        rate = finite("rate_rad_s", self.rate_rad_s)
        shaped("rate_rad_s", rate, ("...", len(time), 3), why=f"to match {len(time)} times")
        if len(time) < 2 or (np.diff(time) <= 0).any():
            raise ValueError("time_s must hold at least two times, each later than the one before")
        object.__setattr__(self, "time_s", time)
        object.__setattr__(self, "rate_rad_s", rate)

    def rate(self, time_s: ArrayLike) -> Floats:
        """Return the rates (..., t, 3) in rad/s at times (t,)."""
        return self._integrals(time_s)[0]

    def angle(self, time_s: ArrayLike) -> Floats:
        """Return the integral of the rates from time 0, (..., t, 3) in rad."""
        return self._integrals(time_s)[1] - self._integrals([0.0])[1]

    def _integrals(self, time_s: ArrayLike) -> tuple[Floats, Floats]:
        """Rate at each time, and its integral from the first sample."""
        at, time, rate = (
            finite("time_s", time_s),
            np.asarray(self.time_s),
            np.asarray(self.rate_rad_s),
        )
        if at.min() < time[0] or at.max() > time[-1]:
            raise ValueError(
                f"rates are known from {time[0]:g} to {time[-1]:g} s, not at {at.min():g} to "
                f"{at.max():g} s"
            )
        left = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
        step = np.diff(time)[:, None]
        slope = np.diff(rate, axis=-2) / step
        whole = np.cumsum((rate[..., 1:, :] + rate[..., :-1, :]) * step / 2, axis=-2)
        before = np.concatenate([np.zeros_like(rate[..., :1, :]), whole], axis=-2)
        since = (at - time[left])[:, None]
        now = rate[..., left, :] + slope[..., left, :] * since
        return now, before[..., left, :] + (rate[..., left, :] + now) * since / 2


def random_vibration(
    n: int,
    seed: np.random.Generator | int | None = None,
    *,
    max_rate_rad_s: float,
    frequency_hz: tuple[float, float] = (1.0, 60.0),
    axes: str = "three",
    rng: np.random.Generator | int | None = None,
) -> Vibration:
    """Draw vibrations for n exposures.

    Parameters
    ----------
    n : int
        Number of exposures.
    seed : int or numpy Generator
        Must be given.
    max_rate_rad_s : float, rad/s
    frequency_hz : (low, high), Hz
        Range of the uniform distribution of frequencies.
    axes : "three" or "one"
        "three": independent sinusoids about x, y and z, each amplitude uniform up to the maximum.
        "one": one sinusoid of the full amplitude about an axis that points anywhere.
    rng
        Second word for ``seed``.

    Returns
    -------
    Vibration
        With parameters of shape (n, 3).

    Raises
    ------
    ValueError
        If ``n`` is not a whole number, or a rate or frequency out of range.

    Examples
    --------
    >>> shakes = random_vibration(1000, 7, max_rate_rad_s=0.05)
    >>> bool(abs(shakes.rate([0.0, 0.01])).max() <= 0.05)
    True
    """
    count = integer("n", n, low=0)
    top = number("max_rate_rad_s", max_rate_rad_s, low=0.0)
    low, high = positive("frequency_hz", frequency_hz)
    random = generator(*named_twice("seed", seed, None, rng=rng))
    if choice("axes", axes, ("three", "one")) == "three":
        amplitude = random.uniform(0.0, top, (count, 3))
        size = (count, 3)
    else:
        axis = random.standard_normal((count, 3))
        amplitude = top * axis / np.linalg.norm(axis, axis=1, keepdims=True)
        size = (count, 1)
    return Vibration(
        amplitude_rad_s=amplitude,
        frequency_hz=random.uniform(low, high, size),
        phase_rad=random.uniform(0.0, 2.0 * np.pi, size),
    )
