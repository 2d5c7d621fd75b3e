"""From whole frames, or from windows that somebody else cut, to one flat stack of windows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats, Indices
from losbench.checks import finite, odd, shaped
from losbench.imaging.stamps import cut_stamps
from losbench.optics.camera import Camera
from losbench.optics.motion.path import AttitudePath

__all__ = ["Cut", "cut_windows", "take_windows"]


_REACH_SIGMAS = 5.0


@dataclass(frozen=True)
class Cut:
    """Raw windows of all stars, flat: pixels (M, h, w) and origin (M, 2), M = number of images
    times ``stars``.
    """

    pixels: Floats
    origin: Floats
    batch: tuple[int, ...]
    stars: int

    @property
    def image(self) -> Indices:
        """Which image each window is from, (M,)."""
        return np.arange(len(self.pixels)) // max(1, self.stars)


def take_windows(frames: ArrayLike, origin: ArrayLike) -> Cut:
    """Take windows (..., n, h, w) with the frame position (..., n, 2) of each one's first pixel."""
    array = _numbers(frames)
    shaped("frames", array, ("...", "n", "h", "w"), why="to be windows with an origin")
    corner = np.asarray(origin, dtype=np.float64)
    shaped("origin", corner, (*array.shape[:-2], 2), why="to match the windows")
    if corner.size:
        finite("origin", corner)
    pixels = np.asarray(array.reshape(-1, *array.shape[-2:]), dtype=np.float64)
    return Cut(pixels, corner.reshape(-1, 2), array.shape[:-3], array.shape[-3])


def cut_windows(
    frames: ArrayLike,
    start: ArrayLike,
    *,
    window: int | None,
    path: AttitudePath,
    camera: Camera,
    sigma: Floats,
) -> Cut:
    """Cut windows out of whole frames around ``start``; all NaN where that is NaN or outside the
    frame.
    """
    array = _numbers(frames)
    shaped("frames", array, ("...", *camera.shape), why="to match the camera")
    given, batch = np.asarray(start, dtype=np.float64), array.shape[:-2]
    shaped("start", given, ("...", "n", 2))
    stars = given.shape[-2]
    if given.shape[:-2] not in ((), batch):
        raise ValueError(
            f"start must have shape (n, 2) or {(*batch, 'n', 2)} to match frames, got {given.shape}"
        )
    places = np.broadcast_to(given, (*batch, stars, 2)).reshape(-1, 2)
    rows, columns = camera.shape
    size = _window(path, camera, sigma) if window is None else odd("window", window, low=3)
    if size > min(rows, columns):
        raise ValueError(
            f"window of {size} x {size} pixels does not fit into frames of {rows} x {columns} "
            "pixels"
        )
    here = np.asarray(((places > -0.5) & (places < (columns - 0.5, rows - 0.5))).all(axis=1))
    middle = np.rint(np.where(here[:, None], places, 0.0)).astype(np.intp)
    image = np.arange(len(middle)) // max(1, stars)
    stamps = cut_stamps(array.reshape(-1, rows, columns), image, middle, size // 2)
    pixels = np.asarray(stamps, dtype=np.float64)
    pixels[~here] = np.nan
    return Cut(pixels, np.asarray(middle - size // 2, dtype=np.float64), batch, stars)


def _numbers(frames: ArrayLike) -> NDArray[np.generic]:
    array = np.asanyarray(frames)
    if array.dtype.kind not in "uif":
        raise ValueError(f"frames must be of an integer or float type, got {array.dtype.name}")
    return array


def _window(path: AttitudePath, camera: Camera, sigma: Floats) -> int:
    """Odd side that holds every track and five sigma on either side, wherever in its pixel the
    track begins.

    At most what fits into the frame.
    """
    rows, columns = camera.shape
    corners = [[x, y] for x in (0.0, columns - 1.0) for y in (0.0, rows - 1.0)]
    span = np.ptp(path.tracks(corners, camera), axis=-2).max(initial=0.0)
    reach = int(np.ceil(span / 2 + _REACH_SIGMAS * sigma.max() + 0.5))
    return 2 * min(reach, (min(rows, columns) - 1) // 2) + 1
