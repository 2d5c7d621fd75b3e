"""How noisy the pixels of a window are, which decides every predicted error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Pixels
from losbench.imaging.background import Plane
from losbench.imaging.columns import Templates
from losbench.imaging.detector import Detector

__all__ = ["PixelNoise", "peak_reading", "pixel_noise"]


@dataclass(frozen=True)
class PixelNoise:
    """Variance of the pixels of M windows, ``floor + per_dn * signal``, and of the background plane
    taken off them.

    Parameters
    ----------
    floor : (M,) array, DN squared
    per_dn : float, DN
        Inverse of the gain; 0 if it is not known.
    plane : (M, 3) array
        Variances of the plane's level, DN squared, and of its slopes along x and y, DN squared per
        pixel squared.
    """

    floor: Floats
    per_dn: float
    plane: Floats

    def of(self, some: NDArray[Any] | slice) -> PixelNoise:
        """Return that of some of the windows."""
        return PixelNoise(self.floor[some], self.per_dn, self.plane[some])

    def unit(self, flux: Floats) -> Floats:
        """Variance (M,) under all the light of a spot, in which the others are counted."""
        return self.floor + self.per_dn * np.maximum(np.nan_to_num(flux), 0.0)

    def relative(self, flux: Floats, at: Templates) -> Pixels | None:
        """Variance (M, S, S) of the pixels under a template with that flux, in those units; None
        where it is the same for all.
        """
        if not self.per_dn:
            return None
        unit = self.unit(flux)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Frames without noise still need weights, though any will do.
            flat = np.where(unit > 0, self.floor / unit, 1.0)
        light = at.light
        light *= (1.0 - flat).astype(light.dtype)[:, None, None]
        light += np.maximum(flat, 1e-6).astype(light.dtype)[:, None, None]
        return light


def pixel_noise(
    plane: Plane, detector: Detector | None, rounding: float, last_digit: Floats
) -> PixelNoise:
    """Variance of the pixels on that background, from the detector or else from the ring.

    ``rounding`` is the least variance of a reading that is rounded, DN squared, 0 for readings of
    a float type, whose ``last_digit`` (M,) is then known.
    """
    if detector is None:
        # Frames without any noise are known to their last digit, not to nothing.
        digit = 0.0 if rounding else last_digit
        floor, per_dn = np.maximum(plane.scatter**2, rounding + digit**2), 0.0
    else:
        floor, per_dn = detector.variance_dn(plane.level), 1.0 / detector.gain_e_per_dn
    of_plane = np.empty((len(floor), 3))
    of_plane[:, 0] = plane.level_variance * floor
    of_plane[:, 1:] = plane.slope_variance * floor[:, None]
    return PixelNoise(floor, per_dn, of_plane)


def peak_reading(raw: Pixels, missing: Bools | None) -> Floats:
    """Highest reading of each stamp, of the pixels that were read."""
    pixels = raw.reshape(-1, raw.shape[1] * raw.shape[2])
    top = pixels.max(axis=1) if missing is None else np.nan_to_num(pixels).max(axis=1)
    return top.astype(np.float64)
