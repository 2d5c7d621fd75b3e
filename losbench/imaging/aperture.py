"""The width of a spot of any size, by an aperture that grows until the spot fits into it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Indices
from losbench.imaging.moment import moment_sigma, plane_under
from losbench.imaging.ownlight import STANDS_OUT, without_hot
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
_OFF = 1.5  # sigma, within which a start is on its spot
_LEAKS = 0.05  # of the peak
_FWHM = 2.3548


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
        NaN where nothing stands out, or what does is more than ten pixels and 1.5 sigma away.

    Notes
    -----
    The aperture grows while nothing stands out in it, while it is darker far away than in the ring
    around it, and while what is above half of the peak is too wide for it. Then `moment_sigma` has
    the width: for a Gaussian to about the bound of Cramer and Rao, noise / (amplitude sigma
    sqrt(pi)), for another shape that of its second moment, without the light of other spots: what
    is brighter than the other side, beyond a dip. One as wide and at most as bright, five sigma
    away or more, changes the width by 12 % at most; at three sigma there is no dip between them,
    and both are one wide spot.
    """
    half, most = _FIRST, max(stack.shape[1:])
    while True:
        seen = _Aperture.at(stack, frame, middle, half)
        if half >= most or not seen.outgrown:
            break
        half = int(np.ceil(_GROWTH * half))
    if not seen.stands_out:
        return np.nan
    sigma = seen.bin * moment_sigma(seen.signal, seen.noise, seen.core, seen.sigma)
    return sigma if seen.bin * seen.off <= max(_FIRST, _OFF * sigma) else np.nan


@dataclass(frozen=True)
class _Aperture:
    """What lies around a spot (rows, columns), the level of the ring off: in squares of ``bin``
    pixels, half the aperture in these, the noise of the ring, how far off the peak is, what is
    above half of it, and whether it is darker far away.
    """

    signal: Floats
    bin: int
    half: float
    noise: float
    peak: float
    off: float
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
            spread = np.abs(ring - plane_under(pixels, around)[around])
        noise = float(max(SIGMA_PER_MAD * np.median(spread), spread.mean() / 3.0))
        signal = without_hot(np.where(seen, pixels - level, 0.0).astype(np.float32), noise)
        told = cv2.blur(signal, (3, 3)) if reach > _ROUNDED else signal
        near = np.where(away <= reach, told, -np.inf)
        top = np.unravel_index(near.argmax(), near.shape)
        peak = float(near[top])
        _, groups = cv2.connectedComponents((near > peak / 2).astype(np.uint8), connectivity=4)
        darker = False
        if far.size:
            error = 1.25 * noise * np.sqrt(1.0 / ring.size + 1.0 / far.size)
            step_down = level - float(np.median(far))
            darker = step_down > max(_LEAKS * peak, STANDS_OUT * error)
        core = (groups == groups[top]) & (near > peak / 2)
        return cls(
            signal.astype(np.float64), size, reach, noise, peak, float(away[top]), core, darker
        )

    @property
    def stands_out(self) -> bool:
        """Whether there is a spot."""
        return self.peak > STANDS_OUT * self.noise / (3.0 if self.half > _ROUNDED else 1.0)

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
