"""Correcting attitudes for a drift, and the angle between two boresights that judges the
correction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from losbench.arrays import Floats
from losbench.checks import finite, finite_or_nan, number, rotation, shaped
from losbench.pointing.starcamera.convention import Attitudes, QuaternionConvention

__all__ = ["Observability", "boresight_angle", "check_design", "correct_drift", "observability"]


_ALONG_Z = (0.0, 0.0, 1.0)


def correct_drift(
    quaternions: ArrayLike,
    drift: ArrayLike,
    *,
    convention: QuaternionConvention,
    installation: ArrayLike | None = None,
) -> Floats:
    """Take a camera's drift out of its measured attitudes.

    Parameters
    ----------
    quaternions : (..., 4) array
        Measured attitudes; a row with NaN is missing.
    drift : (..., 3) array, radians
        Rotation vector by which the camera turned relative to its reference, in its own axes
        (`drift_from_spots`).
    convention : QuaternionConvention
        Order and direction of the quaternions; the result keeps to it.
    installation : (3, 3) array, optional
        Rotation that takes drift components from the monitor's axes to those of the attitude;
        identity by default.

    Returns
    -------
    (..., 4) array
        Attitudes of the camera as if it had not moved; the sign stays with that of the measured
        one. NaN where the attitude or the drift is.

    Raises
    ------
    ValueError
        If a quaternion is not of unit length, shapes do not match, or ``installation`` is no
        rotation.

    Notes
    -----
    ren2023, section 1.2: with delta = M theta, q_corr = q_IC exp(-delta) for camera to inertial;
    stored inertial to camera that is exp(delta) q_CI.

    Examples
    --------
    >>> convention = QuaternionConvention(scalar="last", direction="camera_to_inertial")
    >>> correct_drift([0.0, 0.0, 0.0, 1.0], [2e-6, 0.0, 0.0], convention=convention).round(
    ...     9
    ... ).tolist()
    [-1e-06, 0.0, 0.0, 1.0]
    """
    attitudes = Attitudes.read(quaternions, convention)
    theta = finite_or_nan("drift", drift)
    shaped("drift", theta, ("...", 3))
    try:
        theta = np.broadcast_to(theta, (*attitudes.shape, 3)).reshape(-1, 3)
    except ValueError:
        shape = (*attitudes.shape, 3)
        raise ValueError(
            f"drift must broadcast to {shape} to match quaternions, got {theta.shape}"
        ) from None
    unknown = np.isnan(theta.sum(axis=-1))
    turn = Rotation.from_rotvec(
        np.where(unknown[:, None], 0.0, theta) @ rotation_matrix("installation", installation).T
    )
    stored = attitudes.stored * turn.inv() if convention.to_inertial else turn * attitudes.stored
    return attitudes.quaternions(stored, also_missing=unknown)


def boresight_angle(
    first: ArrayLike,
    second: ArrayLike,
    *,
    convention: QuaternionConvention,
    boresight: ArrayLike = _ALONG_Z,
) -> Floats:
    """Angle between the boresights of two cameras.

    Parameters
    ----------
    first, second : (..., 4) arrays
        Attitudes of the two at the same times; a row with NaN is missing.
    convention : QuaternionConvention
        Order and direction of the quaternions.
    boresight : (3,) array
        Line of sight in camera axes, +z by default.

    Returns
    -------
    (...) array, radians
        NaN where either attitude is missing.

    Raises
    ------
    ValueError
        If a quaternion is not of unit length or the shapes differ.

    Notes
    -----
    ren2023, eq. (5)-(8), with atan2(abs(z1 x z2), z1 . z2) in place of an arc cosine, which loses
    all of a small angle.

    Examples
    --------
    >>> convention = QuaternionConvention(scalar="last", direction="camera_to_inertial")
    >>> half = np.radians(17.5)
    >>> heads = [[np.sin(half), 0, 0, np.cos(half)], [-np.sin(half), 0, 0, np.cos(half)]]
    >>> float(np.degrees(boresight_angle(*heads, convention=convention)).round(9))
    70.0
    """
    one, two = _both(first, second, convention)
    axis = finite("boresight", boresight)
    z1, z2 = one.direction(axis), two.direction(axis)
    angle = np.arctan2(np.sqrt(_square(np.cross(z1, z2))), np.vecdot(z1, z2))
    angle[two.missing] = np.nan
    return one.restored(angle)


@dataclass(frozen=True)
class Observability:
    """What two attitudes tell of two drifts, as rows over (delta1, delta2), each in its own
    camera's axes.

    Attributes
    ----------
    angle : (..., 6) array
        Change of the boresight angle per radian of each component.
    relative : (..., 3, 6) array
        Change of the relative rotation, as a rotation vector in the first camera's axes.
    """

    angle: Floats
    relative: Floats


def observability(
    first: ArrayLike, second: ArrayLike, *, convention: QuaternionConvention
) -> Observability:
    """Which of the six drift components of a pair can be seen at all.

    Parameters
    ----------
    first, second : (..., 4) arrays
        Attitudes of the two cameras.
    convention : QuaternionConvention
        Order and direction of the quaternions.

    Returns
    -------
    Observability
        The angle has rank one: of six components it sees one combination; the whole relative
        rotation has rank three. What both cameras do together, no comparison of the two can see.

    Raises
    ------
    ValueError
        If a quaternion is not of unit length or the shapes differ.

    Notes
    -----
    d alpha = n . (delta2 - delta1) in inertial components, n = z1 x z2 / abs(z1 x z2), to first
    order.

    Examples
    --------
    >>> convention = QuaternionConvention(scalar="last", direction="camera_to_inertial")
    >>> heads = [[0, 0, 0, 1], [np.sin(0.3), 0, 0, np.cos(0.3)]]
    >>> observability(*heads, convention=convention).angle.round(12).tolist()
    [-1.0, -0.0, -0.0, 1.0, 0.0, 0.0]
    """
    one, two = _both(first, second, convention)
    r1, r2 = one.matrices(), two.matrices()
    normal = np.cross(r1[:, :, 2], r2[:, :, 2])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    angle = np.concatenate([-np.vecmat(normal, r1), np.vecmat(normal, r2)], axis=-1)
    relative = np.concatenate(
        [np.broadcast_to(-np.eye(3), r1.shape), np.swapaxes(r1, 1, 2) @ r2], axis=-1
    )
    return Observability(one.restored(angle), one.restored(relative))


def check_design(
    first: ArrayLike,
    second: ArrayLike,
    *,
    convention: QuaternionConvention,
    angle_deg: float,
    boresight: ArrayLike = _ALONG_Z,
    tolerance_deg: float = 0.5,
    scatter_arcsec: float = 100.0,
) -> None:
    """Raise unless the angle between the boresights is the one that the pair was built with, and
    stays so.

    A wrong order or direction of the quaternions still gives smooth curves; but not this angle, and
    not a steady one.

    Parameters
    ----------
    first, second : (n, 4) arrays
        Attitudes of the two cameras.
    convention : QuaternionConvention
        As the caller believes it to be.
    angle_deg : float
        Angle between the boresights by design.
    boresight : (3,) array
        Line of sight in camera axes, +z by default.
    tolerance_deg, scatter_arcsec : float
        Allowed distance of the median angle from it, and half-width of the middle half of the
        angles about it.

    Raises
    ------
    ValueError
        With what was found, and any convention of either camera that would fit.
    """
    design = number("angle_deg", angle_deg, low=0.0, high=180.0)

    def found(one: ArrayLike, two: ArrayLike) -> tuple[float, float]:
        angle = np.degrees(boresight_angle(one, two, convention=convention, boresight=boresight))
        low, middle, high = np.nanpercentile(angle, [25.0, 50.0, 75.0])
        return float(middle), float((high - low) / 2.0 * 3600.0)

    def fits(middle: float, scatter: float) -> bool:
        return abs(middle - design) <= tolerance_deg and scatter <= scatter_arcsec

    middle, scatter = found(first, second)
    if fits(middle, scatter):
        return
    others = [
        f"first camera {a}; second camera {b}"
        for a in QuaternionConvention.every()
        for b in QuaternionConvention.every()
        if fits(*found(_translated(first, a, convention), _translated(second, b, convention)))
    ]
    raise ValueError(
        f"the boresights must stand {design:g} deg apart to {tolerance_deg:g} deg and "
        f"{scatter_arcsec:g} arcsec, but "
        f"with {convention} they stand {middle:.4g} deg apart with a scatter of {scatter:.3g} "
        "arcsec; "
        + (
            f"what would fit: {', or '.join(others)}"
            if others
            else "no other convention fits either"
        )
    )


def rotation_matrix(name: str, matrix: ArrayLike | None) -> Floats:
    """Return ``matrix`` as a proper rotation (3, 3), the identity for None, or raise
    ``ValueError``.
    """
    return np.eye(3) if matrix is None else rotation(name, matrix)


def _both(
    first: ArrayLike, second: ArrayLike, convention: QuaternionConvention
) -> tuple[Attitudes, Attitudes]:
    one, two = (
        Attitudes.read(first, convention, "first"),
        Attitudes.read(second, convention, "second"),
    )
    if one.shape != two.shape:
        raise ValueError(
            f"second must have shape {(*one.shape, 4)} to match first, got {(*two.shape, 4)}"
        )
    missing = one.missing | two.missing
    return (
        Attitudes(one.stored, missing, one.shape, convention),
        Attitudes(two.stored, missing, two.shape, convention),
    )


def _translated(
    quaternions: ArrayLike, stored: QuaternionConvention, wanted: QuaternionConvention
) -> Floats:
    """Quaternions that are really of one convention, written in another."""
    q = np.array(quaternions, dtype=np.float64)
    if stored.scalar == "first":
        q = np.roll(q, -1, axis=-1)
    if stored.direction != wanted.direction:
        q[..., :3] *= -1.0
    return np.roll(q, 1, axis=-1) if wanted.scalar == "first" else q


def _square(vectors: Floats) -> Floats:
    return np.vecdot(vectors, vectors)
