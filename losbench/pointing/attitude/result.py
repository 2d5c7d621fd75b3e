"""What an attitude solve hands back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Ints
from losbench.units import rad_to_arcsec

__all__ = ["AttitudeFit"]


@dataclass(frozen=True)
class AttitudeFit:
    """Angles of each solve, and how far to trust them; a solve takes one frame, or K with stack=K.

    Attributes
    ----------
    angles : (..., 3) array
        Rotation vector (alpha, beta, gamma), radians; NaN where too few spots were seen.
    cov : (..., 3, 3) array
        Covariance of the angles, radians squared.
    residuals : (..., n, 2) array
        Model minus shift of every spot of every frame, unit of the shifts; NaN where the spot is
        missing.
    weights : (..., n, 2) array
        Robust weight of every shift, 1 for least squares, 0 where the spot is missing.
    leverage : (..., n, 2) array
        Part of its own error that a shift puts into the fit; 1 - leverage is its redundancy number.
        NaN where missing.
    redundancy : (...) int array
        Shifts beyond the three needed; below zero where too few spots were seen.
    p_value : (...) array
        Probability of residuals at least as large as those of least squares if ``sigma`` is right
        and no spot is bad (chi-square test); NaN without sigma.
    scale : (...) array
        Residual scale: unit of the shifts, or of sigma where that was given.
    converged, ok : (...) bool arrays
        Whether the iteration settled; whether enough spots were seen.
    """

    angles: Floats
    cov: Floats
    residuals: Floats
    weights: Floats
    leverage: Floats
    redundancy: Ints
    p_value: Floats
    scale: Floats
    converged: Bools
    ok: Bools

    @property
    def std_error(self) -> Floats:
        """One-sigma errors of the angles (..., 3), radians."""
        return np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))

    @property
    def angles_arcsec(self) -> Floats:
        """The angles (..., 3) in arcseconds."""
        return rad_to_arcsec(self.angles)

    @property
    def std_error_arcsec(self) -> Floats:
        """One-sigma errors of the angles (..., 3) in arcseconds."""
        return rad_to_arcsec(self.std_error)
