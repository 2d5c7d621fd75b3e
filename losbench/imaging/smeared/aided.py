"""Centroids of smeared stars, aided by a gyro: the public entry, from frames to positions with
errors and flags.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import choice, finite, finite_or_nan, integer, named_twice, number, shaped
from losbench.imaging.detector import Detector
from losbench.imaging.smeared.cutting import Cut, cut_windows, take_windows
from losbench.imaging.smeared.measuring import Scene, measure_jointly, measure_singly
from losbench.imaging.smeared.methods import METHODS, Joint, MethodName, Recipe
from losbench.imaging.smeared.model import spot_width
from losbench.imaging.smeared.result import AidedCentroids
from losbench.imaging.smeared.solvers import Stop
from losbench.optics.camera import Camera
from losbench.optics.motion.path import EPOCHS, AttitudePath, Epoch

__all__ = ["aided_centroid"]

_OWN_REGION = {"data": False, "own": True}


def aided_centroid(
    frames: ArrayLike,
    start: ArrayLike | None = None,
    *,
    path: AttitudePath,
    camera: Camera,
    width: ArrayLike | None = None,
    method: MethodName = "iterative",
    epoch: Epoch = "end",
    origin: ArrayLike | None = None,
    window: int | None = None,
    background: str | ArrayLike = "border",
    detector: Detector | None = None,
    full_scale_dn: float | None = None,
    threshold: float | None = None,
    region: Literal["data", "own"] = "data",
    predicted: ArrayLike | None = None,
    rate_prior_rad_s: float = 0.0,
    tolerance: float = 1e-5,
    max_iter: int = 50,
    noise: Detector | None = None,
    full_scale: float | None = None,
    sigma: ArrayLike | None = None,
) -> AidedCentroids:
    """Find where smeared stars were at one moment of the exposure.

    Parameters
    ----------
    frames : (..., H, W) array, or with ``origin`` (..., n, h, w)
        Whole frames, or windows that somebody else cut. NaN marks a pixel that was not read.
    start : (..., n, 2) array, pixels
        With whole frames: about where the middle of each smeared star is, to a pixel or so; NaN for
        a star that is missing from an image.
    path : AttitudePath
        From `gyro_path`; its batch axes are those of the images, or none.
    camera : Camera
        Its ``shape`` is that of a whole frame.
    width : float or (sx, sy), pixels
        Sigma of a star that does not move.
    method : "iterative", "closed_form", "least_squares" or "joint"
        "iterative": lyu2015, section 1.3. "closed_form": the measured centre plus what the path's
        epoch is off its mean; the same for widths of at least 0.5 where every pixel counts, at a
        fraction of the cost. "least_squares": position and flux from all pixels by inverse variance
        (eq. 11-12), the most precise for one star. "joint": one rotation for all stars of an image,
        from their ``predicted`` places, and maybe one rate error of the gyro.
    epoch : "start", "middle" or "end"
        The moment of the exposure.
    origin : (..., n, 2) array, pixels
        With windows: frame position (x, y) of each window's first pixel.
    window : odd int, pixels, optional
        With whole frames: side of the windows, within the frame; by default the longest track and
        five widths on either side.
    background : "border", or float or array that broadcasts to (..., n)
        Subtracted from the pixels; "border" takes the median of each window's outermost ones.
    detector : Detector, optional
        Gain, read noise and offset. Without it all pixels of a window count the same, with the
        scatter of its border.
    full_scale_dn : float, optional
        Reading of a saturated pixel, left out of data and model; by default that of the detector,
        else the largest number of an integer type.
    threshold : float, optional
        Only pixels above that part of a star's flux count.
    region : "data" or "own"
        For "iterative" with a threshold. "data": the pixels chosen on the data count on both sides.
        "own": the model is thresholded by itself in every round, as the paper seems to; that
        triples the error and may never settle.
    predicted : (..., n, 2) array, pixels
        For "joint": where a catalogue and a rough attitude put the stars at the epoch; NaN leaves a
        star out.
    rate_prior_rad_s : float, rad/s
        For "joint": one sigma of the gyro's constant rate error; 0 trusts the gyro, infinity does
        not.
    tolerance : float, pixels
        The iteration ends with a step below it.
    max_iter : int
    noise, full_scale, sigma
        Second words for ``detector``, ``full_scale_dn`` and ``width``.

    Returns
    -------
    AidedCentroids

    Raises
    ------
    ValueError
        If shapes do not match, a number is out of range, or an option lacks what it needs.

    Notes
    -----
    ============== ===============================================================================
    flag           meaning
    ============== ===============================================================================
    NOT_CONVERGED  ``max_iter`` was reached; the last position is kept, or NaN where "joint" sees
                   too few stars
    EDGE           the track leaves the frame, or comes within three widths of its window's edge,
                   or the window holds pixels that were not read; kept, without what is not there
    SATURATED      pixels at full scale were left out; "iterative" then ends with least squares,
                   as what is left may hardly follow the star
    NEIGHBOUR      the window of another star of the image reaches this star's track; kept, but not
                   to be trusted
    TOO_FAINT      flux below five times its error; kept, or NaN where there is no light at all
    SLOW           a width below 0.25 px, where the iteration hardly contracts: damped, and
                   polished by least squares where it did not settle
    MISSING        no start in the frame, no ``predicted``, or no pixel of the window read; NaN,
                   but a star that is predicted and not seen is where the others of a "joint" image
                   put it
    ============== ===============================================================================

    Pixels are integrated over their area and over the path; an error of the width is not in the
    predicted error.

    Examples
    --------
    >>> from losbench import render_streaks
    >>> from losbench.optics.motion.path import gyro_path
    >>> camera = Camera(focal_mm=36.6097, pixel_um=10.0, shape=(512, 512))
    >>> path = gyro_path(np.full((5, 3), [0.0, 1e-4, 0.0]), interval_s=0.005, exposure_s=0.025)
    >>> truth = [[100.3, 200.8]]
    >>> frame = render_streaks(
    ...     path.tracks(truth, camera, epoch="end"), path.share, 1e5, 0.6, camera.shape
    ... )
    >>> stars = aided_centroid(frame, [[101, 201]], path=path, camera=camera, width=0.6)
    >>> stars.xy.round(4).tolist(), bool(stars.converged)
    ([[100.3, 200.8]], True)
    """
    chosen = METHODS[choice("method", method, METHODS)]
    own_region = _OWN_REGION[choice("region", region, _OWN_REGION)]
    word, camera_noise = named_twice("detector", detector, None, noise=noise)
    if camera_noise is not None and not isinstance(camera_noise, Detector):
        raise ValueError(f"{word} must be a Detector, got {camera_noise!r}")
    part = None if threshold is None else number("threshold", threshold, low=0.0, high=1.0)
    if own_region and part is None:
        raise ValueError(
            "region 'own' needs a threshold: without one every pixel counts on both sides"
        )
    if (predicted is None) == isinstance(chosen, Joint):
        raise ValueError("predicted must be given for method 'joint', and for no other")
    how = Recipe(
        method=chosen,
        epoch=EPOCHS.index(choice("epoch", epoch, EPOCHS)),
        detector=camera_noise,
        threshold=part,
        own_region=own_region,
        stop=Stop(number("tolerance", tolerance, low=1e-12), integer("max_iter", max_iter, low=1)),
    )
    sides = spot_width(width, sigma)
    if origin is not None and start is None:
        cut = take_windows(frames, origin)
    elif start is not None and origin is None:
        cut = cut_windows(frames, start, window=window, path=path, camera=camera, sigma=sides)
    else:
        raise ValueError("give start with whole frames, or origin with windows, and not both")
    if path.batch not in ((), cut.batch):
        raise ValueError(
            f"path must be of one exposure or of {cut.batch} to match frames, got {path.batch}"
        )
    scene = Scene(
        path=path,
        camera=camera,
        sigma=sides,
        cut=cut,
        background=_background(background, cut),
        full_scale=_full_scale(
            np.asanyarray(frames).dtype,
            camera_noise,
            named_twice("full_scale_dn", full_scale_dn, None, full_scale=full_scale),
        ),
    )
    if not isinstance(chosen, Joint):
        return measure_singly(scene, how, chosen)
    places = np.asarray(predicted, dtype=np.float64)
    shaped("predicted", places, (*cut.batch, cut.stars, 2), why=f"to match {cut.stars} stars")
    if cut.stars < 2:
        raise ValueError(f"joint needs at least 2 stars in an image, got {cut.stars}")
    prior = (
        np.inf
        if rate_prior_rad_s == np.inf
        else number("rate_prior_rad_s", rate_prior_rad_s, low=0.0)
    )
    return measure_jointly(scene, how, finite_or_nan("predicted", places), prior)


def _background(background: str | ArrayLike, cut: Cut) -> Floats | None:
    if isinstance(background, str):
        choice("background", background, ("border",))
        return None
    level = finite("background", background)
    try:
        return np.broadcast_to(level, (*cut.batch, cut.stars)).ravel()
    except ValueError:
        raise ValueError(
            f"background must broadcast to {(*cut.batch, cut.stars)}, got shape {level.shape}"
        ) from None


def _full_scale(
    dtype: np.dtype[Any], detector: Detector | None, named: tuple[str, float | None]
) -> float:
    word, given = named
    if given is not None:
        return number(word, given)
    if detector is not None:
        return float(np.floor(detector.full_scale_dn))
    return float(np.iinfo(dtype).max) if dtype.kind in "ui" else np.inf
