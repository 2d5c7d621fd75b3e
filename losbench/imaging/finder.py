"""Where the spots of a frame are, to a pixel or so, at the price of a few passes over the frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats, Indices
from losbench.checks import integer, number, shaped, unmasked

__all__ = ["Find", "find_spots"]


_SAMPLES = 2048  # enough for a median to 3 % of the noise
_BAND = 8  # rows that are rejected together
_STAMP = 1024  # pixels; what is smaller is a stamp
# two peaks are two spots if the saddle between them falls below this part of the fainter one
_DIP = 0.8
# the four neighbours of a real spot's only bright pixel hold at least this part of its light
_CROSS = 0.3
_STEPS = np.linspace(0.0, 1.0, 17)[:, None, None]


@dataclass(frozen=True)
class Find:
    """How `measure` finds the spots of a first frame; `find_spots` is the call and explains the
    parameters.

    Parameters
    ----------
    n : int, optional
    threshold : float

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

    def __post_init__(self) -> None:
        if self.n is not None:
            integer("n", self.n, low=1)
        number("threshold", self.threshold, low=0)

    def find(self, image: ArrayLike) -> Floats:
        """Find the spots of one image (rows, columns)."""
        return find_spots(image, self.n, self.threshold)


def find_spots(image: ArrayLike, n: int | None = None, threshold: float = 8.0) -> Floats:
    """Find the spots that stand out of the background, brightest first.

    Parameters
    ----------
    image : (rows, columns) array of numbers
        NaN marks a pixel that was not read.
    n : int, optional
        How many spots to return; all that were found if not given.
    threshold : float
        How far a pixel must stand above the background, in standard deviations of its noise, to
        belong to a spot.

    Returns
    -------
    (n, 2) array, pixels
        Centre of mass (x, y) of each spot's bright pixels: a start for `centroid`, not a
        measurement. Brightest means most light above the background. Shape (0, 2) where nothing
        stands out.

    Raises
    ------
    ValueError
        If the image is not two-dimensional, or holds fewer than ``n`` spots.

    Notes
    -----
    Background and noise are median and 1.4826 MAD of a regular sample of some 2048 pixels; in a
    stamp of up to 1024 pixels they come from its darker half. Bands of eight rows, then columns,
    then rows are rejected by their maximum, and only what is left is grouped. Touching spots are
    told apart where the saddle between their peaks, after a 3 x 3 mean, is below 0.8 of the fainter
    peak. A lone bright pixel whose four neighbours hold less than 0.3 of its light is a hot pixel,
    and left out.

    Examples
    --------
    >>> from losbench import render_spots
    >>> noise = np.random.default_rng(0).normal(20.0, 2.0, (60, 80))
    >>> image = noise + render_spots([[20.0, 30.0], [55.0, 40.0]], [4000.0, 9000.0], 2.0, (60, 80))
    >>> find_spots(image, n=2).round().astype(int).tolist()
    [[55, 40], [20, 30]]
    """
    pixels = unmasked(image)
    shaped("image", pixels, ("rows", "columns"))
    if pixels.dtype.kind not in "buif":
        raise ValueError(f"image must be an array of numbers, got {pixels.dtype.name}")
    if not pixels.size:
        raise ValueError(f"image must hold at least one pixel, got shape {pixels.shape}")
    wanted = None if n is None else integer("n", n, low=1)
    cut = number("threshold", threshold, low=0)
    if pixels.dtype.kind == "f" and not np.isfinite(pixels).all():
        present = np.isfinite(pixels)
        pixels = np.where(present, pixels, np.median(pixels[present]) if present.any() else 0.0)
    # First the pass over the frame, so that the sample finds it in the cache.
    band_maxima = np.maximum.reduceat(
        pixels.ravel(), np.arange(0, pixels.size, _BAND * pixels.shape[1])
    )
    background, noise = _sampled_background(pixels)

    found = []
    for rows, columns in _bright_boxes(pixels, band_maxima, background + cut * noise):
        signal = pixels[rows, columns].astype(np.float64) - background
        found += [
            (x + columns.start, y + rows.start, light)
            for x, y, light in _spots_in(signal, cut * noise)
        ]
    if wanted is not None and len(found) < wanted:
        raise ValueError(f"found {len(found)} of the {wanted} spots asked for at threshold {cut:g}")
    found.sort(key=lambda spot: -spot[2])
    return np.array([spot[:2] for spot in found[:wanted]]).reshape(-1, 2)


