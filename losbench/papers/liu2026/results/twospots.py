"""The angles of two spots in closed form, by LS and by Huber's IRLS, and what Table 1 allows alpha
to be whatever the estimator.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Floats
from losbench.checks import choice, number
from losbench.papers.liu2026.results.centroiding import TABLE_1
from losbench.papers.liu2026.scenario import Bench

__all__ = ["Bound", "alpha_bound", "two_spot_angles"]

TUNING = 1.345


@dataclass(frozen=True)
class Bound:
    """The largest RMS or PV of alpha that prints allow, in arcseconds, and the terms that it is
    made of.
    """

    from_centroids: float
    from_gamma: float

    @property
    def total(self) -> float:
        """Return the sum of both terms."""
        return self.from_centroids + self.from_gamma


def alpha_bound(
    statistic: str, gamma_arcsec: float, *, setting: Bench, column: str = "eiwa"
) -> Bound:
    """Bound alpha by a column of Table 1, for any estimator, correlation and place of the spots.

    The row dy = f alpha + x gamma holds for either spot, so whatever weights >= 0 an estimator
    gives its rows, alpha is a weighted mean of (dy - x gamma) / f. RMS and PV obey the triangle
    inequality::

        S(alpha) <= max(S(y_a), S(y_b)) * pixel / f + max|x| / f * S(gamma),

    and ``|x|`` is at most half the sensor.

    Parameters
    ----------
    statistic : "rms" or "pv"
    gamma_arcsec : float
        The same statistic of gamma.
    setting : Bench
        Focal length, pixel and sensor.
    column : str
        Of `TABLE_1`: "eiwa" or "eiwa in the text".

    Examples
    --------
    >>> round(alpha_bound("rms", 0.48, setting=Bench()).total, 3)
    0.099
    """
    _, y_a, _, y_b = TABLE_1[column][statistic]
    half_width_mm = setting.shape[1] / 2 * setting.pixel_um * 1e-3
    return Bound(
        from_centroids=max(y_a, y_b) * setting.camera.arcsec_per_px,
        from_gamma=half_width_mm / setting.focal_mm * gamma_arcsec,
    )


def two_spot_angles(
    points_mm: Floats, shifts_mm: Floats, *, focal_mm: float, scale: str | float | None = None
) -> Floats:
    """Angles (..., 3) in radians of two spots by eq. (7), or by eq. (8)-(10) in closed form.

    With D = A - B, d = ``|D|``, e = D / d, e' = (-e_y, e_x), and the shifts' half difference
    s = e . (b_A - b_B) / 2 the residuals of LS are (s e, -s e). Huber's loss moves gamma alone:
    where an element exceeds c the larger one ``|e_i|`` is held at the loss's slope and::

        gamma = e' . (b_A - b_B) / d - 2 e'_i sgn(s e_i) E / d,
        E = |r_i| - min(|s|, c / |e_i|) |e_i|,

    and alpha, beta follow from the mean shifts, of which gamma takes its part.

    Parameters
    ----------
    points_mm : (2, 2) array
        Places of A and B on the sensor.
    shifts_mm : (F, 2, 2) array
        Displacements of both, frame by frame.
    focal_mm : float
        The spots stand at z = -f.
    scale : float, "frame", "run", or None
        None is least squares. A number is c in millimetres; "frame" takes 1.345 times the root
        mean square of the frame's own four residuals, "run" that of all frames' residuals, both
        evaluated anew until they stay.

    Returns
    -------
    (F, 3) array

    Examples
    --------
    >>> points = np.array([[4.68, 3.36], [9.48, 0.87]])
    >>> shifts = 1e-2 * np.array([[[0.02, -0.01], [-0.05, 0.012]]])
    >>> from losbench.units import rad_to_arcsec
    >>> rad_to_arcsec(two_spot_angles(points, shifts, focal_mm=260.0)).round(6)
    array([[ 0.1399  ,  0.158421, -4.846219]])
    """
    baseline = points_mm[0] - points_mm[1]
    d = float(np.hypot(*baseline))
    e = baseline / d
    across = np.array([-e[1], e[0]])
    middle = points_mm.mean(axis=0)
    difference = shifts_mm[..., 0, :] - shifts_mm[..., 1, :]
    mean = shifts_mm.mean(axis=-2)
    s = difference @ e / 2
    gamma = difference @ across / d
    if scale is not None:
        i = int(np.abs(e[1]) > np.abs(e[0]))
        excess = _excess(s, e, i, scale)
        gamma = gamma - 2 * across[i] * np.sign(s * e[i]) * excess / d
    alpha = (mean[..., 1] - middle[0] * gamma) / focal_mm
    beta = -(mean[..., 0] + middle[1] * gamma) / focal_mm
    return np.stack([alpha, beta, gamma], axis=-1)


def _excess(s: Floats, e: Floats, i: int, scale: str | float) -> Floats:
    """By how much the larger residual exceeds Huber's bend, (F,)."""
    big, small = abs(float(e[i])), abs(float(e[1 - i]))

    def residuals(c: float | Floats) -> tuple[Floats, Floats]:
        bend = np.minimum(np.abs(s), c / big)
        minor = bend * small
        return (np.abs(s) - small * minor) / big, minor

    if isinstance(scale, str):
        choice("scale", scale, ("frame", "run"))
        c: float | Floats = np.inf
        for _ in range(200):
            major, minor = residuals(c)
            square = (major**2 + minor**2) / 2
            new = TUNING * np.sqrt(square.mean() if scale == "run" else square)
            settled = np.all(np.abs(new - c) <= 1e-13 * new)
            c = new
            if settled:
                break
    else:
        c = number("scale", scale, low=0.0)
    major, minor = residuals(c)
    return major - np.minimum(np.abs(s), c / big) * big
