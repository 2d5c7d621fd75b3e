"""Angles, lengths and spreads in the units that people quote them in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import positive

__all__ = [
    "ARCSEC_PER_RAD",
    "MAD_PER_SIGMA",
    "SIGMA_PER_MAD",
    "arcsec_to_rad",
    "px_to_arcsec",
    "rad_to_arcsec",
]

ARCSEC_PER_RAD = 180.0 * 3600.0 / np.pi
MAD_PER_SIGMA = 0.6744897501960817  # median absolute deviation of normal errors: upper quartile
SIGMA_PER_MAD = 1.0 / MAD_PER_SIGMA


def rad_to_arcsec(angle_rad: ArrayLike) -> Floats:
    """Convert radians to arcseconds, any shape.

    >>> float(rad_to_arcsec(np.pi))
    648000.0
    """
    return np.asarray(angle_rad, dtype=np.float64) * ARCSEC_PER_RAD


def arcsec_to_rad(angle_arcsec: ArrayLike) -> Floats:
    """Convert arcseconds to radians, any shape."""
    return np.asarray(angle_arcsec, dtype=np.float64) / ARCSEC_PER_RAD


def px_to_arcsec(shift_px: ArrayLike, *, focal_mm: float, pixel_um: float) -> Floats:
    """Convert a small shift near the axis from pixels to arcseconds, any shape.

    >>> round(float(px_to_arcsec(1.0, focal_mm=260.0, pixel_um=10.0)), 3)
    7.933
    """
    per_px = positive("pixel_um", pixel_um) * 1e-3 / positive("focal_mm", focal_mm)
    return rad_to_arcsec(np.asarray(shift_px, dtype=np.float64) * per_px)
