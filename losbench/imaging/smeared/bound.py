"""How well a smeared star could be located at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, named_twice, non_negative, shaped
from losbench.imaging.detector import Detector
from losbench.imaging.smeared.model import StreakModel, spot_width
from losbench.optics.camera import Camera
from losbench.optics.motion.path import AttitudePath

__all__ = ["streak_bound"]


_BLOCK = 512
_REACH_SIGMAS = 6.0


def streak_bound(
    xy: ArrayLike,
    flux: ArrayLike,
    *,
    path: AttitudePath,
    camera: Camera,
    width: ArrayLike | None = None,
    detector: Detector | None = None,
    background: float = 0.0,
    noise: Detector | None = None,
    sigma: ArrayLike | None = None,
) -> Floats:
    """Cramer-Rao bound of the position of a smeared star whose path and width are known and whose
    flux is not.

    Parameters
    ----------
    xy : (..., n, 2) array, pixels
        Positions at the start of the exposure.
    flux : float or array that broadcasts to (..., n), DN
    path : AttitudePath
    camera : Camera
    width : float or (sx, sy), pixels
        Sigma of a star that does not move.
    detector : Detector
    background : float, DN
        Reading of a pixel without star, the offset included.
    noise, sigma
        Second words for ``detector`` and ``width``.

    Returns
    -------
    (..., n, 2) array, pixels
        Smallest standard deviation of x and of y that an unbiased estimate can have, at any epoch.

    Raises
    ------
    ValueError
        If shapes do not match, or a width or flux is out of range.

    Notes
    -----
    Fisher information I_ab = sum over pixels of (dG/da dG/db) / V with a, b of x, y and flux; the
    variance V of a pixel, shot noise and read noise, is taken as known.

    Examples
    --------
    >>> from losbench.optics.motion.path import gyro_path
    >>> camera = Camera(focal_mm=36.6097, pixel_um=10.0, shape=(512, 512))
    >>> rest = gyro_path(np.zeros((5, 3)), interval_s=0.005, exposure_s=0.025)
    >>> bound = streak_bound(
    ...     [[100.5, 99.5]], 1e6, path=rest, camera=camera, width=2.0, detector=Detector()
    ... )
    >>> bound.round(5).tolist()  # near width / sqrt(flux) where the star outshines the read noise
    [[0.00202, 0.00202]]
    """
    places, sides = finite("xy", xy), spot_width(width, sigma)
    shaped("xy", places, ("...", "n", 2))
    word, seen_by = named_twice("detector", detector, None, noise=noise)
    if not isinstance(seen_by, Detector):
        raise ValueError(f"{word} must be a Detector, got {seen_by!r}")
    tracks = path.tracks(places, camera)
    light = np.broadcast_to(non_negative("flux", flux), tracks.shape[:-2]).ravel()
    flat = tracks.reshape(-1, *tracks.shape[-2:])
    size = int(np.ceil(np.ptp(flat, axis=1).max() + 2 * _REACH_SIGMAS * sides.max() + 1))
    origin = np.rint((flat.max(axis=1) + flat.min(axis=1)) / 2 - size / 2)
    dark = max(
        float(seen_by.variance_dn(background)), float(seen_by.variance_dn(seen_by.offset_dn))
    )
    bounds = np.empty((len(flat), 2))
    for first in range(0, len(flat), _BLOCK):
        part = slice(first, first + _BLOCK)
        focal_px, principal = camera.focal_px, np.asarray(camera.principal_px)
        model = StreakModel(
            np.empty(0), path.share, focal_px, principal, sides, origin[part], (size, size)
        )
        seen = model.gradient(flat[part])
        flux_here = light[part, None, None]
        variance = seen.image * flux_here / seen_by.gain_e_per_dn + dark
        columns = np.stack([seen.by_x * flux_here, seen.by_y * flux_here, seen.image], axis=1)
        columns = columns.reshape(len(columns), 3, -1)
        information = (columns / variance.reshape(len(columns), 1, -1)) @ np.swapaxes(columns, 1, 2)
        bounds[part] = np.sqrt(np.diagonal(np.linalg.inv(information), axis1=1, axis2=2)[:, :2])
    return bounds.reshape(*tracks.shape[:-2], 2)
