"""Spots drawn by cubic splines, a template without a formula: its light and its slopes in the
pixels of many windows.

What is drawn is the reading of a pixel as a function of where the pixel stands to the spot, the
effective point spread function of Anderson and King (2000, PASP 112, 1360): no integral over pixels
is needed. Knots are so many to a pixel, a whole number: all pixels of a window then lie alike
between theirs, and four weights along x and four along y do for all of them.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import DTypeLike

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.checks import integer
from losbench.imaging.columns import Sums

__all__ = ["PHASES", "Drawn", "SpotShape", "knots_per_pixel", "spline_count", "spline_weights"]


PHASES = 8  # places along a pixel at which the error of a shape is told
_ROOM = 1.5  # pixels, by which a spot may stand off the middle of its window
_KNOTS = {11: 3, 61: 2}  # to a pixel, in windows of up to so many pixels; one in wider ones
_SHARP = 0.8  # pixels, and 1.6 knots: what is sharper is not told between the pixels
_STILL, _FAR = 0.02, 3.0  # pixels; spreads of the places that made a shape
# Four splines in the powers of the way from one knot to the next.
_POWERS = np.array([[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6.0


@dataclass(frozen=True, eq=False, repr=False)
class SpotShape:
    """What a spot looks like, as its frames have shown it: cubic splines.

    Attributes
    ----------
    side : int, pixels
        Side of the windows that it was made from, and fits.
    coefficients : (K, K) array, 1 / pixel squared
        Of the splines, y first; the light of all is one.
    error : (8, 8, 2) array, pixels
        One-sigma error of a place along x and y that is the shape's own, by the part of the pixel
        that the spot stands in, y first; without that of its origin, which moves all places alike.
    frames : int
        How many windows it was made from.
    place, spread : (2,) arrays, pixels
        Mean and standard deviation of where the spot stood in their frames.
    """

    side: int
    coefficients: Floats
    error: Floats
    frames: int
    place: Floats
    spread: Floats

    @cached_property
    def digest(self) -> str:
        """A short name, another for each content."""
        found = hashlib.sha256(f"{self.side} {self.frames}".encode())
        for part in (self.coefficients, self.error, self.place, self.spread):
            found.update(np.ascontiguousarray(part).tobytes())
        return found.hexdigest()[:12]

    @property
    def own(self) -> float:
        """Variance that the shape brings into a pixel, in parts of that of a window's, at most."""
        return min(1.0, self.coefficients.size / (self.frames * self.side**2))

    def image(self, finer: int = 1) -> Floats:
        """Draw it, (side * finer, side * finer) readings, so many to a pixel, to be looked at."""
        integer("finer", finer, low=1)
        off = (np.arange(finer) + 0.5) / finer - 0.5
        weights = spline_weights(self.side, -off)[0].swapaxes(0, 1)
        weights = weights.reshape(-1, weights.shape[-1])
        return np.asarray(weights @ self.coefficients @ weights.T)

    def error_at(self, centre: Floats) -> Floats:
        """Error (M, 2) that the shape brings into places at (M, 2), pixels."""
        phase = np.nan_to_num(centre) + 0.5
        column, row = (np.floor(PHASES * (phase - np.floor(phase))).astype(np.intp) % PHASES).T
        return self.error[row, column]

    @cached_property
    def width(self) -> float:
        """Within how many pixels its light changes. Of a Gaussian it is sigma, of a ring 1.4 times
        the sigma of its line, with the pixel's own.
        """
        phases = np.array([[0.0, 0.0], [0.5, 0.5]])
        splines, one = self.coefficients[None], np.zeros(2, np.intp)
        light, *slopes = Drawn.of(self.side, phases, splines, one, np.float64).columns.swapaxes(
            0, 1
        )
        return float(np.sqrt((light**2).sum() / np.square(slopes).sum()))

    def beyond(self, centre: Floats) -> Bools:
        """Whether places at (M, 2) lie further off, by the part of the pixel, than the frames tell:
        spots that stood still show no slopes, and sharp ones none at all.
        """
        if self.width < max(_SHARP, 2.0 * _SHARP / knots_per_pixel(self.side)):
            return np.ones(len(centre), dtype=bool)
        off = centre - self.place
        off -= np.rint(off)
        return np.asarray((np.abs(off) > _STILL + _FAR * self.spread).any(axis=1))

    def __eq__(self, other: object) -> bool:
        """Whether all bytes are the same."""
        return isinstance(other, SpotShape) and self.digest == other.digest

    def __hash__(self) -> int:
        """Follow the content."""
        return hash(self.digest)

    def __repr__(self) -> str:
        """Return it in short."""
        return f"<SpotShape {self.digest}, {self.side} pixels, of {self.frames} windows>"


def knots_per_pixel(side: int) -> int:
    """Three, two in windows of more than 11 pixels and one in those of more than 61, whose spots
    are the smoother.
    """
    return next((knots for most, knots in _KNOTS.items() if side <= most), 1)


def spline_count(side: int) -> int:
    """Splines along each axis for windows of that side."""
    return round((side - 1 + 2 * _ROOM) * knots_per_pixel(side)) + 3