def _sampled_background(pixels: NDArray[Any]) -> tuple[float, float]:
    """Level and standard deviation of the background."""
    step = max(1, int(np.sqrt(pixels.size / _SAMPLES)))
    sample = pixels[::step, ::step].astype(np.float64).ravel()
    # A spot may fill more than half of a stamp, but hardly the darker half of it.
    darker = sample if pixels.size > _STAMP else np.sort(sample)[: (sample.size + 1) // 2]
    level = _median(darker)
    scatter = _median(np.abs(darker - level))
    # Rounding to whole numbers hides noise below about 0.7 DN from the MAD.
    floor = 0.5 if pixels.dtype.kind in "ui" else 0.0
    if darker is sample:
        return level, max(1.4826 * scatter, floor)
    noise = max(2.5057 * scatter, floor)
    return level + 0.6745 * noise, noise


def _median(values: Floats) -> float:
    middle = values.size // 2
    return float(np.partition(values, middle)[middle])


def _bright_boxes(
    pixels: NDArray[Any], band_maxima: NDArray[Any], level: float
) -> Iterator[tuple[slice, slice]]:
    """Boxes, two pixels wider than what exceeds the level in them."""
    for band in _runs(np.repeat(band_maxima > level, _BAND)[: len(pixels)]):
        for columns in _runs(pixels[band].max(axis=0) > level):
            for rows in _runs(pixels[band, columns].max(axis=1) > level):
                yield slice(band.start + rows.start, band.start + rows.stop), columns


def _runs(bright: Bools) -> Iterator[slice]:
    """Runs of True, two wider on both sides; runs that then meet are one."""
    places = np.flatnonzero(bright)
    if places.size:
        gaps = np.flatnonzero(places[1:] - places[:-1] > 4)
        starts = [places[0], *places[gaps + 1]]
        ends = [*places[gaps], places[-1]]
        for start, end in zip(starts, ends, strict=True):
            yield slice(max(0, int(start) - 2), min(bright.size, int(end) + 3))


def _spots_in(signal: Floats, cut: float) -> Iterator[tuple[float, float, float]]:
    """(x, y, light) of each spot in a small box of background-free pixels."""
    bright = signal > cut
    smooth = _filter3(signal, np.add) / 9.0
    row, column = np.nonzero(bright)
    light = signal[row, column]
    candidate = np.where(bright, smooth, -np.inf)
    peaks = np.argwhere(bright & (candidate == _filter3(candidate, np.maximum)))
    centres = _separate_peaks(smooth, peaks)
    owner = ((row[:, None] - centres[:, 0]) ** 2 + (column[:, None] - centres[:, 1]) ** 2).argmin(
        axis=1
    )
    for spot in range(len(centres)):
        mine = owner == spot
        total = float(light[mine].sum())
        if np.count_nonzero(mine) > 1 or not _is_hot(signal, row[mine], column[mine]):
            yield (
                float(light[mine] @ column[mine]) / total,
                float(light[mine] @ row[mine]) / total,
                total,
            )


def _filter3(image: Floats, combine: np.ufunc) -> Floats:
    """Sum or maximum over 3 x 3 pixels, of those that exist."""
    down = image.copy()
    combine(down[1:], image[:-1], out=down[1:])
    combine(down[:-1], image[1:], out=down[:-1])
    across = down.copy()
    combine(across[:, 1:], down[:, :-1], out=across[:, 1:])
    combine(across[:, :-1], down[:, 1:], out=across[:, :-1])
    return across


def _separate_peaks(smooth: Floats, peaks: Indices) -> Indices:
    """Keep the peaks that no path above ``_DIP`` of their height joins to a higher one; highest
    first.
    """
    if len(peaks) < 2:
        return peaks
    height = smooth[peaks[:, 0], peaks[:, 1]]
    order = np.argsort(-height, kind="stable")
    peaks, needed = peaks[order], _DIP * height[order]
    # A straight path from the highest peak settles nearly all of them without a search.
    line = np.rint(peaks[0] + _STEPS * (peaks - peaks[0])).astype(np.intp)
    apart = smooth[line[..., 0], line[..., 1]].min(axis=0) < needed
    kept = [0]
    for candidate in np.flatnonzero(apart):
        island = _island(smooth >= needed[candidate], peaks[candidate])
        if not island[peaks[kept, 0], peaks[kept, 1]].any():
            kept.append(int(candidate))
    return peaks[kept]


def _island(above: Bools, seed: Indices) -> Bools:
    from scipy import ndimage

    labels, _ = ndimage.label(above, np.ones((3, 3)))
    return labels == labels[tuple(seed)]


def _is_hot(signal: Floats, row: Indices, column: Indices) -> bool:
    y, x = int(row[0]), int(column[0])
    cross = (
        signal[max(0, y - 1) : y + 2, x].sum()
        + signal[y, max(0, x - 1) : x + 2].sum()
        - 2.0 * signal[y, x]
    )
    return bool(cross < _CROSS * signal[y, x])
