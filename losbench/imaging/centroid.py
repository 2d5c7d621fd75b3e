"""Centroids of many spots in many frames, with their errors and with what may be wrong about
them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats
from losbench.checks import boolean, choice, finite, integer, number
from losbench.imaging.background import RING
from losbench.imaging.detector import Detector
from losbench.imaging.estimates import TEMPLATES, Choices
from losbench.imaging.results import Centroids, SpotFlag, all_missing, only_frame
from losbench.imaging.stamps import as_stack, as_starts, in_frame, peak_pixels, spot_sigma
from losbench.imaging.widths import template_widths
from losbench.imaging.windows import measure_windows

__all__ = ["centroid", "default_window", "window_path"]


_BLOCK_PIXELS = 500_000  # of one block of stamps: a larger one gains little
_TOLERANCE = {"error": 1e-3, "step": 5e-3}


def centroid(
    frames: ArrayLike,
    start: ArrayLike,
    *,
    method: str = "eiwa",
    window: int | None = None,
    sigma: ArrayLike | None = None,
    stop: str = "error",
    tolerance: float | None = None,
    max_iter: int = 50,
    centre: str | None = None,
    background: str | float = "ring",
    ring: int | None = None,
    hot_pixel_gate: bool = False,
    noise: Detector | None = None,
    full_scale_dn: float | None = None,
) -> Centroids:
    """Measure the centroids of n spots in F frames.

    Parameters
    ----------
    frames : (F, H, W) or (H, W) array, DN
        Any integer or float type; frames stay in it, only windows are converted. NaN marks a pixel
        that was not read.
    start : (n, 2) or (F, n, 2) array, pixels
        Where each spot is, to a pixel or so; NaN for a spot that is missing.
    method : "eiwa", "grey", "weighted" or "gaussian"
        A window that moves until it is centred on its own centroid (liu2026, eq. 13-15), or one
        that stays (eq. 11-12): these take a spot of any shape. For round spots, the optimal
        weighted centroid by a Gaussian template, which reaches the Cramer-Rao bound, and a plain
        least-squares fit of a Gaussian to check against, some milliseconds a spot.
    window : odd int, pixels, optional
        Side N of the window. By default the first odd N of at least six sigma (1.5 spot diameters
        of four sigma), one for the whole call, from the median over the spots of `spot_sigma`.
    sigma : float, (2,) or (n, 2) array, pixels, optional
        Width of the template, or where the fit of it begins, along x and y. By default what fits
        best: the median over frames for a spot that four frames show well, else the median of the
        call, weighted by information. One faint or undersampled star does not tell its width.
    stop : "error" or "step"
        EIWA only. "step" is the paper to the letter: stop when the centroid moves by less than
        0.005 pixel. "error" takes safeguarded Newton steps to the same fixed point, until the error
        that is left is below 0.001 pixel.
    tolerance : float, pixels, optional
        In place of these 0.005 and 0.001; for weighted the last step.
    max_iter : int
        Evaluations of a window or template before it counts as not converged.
    centre : "start" or "peak", optional
        Where the first window stands: on ``start``, or on the brightest pixel within a quarter of a
        window of it, frame by frame. Default: "peak" for grey, as in the paper, else "start". A
        grey window stands on a whole pixel.
    background : "ring", "none" or float, DN
        What is taken off: a plane through a ring of four pixels, nothing, or a number. Templates
        need the background off, by one of these or before.
    ring : odd int, pixels, optional
        Side of the square that the ring surrounds, by default the window. With a window below six
        sigma the spot's own light would tilt the plane: give six sigma here.
    hot_pixel_gate : bool
        Replace pixels that stand out of their 3 x 3 median. Not for spots with a sigma below 0.9
        pixels.
    noise : Detector, optional
        Gain, read noise and offset for the predicted errors. Without it every pixel is given the
        scatter of the ring, which leaves out the shot noise of the spot itself: a lower bound for
        bright spots.
    full_scale_dn : float, optional
        Reading of a saturated pixel; by default that of ``noise``, else the largest number of an
        integer type.

    Returns
    -------
    Centroids

    Raises
    ------
    ValueError
        If shapes do not match, there is no frame, or the window is even or larger than the frame.

    Notes
    -----
    ============= ====================================================================================== ============
    flag          meaning                                                                                xy
    ============= ====================================================================================== ============
    NOT_CONVERGED ``max_iter`` was reached, or the window ended more than half its side from the start   kept
    EDGE          the window, or the ring, reaches beyond the frame                                      NaN if window
    SATURATED     a pixel at full scale, or more pixels share the maximum than the top of a spot would   kept
    NEIGHBOUR     another start lies within six sigma, that is one window                                kept
    TOO_FAINT     the flux is below five times its error                                                 NaN
    SLOW          contraction above 0.85: the centroid follows its window, and hardly the spot           kept
    MISSING       no start within the frame, or a pixel of the window was not read                       NaN
    RING          the spot's own light lies in the ring and tilts the plane: give a larger ring          kept
    MISFIT        template and window, or their middles, differ by a tenth in light: wrong width or shape kept
    ============= ====================================================================================== ============

    The error is the sandwich error of the equation sum w(c) (x - c) (I - B) = 0 with background
    plane B: the root of sum w^2 (x - c)^2 V + (sum w (x - c)^2)^2 var(slope of B), over T (1 -
    kappa), with the variance V of a pixel, the sum T of the window and the contraction kappa = N
    S_edge / T. A window that stays has no 1 - kappa, but is pulled by kappa times its distance from
    the spot; that is added in quadrature, as is the error left by EIWA's stop rule. Pixel response
    and the S-curve (about 1 mpx at six sigma) are not in it. The error of weighted is that of the
    information in the window, the error of gaussian the sandwich error of its equal weights, both
    with the error of the plane; neither knows how far a spot is from a Gaussian.

    Examples
    --------
    >>> from losbench import Detector, render_spots
    >>> camera = Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
    >>> light = render_spots([[20.3, 15.8], [50.1, 22.6]], 2e5, 2.0, (40, 70)) + 30.0
    >>> spots = centroid(camera.expose(light, 1), [[20, 16], [50, 23]], noise=camera)
    >>> spots.xy.round(2).tolist(), spots.flags.tolist(), spots.window
    ([[20.3, 15.79], [50.1, 22.6]], [0, 0], 13)
    """
    stack = as_stack(frames)
    places = as_starts("start", start, len(stack))
    choice("method", method, ("eiwa", "grey", *TEMPLATES))
    usual = "peak" if method == "grey" else "start"
    first = choice("centre", usual if centre is None else centre, ("start", "peak"))
    side = _window(stack, places, window)
    how = Choices(
        method=method,
        window=side,
        ring=side if ring is None else _odd("ring", ring, side),
        stop=choice("stop", stop, ("error", "step")),
        tolerance=number(
            "tolerance", _TOLERANCE[stop] if tolerance is None else tolerance, low=1e-12
        ),
        max_iter=integer("max_iter", max_iter, low=1),
        background=_background(background),
        gate=boolean("hot_pixel_gate", hot_pixel_gate),
        noise=noise,
        full_scale=_full_scale(stack, noise, full_scale_dn),
        rounding=1.0 / 12.0 if stack.dtype.kind in "ui" else 0.0,
    )
    at = peak_pixels(stack, places, max(2, side // 4)) if first == "peak" else places
    frame, spot, middle = in_frame(stack, at)
    width = None
    if method in TEMPLATES:
        n_spots = places.shape[1]
        if sigma is None:
            width = template_widths(stack, frame, spot, middle, n_spots, how)
        else:
            width = _sigma(sigma, n_spots, side)
    result = all_missing(places.shape[:2], side, width)
    per_block = max(1, _BLOCK_PIXELS // (how.ring + 2 * RING) ** 2)
    for first_of_block in range(0, len(frame), per_block):
        block = slice(first_of_block, first_of_block + per_block)
        where = frame[block], spot[block]
        mine = None if width is None else width[spot[block]]
        measured = measure_windows(stack, frame[block], middle[block], at[where], how, width=mine)
        for name, values in vars(measured).items():
            getattr(result, name)[where] = values
    result.flags[_crowded(places, side)] |= SpotFlag.NEIGHBOUR
    return result if np.ndim(frames) == 3 else only_frame(result)


def default_window(frames: ArrayLike, start: ArrayLike) -> int:
    """First odd window of at least six sigma of the spots that the data show, or the largest that
    fits around a start.

    >>> from losbench import render_spots
    >>> default_window(render_spots([[30.2, 25.4]], 1e4, 2.0, (60, 70)), [[30, 25]])
    13
    """
    stack = as_stack(frames)
    places = as_starts("start", start, len(stack))
    sigma = spot_sigma(stack, places)
    # A width measured to a few percent must not flip the window at a whole number of pixels.
    wanted = np.ceil(6.0 * sigma - 0.3) if np.isfinite(sigma) else 3.0
    room = np.minimum(places + 0.5, np.array(stack.shape[:0:-1]) - 0.5 - places).min(axis=-1)
    fits = max(2.0 * np.nan_to_num(room, nan=0.0).max(), 3.0)
    return min(int(wanted) | 1, (int(fits) - 1) | 1)


def window_path(
    image: ArrayLike,
    start: ArrayLike,
    *,
    window: int,
    stop: str = "step",
    tolerance: float | None = None,
    max_iter: int = 50,
    background: str | float = "ring",
) -> Floats:
    """Centres that EIWA's window takes on its way to one spot, from the start to where it rests.

    Parameters
    ----------
    image : (H, W) array, DN
    start : (2,) array, pixels
    window, stop, tolerance, max_iter, background
        As in `centroid`; here the paper's rule "step" is the default.

    Returns
    -------
    (k + 1, 2) array, pixels
        After 0 ... k evaluations.

    Raises
    ------
    ValueError
        As `centroid`, and if the start lies outside the image.

    Examples
    --------
    >>> from losbench import render_spots
    >>> image = render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> window_path(image, [19, 17], window=13)[[0, 1, -1]].round(2).tolist()
    [[19.0, 17.0], [20.27, 15.82], [20.3, 15.8]]
    """
    stack = as_stack(image)
    place = as_starts("start", np.asarray(start, dtype=np.float64).reshape(-1, 2), 1)
    side = _window(stack, place, window)
    how = Choices(
        method="eiwa",
        window=side,
        ring=side,
        stop=choice("stop", stop, ("error", "step")),
        tolerance=number(
            "tolerance", _TOLERANCE[stop] if tolerance is None else tolerance, low=1e-12
        ),
        max_iter=integer("max_iter", max_iter, low=1),
        background=_background(background),
        gate=False,
        noise=None,
        full_scale=np.inf,
        rounding=0.0,
    )
    frame, _, middle = in_frame(stack, place)
    if len(frame) != 1 or len(stack) != 1:
        raise ValueError(
            f"start must be one point within one image, got {np.asarray(start).tolist()}"
        )
    path: list[Floats] = []
    measure_windows(stack, frame, middle, place[0], how, path=path)
    return np.concatenate(path)


def _window(stack: NDArray[Any], places: Floats, window: int | None) -> int:
    side = default_window(stack, places) if window is None else _odd("window", window, 3)
    rows, columns = stack.shape[1:]
    if side > min(rows, columns):
        raise ValueError(
            f"window of {side} x {side} pixels does not fit into frames of {rows} x {columns} "
            "pixels"
        )
    return side


def _sigma(sigma: ArrayLike, n_spots: int, window: int) -> Floats:
    given = finite("sigma", sigma)
    if (
        given.shape not in ((), (2,), (n_spots, 2))
        or not ((given >= 0.1) & (given <= window)).all()
    ):
        raise ValueError(
            f"sigma must be a number, two or ({n_spots}, 2), of 0.1 to {window} pixels, the "
            f"window, got {sigma!r}"
        )
    return np.broadcast_to(given, (n_spots, 2)).copy()


def _odd(name: str, value: int, low: int) -> int:
    side = integer(name, value, low=low)
    if side % 2 == 0:
        raise ValueError(f"{name} must be odd, got {side}")
    return side


def _background(background: str | float) -> str | float:
    if isinstance(background, str):
        return choice("background", background, ("ring", "none"))
    return number("background", background)


def _full_scale(stack: NDArray[Any], noise: Detector | None, given: float | None) -> float:
    if given is not None:
        return number("full_scale_dn", given)
    if noise is not None:
        return float(np.floor(noise.full_scale_dn))
    return float(np.iinfo(stack.dtype).max) if stack.dtype.kind in "ui" else np.inf


def _crowded(places: Floats, window: int) -> Bools:
    """Spots (F, n) with another start within one window."""
    gap = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    gap[:, np.arange(gap.shape[1]), np.arange(gap.shape[1])] = np.inf
    return (gap < window).any(axis=-1)
