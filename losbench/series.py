"""Series in time: what belongs together, what is missing, and means that slide along.

Times are seconds and increase; a sample that is missing is NaN. Nothing is taken across a gap.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats, Ints
from losbench.checks import finite_or_nan, increasing, number, odd, shaped

__all__ = [
    "gaps",
    "mark_gaps",
    "neighbours",
    "read_series",
    "runs",
    "sliding_mean",
    "split_tracks",
    "window_means",
]


_LONGEST_STEP = 1.5  # median steps; beyond them stands a gap


def read_series(
    time_s: ArrayLike, values: ArrayLike, name: str = "series"
) -> tuple[Floats, Floats]:
    """Check times (n,) and values (n, ...), in which NaN marks what is missing."""
    t, x = increasing("time_s", time_s), finite_or_nan(name, values)
    shaped(name, x, (len(t), *x.shape[1:]), why=f"to match {len(t)} times")
    return t, x


def gaps(time_s: Floats, *, longest_s: float | None = None) -> Bools:
    """Which steps (n - 1,) between samples are gaps: longer than ``longest_s``, by default than the
    median step by more than half.

    >>> gaps(np.array([0.0, 1.0, 2.0, 5.0])).tolist()
    [False, False, True]
    """
    step = np.diff(time_s)
    if longest_s is None:
        longest_s = _LONGEST_STEP * float(np.median(step)) if len(step) else np.inf
    return step > longest_s


def split_tracks(time_s: ArrayLike, *, gap_s: float = 60.0) -> Ints:
    """Number the tracks of a record: a new one begins after every gap longer than ``gap_s``.

    >>> split_tracks([0.0, 1.0, 500.0, 501.0]).tolist()
    [0, 0, 1, 1]
    """
    broken = gaps(increasing("time_s", time_s), longest_s=number("gap_s", gap_s, low=0.0))
    return np.concatenate([[0], np.cumsum(broken)]).astype(np.int64)


def neighbours(time_s: ArrayLike, *, gap_s: float = 60.0) -> Bools:
    """Which samples (n - 1,) have the next one in the same track.

    >>> neighbours([0.0, 1.0, 500.0, 501.0]).tolist()
    [True, False, True]
    """
    return np.diff(split_tracks(time_s, gap_s=gap_s)) == 0


def mark_gaps(time_s: ArrayLike, series: ArrayLike) -> Floats:
    """Put one NaN row between any two samples that are not neighbours in time, so that nothing is
    taken across.

    Parameters
    ----------
    time_s : (n,) array, seconds
        Increasing. A step is a gap where it exceeds the median step by more than half.
    series : (n, ...) array, any unit

    Returns
    -------
    (n + gaps, ...) array

    Raises
    ------
    ValueError
        If the times do not increase or their number does not fit.

    Examples
    --------
    >>> mark_gaps([0.0, 1.0, 2.0, 5.0], [7.0, 8.0, 9.0, 4.0]).tolist()
    [7.0, 8.0, 9.0, nan, 4.0]
    """
    t, x = read_series(time_s, series)
    if len(t) < 3:
        return x
    return np.insert(x, np.flatnonzero(gaps(t)) + 1, np.nan, axis=0)


def runs(time_s: Floats, present: Bools) -> list[slice]:
    """Pieces of a record without gap or missing sample, from which samples are ``present`` (n,).

    >>> runs(np.array([0.0, 1.0, 2.0, 3.0, 9.0]), np.array([True, False, True, True, True]))
    [slice(0, 1, None), slice(2, 4, None), slice(4, 5, None)]
    """
    joined = np.zeros(len(time_s) + 1, dtype=bool)
    joined[1:-1] = present[1:] & present[:-1] & ~gaps(time_s)
    starts = np.flatnonzero(~joined[:-1] & present)
    ends = np.flatnonzero(present & ~joined[1:]) + 1
    return [slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def sliding_mean(series: ArrayLike, window: int = 5) -> Floats:
    """Centred mean of ``window`` samples along axis 0, (n - window + 1, ...); NaN where a sample is
    missing.

    >>> sliding_mean([1.0, 2.0, 6.0, 4.0], 3).tolist()
    [3.0, 4.0]
    """
    x = finite_or_nan("series", series)
    odd("window", window, low=3, why="so that its mean belongs to a sample")
    if len(x) < window:
        raise ValueError(
            f"series must hold at least {window} samples for a window of {window}, got {len(x)}"
        )
    mean = sliding_window_view(x, window, axis=0).mean(axis=-1)
    if np.isnan(mean).all():
        raise ValueError(
            f"series must hold a run of {window} samples without a gap for a window of {window}"
        )
    return mean


def window_means(time_s: Floats, values: Floats, window_s: float) -> Floats:
    """Means (n, ...) of what lies within half a window of each sample, whatever the steps; a row
    with NaN is left out and stays missing.

    >>> window_means(np.arange(4.0), np.array([[0.0], [3.0], [0.0], [3.0]]), 2.0).ravel().tolist()
    [1.5, 1.0, 2.0, 1.5]
    """
    flat = values.reshape(len(time_s), -1)
    present = np.isfinite(flat.sum(axis=1))
    # Differences of running sums: one pass, whatever the window.
    total = np.concatenate(
        [np.zeros((1, flat.shape[1])), np.cumsum(np.where(present[:, None], flat, 0.0), axis=0)]
    )
    count = np.concatenate([[0], np.cumsum(present)])
    first = np.searchsorted(time_s, time_s - window_s / 2.0, "left")
    last = np.searchsorted(time_s, time_s + window_s / 2.0, "right")
    mean = (total[last] - total[first]) / np.maximum(count[last] - count[first], 1)[:, None]
    return np.where(present[:, None], mean, np.nan).reshape(values.shape)
