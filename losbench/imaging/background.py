"""What lies under a spot: a plane through the ring around its window, a known level, or nothing."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache, lru_cache
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.checks import number, odd
from losbench.imaging.ranks import CLIPPED, noise_above_black
from losbench.imaging.stamps import RING, ring_places
from losbench.units import SIGMA_PER_MAD

__all__ = ["RING", "Background", "Level", "Plane", "Ring", "inverse_normal"]


_CLIP = 3.0
_KEPT_VARIANCE = 0.9733  # of a Gaussian cut at three sigma
# In a ring of noise alone one pixel in 2000 stands out by more, and the third moment is within
# 0.15 scatters cubed of zero.
_STANDS_OUT = 3.5  # scatters
_LOPSIDED = 0.6


@dataclass(frozen=True)
class Plane:
    """Background of M spots, level + slope . (x, y) with (x, y) counted from the middle of the
    stamp.

    Parameters
    ----------
    level : (M,) array, DN
        NaN where the ring holds no pixel.
    slope : (M, 2) array, DN per pixel
    scatter : (M,) array, DN
        Standard deviation of a ring pixel about the plane.
    level_variance : (M,) array
        Variance of the level in units of the scatter squared.
    slope_variance : (M, 2) array, 1 / pixel squared
        Variance of the slope in the same units.
    excess, excess_error : (M,) arrays, DN
        How much brighter the innermost pixels of the ring are than its outermost, and the error of
        that.
    outlier : (M,) array
        How far the pixel that stands out most lies from the plane, in units of the scatter.
    noise : (M,) array, DN
        The scatter; where black is clipped, what it was before.
    clipped : (M,) array of bool
        Whether the ring tells of black that is clipped.
    """

    level: Floats
    slope: Floats
    scatter: Floats
    level_variance: Floats
    slope_variance: Floats
    excess: Floats
    excess_error: Floats
    outlier: Floats
    noise: Floats
    clipped: Bools

    def of(self, some: NDArray[Any]) -> Plane:
        """Return that of some of the spots."""
        return Plane(*(getattr(self, field.name)[some] for field in fields(self)))

    def off(self, raw: Pixels) -> Pixels:
        """Stamps (M, S, S) without the plane."""
        parts = np.column_stack([self.level, self.slope]).astype(raw.dtype)
        off: Pixels = raw - (parts @ _lever(raw.shape[1], raw.dtype)).reshape(raw.shape)
        return off

    def at(self, xy: Floats) -> Floats:
        """Background (M,) at the places (M, 2)."""
        # Where nothing is known of the place, a plane without slope still has its level.
        return self.level + np.where(self.slope == 0.0, 0.0, self.slope * xy).sum(axis=1)


@runtime_checkable
class Background(Protocol):
    """What is taken off a spot: a frozen dataclass with one method.

    Attributes
    ----------
    side : int or None, pixels
        Side of the square that the ring surrounds; None: the window.
    tilts : bool
        Whether the background changes where the window is cut anew.
    """

    tilts: ClassVar[bool]

    @property
    def side(self) -> int | None: ...  # noqa: D102

    def under(self, ring: Pixels, side: int) -> Plane:
        """Background of M spots, from the pixels (M, R) of the ring around ``side`` pixels, in the
        order of `ring_places`.
        """
        ...


@dataclass(frozen=True)
class Ring:
    """Take a plane through a ring of four pixels off every spot.

    Parameters
    ----------
    side : odd int, pixels, optional
        Side of the square that the ring surrounds, by default the window. With a window below six
        sigma the spot's own light would tilt the plane: give six sigma here.

    Raises
    ------
    ValueError
        If the side is even.

    Notes
    -----
    An untreated slope g moves a centroid by g N^4 / (12 (F - N S_edge)), with the window's side N,
    its light F and the light S_edge of a column at its edge.

    Examples
    --------
    >>> import losbench as lb
    >>> ramp = 3.0 * np.arange(70)
    >>> image = lb.render_spots([[30.3, 20.8]], 1e4, 2.0, (40, 70)) + ramp
    >>> lb.centroid(image, [[30, 21]], background=lb.Ring(19)).xy.round(2).tolist()
    [[30.3, 20.8]]
    """

    side: int | None = None
    tilts: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.side is not None:
            odd("ring", self.side, low=3)

    def under(self, ring: Pixels, side: int) -> Plane:
        """Plane through the ring of each spot."""
        return fit_ring(ring, side)


@dataclass(frozen=True)
class Level:
    """Take a known level off every pixel; the ring around the window then only tells the noise.

    Parameters
    ----------
    dn : float, DN

    Raises
    ------
    ValueError
        If it is not a finite number.

    Examples
    --------
    >>> import losbench as lb
    >>> image = lb.render_spots([[30.3, 20.8]], 1e4, 2.0, (40, 70)) + 50.0
    >>> lb.centroid(image, [[30, 21]], background=lb.Level(50.0)).background.tolist()
    [50.0]
    """

    dn: float
    side: ClassVar[int | None] = None
    tilts: ClassVar[bool] = False

    def __post_init__(self) -> None:
        number("background", self.dn)

    def under(self, ring: Pixels, side: int) -> Plane:
        """Return that level, flat and free of error, with the scatter of the ring."""
        plane = fit_ring(ring, side)
        nothing = np.zeros_like(plane.level)
        return replace(
            plane,
            level=np.full_like(plane.level, self.dn),
            slope=np.zeros_like(plane.slope),
            level_variance=nothing,
            slope_variance=np.zeros_like(plane.slope),
            excess=nothing,
        )


@dataclass(frozen=True)
class _Geometry:
    """What is multiplied with the readings (R, p) of a ring.

    ``rows`` (3, R): 1, x and y, the last two over ``reach``; ``squares``: the products of two;
    ``solve`` gives the plane, and how much brighter the innermost pixels are than the outermost.
    ``variance`` (4,) is what all that has of the scatter squared.
    """

    reach: float
    rows: Pixels
    squares: Pixels
    solve: Pixels
    variance: Floats


@lru_cache(maxsize=8)
def _lever(size: int, dtype: np.dtype[np.floating[Any]]) -> Pixels:
    """1, x and y (3, S * S) of the pixels of a stamp, counted from its middle."""
    y, x = (each.ravel() - size // 2 for each in np.indices((size, size)))
    return np.stack([np.ones(len(x)), x, y]).astype(dtype)


@cache
def _geometry(side: int, dtype: np.dtype[np.floating[Any]]) -> _Geometry:
    x, y = ring_places(side)
    reach, edge = float(side // 2 + RING), np.maximum(abs(x), abs(y))
    rows = np.stack([np.ones(len(x)), x / reach, y / reach])
    first, second = np.triu_indices(3)
    squares = (rows[first] * rows[second]).T
    inner, outer = edge == side // 2 + 1, edge == side // 2 + RING
    share = inner / inner.sum() - outer / outer.sum()
    solve = np.column_stack([rows.T @ np.linalg.inv(rows @ rows.T), share])
    variance = (solve**2).sum(axis=0)
    rows, squares, solve = (part.astype(dtype, order="C") for part in (rows, squares, solve))
    return _Geometry(reach, rows, squares, solve, variance)


def fit_ring(ring: Pixels, side: int) -> Plane:
    """Fit a plane to the ring of four pixels around the middle ``side`` pixels.

    Parameters
    ----------
    ring : (M, R) array, DN
        In the order of `ring_places`; NaN marks what lies outside the frame. Changed in place.
    side : int, pixels

    Returns
    -------
    Plane

    Notes
    -----
    Where something stands out of the ring, pixels are dropped beyond three sigma, first from the
    median, then from the plane, so that a neighbour or a hot pixel in the ring does not tilt it. An
    untreated slope g moves a centroid by g N^4 / (12 (F - N S_edge)).
    """
    geometry, count = _geometry(side, ring.dtype), ring.shape[1]
    level = np.where(
        np.isfinite(ring[:, 0]), ring[:, 0], 0.0
    )  # any will do: small numbers lose less of their digits
    ring -= level[:, None]
    solved = ring @ geometry.solve
    residual = ring - solved[:, :3] @ geometry.rows
    square = residual * residual
    scatter = np.sqrt(np.vecdot(residual, residual).astype(np.float64) / (count - 3.0))
    lopsided = np.abs(np.vecdot(square, residual)) > _LOPSIDED * count * scatter**3
    even = (square.max(axis=1) <= (_STANDS_OUT * scatter) ** 2) & ~lopsided
    variance = np.full((len(ring), 3), geometry.variance[:3])
    solved = solved.astype(np.float64)
    fit = _Fit(solved[:, :3], variance, scatter, solved[:, 3], np.zeros(len(ring)))
    uneven = np.flatnonzero(~even)
    if uneven.size:
        fit.put(uneven, _clipped(ring[uneven], geometry))
    at_lowest = ring == np.fmin.reduce(ring, axis=1)[:, None]
    lowest = np.add.reduce(at_lowest.view(np.uint8), axis=1, dtype=np.uint32)  # fast along an axis
    black = lowest >= CLIPPED * count
    noise = np.zeros(len(ring))
    if black.any():
        noise[black] = noise_above_black(ring[black])
    return Plane(
        level=level + fit.plane[:, 0],
        slope=fit.plane[:, 1:] / geometry.reach,
        scatter=fit.scatter,
        level_variance=fit.variance[:, 0],
        slope_variance=fit.variance[:, 1:] / geometry.reach**2,
        excess=fit.excess,
        excess_error=fit.scatter * np.sqrt(geometry.variance[3]),
        outlier=fit.outlier,
        noise=np.fmax(fit.scatter, noise),
        clipped=noise != 0.0,
    )


@dataclass(frozen=True)
class _Fit:
    """Plane (M, 3), its variances in units of the scatter squared, scatter about it, how much
    brighter the innermost pixels are than the outermost, and how many scatters the worst lies off,
    (M,); NaN where nothing was kept.
    """

    plane: Floats
    variance: Floats
    scatter: Floats
    excess: Floats
    outlier: Floats

    def put(self, where: Indices, part: _Fit) -> None:
        """Replace what is ``where`` by a part."""
        self.plane[where], self.variance[where] = part.plane, part.variance
        self.scatter[where], self.excess[where] = part.scatter, part.excess
        self.outlier[where] = part.outlier


def _clipped(values: Pixels, geometry: _Geometry) -> _Fit:
    """Plane in two passes, each without the pixels beyond three sigma of what was known before."""
    middle, scatter = _median_and_scatter(values[:, ::4])
    values -= middle[:, None]
    present = np.isfinite(values)
    if not present.all():
        values[~present] = 0.0
    near = present & (np.abs(values) <= _CLIP * scatter[:, None])
    plane, _, scatter = _kept(values, near, geometry)
    apart = np.abs(values - plane.astype(values.dtype) @ geometry.rows)
    near = present & (apart <= _CLIP * scatter.astype(values.dtype)[:, None])
    plane, variance, scatter = _kept(values, near, geometry)
    plane[:, 0] += middle
    worst = (apart * present).max(axis=1)
    outlier = np.divide(worst, scatter, out=np.zeros(len(worst)), where=scatter > 0)
    excess = (values @ geometry.solve[:, 3]).astype(np.float64)
    return _Fit(plane, variance, scatter, excess, outlier)


def _kept(values: Pixels, keep: Bools, geometry: _Geometry) -> tuple[Floats, Floats, Floats]:
    """Least-squares plane (M, 3) through the kept pixels of each spot, the variances of its parts,
    and the scatter (M,) about it.
    """
    kept = keep.astype(values.dtype)
    sums = (kept @ geometry.squares).astype(np.float64)
    sums[sums[:, 0] == 0] = np.nan  # nothing is known of an empty ring
    inverse = inverse_normal(sums)
    kept *= values
    moments = (kept @ geometry.rows.T).astype(np.float64)
    plane = np.einsum("mij,mj->mi", inverse, moments)
    squares = np.vecdot(kept, values) - np.vecdot(plane, moments)
    scatter = np.sqrt(np.maximum(squares, 0.0) / np.maximum(sums[:, 0] - 3.0, 1.0) / _KEPT_VARIANCE)
    return plane, np.diagonal(inverse, axis1=1, axis2=2), scatter


def _median_and_scatter(values: Pixels) -> tuple[Pixels, Pixels]:
    """Median and 1.4826 MAD of each row, of the pixels that are there."""
    if np.isnan(values).any():
        values = values.copy()
        values[np.isnan(values).all(axis=1)] = 0.0
        middle = np.nanmedian(values, axis=1)
        deviation = np.abs(values - middle[:, None])
        scatter = np.nanmedian(deviation, axis=1)
        mean = np.nanmean(deviation, axis=1)
    else:
        half = values.shape[1] // 2
        middle = np.partition(values, half, axis=1)[:, half]
        deviation = np.abs(values - middle[:, None])
        scatter = np.partition(deviation, half, axis=1)[:, half]
        mean = deviation.mean(axis=1)
    # In a quiet ring of whole numbers most pixels equal the median; the mean deviation still sees
    # the others.
    return middle, np.maximum(SIGMA_PER_MAD * scatter, mean / _CLIP)


def inverse_normal(sums: Floats) -> Floats:
    """Inverse normal matrix of the plane 1, x, y from the sums of 1, x, y, xx, xy, yy, by
    cofactors.
    """
    n, sx, sy, sxx, sxy, syy = sums.T
    # Enough to invert what a corner of a frame leaves, too little to matter elsewhere.
    n, sxx, syy = n + 1e-6, sxx + 1e-6, syy + 1e-6
    first, second, third = sxx * syy - sxy**2, sy * sxy - sx * syy, sx * sxy - sy * sxx
    determinant = n * first + sx * second + sy * third
    inverse = np.empty((len(sums), 3, 3))
    inverse[:, 0, 0] = first / determinant
    inverse[:, 0, 1] = inverse[:, 1, 0] = second / determinant
    inverse[:, 0, 2] = inverse[:, 2, 0] = third / determinant
    inverse[:, 1, 1] = (n * syy - sy**2) / determinant
    inverse[:, 1, 2] = inverse[:, 2, 1] = (sx * sy - n * sxy) / determinant
    inverse[:, 2, 2] = (n * sxx - sx**2) / determinant
    return inverse
