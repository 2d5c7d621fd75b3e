"""What lies under a spot: a plane through the ring around its window, a known level, or nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike

from losbench.arrays import Bools, Floats, Pixels
from losbench.checks import number, odd
from losbench.units import SIGMA_PER_MAD

__all__ = ["RING", "Background", "Level", "Plane", "Ring"]


RING = 4  # pixels, the ring's breadth
_CLIP = 3.0
_KEPT_VARIANCE = 0.9733  # of a Gaussian cut at three sigma


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
    """

    level: Floats
    slope: Floats
    scatter: Floats
    level_variance: Floats
    slope_variance: Floats
    excess: Floats
    excess_error: Floats

    def over(self, reach: int, dtype: DTypeLike = np.float64) -> Pixels:
        """Plane over the middle ``2 * reach + 1`` pixels, as (M, rows, columns), or (M, 1, 1) where
        it has no slope.
        """
        if not self.slope.any():  # a level needs no image
            return self.level.astype(dtype)[:, None, None]
        offset = np.arange(-reach, reach + 1)
        across = (self.slope[:, :1] * offset).astype(dtype)
        down = (self.level[:, None] + self.slope[:, 1:] * offset).astype(dtype)
        return down[:, :, None] + across[:, None, :]

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

    def under(self, stamps: Pixels, side: int) -> Plane:
        """Background of M stamps (M, S, S) with a ring around ``side`` pixels, S = side + 8."""
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

    def under(self, stamps: Pixels, side: int) -> Plane:
        """Plane through the ring of each stamp."""
        return fit_ring(stamps, side)


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

    def under(self, stamps: Pixels, side: int) -> Plane:
        """Return that level, flat and free of error, with the scatter of the ring."""
        ring = fit_ring(stamps, side)
        nothing = np.zeros_like(ring.level)
        return replace(
            ring,
            level=np.full_like(ring.level, self.dn),
            slope=np.zeros_like(ring.slope),
            level_variance=nothing,
            slope_variance=np.zeros_like(ring.slope),
            excess=nothing,
        )


def fit_ring(stamps: Pixels, side: int) -> Plane:
    """Fit a plane to the ring of four pixels around the middle ``side`` pixels, in two clipped
    passes.

    Parameters
    ----------
    stamps : (M, S, S) array, DN
        S = side + 8; NaN marks what lies outside the frame.
    side : int, pixels

    Returns
    -------
    Plane

    Notes
    -----
    Pixels are dropped beyond three sigma, first from the median, then from the plane, so that a
    neighbour or a hot pixel in the ring does not tilt it. An untreated slope g moves a centroid by
    g N^4 / (12 (F - N S_edge)).
    """
    offset = np.arange(stamps.shape[1]) - stamps.shape[1] // 2
    distance = np.maximum(abs(offset)[:, None], abs(offset))
    row, column = np.nonzero((distance > side // 2) & (distance <= side // 2 + RING))
    values = stamps.reshape(len(stamps), -1).take(row * len(offset) + column, axis=1)
    reach = float(offset[-1])
    basis = np.stack(
        [np.ones(len(row)), offset[column] / reach, offset[row] / reach], axis=-1
    ).astype(values.dtype)

    middle, scatter = _median_and_scatter(values[:, ::4])
    values -= middle[:, None]
    present = np.isfinite(values)
    if not present.all():
        values[~present] = 0.0
    fit = _fit(values, present & (np.abs(values) <= _CLIP * scatter[:, None]), basis)
    residual = values - fit.plane.astype(values.dtype) @ basis.T
    fit = _fit(
        values,
        present & (np.abs(residual) <= _CLIP * fit.scatter.astype(values.dtype)[:, None]),
        basis,
    )
    edge = distance[row, column]
    inner, outer = edge == side // 2 + 1, edge == side // 2 + RING
    share = (inner / inner.sum() - outer / outer.sum()).astype(values.dtype)
    return Plane(
        level=middle + fit.plane[:, 0],
        slope=fit.plane[:, 1:] / reach,
        scatter=fit.scatter,
        level_variance=fit.inverse[:, 0, 0],
        slope_variance=fit.inverse[:, (1, 2), (1, 2)] / reach**2,
        excess=(values @ share).astype(np.float64),
        excess_error=fit.scatter * float(np.sqrt((share**2).sum())),
    )


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


@dataclass(frozen=True)
class _Fit:
    """Plane (M, 3), inverse normal matrix (M, 3, 3) and scatter about the plane (M,); NaN where
    nothing was kept.
    """

    plane: Floats
    inverse: Floats
    scatter: Floats


def _fit(values: Pixels, keep: Bools, basis: Pixels) -> _Fit:
    """Least-squares plane through the kept pixels of each spot."""
    one, x, y = basis.T
    kept = keep.astype(values.dtype)
    sums = (kept @ np.stack([one, x, y, x * x, x * y, y * y], axis=-1)).astype(np.float64)
    inverse = _inverse_normal(sums)
    kept *= values
    moments = (kept @ basis).astype(np.float64)
    plane = np.einsum("mij,mj->mi", inverse, moments)
    squares = np.einsum("mr,mr->m", kept, values) - np.einsum("mi,mi->m", plane, moments)
    scatter = np.sqrt(np.maximum(squares, 0.0) / np.maximum(sums[:, 0] - 3.0, 1.0) / _KEPT_VARIANCE)
    empty = sums[:, 0] == 0
    return _Fit(np.where(empty[:, None], np.nan, plane), inverse, np.where(empty, np.nan, scatter))


def _inverse_normal(sums: Floats) -> Floats:
    """Inverse normal matrix of the plane 1, x, y from the sums of 1, x, y, xx, xy, yy, by
    cofactors.
    """
    n, sx, sy, sxx, sxy, syy = sums.T
    # Enough to invert what a corner of a frame or an empty ring leaves, too little to matter
    # elsewhere.
    n, sxx, syy = n + 1e-6, sxx + 1e-6, syy + 1e-6
    adjugate = np.array(
        [
            [sxx * syy - sxy**2, sy * sxy - sx * syy, sx * sxy - sy * sxx],
            [sy * sxy - sx * syy, n * syy - sy**2, sx * sy - n * sxy],
            [sx * sxy - sy * sxx, sx * sy - n * sxy, n * sxx - sx**2],
        ]
    )
    determinant = n * adjugate[0, 0] + sx * adjugate[0, 1] + sy * adjugate[0, 2]
    return np.moveaxis(adjugate / determinant, -1, 0)
