"""A Gaussian integrated over pixels, its slopes, and the weighted sums of their products.

Every column is a profile along x times a profile along y, and so is every product of two. Sums over
a window are therefore taken along x first and then along y, and no column is ever written out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import DTypeLike
from scipy.special import ndtr

from losbench.arrays import Floats, Indices, Pixels

__all__ = ["Drawing", "Sums", "Templates"]


_SQUARE_ROOT_2_PI = float(np.sqrt(2.0 * np.pi))
# The template, its slopes by x and y, and those by the logarithms of its widths: which profile each
# is along x and along y; 0 the light, 1 its slope by the place, 2 its slope by the width.
_ALONG_X, _ALONG_Y = (0, 1, 0, 2, 0), (0, 0, 1, 0, 2)


_SLOPE, *_TERMS = 0.2316419, 1.330274429, -1.821255978, 1.781477937, -0.356563782, 0.319381530


def _below(at: Pixels, bell: Pixels) -> Pixels:
    """Light of a Gaussian below each place, from its density there; in single precision to 3e-7
    (Abramowitz and Stegun 1964, eq. 26.2.17), at a tenth of the time of `ndtr`.
    """
    if at.dtype != np.float32:
        return np.asarray(ndtr(at))
    t = np.abs(at)
    t *= _SLOPE
    t += 1.0
    np.reciprocal(t, out=t)
    tail: Pixels = t * _TERMS[0]
    for term in _TERMS[1:]:
        tail += term
        tail *= t
    tail *= bell
    return np.abs((at > 0) - tail)


@dataclass(frozen=True)
class Sums:
    """Sums over the pixels of M windows: of products of p columns (M, p, p), of columns and reading
    (M, p), and of columns and 1, x and y (M, p, 3).
    """

    normal: Floats
    reading: Floats
    plane: Floats


class Drawing(Protocol):
    """Templates of M windows, each with the slopes of its light."""

    @property
    def light(self) -> Pixels:
        """Light in each pixel, (M, S, S), of a template whose whole light is one."""
        ...

    def sums(self, reading: Pixels, weight: Pixels | None) -> Sums:
        """Sums over pixels with that weight (M, S, S); None: one."""
        ...


@dataclass(frozen=True)
class _Order:
    """Which profiles are multiplied, and where in the flat table of their sums over rows and
    columns those of two columns (p, p) stand, and those of a column and 1, x and y (p, 3); and
    where those of a column and the reading (p,) do in theirs.
    """

    pairs: tuple[tuple[int, int], ...]
    product: Indices
    plane: Indices
    single: Indices


@cache
def _order(free: bool) -> _Order:
    kinds, count = (3, 5) if free else (2, 3)
    pairs = tuple((i, j) for i in range(kinds) for j in range(i, kinds))
    x, y = np.array(_ALONG_X[:count]), np.array(_ALONG_Y[:count])
    place = {pair: k for k, pair in enumerate(pairs)}

    def table(kind: Indices) -> Indices:
        return np.array([[place[min(i, j), max(i, j)] for j in kind] for i in kind])

    one, far, arms = len(pairs), len(pairs) + kinds, len(pairs) + 2 * kinds
    down, right = np.stack([y + one, y + one, y + far], 1), np.stack([x + one, x + far, x + one], 1)
    return _Order(pairs, arms * table(y) + table(x), arms * down + right, kinds * y + x)


@dataclass(frozen=True)
class Templates:
    """Gaussians of M windows.

    ``profiles`` (M, 2, k, S) are the light in each pixel column and row, its slope by the place
    and, if the widths are free, that by the logarithm of the width.
    """

    profiles: Pixels

    @classmethod
    def of(
        cls, side: int, centre: Floats, width: Floats, dtype: DTypeLike, *, free: bool
    ) -> Templates:
        """Integrate Gaussians over the pixels of windows of that side."""
        # With the spots last, as many as there are lie side by side.
        middle, sigma = (np.ascontiguousarray(each.T)[:, None] for each in (centre, width))
        sigma = sigma.astype(dtype)
        edges = ((np.arange(side + 1) - side / 2)[:, None] - middle).astype(dtype) / sigma
        bell = np.exp(-0.5 * edges * edges) / _SQUARE_ROOT_2_PI
        profiles = np.empty((len(centre), 2, 3 if free else 2, side), dtype)
        lines = profiles.transpose(2, 1, 3, 0)
        light = _below(edges, bell)
        np.subtract(light[:, 1:], light[:, :-1], out=lines[0])
        np.divide(bell[:, :-1] - bell[:, 1:], sigma, out=lines[1])
        if free:
            bell *= edges
            np.subtract(bell[:, :-1], bell[:, 1:], out=lines[2])
        return cls(profiles)

    @property
    def light(self) -> Pixels:
        """Light in each pixel, (M, S, S)."""
        # In half the time of a product by broadcasting.
        light: Pixels = np.einsum("mi,mj->mij", self.profiles[:, 1, 0], self.profiles[:, 0, 0])
        return light

    def sums(self, reading: Pixels, weight: Pixels | None) -> Sums:
        """Sums over pixels with that weight (M, S, S); None: one."""
        count, _, kinds, side = self.profiles.shape
        order = _order(kinds == 3)
        arms = np.empty((count, 2, len(order.pairs) + 2 * kinds, side), self.profiles.dtype)
        for k, (i, j) in enumerate(order.pairs):
            np.multiply(self.profiles[:, :, i], self.profiles[:, :, j], out=arms[:, :, k])
        arms[:, :, -2 * kinds : -kinds] = self.profiles
        offset = np.arange(side, dtype=self.profiles.dtype) - side // 2
        np.multiply(self.profiles, offset, out=arms[:, :, -kinds:])
        if weight is None:
            total = arms.sum(axis=3, dtype=np.float64)
            table = total[:, 1, :, None] * total[:, 0, None, :]
        else:
            reading = reading * weight
            # Rows first: BLAS takes three times as long to multiply a window by turned profiles.
            table = arms[:, 1] @ weight @ arms[:, 0].swapaxes(1, 2)
        seen = self.profiles[:, 1] @ reading @ self.profiles[:, 0].swapaxes(1, 2)
        table = table.astype(np.float64).reshape(count, arms.shape[2] ** 2)
        seen = seen.astype(np.float64).reshape(count, kinds**2)
        return Sums(
            table.take(order.product, axis=1),
            seen.take(order.single, axis=1),
            table.take(order.plane, axis=1),
        )
