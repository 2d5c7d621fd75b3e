"""The width of a spot of any size, by an aperture that grows until the spot fits into it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.imaging.places import evenly
from losbench.imaging.stamps import cut_stamps
from losbench.units import SIGMA_PER_MAD

__all__ = ["aperture_sigma"]


_FIRST = 10  # pixels, half the first aperture
_GROWTH = 1.7
_FINEST = 40  # pixels of the half, up to which no pixels are averaged
_FRAMES = 16
_RING = 4  # pixels
_ROUNDED = 12  # pixels of the half, beyond which the peak is that of the 3 x 3 mean
_STANDS_OUT = 5.0  # noises
_LEAKS = 0.05  # of the peak
_CROSS = 0.3  # part of a real peak that its four neighbours hold
_NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], np.float32)
_FWHM = 2.3548
_RIDGE = 1e-9 * np.eye(3)
_FEWEST = 12  # pixels of a ring that tell a plane
_BRIGHT = 20.0  # errors of the flux, for a second moment to tell
_ROUNDS = 12
_LONG = 1.2  # ratio of the axes from which on a spot is not round


def aperture_sigma(stack: NDArray[Any], frame: Indices, middle: Indices) -> float:
    """Gaussian sigma of a spot, in pixels, of the wider axis of one that is not round.

    Parameters
    ----------
    stack : (F, H, W) array
    frame : (K,) array of int
        Frames that show it.
    middle : (K, 2) array of int, pixels
        Where, within ten pixels.

    Returns
    -------
    float
        NaN where nothing stands out.

    Notes
    -----
    The aperture grows while nothing stands out in it, while it is darker far away than in the ring
    around it, and while what is above half of the peak is too wide for it. Then the second moment
    in a window of six sigma about its own centre, of a Gaussian cut off there, is iterated.
    """
    half, most = _FIRST, max(stack.shape[1:])
    while True:
        seen = _Aperture.at(stack, frame, middle, half)
        if half >= most or not seen.outgrown:
            break
        half = int(np.ceil(_GROWTH * half))
    return _second_moment(seen) if seen.stands_out else np.nan


@dataclass(frozen=True)
class _Aperture:
    """What lies around a spot (rows, columns), the level of the ring off: in squares of ``bin``
    pixels, half the aperture in these, the noise of the ring, what is above half of the peak, and
    whether it is darker far away.
    """

    signal: Floats
    bin: int
    half: float
    noise: float
    peak: float
    core: Bools
    darker: bool

    @classmethod
    def at(cls, stack: NDArray[Any], frame: Indices, middle: Indices, half: int) -> _Aperture:
        """Look at a spot."""
        import cv2

        size = max(1, half // _FINEST)
        pixels, away = _around(stack, frame, middle, int(2.25 * half) + 2 * _RING, size)
        seen = np.isfinite(pixels)
        reach = half / size
        around = seen & (away > reach) & (away <= reach + _RING)
        ring = pixels[around]
        far = pixels[seen & (away > 2 * reach + _RING)]
        if not ring.size:
            ring = pixels[seen] if seen.any() else np.zeros(1)
        level = float(np.median(ring))
        spread = np.abs(ring - level)
        if around.any():  # about a plane, so that a gradient is no noise
            spread = np.abs(ring - _plane_under(pixels, around)[around])
        noise = float(max(SIGMA_PER_MAD * np.median(spread), spread.mean() / 3.0))
        signal = _without_hot(np.where(seen, pixels - level, 0.0).astype(np.float32), noise)
        told = cv2.blur(signal, (3, 3)) if reach > _ROUNDED else signal
        near = np.where(away <= reach, told, -np.inf)
        top = np.unravel_index(near.argmax(), near.shape)
        peak = float(near[top])
        _, groups = cv2.connectedComponents((near > peak / 2).astype(np.uint8), connectivity=4)
        error = 1.25 * noise * np.sqrt(1.0 / ring.size + 1.0 / max(far.size, 1))
        step_down = level - float(np.median(far)) if far.size else 0.0
        darker = step_down > max(_LEAKS * peak, _STANDS_OUT * error)
        core = (groups == groups[top]) & (near > peak / 2)
        return cls(signal.astype(np.float64), size, reach, noise, peak, core, darker)

    @property
    def stands_out(self) -> bool:
        """Whether there is a spot."""
        return self.peak > _STANDS_OUT * self.noise / (3.0 if self.half > _ROUNDED else 1.0)

    @property
    def sigma(self) -> float:
        """That of a Gaussian with as many pixels above half of its peak."""
        return float(2.0 * np.sqrt(self.core.sum() / np.pi) / _FWHM)

    @property
    def outgrown(self) -> bool:
        """Whether the spot may be larger than the aperture."""
        if not self.stands_out or self.darker:
            return True
        sides = [np.ptp(np.flatnonzero(self.core.any(axis=axis))) + 1 for axis in (0, 1)]
        return bool(max(sides) > 0.8 * self.half) or 3.2 * self.sigma > self.half


def _around(
    stack: NDArray[Any], frame: Indices, middle: Indices, reach: int, size: int
) -> tuple[Floats, Floats]:
    """Pixels around a spot, and how far each is from its middle: the mean of some frames, or, in
    squares of more than one pixel, those of one.
    """
    if size == 1:
        few = evenly(len(frame), _FRAMES)
        stamps = cut_stamps(stack, frame[few], middle[few], reach)
        if len(few) == 1:
            pixels = stamps[0].astype(np.float64)
        else:
            seen = np.isfinite(stamps)
            count = seen.sum(axis=0)
            total = np.where(seen, stamps, 0.0).sum(axis=0, dtype=np.float64)
            pixels = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        x = y = np.arange(-reach, reach + 1.0)
    else:
        image, (column, row) = stack[frame[0]], middle[0]
        x, y = (
            np.arange(max(at - reach, 0), min(at + reach + 1, length) - size + 1, size)
            for at, length in ((column, image.shape[1]), (row, image.shape[0]))
        )
        cut = image[y[0] : y[-1] + size, x[0] : x[-1] + size]
        squares = cut.reshape(len(y), size, len(x), size)
        pixels = squares.mean(axis=(1, 3), dtype=np.float64)
        x, y = ((at + (size - 1) / 2 - c) / size for at, c in ((x, column), (y, row)))
    return pixels, np.maximum(np.abs(y)[:, None], np.abs(x))


def _without_hot(signal: Pixels, noise: float) -> Pixels:
    """Replace pixels that stand out of their 3 x 3 median, unless their neighbours share their
    light.
    """
    import cv2

    median = cv2.medianBlur(signal, 3)
    hot = signal > 2.0 * np.maximum(median, 0.0) + _STANDS_OUT * noise
    if hot.any():
        cross = cv2.filter2D(signal, -1, _NEIGHBOURS)
        hot &= cross < _CROSS * signal
    return np.where(hot, median, signal)


def _second_moment(seen: _Aperture) -> float:
    """Sigma from the second moment, or from the core where the spot is too faint for that."""
    signal, first = seen.signal, max(seen.sigma, 0.3)
    row, column = np.nonzero(seen.core)
    centre, sigma = np.array([column.mean(), row.mean()]), np.array([first, first])
    for _ in range(_ROUNDS):
        half = max(int(np.rint(3.0 * sigma.max())), 1)
        window, beyond = (
            _square(signal, centre, half),
            _square(signal, centre, half + max(half // 3, 2)),
        )
        # Only what lies around is looked at: the square of the window within the larger one.
        inner = tuple(
            slice(a.start - b.start, a.stop - b.start) for a, b in zip(window, beyond, strict=True)
        )
        ring = np.ones(signal[beyond].shape, bool)
        ring[inner] = False
        light = signal[window] - _plane_under(signal[beyond], ring)[inner]
        flux = float(light.sum())
        if flux < _BRIGHT * seen.noise * np.sqrt(light.size):
            return first * seen.bin
        along = [
            np.arange(part.start, part.start + n)
            for part, n in zip(window, light.shape, strict=True)
        ]
        sums = light.sum(axis=0), light.sum(axis=1)
        centre = np.array([sums[0] @ along[1], sums[1] @ along[0]]) / flux
        moment = np.array(
            [sums[0] @ (along[1] - centre[0]) ** 2, sums[1] @ (along[0] - centre[1]) ** 2]
        )
        variance = moment / flux / _kept_variance((half + 0.5) / sigma) - 1.0 / 12.0
        found = np.sqrt(np.clip(variance, 0.04, None)).clip(0.6 * first, 3.0 * first)
        done = bool((np.abs(found - sigma) < 0.02 * sigma).all())
        sigma = found
        if done:
            break
    wider = float(sigma.max())
    return seen.bin * (wider if wider > _LONG * sigma.min() else float(sigma.mean()))


def _plane_under(pixels: Floats, ring: Bools) -> Floats:
    """Plane (rows, columns) through a ring, without what stands out of it."""
    row, column = np.nonzero(ring)
    if len(row) < _FEWEST:
        return np.full(pixels.shape, np.median(pixels[ring]) if len(row) else 0.0)
    basis = np.stack([np.ones(len(row)), column, row], axis=-1)
    values, kept = pixels[ring], np.ones(len(row), bool)
    for _ in range(2):
        some = basis[kept]
        plane = np.linalg.solve(some.T @ some + _RIDGE, some.T @ values[kept])
        rest = values - basis @ plane
        rest -= np.median(rest)
        kept = np.abs(rest) <= 3.0 * SIGMA_PER_MAD * np.median(np.abs(rest)) + 1e-12
        if kept.sum() < _FEWEST:
            break
    y, x = np.arange(pixels.shape[0])[:, None], np.arange(pixels.shape[1])
    return plane[0] + plane[1] * x + plane[2] * y


def _square(signal: Floats, centre: Floats, half: int) -> tuple[slice, slice]:
    """The pixels within so many of the one that holds the centre."""
    x, y = (int(at) for at in np.rint(centre))
    return (
        slice(max(y - half, 0), min(y + half + 1, len(signal))),
        slice(max(x - half, 0), min(x + half + 1, signal.shape[1])),
    )


def _kept_variance(reach: Floats) -> Floats:
    """Part of a Gaussian's variance that is left when it is cut off at so many sigma."""
    bell = np.exp(-0.5 * reach**2) * np.sqrt(2.0 / np.pi)
    kept: Floats = 1.0 - reach * bell / erf(reach / np.sqrt(2.0))
    return kept
