"""From stamps to measured windows: background, centroid, error and flags of a block of spots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from losbench.arrays import Bools, Floats, Indices, Ints, Pixels
from losbench.imaging.background import RING, PixelNoise, RingPlane, fit_ring, gate_hot_pixels
from losbench.imaging.eiwa import look
from losbench.imaging.estimates import Choices, Estimate, estimate
from losbench.imaging.results import SpotFlag
from losbench.imaging.stamps import cut_stamps

__all__ = [
    "Measured",
    "Stamps",
    "cut_windows",
    "level_of",
    "measure_windows",
    "pixel_noise",
    "saturated",
]


_OFF_CENTRE = (
    0.6  # pixels; over a half, so that a centroid near a pixel border is not cut back and forth
)
_FAINTEST = 5.0  # flux in units of its error
_PLATEAU = 5  # pixels
_LEAK = 0.01  # of the peak
_SURE = 5.0  # sigma


@dataclass(frozen=True)
class Measured:
    """Results of M windows: xy and sigma_xy (M, 2) in frame pixels, the others (M,)."""

    xy: Floats
    sigma_xy: Floats
    flux: Floats
    background: Floats
    n_iter: Ints
    flags: Ints


@dataclass(frozen=True)
class Stamps:
    """Windows ready to be weighed: what was read, the background under it, what is left, and what
    was not read.
    """

    raw: Pixels
    signal: Pixels
    missing: Bools | None
    plane: RingPlane


def measure_windows(
    stack: NDArray[Any],
    frame: Indices,
    middle: Indices,
    start: Floats,
    how: Choices,
    *,
    width: Floats | None = None,
    now: Floats | None = None,
    path: list[Floats] | None = None,
    recuts: int = 10,
) -> Measured:
    """Measure M spots: frame numbers (M,), whole pixels to cut around (M, 2) and starts (M, 2) in
    frame pixels.

    The methods with a template need its ``width`` (M, 2). A window that leaves the middle pixel of
    its stamp, or comes to rest off it while the ring does not, is cut anew around where it is
    ``now``. ``path`` receives the centres (M, 2) of every iteration.
    """
    stamps = cut_windows(stack, frame, middle, how)
    level = level_of(stamps, how)
    trace: list[Floats] | None = None if path is None else []
    here = (start if now is None else now) - middle
    fit = estimate(
        stamps.signal, here, pixel_noise(stamps, level, how), how, width=width, path=trace
    )
    if path is not None and trace is not None:
        path.extend(centre + middle for centre in trace[bool(path) :])
    result = _judge(stack.shape[1:], middle, stamps, level, fit, how)
    if how.method == "grey":
        return result

    moved = np.nan_to_num(fit.centroid, posinf=0.0, neginf=0.0)
    nearest = middle + np.rint(moved).astype(np.intp)
    strayed = _longest(nearest - start) > how.window / 2
    result.flags[strayed] |= SpotFlag.NOT_CONVERGED
    again = (_longest(moved) > _OFF_CENTRE) & ~strayed & _inside(nearest, stack.shape[1:])
    if how.background != "ring":
        again &= ~fit.converged
    if recuts and again.any():
        now = moved[again] + middle[again]
        mine = None if width is None else width[again]
        redone = measure_windows(
            stack,
            frame[again],
            nearest[again],
            start[again],
            how,
            width=mine,
            now=now,
            path=path,
            recuts=recuts - 1,
        )
        redone.n_iter[:] += result.n_iter[again]
        for name, values in vars(result).items():
            values[again] = getattr(redone, name)
    return result


def _longest(vectors: Floats) -> Floats:
    return np.maximum(np.abs(vectors[:, 0]), np.abs(vectors[:, 1]))


def _inside(pixels: Indices, shape: tuple[int, ...]) -> Bools:
    x, y = pixels.T
    return (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])


def cut_windows(stack: NDArray[Any], frame: Indices, middle: Indices, how: Choices) -> Stamps:
    """Cut M windows, each with a margin of one pixel, around whole pixels (M, 2), and take the
    background off.
    """
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
    return Stamps(raw, signal, missing, plane)


def _under(plane: RingPlane, how: Choices, reach: int, dtype: DTypeLike = np.float64) -> Pixels:
    if how.background == "ring":
        return plane.over(reach, dtype)
    return np.full((1, 1, 1), 0.0 if how.background == "none" else how.background, dtype=dtype)


def level_of(stamps: Stamps, how: Choices) -> Floats:
    """Background in the middle of each stamp, (M,)."""
    level = np.asarray(_under(stamps.plane, how, 0), dtype=np.float64).reshape(-1)
    return np.broadcast_to(level, (len(stamps.raw),)).copy()


def pixel_noise(stamps: Stamps, level: Floats, how: Choices) -> PixelNoise:
    """Variance of the pixels on that background, from the detector or else from the ring."""
    if how.noise is None:
        # Frames without any noise are known to their last digit, not to nothing.
        digit = 0.0 if how.rounding else np.finfo(stamps.raw.dtype).eps * np.abs(_peak(stamps))
        floor, per_dn = np.maximum(stamps.plane.scatter**2, how.rounding + digit**2), 0.0
    else:
        floor, per_dn = how.noise.variance_dn(level), 1.0 / how.noise.gain_e_per_dn
    plane = np.zeros((len(floor), 3))
    if how.background == "ring":
        plane[:, 0] = stamps.plane.level_variance * floor
        plane[:, 1:] = stamps.plane.slope_variance * floor[:, None]
    return PixelNoise(floor, per_dn, plane)


def _judge(
    shape: tuple[int, ...],
    middle: Indices,
    stamps: Stamps,
    level: Floats,
    fit: Estimate,
    how: Choices,
) -> Measured:
    """Flags of windows that have come to rest."""
    if how.background == "ring":
        level = level + (stamps.plane.slope * fit.centroid).sum(axis=1)

    at = fit.middle + middle
    end = np.array(shape[::-1]) - 0.5
    leaves = ((at - how.window / 2 < -0.5 - 1e-9) | (at + how.window / 2 > end + 1e-9)).any(axis=1)
    reach = how.ring // 2 + RING
    clipped = ((middle < reach) | (middle + reach > end)).any(axis=1)
    holes = np.zeros(len(middle), dtype=bool)
    if stamps.missing is not None:
        unread = look(
            stamps.missing.astype(np.float64), np.nan_to_num(fit.middle), how.window
        ).total
        holes = (unread > 1e-9) & ~leaves
    with np.errstate(invalid="ignore"):
        faint = ~(fit.flux > 0) | (fit.flux < _FAINTEST * fit.sigma_flux)

    flags = np.zeros(len(middle), dtype=np.int64)
    for flag, where in (
        (SpotFlag.NOT_CONVERGED, ~fit.converged & ~holes),
        (SpotFlag.EDGE, leaves | clipped),
        (SpotFlag.SATURATED, saturated(stamps, level, how)),
        (SpotFlag.TOO_FAINT, faint & ~holes),
        (SpotFlag.SLOW, fit.slow),
        (SpotFlag.RING, _leaks(stamps, level, how) & ~faint & ~leaves & ~clipped),
        (SpotFlag.MISFIT, fit.misfit & ~faint & ~leaves),
        (SpotFlag.MISSING, holes),
    ):
        flags[where] |= flag
    nowhere = (leaves | holes | faint)[:, None]
    xy = np.where(nowhere, np.nan, fit.centroid + middle)
    return Measured(
        xy, np.where(np.isnan(xy), np.nan, fit.sigma), fit.flux, level, fit.n_iter.copy(), flags
    )


def _peak(stamps: Stamps) -> Floats:
    """Highest reading of each stamp, of the pixels that were read."""
    pixels = stamps.raw.reshape(len(stamps.raw), -1)
    top = pixels.max(axis=1) if stamps.missing is None else np.nan_to_num(pixels).max(axis=1)
    return top.astype(np.float64)


def _leaks(stamps: Stamps, level: Floats, how: Choices) -> Bools:
    """The ring grows brighter towards the spot: surely, and by more than a hundredth of the spot's
    peak.
    """
    if how.background != "ring":
        return np.zeros(len(level), dtype=bool)
    excess, error = stamps.plane.excess, stamps.plane.excess_error
    with np.errstate(invalid="ignore"):
        leaks: Bools = (excess > _SURE * error) & (excess > _LEAK * (_peak(stamps) - level))
    return leaks


def saturated(stamps: Stamps, level: Floats, how: Choices) -> Bools:
    """Full scale is reached, or more pixels share the maximum than whole numbers make of a round
    top.
    """
    inner = stamps.raw[:, 1:-1, 1:-1].reshape(len(level), -1)
    if stamps.missing is not None:
        inner = np.where(np.isnan(inner), -np.inf, inner)
    top = inner.max(axis=1)
    sharing = (inner == top[:, None]).astype(np.float32).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = how.window**2 / (top - level)
        plateau = (top > level) & (sharing >= _PLATEAU + chance)
    return (top >= how.full_scale) | plateau
