"""Round or elliptical spots as a pixel grid collects them: the light of each pixel integrated, not
sampled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf

from losbench.arrays import Floats
from losbench.checks import finite, integer, non_negative, positive, shaped

__all__ = ["render_spots", "render_streaks"]


def render_spots(
    xy: ArrayLike,
    flux: ArrayLike,
    sigma: ArrayLike,
    shape: tuple[int, int],
    origin: ArrayLike = (0, 0),
) -> Floats:
    """Expected image of Gaussian spots, integrated over each pixel; spots of one image add up.

    Parameters
    ----------
    xy : (..., n, 2) array, pixels
        Centres of the n spots of each image, in frame coordinates.
    flux : float or array that broadcasts to (..., n), electrons
        Light of each whole spot, also of the part that falls outside the image.
    sigma : float or array that broadcasts to (..., n, 2), pixels
        Standard deviation: one number, a pair (sx, sy), or (n, 1) and (n, 2) for spots that differ.
    shape : (rows, columns)
        Size of the image or of the window of it that is rendered.
    origin : (2,) or (..., 2) array, pixels
        Frame coordinates (x, y) of the window's first pixel; one for all images or one for each.

    Returns
    -------
    (..., rows, columns) array, electrons

    Raises
    ------
    ValueError
        If a shape does not fit, a position is not finite, a sigma not positive or a flux negative.

    Notes
    -----
    Pixel (i, j) collects flux * X_j * Y_i with X_j = (E(j + 1/2) - E(j - 1/2)) / 2, E(u) = erf((u -
    x) / (sqrt2 sx)), and Y_i likewise: the error function is needed at pixel edges only, and an
    image is a sum of outer products.

    Examples
    --------
    >>> image = render_spots([[3.0, 2.5]], flux=1000.0, sigma=0.8, shape=(6, 8))
    >>> image.shape, round(float(image.sum()), 1)
    ((6, 8), 999.8)
    """
    centres = np.asarray(xy, dtype=np.float64)
    shaped("xy", centres, ("...", "n", 2))
    if centres.size:
        finite("xy", centres)
    if np.shape(shape) != (2,):
        raise ValueError(f"shape must be (rows, columns), got {shape!r}")
    rows, columns = (integer("shape", length, low=1) for length in shape)
    corner = finite("origin", origin)
    shaped("origin", corner, ("...", 2))
    width = _fitting("sigma", positive("sigma", sigma), centres.shape)
    light = _fitting("flux", non_negative("flux", flux), centres.shape[:-1])

    relative = centres - corner[..., None, :]
    across = _pixel_shares(relative[..., 0], width[..., 0], columns)
    down = _pixel_shares(relative[..., 1], width[..., 1], rows)
    return np.matmul(np.swapaxes(down * light[..., None], -1, -2), across)


def render_streaks(
    tracks: ArrayLike,
    share: ArrayLike,
    flux: ArrayLike,
    sigma: ArrayLike,
    shape: tuple[int, int],
    origin: ArrayLike = (0, 0),
) -> Floats:
    """Expected image of Gaussian spots that move while the camera exposes.

    Parameters
    ----------
    tracks : (..., n, S, 2) array, pixels
        Where each of the n spots of an image is at S moments, close enough for the spots to
        overlap.
    share : (S,) array
        Part of the exposure that each moment stands for.
    flux, sigma, shape, origin
        As for `render_spots`; ``sigma`` is one number or one pair.

    Returns
    -------
    (..., rows, columns) array, electrons

    Raises
    ------
    ValueError
        As `render_spots` does, or if a shape does not fit.

    Examples
    --------
    >>> track = [[[3.0, 2.0], [4.0, 2.0], [5.0, 2.0]]]
    >>> image = render_streaks(track, [0.25, 0.5, 0.25], flux=100.0, sigma=0.5, shape=(5, 9))
    >>> round(float(image.sum()), 1), int(image[2].argmax())
    (100.0, 4)
    """
    path, part = np.asarray(tracks, dtype=np.float64), finite("share", share, ndim=1)
    shaped("tracks", path, ("...", "n", len(part), 2), why=f"to match {len(part)} shares")
    light = _fitting("flux", non_negative("flux", flux), path.shape[:-2])
    width = np.broadcast_to(positive("sigma", sigma), (2,))
    spots = path.reshape(*path.shape[:-3], -1, 2)
    return render_spots(
        spots, (light[..., None] * part).reshape(spots.shape[:-1]), width, shape, origin
    )


def _pixel_shares(centre: Floats, sigma: Floats, n_pixels: int) -> Floats:
    """Fraction of each spot's light that each of the pixels 0 ... n_pixels - 1 along one axis
    collects.
    """
    edges = np.arange(n_pixels + 1) - 0.5
    return 0.5 * np.diff(erf((edges - centre[..., None]) / (np.sqrt(2.0) * sigma[..., None])))


def _fitting(name: str, value: Floats, shape: tuple[int, ...]) -> Floats:
    try:
        return np.broadcast_to(value, shape)
    except ValueError:
        raise ValueError(
            f"{name} must broadcast to {shape} to match xy, got shape {value.shape}"
        ) from None
