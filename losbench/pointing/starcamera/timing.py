"""Drifts and attitudes at the times they are wanted: smoothed, interpolated, and the clocks of two
heads compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from losbench.arrays import Bools, Floats
from losbench.checks import finite, number, positive, shaped
from losbench.pointing.starcamera.convention import Attitudes, QuaternionConvention
from losbench.series import read_series, window_means

__all__ = [
    "TimeOffset",
    "interpolate_attitude",
    "interpolate_drift",
    "smooth_drift",
    "time_tag_offset",
]

_TELLING = 2.0  # mean square of the rate over that of its noise
_ROUNDS = 3


def smooth_drift(time_s: ArrayLike, drift: ArrayLike, *, window_s: float) -> Floats:
    """Low-pass a drift by its mean over a window about each time.

    Parameters
    ----------
    time_s : (n,) array, seconds
        Increasing, in any steps.
    drift : (n, ...) array, any unit
        A row with NaN is left out of the mean, and stays missing.
    window_s : float
        Width of the window. At the ends of a record it holds fewer samples.

    Returns
    -------
    (n, ...) array, same unit

    Raises
    ------
    ValueError
        If times do not increase or shapes do not match.

    Examples
    --------
    >>> smooth_drift(
    ...     [0.0, 1.0, 2.0, 3.0], [[0.0], [3.0], [0.0], [3.0]], window_s=2.0
    ... ).ravel().tolist()
    [1.5, 1.0, 2.0, 1.5]
    """
    t, x = read_series(time_s, drift, "drift")
    return window_means(t, x, float(positive("window_s", number("window_s", window_s))))


def interpolate_drift(
    time_s: ArrayLike, drift: ArrayLike, at_s: ArrayLike, *, max_gap_s: float = 10.0
) -> Floats:
    """Drift rotation vectors at other times, along the shortest turn between neighbours (Slerp).

    Parameters
    ----------
    time_s : (n,) array, seconds
        Increasing.
    drift : (n, 3) array, radians
        A row with NaN is missing.
    at_s : (m,) array, seconds
        Wanted times.
    max_gap_s : float
        Longest stretch between known drifts that is bridged.

    Returns
    -------
    (m, 3) array, radians
        NaN outside the known drifts and inside longer gaps.

    Raises
    ------
    ValueError
        If times do not increase, shapes do not match or no drift is known at two times.

    Examples
    --------
    >>> interpolate_drift([0.0, 2.0], [[0.0, 0.0, 0.0], [2e-6, 0.0, 0.0]], [1.0, 3.0]).round(
    ...     9
    ... ).tolist()
    [[1e-06, 0.0, 0.0], [nan, nan, nan]]
    """
    t, x = read_series(time_s, drift, "drift")
    shaped("drift", x, (len(t), 3))
    known = np.isfinite(x.sum(axis=1))
    turned, inside = _slerp(t[known], Rotation.from_rotvec(x[known]), at_s, max_gap_s, "drift")
    return np.where(inside[:, None], turned.as_rotvec(), np.nan)


def interpolate_attitude(
    time_s: ArrayLike,
    quaternions: ArrayLike,
    at_s: ArrayLike,
    *,
    convention: QuaternionConvention,
    max_gap_s: float = 1.0,
) -> Floats:
    """Attitudes at other times by Slerp; the sign of a quaternion may flip between samples.

    Halfway between two samples their noise is averaged: an NEA taken from interpolated attitudes
    comes out low.

    Parameters
    ----------
    time_s : (n,) array, seconds
        Increasing.
    quaternions : (n, 4) array
        A row with NaN is missing.
    at_s : (m,) array, seconds
        Wanted times.
    convention : QuaternionConvention
        Order and direction of the quaternions; the result keeps to it.
    max_gap_s : float
        Longest stretch between attitudes that is bridged.

    Returns
    -------
    (m, 4) array
        NaN outside the attitudes and inside longer gaps.

    Raises
    ------
    ValueError
        If times do not increase, a quaternion is not of unit length, or the times do not overlap.
    """
    t, q = read_series(time_s, quaternions, "quaternions")
    attitudes = Attitudes.read(q, convention)
    known = ~attitudes.missing
    turned, inside = _slerp(t[known], attitudes.stored[known], at_s, max_gap_s, "attitudes")
    return np.where(
        inside[:, None], turned.as_quat(scalar_first=convention.scalar == "first"), np.nan
    )


@dataclass(frozen=True)
class TimeOffset:
    """What to add to the second head's time tags, ``seconds``, with its one-sigma error
    ``sigma_s``.
    """

    seconds: float
    sigma_s: float


def time_tag_offset(
    time_s: ArrayLike,
    first: ArrayLike,
    second: ArrayLike,
    *,
    convention: QuaternionConvention,
    smooth_s: float = 2.0,
) -> TimeOffset:
    """Find the offset between two heads' time tags from the changes of the rate at which both turn.

    Two rigidly mounted heads that are read at different moments seem to turn against each other by
    rate x offset; what of that is constant looks like a mounting error, so only a changing rate
    tells. Noise is taken as white; what it may have taken off the offset is part of the error.

    Parameters
    ----------
    time_s : (n,) array, seconds
        Increasing; the tags that both heads claim.
    first, second : (n, 4) arrays
        Attitudes of one track; a row with NaN in either is left out.
    convention : QuaternionConvention
        Order and direction of the quaternions.
    smooth_s : float
        Width over which the rate is taken.

    Returns
    -------
    TimeOffset

    Raises
    ------
    ValueError
        If times do not increase, shapes differ, fewer than ten rows are complete, or the rate
        changes by no more than its noise may: half of its mean square, or more.

    Notes
    -----
    Weighted regression of the relative rotation, C0' R1' R2 as a rotation vector, on the rate of
    the second head, each axis by the scatter that it leaves.
    """
    t, q1 = read_series(time_s, first, "first")
    q2 = read_series(time_s, second, "second")[1]
    one, two = Attitudes.read(q1, convention, "first"), Attitudes.read(q2, convention, "second")
    known = ~(one.missing | two.missing)
    if np.count_nonzero(known) < 10:
        raise ValueError(
            f"at least ten rows must hold both attitudes, got {np.count_nonzero(known)}"
        )
    t = t[known]
    r1, r2 = (Rotation.from_matrix(head.matrices()[known]) for head in (one, two))
    relative = r1.inv() * r2
    away = (relative.mean().inv() * relative).as_rotvec()
    rate, span = _rate(t, r2, float(positive("smooth_s", number("smooth_s", smooth_s))))
    away, rate = away - away.mean(axis=0), rate - rate.mean(axis=0)
    seconds = power = 0.0
    for _ in range(_ROUNDS):  # each axis counts by what the offset leaves of it
        weight = 1.0 / np.maximum(np.var(away - seconds * rate, axis=0), 1e-30)
        power = float(np.sum(weight * np.sum(rate**2, axis=0)))
        seconds = float(np.sum(weight * np.sum(rate * away, axis=0))) / max(power, 1e-300)
    # Noise of the second head is in the rate too, at most all that neighbours differ by: it draws
    # the offset towards zero, by its share of the power.
    white = 0.5 * np.mean(np.diff(away - seconds * rate, axis=0) ** 2, axis=0)
    noise = float(np.sum(weight * white) * np.sum(2.0 / span**2))
    if not power > _TELLING * noise:
        raise ValueError(
            "the rate must change by more than its noise for a time offset to be seen; here it is "
            "steady"
        )
    return TimeOffset(seconds, float(np.hypot(power**-0.5, seconds * noise / power)))


def _rate(t: Floats, attitude: Rotation, smooth_s: float) -> tuple[Floats, Floats]:
    """Angular rate (n, 3) in camera axes, radians per second: the mean over a window centred at
    each time; and its width (n,), seconds.
    """
    half = smooth_s / 2.0
    before = np.clip(np.searchsorted(t, t - half), 0, len(t) - 2)
    after = np.clip(np.searchsorted(t, t + half), before + 1, len(t) - 1)
    span = t[after] - t[before]
    return (attitude[before].inv() * attitude[after]).as_rotvec() / span[:, None], span


def _slerp(
    t: Floats, rotations: Rotation, at_s: ArrayLike, max_gap_s: float, what: str
) -> tuple[Rotation, Bools]:
    """Rotations at the wanted times, and which of them lie inside what is known."""
    at = finite("at_s", at_s, ndim=1)
    if len(t) < 2:
        raise ValueError(f"{what} must be known at two times or more, got {len(t)}")
    inside = (at >= t[0]) & (at <= t[-1])
    if not inside.any():
        raise ValueError(
            f"{what} must overlap the wanted times: they run from {t[0]:g} to {t[-1]:g} s, "
            f"wanted are {at.min():g} to {at.max():g} s"
        )
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    bridged = (t[after] - t[after - 1] <= number("max_gap_s", max_gap_s, low=0.0)) | np.isin(at, t)
    return Slerp(t, rotations)(np.clip(at, t[0], t[-1])), inside & bridged
