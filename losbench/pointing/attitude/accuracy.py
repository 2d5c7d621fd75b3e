"""How well a layout of spots can know the angles, before any frame is taken."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import integer, positive
from losbench.optics.camera import Model, checked_points, design_matrix
from losbench.pointing.attitude.blocks import SAME_DIRECTION, broadcast_sigma

__all__ = ["attitude_covariance"]


def attitude_covariance(
    points: ArrayLike, sigma: ArrayLike, *, model: Model = "pinhole", stack: int = 1
) -> Floats:
    """Covariance of the angles that a layout of spots allows, with no shift observed yet.

    Parameters
    ----------
    points : (..., n, 3) array, any unit of length
        Layouts to compare.
    sigma : float or array that broadcasts to (..., n, 2), unit of ``points``
        Standard deviation of each shift, errors independent.
    model : "pinhole" or "paper"
        Rows of the design matrix, see `design_matrix`.
    stack : int
        Number of frames that share the angles.

    Returns
    -------
    (..., 3, 3) array, radians squared
        (A' S^-1 A)^-1 / stack; infinite where a layout leaves a rotation undetermined.

    Raises
    ------
    ValueError
        If shapes do not match or ``sigma`` is not positive.

    Examples
    --------
    The layout of liu2026, 0.5 px of 4.5 um: errors in arcseconds about x, y, z.

    >>> points = [[5.0, 75.0, -475.0], [-5.0, 75.0, -475.0]]
    >>> covariance = attitude_covariance(points, 0.5 * 4.5e-3, model="paper")
    >>> (np.sqrt(np.diag(covariance)) * 206264.806).round(2)
    array([ 0.69, 10.39, 65.63])
    """
    p = checked_points(points)
    error = broadcast_sigma(positive("sigma", sigma), (*p.shape[:-1], 2))
    rows = design_matrix(p, model) / error.reshape(*p.shape[:-2], -1, 1)
    size = np.linalg.norm(rows, axis=-2, keepdims=True)
    _, singular, right = np.linalg.svd(rows / size, full_matrices=False)
    determined = singular[..., -1:, None] > SAME_DIRECTION * singular[..., :1, None]
    root = np.where(
        determined, right / np.where(determined, singular[..., None], 1.0) / size, np.inf
    )
    return np.swapaxes(root, -1, -2) @ root / integer("stack", stack, low=1)
