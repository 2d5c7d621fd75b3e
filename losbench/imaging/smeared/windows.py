"""The pixels that belong to each star: its window, without background, and which of its pixels
count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from losbench.arrays import Bools, Floats, Indices
from losbench.imaging.detector import Detector
from losbench.records import take
from losbench.units import SIGMA_PER_MAD

__all__ = ["Windows", "centre_covariance", "grey_centre", "prepare"]


@dataclass(frozen=True)
class Windows:
    """Windows of M stars, flat.

    Parameters
    ----------
    light : (M, h, w) array
        Pixels without background; 0 where they do not count.
    used : (M, h, w) array of bool
        Which pixels count, on data and model alike.
    origin : (M, 2) array, pixels
    background : (M,) array
    dark_variance : (M,) array
        Noise variance of a pixel that shows nothing but background.
    shot_variance : float
        What a pixel has more per unit of light.
    saturated, incomplete, missing : (M,) array of bool
        Some pixels at full scale; some not read; none read.
    """

    light: Floats
    used: Bools
    origin: Floats
    background: Floats
    dark_variance: Floats
    shot_variance: float
    saturated: Bools
    incomplete: Bools
    missing: Bools

    @cached_property
    def whole(self) -> bool:
        """Whether every pixel of every window counts."""
        return bool(self.used.all())

    @cached_property
    def moments(self) -> Floats:
        """Sums of the light times 1, x, y, x^2, y^2, x y about each window's middle, (M, 6)."""
        return _moments(self.light, 6)

    @property
    def flux(self) -> Floats:
        """Light of each window, (M,)."""
        return self.moments[:, 0]

    @property
    def flux_error(self) -> Floats:
        """One sigma of the flux, (M,)."""
        pixels = _moments(self.used[:1] if self.whole else self.used, 1)[:, 0]
        return np.sqrt(
            self.shot_variance * np.maximum(self.flux, 0.0) + self.dark_variance * pixels
        )

    def weight(self, light: Floats) -> Floats:
        """Inverse noise variance of the pixels that count, with that light (M, h, w); 1 if no noise
        is known.
        """
        variance = self.shot_variance * light + self.dark_variance[:, None, None]
        return self.used / np.where(variance > 0, variance, 1.0)

    def keep(self, chosen: Indices) -> Windows:
        """Return the windows of some of the stars."""
        return take(self, chosen)

    def only(self, known: Bools) -> Windows:
        """Return the windows with those of the stars that are not ``known`` (M,) blanked out."""
        used = self.used & known[:, None, None]
        return replace(
            self, used=used, light=np.where(used, self.light, 0.0), missing=self.missing | ~known
        )

    def above(self, part: float) -> Windows:
        """Return the windows with only the pixels above that part of the star's flux."""
        used = self.used & (self.light > part * self.flux[:, None, None])
        return replace(self, used=used, light=np.where(used, self.light, 0.0))


def prepare(
    pixels: Floats,
    origin: Floats,
    *,
    background: Floats | None,
    detector: Detector | None,
    full_scale: float,
) -> Windows:
    """Make windows from raw pixels (M, h, w), NaN where nothing was read.

    Without a background, that of the window's outermost pixels, their median; without a noise
    model, their scatter.
    """
    count = len(pixels)
    under, scatter = background, np.empty(0)
    if under is None or detector is None:
        level, scatter = _border(pixels)
        under = level if under is None else under
    light = pixels - under[:, None, None]
    top = light.reshape(count, pixels.shape[1] * pixels.shape[2]).max(axis=1) + under
    used = np.ones(pixels.shape, dtype=bool)
    states = np.zeros((3, count), dtype=bool)
    if not (top < full_scale).all():  # so it is too where a NaN is the maximum
        full, unread = pixels >= full_scale, np.isnan(light)
        used = ~(full | unread)
        light = np.where(used, light, 0.0)
        states = np.stack([full.any(axis=(1, 2)), unread.any(axis=(1, 2)), unread.all(axis=(1, 2))])
    if detector is None:
        return Windows(light, used, origin, under, scatter**2, 0.0, *states)
    darkest = float(detector.variance_dn(detector.offset_dn))
    dark = np.maximum(detector.variance_dn(under), darkest)
    return Windows(light, used, origin, under, dark, 1.0 / detector.gain_e_per_dn, *states)


def grey_centre(light: Floats, origin: Floats) -> Floats:
    """Grey-weighted centre of windows (M, h, w) in frame coordinates, (M, 2); NaN where there is no
    light.
    """
    return _centre(_moments(light, 3), origin, light.shape)


def centre_covariance(data: Windows) -> tuple[Floats, Floats]:
    """Grey-weighted centre (M, 2) of the light, and its covariance (M, 2, 2) from the noise of the
    pixels.
    """
    light = data.moments
    area = _moments(data.used[:1] if data.whole else data.used, 6)
    variance = data.shot_variance * light + data.dark_variance[:, None] * area
    with np.errstate(invalid="ignore"):
        x, y = (light[:, 1:3] / np.where(light[:, 0] > 0, light[:, 0], np.nan)[:, None]).T
    v, vx, vy, vxx, vyy, vxy = variance.T
    cov = np.empty((len(x), 2, 2))
    cov[:, 0, 0] = vxx - 2 * x * vx + x**2 * v
    cov[:, 1, 1] = vyy - 2 * y * vy + y**2 * v
    cov[:, 0, 1] = cov[:, 1, 0] = vxy - x * vy - y * vx + x * y * v
    return _centre(light, data.origin, data.light.shape), cov / light[:, :1, None] ** 2


def _moments(values: Floats | Bools, count: int) -> Floats:
    """Sums of values (M, h, w) times 1, x, y, x^2, y^2, x y about the window's middle: the first
    ``count`` of them.
    """
    height, width = values.shape[1:]
    return values.reshape(len(values), height * width) @ _basis(height, width)[:, :count]


@cache
def _basis(height: int, width: int) -> Floats:
    y, x = (
        part.ravel()
        for part in np.indices((height, width))
        - np.array([height - 1, width - 1])[:, None, None] / 2
    )
    return np.stack([np.ones_like(x), x, y, x * x, y * y, x * y], axis=1)


def _centre(moments: Floats, origin: Floats, shape: tuple[int, ...]) -> Floats:
    light = np.where(moments[:, 0] > 0, moments[:, 0], np.nan)
    return moments[:, 1:3] / light[:, None] + origin + (np.array(shape[:0:-1]) - 1) / 2


def _border(pixels: Floats) -> tuple[Floats, Floats]:
    """Median and robust scatter of the outermost pixels, (M,); 0 where none was read."""
    edge = np.concatenate(
        [pixels[:, 0], pixels[:, -1], pixels[:, 1:-1, 0], pixels[:, 1:-1, -1]], axis=1
    )
    edge[np.isnan(edge).all(axis=1)] = 0.0
    middle = np.nanmedian if np.isnan(edge).any() else np.median
    level = np.asarray(middle(edge, axis=1))
    return level, SIGMA_PER_MAD * np.asarray(middle(np.abs(edge - level[:, None]), axis=1))
