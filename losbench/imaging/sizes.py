"""How wide the spots are, as far as a window must know it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats, Indices, Pixels
from losbench.imaging.places import as_stack, as_starts, evenly, in_frame
from losbench.imaging.stamps import cut_stamps

__all__ = ["default_window", "spot_sigma", "window_in_first"]


_SIGMA_REACH = 20  # pixels around a spot that its width is read from
_SIGMA_FRAMES = 16
_SIGMA_SPOTS = 64


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
    """Width of the spots, in pixels: the median over up to 64 of the Gaussian sigma of their bright
    part's wider axis.

    Each spot is averaged over up to 16 frames. What exceeds a third of its peak, and is connected
    with it, is weighted by that excess; its second moment about its own centre is a known part of a
    Gaussian's. NaN if no spot is seen.

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
    stamps = cut_stamps(stack, chosen[frame], middle, _SIGMA_REACH)
    widths = [_bright_sigma(stamps[spot == k].astype(np.float64)) for k in few]
    return float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan


def _bright_sigma(stamps: Pixels) -> float:
    from scipy import ndimage

    present = np.isfinite(stamps)
    mean = np.where(present, stamps, 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1)
    seen = present.any(axis=0)
    signal = np.where(seen, mean - np.median(mean[seen]), 0.0) if seen.any() else mean
    near = signal[10:-10, 10:-10]
    top = np.unravel_index(near.argmax(), near.shape)
    peak = near[top]
    if not peak > 0:
        return np.nan
    part = 1.0 / 3.0
    groups, _ = ndimage.label(signal > part * peak)
    excess = np.where(groups == groups[top[0] + 10, top[1] + 10], signal - part * peak, 0.0)
    place = np.arange(len(signal))
    variance = max(_variance(excess.sum(axis=axis), place) for axis in (0, 1))
    # Second moment of exp(-u) - t within u < q = ln(1/t), u = r^2 / (2 sigma^2), in units of
    # sigma^2; Sheppard's 1/12.
    q = -np.log(part)
    gaussian = (1 - part * (1 + q + q**2 / 2)) / (1 - part - part * q)
    return float(np.sqrt(max(variance / gaussian - 1.0 / 12.0, 0.04)))


def _variance(weight: Floats, place: Indices) -> float:
    centre = weight @ place / weight.sum()
    return float(weight @ (place - centre) ** 2 / weight.sum())
