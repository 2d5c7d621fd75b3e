"""Stellar aberration, which an attitude must be free of before two boresights can be compared
(extra ``fits``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from losbench.arrays import Floats
from losbench.checks import finite, shaped
from losbench.pointing.starcamera.convention import Attitudes, QuaternionConvention

__all__ = ["earth_velocity_km_s", "remove_aberration"]


LIGHT_KM_S = 299792.458


def earth_velocity_km_s(utc: ArrayLike) -> Floats:
    """Barycentric velocity of the Earth, (..., 3) in km/s along ICRS axes; add the satellite's own
    about the Earth.

    Parameters
    ----------
    utc : (...) array of numpy.datetime64 or ISO 8601 text

    Raises
    ------
    ImportError
        If astropy is not installed.

    Examples
    --------
    >>> speed = np.linalg.norm(earth_velocity_km_s("2022-03-25T00:00:00"))
    >>> bool(29.2 < speed < 30.4)
    True
    """
    _astropy()
    from astropy.coordinates import get_body_barycentric_posvel
    from astropy.time import Time

    _, velocity = get_body_barycentric_posvel(
        "earth", Time(np.asarray(utc).astype("datetime64[ns]").astype(str))
    )
    return np.moveaxis(velocity.xyz.to_value("km/s"), 0, -1)


def remove_aberration(
    quaternions: ArrayLike, velocity_km_s: ArrayLike, *, convention: QuaternionConvention
) -> Floats:
    """Turn attitudes that were matched to catalogue directions without aberration to where the
    camera really looks.

    Parameters
    ----------
    quaternions : (..., 4) array
        Attitudes; a row with NaN is missing.
    velocity_km_s : (..., 3) array
        Velocity of the camera about the barycentre of the solar system, along the inertial axes.
    convention : QuaternionConvention
        Order and direction of the quaternions; the result keeps to it.

    Returns
    -------
    (..., 4) array
        The boresight moved towards the velocity by what aberration moves a star there: 20.5 arcsec
        from the Earth's motion at right angles, 5 from a low orbit.

    Raises
    ------
    ImportError
        If astropy is not installed.
    ValueError
        If a quaternion is not of unit length or the shapes do not match.

    Notes
    -----
    The exact aberration of ``erfa.ab`` at the boresight; how it differs over the field is left to
    the star matching.
    """
    _astropy()
    import erfa  # type: ignore[import-untyped]

    attitudes = Attitudes.read(quaternions, convention)
    v = finite("velocity_km_s", velocity_km_s)
    shaped("velocity_km_s", v, ("...", 3))
    beta = np.broadcast_to(v, (*attitudes.shape, 3)).reshape(-1, 3) / LIGHT_KM_S
    seen = attitudes.direction(np.array([0.0, 0.0, 1.0]))
    inverse_gamma = np.sqrt(1.0 - np.vecdot(beta, beta))
    moved = erfa.ab(
        seen, beta, 1.0, inverse_gamma
    )  # one au from the Sun, whose potential adds less than a microarcsec
    across = np.cross(seen, moved)
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(sine[:, 0], np.vecdot(seen, moved))[:, None]
    turn = Rotation.from_rotvec(across / np.where(sine > 0, sine, 1.0) * angle)
    stored = turn * attitudes.stored if convention.to_inertial else attitudes.stored * turn.inv()
    return attitudes.quaternions(stored)


def _astropy() -> None:
    try:
        import astropy  # noqa: F401
        import erfa  # noqa: F401
    except ImportError:
        raise ImportError("aberration needs astropy: pip install 'losbench[fits]'") from None
