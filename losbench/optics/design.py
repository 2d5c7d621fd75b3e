"""A three-mirror anastigmat in closed form: flat field, no third-order aberration, spherical M2."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import number, positive
from losbench.optics.threemirror import ThreeMirror

__all__ = ["anastigmat", "design_three_mirror", "seidel_sums"]

# In focal lengths: where a spherical second mirror goes with real mirrors.
_SPACING, _BACK = (0.5751, 0.5770), (0.66, 0.72)


def anastigmat(spacing: float, back: float) -> tuple[Floats, Floats]:
    """Curvatures and conics of three mirrors of unit focal length without S_I to S_IV.

    Parameters
    ----------
    spacing : float
        Between M1 and M2, and M2 and M3, in focal lengths.
    back : float
        From M3 to the focus, in focal lengths.

    Returns
    -------
    curvature, conic : (3,) arrays

    Raises
    ------
    ValueError
        If no real mirrors have these distances.

    Notes
    -----
    With a = spacing phi1 and phi2 = -phi1 - phi3 (Petzval), focal length and back focus leave (1 +
    b) a^2 + (d - 2 (1 - b)) a + (1 - b)^2 - d = 0 and spacing phi3 = (b - 1 + a + a^2) / (1 - a).
    The three sums are linear in the conics (Welford 1986, eq. 8.33 and 8.60).

    Examples
    --------
    >>> curvature, conic = anastigmat(0.57610, 0.68585)
    >>> [round(float(k), 3) for k in conic[::2]]
    [-1.617, 0.195]
    """
    linear, constant = spacing - 2.0 * (1.0 - back), (1.0 - back) ** 2 - spacing
    root = linear**2 - 4.0 * (1.0 + back) * constant
    if root < 0:
        raise ValueError(f"no three mirrors have spacing {spacing:g} and back focus {back:g}")
    a = (-linear + np.sqrt(root)) / (2.0 * (1.0 + back))
    c = (back - 1.0 + a + a**2) / (1.0 - a)
    curvature = np.array([a, a + c, c]) / (2.0 * spacing)
    sums = [
        seidel_sums(curvature, conic, spacing)[:3] for conic in np.vstack([np.zeros(3), np.eye(3)])
    ]
    conic = np.linalg.solve(np.array(sums[1:]).T - sums[0][:, None], -sums[0])
    return curvature, np.asarray(conic, dtype=np.float64)


def seidel_sums(curvature: ArrayLike, conic: ArrayLike, spacing: float) -> Floats:
    """Seidel sums S_I, S_II, S_III, S_IV, S_V, (5,), of three mirrors with the stop on the second.

    Object at infinity, marginal ray of height 1, chief ray of unit slope; lengths in one unit.
    """
    bend, k = np.asarray(curvature, dtype=np.float64), np.asarray(conic, dtype=np.float64)
    index = np.array([1.0, -1.0, 1.0, -1.0])  # changes sign at each mirror
    # Distances change sign with the light; curvatures are signed along the first light's way.
    gaps = spacing * np.array([-1.0, 1.0])
    c = -bend
    heights, slopes = _paraxial(c, gaps, index, height=1.0, slope=0.0)
    chief_heights, chief_slopes = _paraxial(c, gaps, index, height=0.0, slope=1.0)
    shift = -chief_heights[1] / heights[1]  # the chief ray goes through the middle of the stop
    chief_heights, chief_slopes = chief_heights + shift * heights, chief_slopes + shift * slopes
    a = index[:3] * (slopes[:3] + heights * c)
    b = index[:3] * (chief_slopes[:3] + chief_heights * c)
    step = heights * np.diff(slopes / index)
    petzval = c * np.diff(1.0 / index)
    invariant = index[0] * (chief_slopes[0] * heights[0] - slopes[0] * chief_heights[0])
    asphere = k * c**3 * heights**4 * np.diff(index)
    ratio = chief_heights / heights
    return np.array(
        [
            np.sum(-(a**2) * step + asphere),
            np.sum(-a * b * step + ratio * asphere),
            np.sum(-(b**2) * step + ratio**2 * asphere),
            np.sum(-(invariant**2) * petzval),
            np.sum(-b / a * (invariant**2 * petzval + b**2 * step) + ratio**3 * asphere),
        ]
    )


def design_three_mirror(
    focal_mm: float = 260.0,
    *,
    beam_mm: float = 40.0,
    bias_deg: float = 6.0,
    pixel_um: float = 10.0,
    shape: tuple[int, int] = (1080, 1920),
) -> ThreeMirror:
    """Design a flat-field anastigmat with a spherical second mirror and the least distortion.

    Of the third-order designs with k2 = 0 it takes the one whose traced field is nearest to that
    of a pinhole about the common axis: there the fifth order balances the third.

    Parameters
    ----------
    focal_mm : float
        Mean of the plate scales along x and y at the middle of the field.
    beam_mm, bias_deg, pixel_um, shape
        As in `ThreeMirror`.

    Returns
    -------
    ThreeMirror

    Raises
    ------
    ValueError
        If a value does not fit.

    Examples
    --------
    >>> [round(radius, 2) for radius in design_three_mirror().radius_mm]
    [542.45, 171.92, 251.7]
    """
    from scipy.optimize import brentq, minimize_scalar  # slow to import

    scale = float(positive("focal_mm", number("focal_mm", focal_mm)))

    def camera(spacing: float, scale: float) -> ThreeMirror:
        back = brentq(lambda back: anastigmat(spacing, back)[1][1], *_BACK, xtol=1e-14)
        curvature, conic = anastigmat(spacing, back)
        return ThreeMirror(
            tuple(scale / curvature),
            tuple(conic),
            (0.0, scale * spacing, 0.0, scale * back),
            beam_mm=beam_mm,
            bias_deg=bias_deg,
            pixel_um=pixel_um,
            shape=shape,
        )

    spacing = minimize_scalar(
        lambda spacing: camera(spacing, scale).distortion_px,
        bounds=_SPACING,
        method="bounded",
        options={"xatol": 1e-7},
    ).x
    return camera(spacing, scale * scale / float(np.mean(camera(spacing, scale).plate_scale_mm)))


def _paraxial(
    c: Floats, gaps: Floats, index: Floats, *, height: float, slope: float
) -> tuple[Floats, Floats]:
    """Heights (3,) on the mirrors and slopes (4,) before and after each."""
    heights, slopes = [height], [slope]
    for i in range(3):
        # Refraction with n' = -n is reflection.
        slopes.append(
            (index[i] * slopes[i] - heights[i] * c[i] * (index[i + 1] - index[i])) / index[i + 1]
        )
        if i < 2:
            heights.append(heights[i] + gaps[i] * slopes[i + 1])
    return np.array(heights), np.array(slopes)
