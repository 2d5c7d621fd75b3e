"""What lies under a spot: a plane through the ring around its window, and pixels that are hot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from losbench.arrays import Bools, Floats, Pixels

__all__ = ["RING", "PixelNoise", "RingPlane", "fit_ring", "gate_hot_pixels"]


RING = 4  # pixels, the ring's breadth
_CLIP = 3.0
_KEPT_VARIANCE = 0.9733  # of a Gaussian cut at three sigma


@dataclass(frozen=True)
class RingPlane:
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
        """Plane over the middle ``2 * reach + 1`` pixels, as (M, rows, columns)."""
        offset = np.arange(-reach, reach + 1)
        across = (self.slope[:, :1] * offset).astype(dtype)
        down = (self.level[:, None] + self.slope[:, 1:] * offset).astype(dtype)
        return down[:, :, None] + across[:, None, :]


@dataclass(frozen=True)
class PixelNoise:
    """Variance of the pixels of M windows, ``floor + per_dn * signal``, and of the background plane
    taken off them.

    Parameters
    ----------
    floor : (M,) array, DN squared
    per_dn : float, DN
        Inverse of the gain; 0 if it is not known.
    plane : (M, 3) array
        Variances of the plane's level, DN squared, and of its slopes along x and y, DN squared per
        pixel squared.
    """

    floor: Floats
    per_dn: float
    plane: Floats

    def of(self, some: NDArray[Any] | slice) -> PixelNoise:
        """Return that of some of the windows."""
        return PixelNoise(self.floor[some], self.per_dn, self.plane[some])


def fit_ring(stamps: Pixels, side: int) -> RingPlane:
    """Fit a plane to the ring of four pixels around the middle ``side`` pixels, in two clipped
    passes.

    Parameters
    ----------
    stamps : (M, S, S) array, DN
        S = side + 8; NaN marks what lies outside the frame.
    side : int, pixels

    Returns
    -------
    RingPlane

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
    return RingPlane(
        level=middle + fit.plane[:, 0],
        slope=fit.plane[:, 1:] / reach,
        scatter=fit.scatter,
        level_variance=fit.inverse[:, 0, 0],
        slope_variance=fit.inverse[:, (1, 2), (1, 2)] / reach**2,
        excess=(values @ share).astype(np.float64),
        excess_error=fit.scatter * float(np.sqrt((share**2).sum())),
    )


def gate_hot_pixels(signal: Pixels, scatter: Floats) -> Pixels:
    """Replace each pixel that stands out of its 3 x 3 neighbourhood by the neighbourhood's median.

    Parameters
    ----------
    signal : (M, S, S) array, DN
        Stamps without background; their outermost pixels are left as they are.
    scatter : (M,) array, DN
        Noise of the background.

    Returns
    -------
    (M, S, S) array, DN

    Notes
    -----
    A pixel stands out if it exceeds twice the median by five sigma. The peak of a spot does not, if
    its sigma is at least 0.9 pixels; sharper spots must not be gated.
    """
    import cv2

    tall = np.ascontiguousarray(signal.reshape(-1, signal.shape[2]), dtype=np.float32)
    median = cv2.medianBlur(tall, 3).reshape(signal.shape).astype(signal.dtype)
    hot = signal > 2.0 * np.maximum(median, 0.0) + 5.0 * scatter[:, None, None]
    hot[:, [0, -1]] = hot[:, :, [0, -1]] = False
    return np.where(hot, median, signal)


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
    return middle, np.maximum(1.4826 * scatter, mean / _CLIP)


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
