"""How wide the spots are, as far as their windows must know it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats, Indices, Ints
from losbench.imaging.aperture import aperture_sigma
from losbench.imaging.places import as_stack, as_starts, evenly, in_frame
from losbench.imaging.protocols import Window
from losbench.imaging.stamps import cut_stamps

__all__ = ["default_window", "spot_sigma", "window_in_first", "window_sides"]


_SIGMA_FRAMES = 16
_SIGMA_SPOTS = 16
_STEP = 2  # pixels from one odd window to the next
_ALIKE = 0.1  # of a window
_ABOVE_HALF = 2.0 * np.pi * np.log(2.0)  # pixels of a spot of sigma one above half of its peak
_UNLIKE = 2.0  # times as many
_FEW = 3  # pixels of them that noise and sampling make


def window_sides(window: Window | None, stack: NDArray[Any], places: Floats) -> Ints:
    """Side of the window (n,) of each spot at (F, n, 2) of frames (F, H, W): as given, or found.

    Raises
    ------
    ValueError
        If windows of another number of spots are given.
    """
    count = places.shape[1]
    if window is None:
        return default_window(stack, places)
    if np.size(window) not in (1, count):
        raise ValueError(
            f"window must be an odd number, or one for each of {count} spots, got {window!r}"
        )
    return np.full(count, window, dtype=np.int64)


def default_window(frames: ArrayLike, start: ArrayLike) -> Ints:
    """First odd window (n,) of at least six sigma of each spot that the data show, or the largest
    that fits around it.

    Spots are thought to be alike: where the window of one is within two pixels, or a tenth, of that
    of their median, it has that one. So has a spot that looks wider for another in its window.

    >>> from losbench import render_spots
    >>> image = render_spots([[30.2, 25.4]], 1e4, 2.0, (90, 150))
    >>> image += render_spots([[100.4, 45.3]], 1e6, 12.0, (90, 150))
    >>> default_window(image, [[30, 25], [100, 45]]).tolist()
    [13, 73]
    """
    stack = as_stack(frames)
    places = as_starts("start", start, len(stack))
    sigma = spot_sigma(stack, places)
    known = np.isfinite(sigma)
    room = np.minimum(places + 0.5, np.array(stack.shape[:0:-1]) - 0.5 - places).min(axis=-1)
    fits = (np.fmax(2.0 * np.nan_to_num(room).max(axis=0), 3.0).astype(np.int64) - 1) | 1
    own = _first_odd(np.where(known, sigma, 0.5))
    common = _first_odd(np.median(sigma[known]) if known.any() else 0.5)
    unlike = known & (np.abs(own - common) > np.maximum(_STEP, _ALIKE * common))
    first = np.isfinite(places[..., 0]).argmax(axis=0)
    at = places[first, np.arange(len(first))]
    unlike[unlike] = ~_widened(at, own, np.flatnonzero(unlike), int(common))
    # A spot near a border keeps the window of those that it is like, and is flagged.
    window: Ints = np.where(unlike, np.minimum(own, fits), np.minimum(common, fits.max()))
    return window


def _first_odd(sigma: ArrayLike) -> Ints:
    # A width measured to a few percent must not flip the window at a whole number of pixels.
    wanted: Ints = np.ceil(6.0 * np.asarray(sigma) - 0.3).astype(np.int64) | 1
    return wanted


def _widened(at: Floats, own: Ints, some: Indices, common: int) -> Bools:
    """Which of some spots (m,) want a wider window than is common and stand in one another's."""
    apart = np.abs(at[some, None] - at).max(axis=-1)
    apart[np.arange(len(some)), some] = np.inf
    near = apart < np.minimum(own[some, None], own)
    return near.any(axis=1) & (own[some] > common)


def window_in_first(frame: NDArray[Any], start: Floats) -> Ints:
    """Window (n,) of each spot of a recording, from its first frame (H, W)."""
    least = min(frame.shape)
    return np.minimum(default_window(frame, start), least - (least + 1) % 2)


def spot_sigma(frames: ArrayLike, start: ArrayLike) -> Floats:
    """Width (n,) of each spot, in pixels, by `aperture_sigma`, from up to 16 frames. NaN where no
    spot is seen.

    Of more than 16 spots, those that look as wide as the median of 16 in the first frame, or have
    another start within six sigma, are given that.

    >>> from losbench import render_spots
    >>> spot_sigma(render_spots([[30.2, 25.4]], 1e4, 2.0, (60, 70)), [[30.0, 25.0]]).round(1)
    array([2.])
    """
    stack = as_stack(frames)
    places = as_starts("start", start, len(stack))
    chosen = evenly(len(stack), _SIGMA_FRAMES)
    frame, spot, middle = in_frame(stack, places[chosen])
    seen = np.unique(spot)
    few = seen[evenly(len(seen), _SIGMA_SPOTS)]
    sigma = np.full(places.shape[1], np.nan)

    def look(some: Indices) -> None:
        for k in some.tolist():
            sigma[k] = aperture_sigma(stack, chosen[frame[spot == k]], middle[spot == k])

    look(few)
    if len(few) < len(seen) and np.isfinite(sigma[few]).any():
        others = np.setdiff1d(seen, few)
        sigma[others] = np.nanmedian(sigma[few])
        look(np.intersect1d(others, _unlike(stack[0], places[0], float(sigma[others[0]]))))
    return sigma


def _unlike(image: NDArray[Any], places: Floats, sigma: float) -> Indices:
    """Numbers of those of many spots (n, 2) of an image that stand alone and have far more, or
    fewer, pixels above half of their peak than a sigma makes.
    """
    from scipy.spatial import cKDTree

    frame, spot, middle = in_frame(image[None], places[None])
    nearest = np.asarray(cKDTree(places[spot]).query(places[spot], k=[2], p=np.inf)[0])[:, 0]
    alone = nearest > 6.0 * sigma
    stamps = cut_stamps(image[None], frame[alone], middle[alone], int(np.ceil(3.0 * sigma)) + 1)
    rim = np.concatenate([stamps[:, [0, -1]], stamps[:, :, [0, -1]].swapaxes(1, 2)], axis=1)
    rim = rim.reshape(len(stamps), 4 * stamps.shape[1])
    stamps -= np.partition(rim, rim.shape[1] // 2, axis=1)[:, rim.shape[1] // 2, None, None]
    near = slice(stamps.shape[1] // 2 - 1, stamps.shape[1] // 2 + 2)
    peak = stamps[:, near, near].max(axis=(1, 2), keepdims=True)
    core = (stamps > 0.5 * peak).sum(axis=(1, 2))
    expected = _ABOVE_HALF * sigma**2
    far = (core > _UNLIKE * expected + _FEW) | (core < expected / _UNLIKE - _FEW)
    found: Indices = spot[alone][far]
    return found
