"""Where the spots of a frame are, to a pixel or so, at the price of a few passes over the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats, Indices
from losbench.checks import choice, integer, number, shaped, unmasked
from losbench.imaging.basins import group, without_crumbs
from losbench.imaging.levels import sky_of
from losbench.imaging.sky import Sky

__all__ = ["Find", "find_spots"]


_BAND = 8  # rows that are rejected together
_STRIP = 200_000  # pixels that are compared at a time
_CROWDED = 0.6  # share of bright pixels from which on a frame shows no spots
_STAMP = 1024  # pixels; a spot may fill what is smaller
# the four neighbours of a real spot's only bright pixel hold at least this part of its light
_CROSS = 0.3
_REACH = 2  # pixels around a bright one that a path between peaks may lead over
_BESIDE = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x]
_ORDERS = ("light", "peak", "x")


@dataclass(frozen=True)
class Find:
    """How `measure` finds the spots of a first frame; `find_spots` is the call and explains the
    parameters.

    Parameters
    ----------
    n : int, optional
    threshold : float
    smooth : float, pixels
    order : "light", "peak" or "x"
    most : int

    Raises
    ------
    ValueError
        If a parameter is out of range.

    Examples
    --------
    >>> from losbench import render_spots
    >>> noise = np.random.default_rng(0).normal(20.0, 2.0, (60, 80))
    >>> Find(1).find(noise + render_spots([[20.0, 30.0]], 4e3, 2.0, (60, 80))).round().tolist()
    [[20.0, 30.0]]
    """

    n: int | None = None
    threshold: float = 8.0
    smooth: float = 0.0
    order: str = "light"
    most: int = 50_000

    def __post_init__(self) -> None:
        if self.n is not None:
            integer("n", self.n, low=1)
        number("threshold", self.threshold, low=0)
        number("smooth", self.smooth, low=0, high=1000)
        choice("order", self.order, _ORDERS)
        integer("most", self.most, low=1)

    def find(self, image: ArrayLike) -> Floats:
        """Find the spots of one image (rows, columns)."""
        pixels = _image(image, self.smooth)
        # First the pass over the frame, so that the sample finds it in the cache.
        band_maxima = np.maximum.reduceat(
            pixels.ravel(), np.arange(0, pixels.size, _BAND * pixels.shape[1])
        )
        sky = sky_of(pixels, float(band_maxima.max()), self.threshold)
        if sky.flat:
            place = _above_level(pixels, band_maxima, sky, self.threshold)
        else:
            place = _above_mesh(pixels, sky, self.threshold)
        if pixels.size > _STAMP and len(place) > _CROWDED * pixels.size:
            raise ValueError(
                f"{len(place)} of {pixels.size} pixels stand out at threshold {self.threshold:g}: "
                "not a frame of spots?"
            )
        found = _spots(pixels, place, sky)
        if len(found) > self.most:
            raise ValueError(
                f"{len(found)} candidates at threshold {self.threshold:g}: not a frame of spots? "
                "Raise threshold, smooth by the width of a spot, or raise most"
            )
        if self.n is not None and len(found) < self.n:
            raise ValueError(
                f"found {len(found)} of the {self.n} spots asked for at threshold "
                f"{self.threshold:g}"
            )
        x, light, peak = found[:, 0], found[:, 2], found[:, 3]
        rank = np.argsort(-(peak if self.order == "peak" else light), kind="stable")[: self.n]
        if self.order == "x":
            rank = rank[np.argsort(x[rank], kind="stable")]
        return found[rank, :2]


def find_spots(
    image: ArrayLike,
    n: int | None = None,
    threshold: float = 8.0,
    *,
    smooth: float = 0.0,
    order: str = "light",
    most: int = 50_000,
) -> Floats:
    """Find the spots that stand out of the background, brightest first.

    Parameters
    ----------
    image : (rows, columns) array of numbers
        NaN marks a pixel that was not read.
    n : int, optional
        How many spots to return, the brightest; all that were found if not given.
    threshold : float
        How far a pixel must stand above the background, in standard deviations of its noise, to
        belong to a spot.
    smooth : float, pixels
        Sigma of a Gaussian that the image is smoothed by before, as wide as the spots: for faint
        spots, and for one wide spot that speckle or noise would break into many.
    order : "light", "peak" or "x"
        Most light above the background first, highest first, or from left to right: two spots of
        one brightness are then numbered by their place, not by noise.
    most : int
        More finds than these are an error.

    Returns
    -------
    (n, 2) array, pixels
        Centre of mass (x, y) of each spot's bright pixels: a start for `centroid`, not a
        measurement. Shape (0, 2) where nothing stands out.

    Raises
    ------
    ValueError
        If the image is not two-dimensional, holds fewer than ``n`` spots, or so many bright pixels
        or candidates that it is no frame of spots.

    Notes
    -----
    Level and noise come from the lower ranks of a sample, so that neither spots nor a camera that
    clips at black disturb them (`losbench.imaging.ranks`): one for the frame where its parts agree,
    else one in each tile of 65 pixels (39 in small frames), with what lies between them straight.
    Bright pixels are grouped by the peaks that they lead up to (`losbench.imaging.basins`):
    touching spots are told apart where the saddle between their peaks, after a 3 x 3 mean, is below
    0.8 of the fainter peak and 1.5 noises below it. Crumbs of less than 0.5 % of a spot that they
    touch are left out, as is a lone bright pixel whose four neighbours hold less than 0.3 of its
    light: a hot pixel.

    Examples
    --------
    >>> from losbench import render_spots
    >>> noise = np.random.default_rng(0).normal(20.0, 2.0, (60, 80))
    >>> image = noise + render_spots([[20.0, 30.0], [55.0, 40.0]], [4000.0, 9000.0], 2.0, (60, 80))
    >>> find_spots(image, n=2).round().astype(int).tolist()
    [[55, 40], [20, 30]]
    """
    return Find(n, threshold, smooth, order, most).find(image)


def _image(image: ArrayLike, smooth: float) -> NDArray[Any]:
    """Return the image without NaN, smoothed if asked."""
    pixels = unmasked(image)
    shaped("image", pixels, ("rows", "columns"))
    if pixels.dtype.kind not in "buif":
        raise ValueError(f"image must be an array of numbers, got {pixels.dtype.name}")
    if not pixels.size:
        raise ValueError(f"image must hold at least one pixel, got shape {pixels.shape}")
    if pixels.dtype.kind == "f" and not np.isfinite(pixels).all():
        present = np.isfinite(pixels)
        pixels = np.where(present, pixels, np.median(pixels[present]) if present.any() else 0.0)
    if smooth > 0:
        import cv2

        pixels = cv2.GaussianBlur(pixels.astype(np.float32), (0, 0), smooth)
    return pixels


def _above_level(
    pixels: NDArray[Any], band_maxima: NDArray[Any], sky: Sky, threshold: float
) -> Indices:
    """Flat places of the pixels above one level, looked for in the bands that reach it."""
    cut: Any = float(sky.level[0, 0] + threshold * sky.noise[0, 0])
    if pixels.dtype.kind in "ui":  # a whole number is compared in the frame's own type
        whole = np.iinfo(pixels.dtype)
        cut = pixels.dtype.type(min(max(math.floor(cut), whole.min), whole.max))
    band = np.flatnonzero(band_maxima > cut)
    runs = np.split(band, np.flatnonzero(np.diff(band) > 1) + 1) if band.size else []
    width, found = pixels.shape[1], [np.zeros(0, dtype=np.intp)]
    for run in runs:
        rows = pixels[run[0] * _BAND : (run[-1] + 1) * _BAND]
        found.append(np.flatnonzero(rows > cut) + run[0] * _BAND * width)
    return np.concatenate(found)


def _above_mesh(pixels: NDArray[Any], sky: Sky, threshold: float) -> Indices:
    """Flat places of the pixels above their own level, a strip at a time."""
    height, width = pixels.shape
    found, rows = [], max(1, _STRIP // width)
    for first in range(0, height, rows):
        last = min(first + rows, height)
        cut = sky.cut(threshold, first, last, width)
        found.append(np.flatnonzero(pixels[first:last] > cut) + first * width)
    return np.concatenate(found)


def _spots(pixels: NDArray[Any], bright: Indices, sky: Sky) -> Floats:
    """(x, y, light, peak) of each spot, from the flat places of the bright pixels."""
    if not bright.size:
        return np.zeros((0, 4))
    # Paths from peak to peak may lead over pixels around the bright ones: noise tears faint spots.
    place = _around(bright, pixels.shape)
    row, column = np.divmod(place, pixels.shape[1])
    level, noise = sky.at(row, column)
    cross, corners = _beside(pixels, row, column, level)
    signal = pixels.ravel()[place].astype(np.float64) - level
    basins = group(place, pixels.shape[1], (signal + cross + corners) / 9.0, noise)

    some = np.searchsorted(place, bright)
    owner, signal = basins.owner[some], signal[some]

    def total(of: Floats) -> Floats:
        return np.bincount(owner, weights=of, minlength=basins.count).astype(np.float64)

    number, light = total(np.ones(len(owner))), total(signal)
    with np.errstate(invalid="ignore"):
        x, y = (total(signal * along[some]) / light for along in (column, row))
    peak = np.full(basins.count, -np.inf)
    np.maximum.at(peak, owner, signal)
    hot = (number == 1) & (total(cross[some]) < _CROSS * light)
    kept = (number > 0) & ~hot
    kept[kept] = without_crumbs(basins, number, light, np.stack([x, y], axis=-1))[kept]
    return np.column_stack([x, y, light, peak])[kept]


def _around(bright: Indices, shape: tuple[int, ...]) -> Indices:
    """Flat places of all pixels within two of the bright ones."""
    height, width = shape
    steps = np.arange(-_REACH, _REACH + 1)
    if bright.size * 100 < height * width:
        column = bright % width
        last = bright + np.minimum(_REACH, width - 1 - column)
        # Each adds what lies in its row beyond the reach of the one before: rising, each once.
        first = np.maximum(bright - np.minimum(_REACH, column), np.append(0, last[:-1] + 1))
        across = bright[:, None] + steps
        near = across[(across >= first[:, None]) & (across <= last[:, None])]
        down = (near + width * steps[:, None]).ravel()
        # A stable sort merges rising runs.
        ranked = np.sort(down[(down >= 0) & (down < height * width)], kind="stable")
        return ranked[np.append(True, ranked[1:] != ranked[:-1])]
    import cv2

    found = np.zeros(shape, dtype=np.uint8)
    found.ravel()[bright] = 1
    near = cv2.dilate(found, np.ones((len(steps), len(steps)), dtype=np.uint8))
    return np.flatnonzero(near.view(bool))


def _beside(
    pixels: NDArray[Any], row: Indices, column: Indices, level: Floats
) -> tuple[Floats, Floats]:
    """Light of the four neighbours of each pixel, and of the four at its corners; none beyond the
    border.
    """
    (height, width), flat = pixels.shape, pixels.ravel()
    inner = (
        row.min() > 0 and row.max() < height - 1 and column.min() > 0 and column.max() < width - 1
    )
    place = row * width + column
    cross, corners = -4.0 * level, -4.0 * level
    for down, right in _BESIDE:
        seen = flat.take(place + (down * width + right), mode="clip")
        if not inner:
            y, x = row + down, column + right
            seen = np.where((y >= 0) & (y < height) & (x >= 0) & (x < width), seen, level)
        which = corners if down and right else cross
        which += seen
    return cross, corners
