"""A camera's own turn, from the spots of reference beams that stay where they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import boolean, finite_or_nan, positive, shaped
from losbench.estimation.robust import lstsq
from losbench.optics.camera import design_matrix
from losbench.pointing.attitude import solve_attitude
from losbench.pointing.attitude.blocks import broadcast_sigma, distinct_points
from losbench.units import rad_to_arcsec

__all__ = ["DriftFit", "drift_from_spots"]


@dataclass(frozen=True)
class DriftFit:
    """Drift of a camera at each time.

    Attributes
    ----------
    delta : (..., 3) array, radians
        Rotation vector by which the camera turned relative to the reference, in its own axes; NaN
        where fewer than two spots were seen.
    focal : (...) array or None
        Relative change of the focal length, if it was asked for.
    cov : (..., p, p) array
        Covariance of delta, and of the focal change behind it: p is 3 or 4.
    residuals : (..., n, 2) array
        Model minus shift, unit of the shifts; NaN where a spot is missing.
    condition : float
        Ratio of the largest to the smallest singular value of the layout's rows: how much worse its
        worst-known combination is than the best-known one.
    """

    delta: Floats
    focal: Floats | None
    cov: Floats
    residuals: Floats
    condition: float

    @property
    def delta_arcsec(self) -> Floats:
        """The drift (..., 3) in arcseconds."""
        return rad_to_arcsec(self.delta)

    @property
    def std_error_arcsec(self) -> Floats:
        """One-sigma errors of the drift (..., 3) in arcseconds."""
        return rad_to_arcsec(np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))[..., :3])


def drift_from_spots(
    points: ArrayLike, shifts: ArrayLike, *, sigma: ArrayLike | None = None, focal: bool = False
) -> DriftFit:
    """Find by how much a camera has turned from the shifts of its reference spots.

    Parameters
    ----------
    points : (n, 3) array, any unit of length
        Reference points (x, y, f) of the spots, e.g. from :meth:`Camera.points_mm`; two or more.
    shifts : (..., n, 2) array, unit of ``points``
        Displacements of the spots. A spot with a NaN is missing.
    sigma : float or (n, 2) array, unit of ``points``, optional
        Standard deviation of each shift; makes the covariance absolute. Without it the residuals
        give the scale, of which two spots leave one.
    focal : bool
        Solve for a relative change of the focal length too. Two spots then leave nothing to check.

    Returns
    -------
    DriftFit

    Raises
    ------
    ValueError
        If shapes do not match, the points leave a rotation undetermined, or with ``focal`` a spot
        count below two.

    Notes
    -----
    ren2023, section 1.1, with a = x/f, b = y/f: dx/f = a b dx - (1 + a^2) dy + b dz + a df/f, dy/f
    = (1 + b^2) dx - a b dy - a dz + b df/f. It is liu2026's exact model (`design_matrix`) with the
    other sign: `solve_attitude` gives the rotation that carries the reference directions into the
    observed ones, the camera itself turned by minus that.

    Examples
    --------
    >>> points = np.array([[30.0, 30.0, 600.0], [-30.0, -30.0, 600.0]])
    >>> shifts = -(design_matrix(points) @ [1e-6, -2e-6, 3e-6]).reshape(2, 2)
    >>> drift_from_spots(points, shifts).delta.round(12).tolist()
    [1e-06, -2e-06, 3e-06]
    """
    p = distinct_points(points)
    if boolean("focal", focal):
        return _with_focal(p, finite_or_nan("shifts", shifts), sigma)
    fit = solve_attitude(p, shifts, method="ls", sigma=sigma)
    return DriftFit(
        -fit.angles, None, fit.cov, fit.residuals, float(np.linalg.cond(design_matrix(p)))
    )


def _with_focal(p: Floats, shifts: Floats, sigma: ArrayLike | None) -> DriftFit:
    shaped("shifts", shifts, ("...", len(p), 2), why=f"to match {len(p)} points")
    design = np.concatenate([-design_matrix(p), p[:, :2].reshape(-1, 1)], axis=1)
    error = (
        np.ones(p[:, :2].shape)
        if sigma is None
        else broadcast_sigma(positive("sigma", sigma), p[:, :2].shape)
    )
    flat = shifts.reshape(-1, design.shape[0])
    present = np.repeat(np.isfinite(shifts).all(axis=-1).reshape(len(flat), -1), 2, axis=1)
    found, cov = np.full((len(flat), 4), np.nan), np.full((len(flat), 4, 4), np.nan)
    residuals = np.full(flat.shape, np.nan)
    patterns, member = np.unique(present, axis=0, return_inverse=True)
    for k, seen in enumerate(patterns):
        rows, weight = member == k, error.reshape(-1)[seen]
        if np.count_nonzero(seen) < 4 or np.linalg.matrix_rank(design[seen]) < 4:
            continue
        fit = lstsq(
            design[seen] / weight[:, None],
            flat[rows][:, seen] / weight,
            scale=None if sigma is None else 1.0,
        )
        found[rows], cov[rows] = fit.x, fit.cov
        residuals[np.ix_(rows, seen)] = fit.residuals * weight
    batch = shifts.shape[:-2]
    return DriftFit(
        delta=found[:, :3].reshape(*batch, 3),
        focal=found[:, 3].reshape(batch),
        cov=cov.reshape(*batch, 4, 4),
        residuals=residuals.reshape(shifts.shape),
        condition=float(np.linalg.cond(design)),
    )