def spline_weights(side: int, centre: Floats) -> tuple[Floats, Floats]:
    """Splines in the pixel columns of windows with spots at (...) from their middle, and their
    slopes by the place, (..., S, K).

    A spot further off than 1.5 pixels is drawn as if it stood there.
    """
    first, power, slope = _between(side, centre)
    pixel, shape = np.arange(side), (*centre.shape, side, spline_count(side))
    weights = []
    for terms in (power, slope):
        dense = np.zeros(shape)
        for k, weight in enumerate(np.moveaxis(terms @ _POWERS.T, -1, 0)):
            place = first[..., None] + knots_per_pixel(side) * pixel + k
            np.put_along_axis(dense, place[..., None], weight[..., None, None], axis=-1)
        weights.append(dense)
    return weights[0], weights[1]


@dataclass(frozen=True)
class Drawn:
    """Splines in the pixels of M windows: ``columns`` (M, 3, S, S) are the light, of a spot whose
    whole light is one, and its slopes by the place along x and y.
    """

    columns: Pixels

    @classmethod
    def of(
        cls, side: int, centre: Floats, coefficients: Pixels, which: Indices, dtype: DTypeLike
    ) -> Drawn:
        """Draw spots at (M, 2) by the coefficients (T, K, K), each by ``which`` (M,) of them.

        Windows whose pixels see the same knots of the same splines are drawn together: there the
        light is a polynomial of the place.
        """
        first, power, slope = _between(side, centre)
        x, y = np.stack([power, slope], axis=1).astype(dtype).swapaxes(0, 2).swapaxes(1, 2)
        kinds = ((0, 0), (0, 1), (1, 0))
        products = [y[:, down, :, None] * x[:, along, None, :] for down, along in kinds]
        terms = np.stack(products, axis=1).reshape(-1, 3, 16)
        seen = np.column_stack([which, first])
        order = np.lexsort(seen.T)
        starts = np.flatnonzero(np.diff(seen[order], axis=0, prepend=-1).any(axis=1))
        drawn = _polynomials(side, coefficients, *seen[order[starts]].T).astype(dtype)
        columns = np.empty((len(centre), 3, side**2), dtype)
        for polynomial, alike in zip(drawn, np.split(order, starts[1:]), strict=True):
            columns[alike] = (terms[alike].reshape(-1, 16) @ polynomial).reshape(-1, 3, side**2)
        return cls(columns.reshape(-1, 3, side, side))

    @property
    def light(self) -> Pixels:
        """Light in each pixel, (M, S, S), none below zero, as the noise of light needs it."""
        return np.maximum(self.columns[:, 0], 0)

    def sums(self, reading: Pixels, weight: Pixels | None) -> Sums:
        """Sums over pixels with that weight (M, S, S); None: one."""
        count, kinds, side, _ = self.columns.shape
        columns = self.columns.reshape(count, kinds, side**2)
        weighted = self.columns if weight is None else self.columns * weight[:, None]
        weighted = weighted.reshape(count, kinds, side**2)
        offset = np.arange(side, dtype=columns.dtype) - side // 2
        x = np.broadcast_to(offset, (side, side))
        lever = np.stack([np.ones_like(x), x, x.T], axis=-1).reshape(side**2, 3)
        seen = weighted @ reading.reshape(count, side**2, 1)
        return Sums(
            (weighted @ columns.swapaxes(1, 2)).astype(np.float64),
            seen[:, :, 0].astype(np.float64),
            (weighted @ lever).astype(np.float64),
        )


def _between(side: int, centre: Floats) -> tuple[Indices, Floats, Floats]:
    """Where the first pixel of windows lies for spots at (M, 2) from their middle: its first spline
    (M, 2), the powers of how far it lies from there to the next, and their slopes by the place, (M,
    2, 4).
    """
    each = knots_per_pixel(side)
    at = np.clip((_ROOM - centre) * each, 0.0, 2 * _ROOM * each - 1e-6)
    first = np.floor(at)
    power = (at - first)[..., None] ** np.arange(4)
    slope = np.zeros_like(power)
    slope[..., 1:] = -each * np.arange(1, 4) * power[..., :3]
    return first.astype(np.intp), power, slope


def _polynomials(side: int, coefficients: Pixels, which: Indices, x: Indices, y: Indices) -> Pixels:
    """Pixels (C, 16, S * S) of windows that begin at those splines, for each power of the place."""
    step = knots_per_pixel(side)
    size, last = step * (side - 1) + 4, step * (side - 1) + 1
    patch = sliding_window_view(coefficients, (size, size), axis=(1, 2))[which, y, x]
    powers = _POWERS.astype(coefficients.dtype)
    rows = np.stack([patch[:, k : k + last : step] for k in range(4)], axis=-1) @ powers
    both = np.stack([rows[:, :, k : k + last : step] for k in range(4)], axis=-1) @ powers
    return np.ascontiguousarray(both.reshape(len(patch), side**2, 16).swapaxes(1, 2))
