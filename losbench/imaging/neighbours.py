"""Light of another spot in a window and its ring: what stands on one side of the spot only, or in
two tops with a dip between them.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from losbench.arrays import Bools, Floats, Pixels
from losbench.imaging.columns import Templates
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows
from losbench.imaging.template import TemplateFit

__all__ = ["OF_PEAK", "SURE", "dark_in_the_middle", "lopsided", "one_sided", "turned", "two_tops"]


SURE = 5.5  # errors
OF_PEAK = 0.02  # of light on one side only
_OUTSIDE = 1.5  # sigma of the spot
_SHARP = 2.0  # pixels of sigma
LONE = 0.7  # of the light of 3 x 3 pixels in one of them
_DIP = 0.8  # of the top, what is darker between two makes them two, as for the finder
_BESIDE = 0.5  # of the top, what is darker on both sides of the line through two is no ring
_APART = 1.5  # pixels from the middle to a top


def lopsided(stamps: Pixels, kept: Pixels, noise: PixelNoise, fit: TemplateFit) -> Bools:
    """Whether light stands on one side of M spots that is not on the other (M,).

    Stamps (M, T, T) without background hold window and ring. What the template leaves over, minus
    itself turned by 180 degrees about the spot: the mean of 3 x 3 pixels beyond 1.5 sigma by 5.5
    errors and 2 % of the peak, unless one pixel holds 70 % of it.
    """
    size = stamps.shape[1]
    at = Templates.of(size, fit.centre, fit.width, stamps.dtype, free=False)
    model = at.light * fit.flux.astype(stamps.dtype)[:, None, None]
    variance = noise.floor[:, None, None] + noise.per_dn * np.maximum(model, 0.0)
    offset = np.arange(size) - size // 2
    arms = (offset - fit.centre[:, :, None]) / fit.width[:, :, None]
    far = arms[:, 1, :, None] ** 2 + arms[:, 0, None, :] ** 2 > _OUTSIDE**2
    least = OF_PEAK * model.max(axis=(1, 2), keepdims=True)
    more = _apart((stamps - model) * kept, kept, fit.centre, variance, least, LONE)
    return (more & far)[:, 1:-1, 1:-1].any(axis=(1, 2))


def one_sided(
    stamps: Pixels,
    kept: Pixels,
    noise: PixelNoise,
    centre: Floats,
    side: int,
    *,
    sure: float = 1.0,
    of_peak: float = OF_PEAK,
    lone: float | None = LONE,
) -> Bools:
    """Whether that is so beyond the middle of windows of ``side`` pixels, half as wide (M,).

    Without a template, and at so much of the 5.5 errors and of the peak, unless one pixel holds
    that part of it; of a spot that is sharp for its window, beyond 1.5 sigma, by its light in the
    brightest pixel, and from half as much.
    """
    offset = np.abs(np.arange(stamps.shape[1]) - stamps.shape[1] // 2)
    top, light = stamps.max(axis=(1, 2)), np.maximum(stamps.sum(axis=(1, 2)), 0.0)
    sigma = np.sqrt(light / (2.0 * np.pi * np.maximum(top, 1e-30)))[:, None, None]
    far = np.maximum(offset[:, None], offset) > np.minimum(side // 4, _OUTSIDE * sigma)
    variance = noise.floor[:, None, None] + noise.per_dn * np.maximum(stamps, 0.0)
    # A thin ring, turned between pixels, is no closer to itself than this; a sharp spot is.
    least = of_peak * np.clip(sigma / _SHARP, 0.5, 1.0)
    least = least * _mean_of_nine(stamps).max(axis=(1, 2), keepdims=True)
    more = _apart(stamps, kept, centre, sure**2 * variance, least, lone)
    return (more & far)[:, 1:-1, 1:-1].any(axis=(1, 2))


def _apart(
    rest: Pixels, kept: Pixels, centre: Floats, variance: Floats, least: Floats, lone: float | None
) -> Bools:
    """Where the mean of 3 x 3 pixels, minus that on the other side, is light (M, T, T), of which
    one pixel holds less than that part.
    """
    import cv2

    apart = rest - turned(rest, centre)
    apart *= kept * (turned(kept, centre) > 0.99)
    mean = _mean_of_nine(apart)
    highest = cv2.dilate(_tall(apart), np.ones((3, 3), np.uint8)).reshape(apart.shape)
    error = np.sqrt(2.0 * np.maximum(variance, 0.0) / 9.0)
    more: Bools = (mean > SURE * error) & (mean > least)
    return more if lone is None else more & (highest < lone * 9.0 * mean)


def dark_in_the_middle(signal: Pixels, centre: Floats, height: Floats, noise: PixelNoise) -> Bools:
    """Whether the pixel at the centre of M windows (M, S, S) is darker than a dip below the
    brightest, as between two tops: a glance.
    """
    half = signal.shape[1] // 2
    x, y = np.rint(np.where(np.isfinite(centre), centre, 0.0)).astype(np.intp).clip(-half, half).T
    value = signal[np.arange(len(x)), y + half, x + half]
    dark: Bools = value < _DIP * height
    if dark.any():
        variance = noise.floor + noise.per_dn * height
        # As sure as the means of nine pixels are that follow.
        dark &= value < _DIP * height - SURE / 3.0 * np.sqrt(np.maximum(variance, 0.0))
    return dark


def two_tops(windows: Windows, centre: Floats) -> Bools:
    """Whether M windows stand between two tops of light, or beside one (M,).

    By means of 3 x 3 pixels: the centre is darker than 0.8 of the top, by 5.5 errors, and so are,
    by a half, both places beside the line through the top, where a ring is as bright.
    """
    import cv2

    signal, noise = windows.signal, windows.noise
    kept = np.ones_like(signal) if windows.kept is None else windows.kept
    light = signal * kept
    highest = cv2.dilate(_tall(light), np.ones((3, 3), np.uint8)).reshape(signal.shape)
    mean = _mean_of_nine(light) / np.maximum(_mean_of_nine(kept), 1e-3)
    mean = np.where(highest < LONE * 9.0 * mean, mean, 0.0)[:, 1:-1, 1:-1]
    size, each = mean.shape[1], np.arange(len(mean))
    row, column = np.divmod(mean.reshape(len(mean), -1).argmax(axis=1), size)
    top = mean[each, row, column].astype(np.float64)
    away = np.stack([column, row], axis=1) - size // 2 - centre

    def at(place: Floats) -> Floats:
        x, y = np.rint(place).astype(np.intp).clip(-(size // 2), size // 2).T + size // 2
        return mean[each, y, x].astype(np.float64)

    across = away[:, ::-1] * (1.0, -1.0)
    beside = np.maximum(at(centre + across), at(centre - across))
    error = np.sqrt(np.maximum(noise.floor + noise.per_dn * np.maximum(top, 0.0), 0.0) / 9.0)
    found: Bools = at(centre) < _DIP * top - SURE * error
    return found & (beside < _BESIDE * top) & (np.hypot(*away.T) > _APART)


def turned(images: Pixels, centre: Floats) -> Pixels:
    """Images turned by 180 degrees about their centres, linearly between pixels."""
    size = images.shape[1]
    both = np.arange(2 * size - 1, dtype=images.dtype) - 2 * (size // 2)
    share = np.abs((2.0 * centre).astype(images.dtype)[:, :, None] - both)
    np.subtract(1.0, share, out=share)
    np.maximum(share, 0.0, out=share)
    # What a pixel gives to another depends on the sum of their offsets alone.
    share = np.ascontiguousarray(sliding_window_view(share, size, axis=2))
    found: Pixels = share[:, 1] @ images @ share[:, 0]
    return found


def _mean_of_nine(images: Pixels) -> Pixels:
    """Means of 3 x 3 pixels of images (M, S, S), of no use in the outermost."""
    import cv2

    mean: Pixels = cv2.blur(_tall(images), (3, 3)).reshape(images.shape)
    return mean


def _tall(images: Pixels) -> Pixels:
    """Images below each other, for one call of OpenCV."""
    return np.ascontiguousarray(images.reshape(-1, images.shape[2]), dtype=np.float32)
