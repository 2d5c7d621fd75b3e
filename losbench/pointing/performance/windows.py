"""Pointing metrics window by window: what each stretch of a record says of itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from losbench.arrays import Floats, Indices

__all__ = ["WindowStatistics", "window_statistics"]

_OVERLAP = 8  # windows start every eighth of their length
_ELEMENTS = 2**16  # worked on at once: few enough to stay in the processor's cache


@dataclass(frozen=True)
class WindowStatistics:
    """Squares of what each window shows, (windows, k), and their pairs' (pairs, k).

    ``mean`` is the window mean itself, ``start`` the first sample of each window.
    """

    start: Indices
    mean: Floats
    rpe: Floats
    smear: Floats
    jitter: Floats
    pde: Floats


def window_statistics(
    series: Floats, pieces: list[slice], samples: int, separation: int | None
) -> WindowStatistics:
    """Take every window of so many samples that lies within one of the pieces."""
    parts = [_of_run(series[piece], piece.start, samples, separation) for piece in pieces]
    return WindowStatistics(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("start", "mean", "rpe", "smear", "jitter", "pde")
        }
    )


def _of_run(run: Floats, first: int, samples: int, separation: int | None) -> WindowStatistics:
    stride = max(samples // _OVERLAP, 1)
    axes = run.shape[1]
    if len(run) < samples:
        none = np.empty((0, axes))
        return WindowStatistics(np.empty(0, dtype=np.intp), none, none, none, none, none)
    windows = sliding_window_view(np.ascontiguousarray(run.T), samples, axis=1).swapaxes(0, 1)
    taken = windows[::stride]
    block = max(_ELEMENTS // (samples * axes), 1)
    parts = [_squares(taken[i : i + block]) for i in range(0, len(taken), block)]
    mean, rpe, smear, jitter = (np.concatenate(column) for column in zip(*parts, strict=True))
    pde = np.empty((0, axes))
    if separation is not None and len(windows) > separation:
        later, even = windows[separation::stride], np.full(samples, 1.0 / samples)
        pde = np.concatenate(
            [
                (later[i : i + block] @ even - mean[i : i + block][: len(later) - i]) ** 2
                for i in range(0, len(later), block)
            ]
        )
    return WindowStatistics(first + stride * np.arange(len(mean)), mean, rpe, smear, jitter, pde)


def _squares(windows: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean, and mean squares about it, along the line and about the line, of windows (w, k, n)."""
    samples = windows.shape[-1]
    mean = windows @ np.full(samples, 1.0 / samples)
    # Each window is centred by itself: sums that run along the record would leave rounding errors
    # of the whole drift in the jitter.
    about = windows - mean[..., None]
    along = np.arange(samples) - 0.5 * (samples - 1)
    norm = along @ along
    slope = about @ along / norm
    rpe = np.vecdot(about, about) / samples
    about -= slope[..., None] * along
    return mean, rpe, slope**2 * norm / samples, np.vecdot(about, about) / samples
