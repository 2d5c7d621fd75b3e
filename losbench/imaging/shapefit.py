"""The shape of a spot, fitted to all its windows at once.

Splines, places and light are found in turns. The splines are the least squares of all pixels, each
weighted by the inverse of its variance, with a penalty on their bending; how strong it is, one half
of the windows decides by how well it foretells the other. The error that a shape brings into places
is that of this fit, with places and light found beside it; the penalty is a belief, and its share
the error of what it smooths away (Nychka 1988, J. Am. Stat. Assoc. 83, 1134).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import DTypeLike
from scipy.linalg import cho_solve_banded, cholesky_banded

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.imaging.leftover import bad_pixels, unlike
from losbench.imaging.protocols import Windows
from losbench.imaging.splines import (
    PHASES,
    Drawn,
    SpotShape,
    knots_per_pixel,
    spline_weights,
)
from losbench.imaging.template import Draw, fit_template

__all__ = ["drawing", "fit_shape"]


_ROUNDS = 8
_AT_REST = 1e-3  # pixels
_SETTLED = 1  # round after which pixels that stand out are left out, and the penalty is chosen
_PENALTIES = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0)  # of the mean information of a spline
_FIRST = 0.1
_RIDGE = 1e-9  # of it
_STEPS, _CLOSE = 12, 1e-5  # pixels squared
_SEEN = 4  # splines of an axis that one pixel sees


def fit_shape(windows: Windows) -> SpotShape:
    """Fit one shape to M windows, whose starts are near, with the mean of these as its origin.

    Where some are not like it, those that are like the shape of that half which one shape fits best
    make it; all, if that is less than half of them.
    """
    shape = _fitted(windows)
    other, left = _judged(shape, windows)
    if not other.any():
        return shape
    half = np.sort(np.argsort(left, kind="stable")[: -(-len(left) // 2)])
    other, _ = _judged(_fitted(windows.of(half)), windows)
    return shape if other.mean() > 0.5 else _fitted(windows.of(~other))


def _judged(shape: SpotShape, windows: Windows) -> tuple[Bools, Floats]:
    """Whether windows are not like a shape, and the squares of what it leaves over of their pixels,
    in errors, (M,).
    """
    draw = drawing(windows.side, shape.coefficients[None], np.zeros(len(windows.start), np.intp))
    fit = fit_template(windows, tolerance=_CLOSE, max_iter=_STEPS, draw=draw)
    pixels = windows.signal[:, 1:-1, 1:-1]
    kept = None if windows.kept is None else windows.kept[:, 1:-1, 1:-1]
    light = draw(slice(None), fit.centre).light * fit.flux[:, None, None]
    bad = bad_pixels(windows, light, kept)
    use = (~bad if kept is None else ~bad & (kept > 0)).astype(pixels.dtype)
    other = unlike(windows, light, use, np.full(len(light), shape.own))
    seen = _Seen.of(windows, fit.centre, fit.flux, light, use)
    return other, (seen.weight * (seen.pixels - light) ** 2).sum(axis=(1, 2))


def drawing(side: int, splines: Pixels, which: Indices, dtype: DTypeLike = np.float64) -> Draw:
    """How spots are drawn by the splines (T, K, K), each by ``which`` (M,) of them."""

    def draw(some: Indices | slice, centre: Floats) -> Drawn:
        return Drawn.of(side, centre, splines, which[some], dtype)

    return draw


def _fitted(windows: Windows) -> SpotShape:
    """Fit splines, places and light in turns, without the pixels that stand out after two."""
    start, none = windows.start, np.zeros(len(windows.start), np.intp)
    pixels = windows.signal[:, 1:-1, 1:-1]
    kept = None if windows.kept is None else windows.kept[:, 1:-1, 1:-1]
    seen = _Seen.of(windows, start, pixels.sum(axis=(1, 2)), pixels.mean(axis=0), kept)
    penalty = _FIRST
    for k in range(_ROUNDS):
        splines = seen.normal().solved(penalty).splines(windows.side)
        draw = drawing(windows.side, splines[None], none)
        here = replace(windows, start=seen.place)
        fit = fit_template(here, tolerance=_CLOSE, max_iter=_STEPS, draw=draw)
        light = draw(slice(None), fit.centre).light * fit.flux[:, None, None]
        if k == _SETTLED:
            bad = bad_pixels(windows, light, kept)
            kept = (~bad if kept is None else ~bad & (kept > 0)).astype(pixels.dtype)
            windows = replace(windows, kept=np.pad(kept, ((0, 0), (1, 1), (1, 1))))
        place = fit.centre + (start - fit.centre).mean(axis=0)
        step = np.abs(place - seen.place).max()
        seen = _Seen.of(windows, place, fit.flux, light, kept)
        if k == _SETTLED:
            penalty = _chosen(seen)
        elif k > _SETTLED and step < _AT_REST:
            break
    solved = seen.normal().solved(penalty)
    error = _error(seen, solved)
    at = seen.place + windows.middle
    return SpotShape(
        windows.side,
        solved.splines(windows.side),
        error,
        len(start),
        at.mean(axis=0),
        at.std(axis=0),
    )


def _drawn(splines: Floats, place: Floats, side: int) -> Drawn:
    return Drawn.of(side, place, splines[None], np.zeros(len(place), np.intp), np.float64)


def _chosen(seen: _Seen) -> float:
    """The penalty with which each half of the windows foretells the other best, downhill from the
    first.
    """
    one, two = (seen.of_some(slice(k, None, 2)) for k in range(2))
    pairs = [(known.normal(), other) for known, other in ((one, two), (two, one))]

    @cache
    def left(k: int) -> float:
        total = 0.0
        for normal, other in pairs:
            splines, scale = normal.solved(_PENALTIES[k]).raw, other.flux[:, None, None]
            light = scale * _drawn(splines, other.place, other.windows.side).columns[:, 0]
            total += float((other.weight * (other.pixels - light) ** 2).sum())
        return total

    best, k = -1, _PENALTIES.index(_FIRST)
    while k != best:
        best = k
        k = min(range(max(k - 1, 0), min(k + 2, len(_PENALTIES))), key=left)
    return _PENALTIES[best]


@dataclass(frozen=True)
class _Seen:
    """Windows with a place (M, 2) and a light (M,) each, and the inverse variances of their pixels
    (M, S, S), zero for those that are not kept.
    """

    windows: Windows
    place: Floats
    flux: Floats
    weight: Floats
    kept: Pixels | None

    @classmethod
    def of(
        cls, windows: Windows, place: Floats, flux: Floats, light: Floats, kept: Pixels | None
    ) -> _Seen:
        """Weigh by the light (M, S, S) that is expected."""
        noise = windows.noise
        variance = noise.floor[:, None, None] + noise.per_dn * np.maximum(light, 0.0)
        # Frames without noise still need weights, though any will do.
        weight = (1.0 if kept is None else kept) / np.where(variance > 0, variance, 1.0)
        return cls(windows, place, np.maximum(flux, 0.0), weight.astype(np.float64), kept)

    @property
    def pixels(self) -> Floats:
        return self.windows.signal[:, 1:-1, 1:-1].astype(np.float64)

    def of_some(self, some: Indices | slice) -> _Seen:
        kept = None if self.kept is None else self.kept[some]
        part = self.windows.of(some), self.place[some], self.flux[some], self.weight[some]
        return _Seen(*part, kept)

    def normal(self) -> _Normal:
        """Sums over all pixels of products of splines, and of splines and readings."""
        side = self.windows.side
        x, y = (spline_weights(side, self.place[:, k])[0] for k in range(2))
        count, light = x.shape[-1], self.flux[:, None, None]
        weighted = (light**2 * self.weight) @ _products(x)
        each = _SEEN * count
        table = _products(y).reshape(-1, each).T @ weighted.reshape(-1, each)
        reading = y.swapaxes(1, 2) @ (light * self.weight * self.pixels) @ x
        return _Normal(table.reshape(_SEEN, count, _SEEN, count), reading.sum(axis=0))

    def slopes(self, splines: Floats) -> tuple[Floats, Floats]:
        """Sums over pixels of products of light and its slopes by the place (M, 3, 3), and of those
        with what each spline adds, (M, 3, K * K).
        """
        side, light = self.windows.side, self.flux[:, None, None]
        columns = _drawn(splines, self.place, side).columns
        columns[:, 1:] *= light[:, None]
        weighted = columns * self.weight[:, None]
        x, y = (spline_weights(side, self.place[:, k])[0] for k in range(2))
        shared = light[:, None] * (y.swapaxes(1, 2)[:, None] @ weighted @ x[:, None])
        return np.einsum("mikl,mjkl->mij", weighted, columns), shared.reshape(len(x), 3, -1)


@dataclass(frozen=True)
class _Normal:
    """Normal equations of splines: ``table[d, k, e, l]`` (4, K, 4, K) is the product of the splines
    (k, l) and (k + d, l + e), which is also that of (k + d, l) and (k, l + e), and the right side
    (K, K).
    """

    table: Floats
    reading: Floats

    def solved(self, penalty: float) -> _Solved:
        """Solve them with a penalty on second differences along both axes."""
        count = len(self.reading)
        unit = float(self.table[0, :, 0].mean())
        unit = unit if unit > 0 else 1.0
        bent = np.diff(np.eye(count), 2, axis=0)
        stiff = np.zeros((_SEEN, count))
        for d in range(3):
            stiff[d, : count - d] = np.diagonal(bent.T @ bent, d)
        table = self.table.copy()
        table[:, :, 0] += penalty * unit * stiff[:, :, None]
        table[0] += penalty * unit * stiff
        table[0, :, 0] += _RIDGE * unit
        root = cholesky_banded(_band(table), lower=True, overwrite_ab=True, check_finite=False)
        return _Solved(
            root, cho_solve_banded((root, True), self.reading.ravel()).reshape(count, -1)
        )


@dataclass(frozen=True)
class _Solved:
    """The band of the root of normal equations, and the splines (K, K) that solve them."""

    root: Floats
    raw: Floats

    def splines(self, side: int) -> Floats:
        """The splines of a spot whose whole light is one, in windows of that side."""
        return self.raw * (knots_per_pixel(side) ** 2 / self.raw.sum())

    def spread(self, of: Floats) -> Floats:
        """Covariance of the splines times (K * K, n)."""
        return np.asarray(cho_solve_banded((self.root, True), of, check_finite=False))


def _error(seen: _Seen, solved: _Solved) -> Floats:
    """Error (8, 8, 2) that the splines bring into places along x and y, by the part of the pixel
    that a spot stands in, y first, beside what they bring into the mean place of the windows.
    """
    seen = seen.of_some(np.flatnonzero(seen.flux > 0))
    count, size = len(seen.place), solved.raw.size
    own, shared = seen.slopes(solved.raw)
    pulls = (np.linalg.inv(own) @ shared)[:, 1:]
    # As many splines as pixels are not known alone: each window has its own place and light. Those
    # of all together are the shape's origin and unit.
    common = np.zeros((count, 3, 3))
    common[:] = np.eye(3)
    common[:, 0, 0] = seen.flux
    rest = np.linalg.qr(common.reshape(-1, 3), mode="complete")[0][:, 3:]
    across = shared.reshape(-1, size).T
    left = np.zeros((count, 3, count, 3))
    left[np.arange(count), :, np.arange(count)] = own
    left = left.reshape(3 * count, -1) - across.T @ solved.spread(across)
    places = (np.arange(PHASES) + 0.5) / PHASES - 0.5
    grid = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    typical = _typical(seen, solved.raw, grid)
    of_grid, with_splines = typical.slopes(solved.raw)
    wanted = (np.linalg.inv(of_grid) @ with_splines)[:, 1:] - pulls.mean(axis=0)
    wanted = wanted.reshape(-1, size).T
    spread = solved.spread(wanted)
    beside = rest.T @ (across.T @ spread)
    more = beside * np.linalg.solve(rest.T @ left @ rest, beside)
    variance = (wanted * spread).sum(axis=0) + more.sum(axis=0)
    return np.sqrt(np.maximum(variance, 0.0)).reshape(PHASES, PHASES, 2)


def _typical(seen: _Seen, splines: Floats, place: Floats) -> _Seen:
    """Windows of median light and noise with spots at (M, 2)."""
    some, noise = np.zeros(len(place), np.intp), seen.windows.noise
    flux = np.full(len(place), np.median(seen.flux))
    light = flux[:, None, None] * _drawn(splines, place, seen.windows.side).light
    floor = np.full(len(place), np.median(noise.floor))
    noise = replace(noise.of(some), floor=floor)
    kept = None if seen.kept is None else np.broadcast_to(seen.kept.mean(axis=0), light.shape)
    return _Seen.of(replace(seen.windows.of(some), noise=noise), place, flux, light, kept)


def _products(weights: Floats) -> Floats:
    """Products (M, S, 4 K) of the weights (M, S, K) of each spline with its own and those of the
    next three, none beyond the last.
    """
    *shape, count = weights.shape
    found = np.zeros((*shape, _SEEN, count))
    for d in range(_SEEN):
        found[..., d, : count - d] = weights[..., : count - d] * weights[..., d:]
    return found.reshape(*shape, -1)


def _band(table: Floats) -> Floats:
    """Lower band (3 K + 4, K * K) of the matrix whose products are in the table (4, K, 4, K)."""
    count = table.shape[1]
    band = np.zeros(((_SEEN - 1) * (count + 1) + 1, count, count))
    for d in range(_SEEN):
        for e in range(_SEEN):
            band[d * count + e] += table[d, :, e]
            if d and e:
                band[d * count - e, :, e:] += table[d, :, e, : count - e]
    return band.reshape(len(band), -1)
