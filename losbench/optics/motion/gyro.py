"""A strapdown gyro: angle increments at its own rate, with the errors that data sheets quote."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, generator, integer, named_twice, number, positive
from losbench.optics.motion.vibration import Motion

__all__ = ["Gyro"]


_RAD_S_PER_DEG_H = np.radians(1.0) / 3600.0
_RAD_RT_S_PER_DEG_RT_H = np.radians(1.0) / 60.0


@dataclass(frozen=True, kw_only=True)
class Gyro:
    """What a gyro makes of a motion.

    Parameters
    ----------
    rate_hz : float
        Increments per second.
    bias_deg_h : float or (..., 3) array, deg/h
        Zero offset of each axis.
    angle_random_walk_deg_rt_h : float, deg/sqrt(h)
        White noise of the rate.
    scale_factor_ppm : float or (3,) array
        Relative error of the scale.
    misalignment_arcsec : (3,) array
        Small rotation of the gyro's axes against the camera's.
    time_offset_s : float, seconds
        By how much the gyro's clock is late: its first increment begins that long after the
        exposure.

    Raises
    ------
    ValueError
        If a parameter is not finite or out of range.

    Examples
    --------
    >>> from losbench.optics.motion.vibration import Vibration
    >>> turn = Vibration(constant_rad_s=[0.0, 0.01, 0.0])
    >>> Gyro(rate_hz=200.0).increments(turn, 0.025)[:, 1].round(12).tolist()
    [5e-05, 5e-05, 5e-05, 5e-05, 5e-05]
    """

    rate_hz: float = 200.0
    bias_deg_h: ArrayLike = 0.0
    angle_random_walk_deg_rt_h: float = 0.0
    scale_factor_ppm: ArrayLike = 0.0
    misalignment_arcsec: ArrayLike = (0.0, 0.0, 0.0)
    time_offset_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        positive("rate_hz", number("rate_hz", self.rate_hz))
        number("angle_random_walk_deg_rt_h", self.angle_random_walk_deg_rt_h, low=0.0)
        number("time_offset_s", self.time_offset_s)
        for name in ("bias_deg_h", "scale_factor_ppm", "misalignment_arcsec"):
            array = finite(name, getattr(self, name))
            if array.shape[-1:] not in ((), (1,), (3,)):
                raise ValueError(
                    f"{name} must be a number or have shape (..., 3), got {array.shape}"
                )

    def increments(
        self,
        motion: Motion,
        exposure_s: float,
        seed: np.random.Generator | int | None = None,
        *,
        margin: int = 0,
        rng: np.random.Generator | int | None = None,
    ) -> Floats:
        """Measure the angle increments of an exposure.

        Parameters
        ----------
        motion : Motion
            E.g. a Vibration.
        exposure_s : float, seconds
        seed : int or numpy Generator
            Needed for a random walk.
        margin : int
            How many increments more to take before the exposure, and as many after it.
        rng
            Second word for ``seed``.

        Returns
        -------
        (..., k, 3) array, rad
            Enough increments of 1 / ``rate_hz`` to span the exposure.

        Raises
        ------
        ValueError
            If the exposure is not positive, or a random walk is asked for without ``seed``.
        """
        exposure = float(positive("exposure_s", number("exposure_s", exposure_s)))
        before = integer("margin", margin, low=0)
        interval = 1.0 / self.rate_hz
        inside = int(np.ceil(exposure * self.rate_hz - 1e-9))
        edges = np.arange(-before, inside + before + 1) * interval + self.time_offset_s
        true = np.diff(motion.angle(edges), axis=-2)
        tilt = np.radians(finite("misalignment_arcsec", self.misalignment_arcsec) / 3600.0)
        seen = (true + np.cross(true, tilt)) * (
            1.0 + 1e-6 * finite("scale_factor_ppm", self.scale_factor_ppm)
        )
        bias = finite("bias_deg_h", self.bias_deg_h) * _RAD_S_PER_DEG_H * interval
        measured = seen + (bias[..., None, :] if bias.ndim else bias)
        if self.angle_random_walk_deg_rt_h:
            word, source = named_twice("seed", seed, None, rng=rng)
            if source is None:
                raise ValueError("seed must be given for a gyro with an angle random walk")
            walk = self.angle_random_walk_deg_rt_h * _RAD_RT_S_PER_DEG_RT_H * np.sqrt(interval)
            measured = measured + walk * generator(word, source).standard_normal(measured.shape)
        return measured
