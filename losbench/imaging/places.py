"""Frames as a stack, and which whole pixels of them the spots are near."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats, Indices
from losbench.checks import integer, unmasked

__all__ = ["as_stack", "as_starts", "evenly", "in_frame", "peak_pixels"]


def as_stack(frames: ArrayLike) -> NDArray[Any]:
    """Return frames as (F, H, W), in their own type, masked pixels as NaN; raise if they are no
    images or none.
    """
    stack = unmasked(frames)
    if stack.ndim not in (2, 3):
        raise ValueError(f"frames must have shape (F, H, W) or (H, W), got {stack.shape}")
    if stack.dtype.kind not in "uif":
        raise ValueError(f"frames must be of an integer or float type, got {stack.dtype.name}")
    if stack.size == 0:
        raise ValueError(f"frames must hold at least one pixel, got shape {stack.shape}")
    if stack.ndim == 3 and stack.shape[-1] in (3, 4) and stack.shape[0] > stack.shape[-1]:
        raise ValueError(
            f"frames must have shape (F, H, W) or (H, W), but {stack.shape} is that of a colour "
            "image: take one channel, image[..., 0]"
        )
    return stack if stack.ndim == 3 else stack[None]


def as_starts(name: str, start: ArrayLike, n_frames: int) -> Floats:
    """Return start positions as (F, n, 2), NaN for a spot that is missing from a frame."""
    xy = np.asarray(start, dtype=np.float64)
    fits = xy.ndim in (2, 3) and xy.shape[-1] == 2 and xy.size > 0
    if not fits or (xy.ndim == 3 and xy.shape[0] != n_frames):
        raise ValueError(
            f"{name} must have shape (n, 2) or ({n_frames}, n, 2) to match {n_frames} frames, got "
            f"{xy.shape}"
        )
    return np.broadcast_to(np.where(np.isfinite(xy), xy, np.nan), (n_frames, *xy.shape[-2:]))


def peak_pixels(frames: ArrayLike, near: ArrayLike, radius: int) -> Floats:
    """Brightest pixel near each given position, frame by frame: a start for `centroid` when spots
    wander.

    Parameters
    ----------
    frames : (F, H, W) or (H, W) array
    near : (n, 2) or (F, n, 2) array, pixels
        Where to look; NaN marks a missing spot.
    radius : int, pixels
        The search covers a square of ``2 * radius + 1`` pixels.

    Returns
    -------
    (F, n, 2) or (n, 2) array, pixels
        Whole numbers (x, y); NaN where ``near`` is NaN or outside the frame, or no pixel there was
        read.

    Raises
    ------
    ValueError
        If shapes do not match or the radius is negative.

    Examples
    --------
    >>> image = np.zeros((20, 30), dtype=np.uint16)
    >>> image[8, 12] = 500
    >>> peak_pixels(image, [[11.0, 9.0]], radius=3).tolist()
    [[12.0, 8.0]]
    """
    stack = as_stack(frames)
    places = as_starts("near", near, len(stack))
    reach = integer("radius", radius, low=0)
    frame, spot, middle = in_frame(stack, places)
    peaks = np.full(places.shape, np.nan)
    offset, (_, rows, columns) = np.arange(-reach, reach + 1), stack.shape
    # Beyond a border its own pixels are looked at again, which changes no maximum.
    x = np.clip(middle[:, 0, None] + offset, 0, columns - 1)
    y = np.clip(middle[:, 1, None] + offset, 0, rows - 1)
    pixels = stack[frame[:, None, None], y[:, :, None], x[:, None, :]]
    if stack.dtype.kind == "f":
        pixels = np.where(np.isnan(pixels), -np.inf, pixels)
    flat = pixels.reshape(len(frame), (2 * reach + 1) ** 2)
    row, column = np.divmod(flat.argmax(axis=1), 2 * reach + 1)
    each = np.arange(len(frame))
    found = np.stack([x[each, column], y[each, row]], axis=-1)
    unread = np.isneginf(pixels[each, row, column]) if stack.dtype.kind == "f" else False
    peaks[frame, spot] = np.where(np.reshape(unread, (-1, 1)), np.nan, found)
    return peaks if np.ndim(frames) == 3 else peaks[0]


def in_frame(stack: NDArray[Any], places: Floats) -> tuple[Indices, Indices, Indices]:
    """Frame number, spot number and nearest pixel of the places that are not NaN and lie within
    their frame.
    """
    nearest = np.rint(places)
    inside = ((nearest >= 0) & (nearest < stack.shape[:0:-1])).all(axis=-1)  # NaN is not
    frame, spot = np.nonzero(inside)
    return frame, spot, nearest[inside].astype(np.intp)


def evenly(count: int, most: int) -> Indices:
    """Up to ``most`` of ``count`` places, evenly spread from the first to the last.

    >>> evenly(9, 3).tolist(), evenly(2, 5).tolist(), evenly(0, 5).tolist()
    ([0, 4, 8], [0, 1], [])
    """
    return np.unique(np.linspace(0, count - 1, most if count else 0, dtype=np.intp))
