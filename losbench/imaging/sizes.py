"""How wide the spots are, as far as a window must know it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats
from losbench.imaging.aperture import aperture_sigma
from losbench.imaging.places import as_stack, as_starts, evenly, in_frame

__all__ = ["default_window", "spot_sigma", "window_in_first"]


_SIGMA_FRAMES = 16
_SIGMA_SPOTS = 16


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


def window_in_first(frame: NDArray[Any], start: Floats) -> int:
    """Window for the spots of a recording, from its first frame (H, W).

    Raises
    ------
    ValueError
        If nothing stands at a start.
    """
    found = default_window(frame, start)
    if found < 3:
        raise ValueError(
            f"no spot stands at {start.round(1).tolist()} in the first frame: nothing there to "
            "size a window by"
        )
    least = min(frame.shape)
    return min(found, least - (least + 1) % 2)


def spot_sigma(frames: ArrayLike, start: ArrayLike) -> float:
    """Width of the spots, in pixels: the median over up to 16 of `aperture_sigma`, each from up to
    16 frames. NaN if no spot is seen.

    >>> from losbench import render_spots
    >>> round(spot_sigma(render_spots([[30.2, 25.4]], 1e4, 2.0, (60, 70)), [[30.0, 25.0]]), 1)
    2.0
    """
    stack = as_stack(frames)
    places = as_starts("start", start, len(stack))
    chosen = evenly(len(stack), _SIGMA_FRAMES)
    frame, spot, middle = in_frame(stack, places[chosen])
    seen = np.unique(spot)
    few = seen[evenly(len(seen), _SIGMA_SPOTS)]
    widths = [aperture_sigma(stack, chosen[frame[spot == k]], middle[spot == k]) for k in few]
    return float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
