"""Centroids of many spots in many frames, with their errors and with what may be wrong about
them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats, Ints
from losbench.imaging.auto import AutoCentroid
from losbench.imaging.background import Background
from losbench.imaging.common import smoothed
from losbench.imaging.detector import Detector
from losbench.imaging.eiwa import EIWA
from losbench.imaging.empirical import Empirical
from losbench.imaging.gain import recording_gain
from losbench.imaging.groups import grouped
from losbench.imaging.methods import MethodFields, as_background, as_method
from losbench.imaging.noise import Gain
from losbench.imaging.places import as_stack, as_starts
from losbench.imaging.protocols import CentroidMethod
from losbench.imaging.results import Centroids, Measured, SpotFlag
from losbench.imaging.shaping import shaped
from losbench.imaging.sizes import default_window, window_sides
from losbench.imaging.widths import spot_widths

__all__ = ["centroid", "default_window", "window_path"]


def centroid(
    frames: ArrayLike,
    start: ArrayLike,
    *,
    method: CentroidMethod | str = "eiwa",
    background: Background | str | float | None = "ring",
    detector: Detector | Gain | None = None,
    full_scale_dn: float | None = None,
    ring: int | None = None,
    noise: Detector | Gain | None = None,
    **named: Unpack[MethodFields],
) -> Centroids:
    """Measure the centroids of n spots in F frames.

    Parameters
    ----------
    frames : (F, H, W) or (H, W) array, DN
        Any integer or float type; frames stay in it, only windows are converted. NaN marks a pixel
        that was not read.
    start : (n, 2) or (F, n, 2) array, pixels
        Where each spot is, to a pixel or so; NaN for a spot that is missing.
    method : EIWA, Grey, Weighted, Likelihood, Gaussian, Empirical, AutoCentroid, or a name
        A window that moves until it is centred on its own centroid (liu2026, eq. 13-15), or one
        that stays (eq. 11-12): these take a spot of any shape. For round spots, the optimal
        weighted centroid by a Gaussian template, and the likeliest Gaussian with its widths fitted,
        which reach the Cramer-Rao bound; and a plain least-squares fit of a Gaussian to check
        against. For spots of another shape, `Empirical` makes a template of the frames.
        `AutoCentroid` chooses. Names are "eiwa", "grey", "weighted", "likelihood", "gaussian",
        "empirical" and "auto". Any frozen dataclass with the fields and the method of
        `losbench.imaging.protocols.CentroidMethod` will do.
    background : Ring, Level, None, or "ring", "none", float (DN)
        What is taken off: a plane through a ring of four pixels, a known level, or nothing.
        Templates need the background off, by one of these or before.
    detector : Detector or Gain, optional
        Gain, read noise and offset for the predicted errors. Without it every pixel is given the
        scatter of the ring, and the shot noise of the spots that `estimate_gain` finds in up to 64
        frames. Fewer than three tell it by what a Gaussian leaves over, where that is noise alone;
        where it is not, the errors of spots are lower bounds, and flagged.
    full_scale_dn : float, optional
        Reading of a saturated pixel; by default that of ``detector``, else the largest number of an
        integer type.
    ring : odd int, pixels, optional
        Beside ``background="ring"``, short for ``Ring(ring)``.
    noise : Detector or Gain, optional
        A second word for ``detector``.
    **named
        Beside the name of a method, its fields: ``window=13`` beside "eiwa" is ``EIWA(13)``.
        ``sigma`` is a second word for ``width``.

    Returns
    -------
    Centroids

    Raises
    ------
    ValueError
        If shapes do not match, there is no frame, the window is even or larger than the frame, or
        something is given both in an object and beside it.

    Notes
    -----
    `SpotFlag` lists the flags. The window, unless given, is the first odd one of at least six sigma
    (1.5 spot diameters of four sigma) of `losbench.imaging.sizes.spot_sigma`: that of the median,
    and a spot whose own differs by more than two pixels and a tenth has its own.

    The error is the sandwich error of the equation sum w(c) (x - c) (I - B) = 0 with background
    plane B: the root of sum w^2 (x - c)^2 V + (sum w (x - c)^2)^2 var(slope of B), over T (1 -
    kappa), with the variance V of a pixel, the sum T of the window and the contraction kappa = N
    S_edge / T. A window that stays has no 1 - kappa, but is pulled by kappa times its distance from
    the spot; that is added in quadrature, as is the error left by EIWA's stop rule. Pixel response
    and the S-curve (about 1 mpx at six sigma) are not in it. `Weighted`, `Likelihood`,
    `Gaussian` and `Empirical` say which error is theirs.

    Light of another spot shows in window and ring: from 2 % of the peak on one side, 5 % under a
    window of moments, which is coarser; as a second top with a dip before it; where the window has
    left a spot behind. What makes one long spot of two does not: a spot of 3 %, or one as bright,
    two sigma away. A template of common width then says MISFIT of the brighter.

    Examples
    --------
    >>> from losbench import EIWA, Detector, render_spots
    >>> camera = Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
    >>> light = render_spots([[20.3, 15.8], [50.1, 22.6]], 2e5, 2.0, (40, 70)) + 30.0
    >>> frame = camera.expose(light, 1)
    >>> spots = centroid(frame, [[20, 16], [50, 23]], method=EIWA(13), detector=camera)
    >>> spots.xy.round(2).tolist(), spots.flags.tolist(), spots.window
    ([[20.3, 15.79], [50.1, 22.6]], [0, 0], 13)
    """
    chosen, under = as_method(method, named), as_background(background, ring)
    if detector is not None and noise is not None:
        raise ValueError("detector and noise are two words for one thing: give detector")
    stack = as_stack(frames)
    places = as_starts("start", start, len(stack))
    sides = window_sides(chosen.window, stack, places)
    known = detector or noise
    groups = grouped(stack, places, sides, chosen, under, known, full_scale_dn)
    if known is None:
        known = recording_gain(groups, stack)
        groups = [each.of(noise=known) for each in groups]
    reason = ""
    if isinstance(chosen, AutoCentroid):
        choice = chosen.choose(groups, stack)
        chosen, reason = choice.method, choice.reason
        groups = [each.of(method=chosen) for each in groups]
    if isinstance(chosen, Empirical):
        chosen = shaped(chosen, groups, stack)
        groups = [each.of(method=chosen) for each in groups]
    width = spot_widths(groups, stack)
    result = Measured.nothing(places.shape[:2])
    for group in groups:
        group.measure(stack, width[group.numbers], result)
    result.flags[:] |= _crowded(places, sides) * SpotFlag.NEIGHBOUR
    if isinstance(known, Gain) and not known.known:
        result.flags[np.isfinite(result.xy[..., 0])] |= SpotFlag.LOWER_BOUND
    if chosen.smooth is not None:
        xy, sigma = smoothed(chosen.smooth, result.xy)
        result = replace(result, xy=xy, sigma_xy=sigma)
    if np.ndim(frames) == 2:
        result = result.of(0)
    return Centroids(
        result.xy,
        result.sigma_xy,
        result.flux,
        result.background,
        result.n_iter,
        result.flags,
        sides if len(groups) > 1 else groups[0].engine.window,
        None if np.isnan(width).all() else width,
        result.n_bad,
        chosen,
        reason,
        known,
    )


def window_path(
    image: ArrayLike,
    start: ArrayLike,
    *,
    window: int,
    stop: str = "step",
    tolerance: float | None = None,
    max_iter: int = 50,
    background: Background | str | float | None = "ring",
) -> Floats:
    """Centres that EIWA's window takes on its way to one spot: `EIWA.path` by another name.

    Parameters
    ----------
    image : (H, W) array, DN
    start : (2,) array, pixels
    window, stop, tolerance, max_iter
        As for `EIWA`; here the paper's rule "step" is the default.
    background : Background, "ring", "none", float or None
        As for `centroid`.

    Returns
    -------
    (k + 1, 2) array, pixels
        After 0 ... k evaluations.

    Examples
    --------
    >>> from losbench import render_spots
    >>> image = render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> window_path(image, [19, 17], window=13)[[0, 1, -1]].round(2).tolist()
    [[19.0, 17.0], [20.27, 15.82], [20.3, 15.8]]
    """
    method = EIWA(window, stop, tolerance, max_iter=max_iter)
    return method.path(image, start, background=as_background(background))


def _crowded(places: Floats, sides: Ints) -> Bools:
    """Spots (F, n) with another start within one window (n,), theirs or that of the other; (1, n)
    where all frames have the same starts.
    """
    places = places if places.strides[0] else places[:1]
    crowded = np.zeros(places.shape[:2], dtype=bool)
    if len(sides) == 1:
        return crowded
    from scipy.spatial import cKDTree

    frame, spot = np.nonzero(np.isfinite(places).all(axis=-1))
    widest = sides.max()
    above = 2.0 * widest * frame  # frames lie above each other, out of reach
    points = np.column_stack([places[frame, spot], above])
    tree = cKDTree(points, compact_nodes=False, balanced_tree=False)
    pairs = tree.query_pairs(widest, output_type="ndarray")
    apart = points[pairs[:, 0]] - points[pairs[:, 1]]
    near = pairs[np.vecdot(apart, apart) < sides[spot[pairs]].max(axis=1) ** 2]
    crowded[frame[near], spot[near]] = True
    return crowded
