"""From stamps to measured windows: background, centroid, error and flags of a block of spots."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from losbench.imaging.background import RING, RingPlane, fit_ring, gate_hot_pixels
from losbench.imaging.detector import Detector
from losbench.imaging.eiwa import NEWTON_LIMIT, Look, WindowFit, eiwa, grey, look, spread
from losbench.imaging.stamps import cut_stamps

__all__ = ["Choices", "Measured", "SpotFlag", "measure_windows"]

Floats = NDArray[np.float64]
Pixels = NDArray[np.floating[Any]]
Whole = NDArray[np.intp]

_OFF_CENTRE = 0.6  # pixels; over a half, so that a centroid near a pixel border is not cut back and forth
_FAINTEST = 5.0  # flux in units of its error
_PLATEAU = 5  # pixels


class SpotFlag(IntFlag):
    """What may be wrong with a centroid; the docstring of `centroid` says what each bit means."""

    NOT_CONVERGED = 1
    EDGE = 2
    SATURATED = 4
    NEIGHBOUR = 8
    TOO_FAINT = 16
    SLOW = 32
    MISSING = 64


@dataclass(frozen=True)
class Choices:
    """How to measure: what holds for every spot of a call."""

    moving: bool
    window: int
    ring: int
    stop: str
    tolerance: float
    max_iter: int
    background: str | float
    gate: bool
    noise: Detector | None
    full_scale: float
    rounding: float  # variance of a reading's rounding, DN squared


@dataclass(frozen=True)
class Measured:
    """Results of M windows: xy and sigma_xy (M, 2) in frame pixels, the others (M,)."""

    xy: Floats
    sigma_xy: Floats
    flux: Floats
    background: Floats
    n_iter: NDArray[np.int64]
    flags: NDArray[np.int64]


@dataclass(frozen=True)
class _Stamps:
    """Windows ready to be weighed: what was read, the background under it, what is left, and what was not read."""

    raw: Pixels
    signal: Pixels
    missing: NDArray[np.bool_] | None
    plane: RingPlane


def measure_windows(
    stack: NDArray[Any],
    frame: Whole,
    middle: Whole,
    start: Floats,
    how: Choices,
    *,
    now: Floats | None = None,
    path: list[Floats] | None = None,
    recuts: int = 10,
) -> Measured:
    """Measure M spots: frame numbers (M,), whole pixels to cut around (M, 2) and starts (M, 2) in frame pixels.

    A window that leaves the middle pixel of its stamp, or comes to rest off it while the ring does not, is cut anew
    around where it is ``now``. ``path`` receives the centres (M, 2) of every iteration.
    """
    stamps = _cut(stack, frame, middle, how)
    if not how.moving:
        fit = grey(stamps.signal, np.zeros(middle.shape), how.window)
        return _judge(stack.shape[1:], middle, stamps, fit, how)
    trace: list[Floats] | None = None if path is None else []
    here = (start if now is None else now) - middle
    rule, size, most = how.stop, how.tolerance, how.max_iter
    fit = eiwa(stamps.signal, here, how.window, stop=rule, tolerance=size, max_iter=most, path=trace)
    if path is not None and trace is not None:
        path.extend(centre + middle for centre in trace[bool(path) :])
    result = _judge(stack.shape[1:], middle, stamps, fit, how)

    moved = np.nan_to_num(fit.centroid, posinf=0.0, neginf=0.0)
    nearest = middle + np.rint(moved).astype(np.intp)
    strayed = _longest(nearest - start) > how.window / 2
    result.flags[strayed] |= SpotFlag.NOT_CONVERGED
    again = (_longest(moved) > _OFF_CENTRE) & ~strayed & _inside(nearest, stack.shape[1:])
    if how.background != "ring":
        again &= ~fit.converged
    if recuts and again.any():
        now = moved[again] + middle[again]
        redone = measure_windows(
            stack, frame[again], nearest[again], start[again], how, now=now, path=path, recuts=recuts - 1
        )
        redone.n_iter[:] += result.n_iter[again]
        for name, values in vars(result).items():
            values[again] = getattr(redone, name)
    return result


def _longest(vectors: Floats) -> Floats:
    return np.maximum(np.abs(vectors[:, 0]), np.abs(vectors[:, 1]))


def _inside(pixels: Whole, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    x, y = pixels.T
    return (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])


def _cut(stack: NDArray[Any], frame: Whole, middle: Whole, how: Choices) -> _Stamps:
    stamps = cut_stamps(stack, frame, middle, how.ring // 2 + RING)
    plane = fit_ring(stamps, how.ring)
    # One pixel for the window to move in, and one more where the gate looks at neighbours.
    reach = how.window // 2 + (2 if how.gate else 1)
    margin = slice(how.ring // 2 + RING - reach, how.ring // 2 + RING + reach + 1)
    raw = np.ascontiguousarray(stamps[:, margin, margin])
    signal: Pixels = raw - _under(plane, how, reach, raw.dtype)
    absent = np.isnan(raw)
    missing = absent if absent.any() else None
    if missing is not None:
        signal[missing] = 0.0
    if how.gate:
        signal = gate_hot_pixels(signal, np.nan_to_num(plane.scatter))[:, 1:-1, 1:-1]
        raw = raw[:, 1:-1, 1:-1]
        missing = None if missing is None else missing[:, 1:-1, 1:-1]
    return _Stamps(raw, signal, missing, plane)


def _under(plane: RingPlane, how: Choices, reach: int, dtype: DTypeLike = np.float64) -> Pixels:
    if how.background == "ring":
        return plane.over(reach, dtype)
    return np.full((1, 1, 1), 0.0 if how.background == "none" else how.background, dtype=dtype)


def _judge(shape: tuple[int, ...], middle: Whole, stamps: _Stamps, fit: WindowFit, how: Choices) -> Measured:
    """Errors and flags of windows that have come to rest."""
    seen = fit.seen
    window_centre = fit.centroid if how.moving else np.zeros_like(fit.centroid)
    level = np.broadcast_to(
        np.asarray(_under(stamps.plane, how, 0), dtype=np.float64).reshape(-1), seen.total.shape
    ).copy()
    sigma, sigma_flux = _errors(stamps, window_centre, seen, fit, level, how)
    if how.background == "ring":
        level = level + (stamps.plane.slope * fit.centroid).sum(axis=1)

    at = window_centre + middle
    end = np.array(shape[::-1]) - 0.5
    leaves = ((at - how.window / 2 < -0.5 - 1e-9) | (at + how.window / 2 > end + 1e-9)).any(axis=1)
    reach = how.ring // 2 + RING
    clipped = ((middle < reach) | (middle + reach > end)).any(axis=1)
    holes = np.zeros(len(middle), dtype=bool)
    if stamps.missing is not None:
        unread = look(stamps.missing.astype(np.float64), np.nan_to_num(window_centre), how.window).total
        holes = (unread > 1e-9) & ~leaves
    with np.errstate(invalid="ignore"):
        faint = ~(seen.total > 0) | (seen.total < _FAINTEST * sigma_flux)
    slow = seen.contraction.max(axis=1) > NEWTON_LIMIT

    flags = np.zeros(len(middle), dtype=np.int64)
    for flag, where in (
        (SpotFlag.NOT_CONVERGED, ~fit.converged & ~holes),
        (SpotFlag.EDGE, leaves | clipped),
        (SpotFlag.SATURATED, _saturated(stamps, level, how)),
        (SpotFlag.TOO_FAINT, faint & ~holes),
        (SpotFlag.SLOW, slow),
        (SpotFlag.MISSING, holes),
    ):
        flags[where] |= flag
    nowhere = (leaves | holes | faint)[:, None]
    xy = np.where(nowhere, np.nan, fit.centroid + middle)
    return Measured(xy, np.where(np.isnan(xy), np.nan, sigma), seen.total, level, fit.n_iter.copy(), flags)


def _errors(
    stamps: _Stamps, centre: Floats, seen: Look, fit: WindowFit, level: Floats, how: Choices
) -> tuple[Floats, Floats]:
    """Predicted errors of the centroid (M, 2) and of the flux (M,)."""
    if how.noise is None:
        floor, per_dn = np.maximum(stamps.plane.scatter**2, how.rounding), 0.0
    else:
        floor, per_dn = how.noise.variance_dn(level), 1.0 / how.noise.gain_e_per_dn
    total_variance, moment_variance = spread(stamps.signal, centre, how.window, floor, per_dn)
    if how.background == "ring":
        arm = how.window**2 * (how.window**2 - 1) / 12.0
        moment_variance += arm**2 * stamps.plane.slope_variance * floor[:, None]
        total_variance += how.window**4 * stamps.plane.level_variance * floor
    gain = 1.0 / np.maximum(1.0 - seen.contraction, 1.0 - NEWTON_LIMIT) if how.moving else 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        statistical = np.maximum(moment_variance, 0.0) * (gain / seen.total[:, None]) ** 2
    return np.sqrt(statistical + fit.remaining**2), np.sqrt(np.maximum(total_variance, 0.0))


def _saturated(stamps: _Stamps, level: Floats, how: Choices) -> NDArray[np.bool_]:
    """Full scale is reached, or more pixels share the maximum than whole numbers make of a round top."""
    inner = stamps.raw[:, 1:-1, 1:-1].reshape(len(level), -1)
    if stamps.missing is not None:
        inner = np.where(np.isnan(inner), -np.inf, inner)
    top = inner.max(axis=1)
    sharing = (inner == top[:, None]).astype(np.float32).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = how.window**2 / (top - level)
        plateau = (top > level) & (sharing >= _PLATEAU + chance)
    return (top >= how.full_scale) | plateau
