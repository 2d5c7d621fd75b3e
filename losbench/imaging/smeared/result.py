"""What aided centroiding found."""

from __future__ import annotations

from dataclasses import dataclass

from losbench.arrays import Bools, Floats, Ints

__all__ = ["AidedCentroids"]


@dataclass(frozen=True)
class AidedCentroids:
    """Positions of n stars in any batch of images.

    Parameters
    ----------
    xy : (..., n, 2) array, pixels
        Position (x, y) at the epoch; NaN where there is none.
    sigma_xy : (..., n, 2) array, pixels
        Predicted one-sigma error; 0 where no noise is known.
    flux : (..., n) array, unit of the frames
        Light of the whole star.
    n_iter : (..., n) array of int
    converged : (..., n) array of bool
    flags : (..., n) array of int
        Bits of `losbench.imaging.centroid.SpotFlag`; 0 is a star without reproach.
    turn_rad, rate_rad_s : (..., 3) arrays
        Method "joint" only, else None: the rotation that carries the predicted rays at the epoch
        into the observed ones, and the constant rate that the rays have on top of the gyro's path.
    """

    xy: Floats
    sigma_xy: Floats
    flux: Floats
    n_iter: Ints
    converged: Bools
    flags: Ints
    turn_rad: Floats | None = None
    rate_rad_s: Floats | None = None
