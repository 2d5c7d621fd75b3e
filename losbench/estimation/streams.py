"""What a million trials say, kept in the memory of none: counts, moments and quantiles that merge.

Mean and products of deviations merge as Chan, Golub and LeVeque (1983) have it. Quantiles come from
a histogram that counts from the median of the first chunk in units of its spread: equal bins up to
eight units, beyond them bins that grow with the distance. Merging it is exact in any order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.units import SIGMA_PER_MAD

__all__ = ["Summary"]

_NEAR, _PER_UNIT = 8, 512  # units of spread in equal bins, and bins in each of them
_EQUAL = _NEAR * _PER_UNIT  # bins of each sign
_FIRST, _OCTAVES, _BITS = 3, 17, 8  # powers of two beyond, from 8 to 1e6 units, 256 bins in each
_FAR = _OCTAVES << _BITS
_MIDDLE_OF = 501  # values that tell the middle and the unit of the bins
_FLOAT32_BIAS, _FLOAT32_BITS = 127, 23


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What is kept of n trials of p numbers.

    Attributes
    ----------
    n, left_out, unconverged : int
        Trials that count, trials with a number that is not finite, and fits that did not converge.
    mean, low, high : (p,) arrays
    products : (p, p) array
        Sums of products of deviations from the mean.
    centre, spread : (p,) arrays
        Where the histogram counts from, and its unit.
    counts : (p, bins) array of int64
    """

    n: int
    left_out: int
    unconverged: int
    mean: Floats
    low: Floats
    high: Floats
    products: Floats
    centre: Floats
    spread: Floats
    counts: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        values: Floats,
        unconverged: int = 0,
        *,
        centre: Floats | None = None,
        spread: Floats | None = None,
    ) -> Self:
        """Summarise trials (p, size); a trial with a number that is not finite is left out whole.

        Without ``centre`` and ``spread`` they are those of the values themselves.

        >>> few = Summary.of(np.array([[1.0, 2.0, 4.0, np.nan]]))
        >>> few.n, few.left_out, few.quantiles([0.5]).round(2).tolist()
        (3, 1, [[2.0]])
        """
        whole = np.isfinite(values).all(axis=0)
        kept = values if whole.all() else np.ascontiguousarray(values[:, whole])
        n = kept.shape[1]
        if centre is None or spread is None:
            centre, spread = _middle(kept)
        if not n:
            nothing = np.full(len(kept), np.nan)
            mean, low, high = np.zeros(len(kept)), nothing, nothing
        else:
            mean, low, high = kept.mean(axis=1), kept.min(axis=1), kept.max(axis=1)
        deviations = kept - mean[:, None]
        return cls(
            n=n,
            left_out=values.shape[1] - n,
            unconverged=unconverged,
            mean=mean,
            low=low,
            high=high,
            products=_products(deviations),
            centre=centre,
            spread=spread,
            counts=_histogram((kept - centre[:, None]) / spread[:, None]),
        )

    def merged(self, other: Self) -> Self:
        """Return what both together say; both count from the same centre."""
        n = self.n + other.n
        apart = other.mean - self.mean
        share = other.n / max(n, 1)
        return replace(
            self,
            n=n,
            left_out=self.left_out + other.left_out,
            unconverged=self.unconverged + other.unconverged,
            mean=self.mean + apart * share,
            low=np.fmin(self.low, other.low),
            high=np.fmax(self.high, other.high),
            products=self.products + other.products + np.outer(apart, apart) * (self.n * share),
            counts=self.counts + other.counts,
        )

    @property
    def covariance(self) -> Floats:
        """Sample covariance (p, p), NaN of fewer than two trials."""
        return self.products / (self.n - 1) if self.n > 1 else np.full_like(self.products, np.nan)

    def quantiles(self, probabilities: list[float] | Floats) -> Floats:
        """Return quantiles (p, len(probabilities)), by the rank p (n - 1) that NumPy takes too."""
        wanted = np.asarray(probabilities, dtype=np.float64)
        if not self.n:
            return np.full((len(self.mean), len(wanted)), np.nan)
        rank, edges = wanted * (self.n - 1), _edges()
        found = np.empty((len(self.mean), len(wanted)))
        for k, counts in enumerate(self.counts):
            filled = np.flatnonzero(counts)
            upto = np.cumsum(counts[filled])
            # The j-th of c values in a bin is taken to lie at (j + 1/2) / c of it.
            at = np.searchsorted(upto, rank, side="right").clip(max=len(filled) - 1)
            bin_, count = filled[at], counts[filled][at]
            part = ((rank - (upto[at] - count) + 0.5) / count).clip(0.0, 1.0)
            z = edges[bin_] + part * (edges[bin_ + 1] - edges[bin_])
            x = self.centre[k] + self.spread[k] * z
            x = np.where(rank <= 0, self.low[k], np.where(rank >= self.n - 1, self.high[k], x))
            found[k] = x.clip(self.low[k], self.high[k])
        return found


def _middle(values: Floats) -> tuple[Floats, Floats]:
    """Upper median and scaled MAD of each row's first values, or where that is zero the standard
    deviation.
    """
    if not values.shape[1]:
        return np.zeros(len(values)), np.ones(len(values))
    values = values[:, :_MIDDLE_OF]
    half = values.shape[1] // 2
    centre = np.partition(values, half, axis=1)[:, half]
    away = np.abs(values - centre[:, None])
    spread = SIGMA_PER_MAD * np.partition(away, half, axis=1)[:, half]
    if not (spread > 0).all():
        spread = np.where(spread > 0, spread, values.std(axis=1))
    return centre, np.where(spread > 0, spread, 1.0)


def _products(rows: Floats) -> Floats:
    """Sums (p, p) of the products of any two rows (p, n)."""
    sums = np.empty((len(rows), len(rows)))
    for k, row in enumerate(rows):
        # Not by BLAS, whose last bit may depend on how many threads it has.
        sums[k, k:] = sums[k:, k] = np.einsum("jn,n->j", rows[k:], row)
    return sums


def _histogram(z: Floats) -> NDArray[np.int64]:
    """Count each row's values in bins."""
    place = np.floor(z * _PER_UNIT)
    far = (z < -_NEAR) | (z >= _NEAR)
    if far.any():
        # The leading bits of a float are the logarithm's stairs: its exponent, then equal steps.
        size = np.abs(z[far]).clip(max=1 << (_FIRST + _OCTAVES)).astype(np.float32)
        bits = size.view(np.int32) >> (_FLOAT32_BITS - _BITS)
        beyond = (bits - ((_FLOAT32_BIAS + _FIRST) << _BITS)).clip(0, _FAR - 1)
        place[far] = np.where(z[far] < 0, -_EQUAL - 1 - beyond, _EQUAL + beyond)
    bins = 2 * (_EQUAL + _FAR)
    place += _EQUAL + _FAR + bins * np.arange(len(z))[:, None]
    counts = np.bincount(place.astype(np.intp).reshape(-1), minlength=bins * len(z))
    return counts.reshape(len(z), bins)


def _edges() -> Floats:
    """Ends of the bins."""
    octave = np.ldexp(1.0, np.arange(_FIRST, _FIRST + _OCTAVES))[:, None]
    steps = (octave * (1.0 + np.arange(1 << _BITS) / (1 << _BITS))).reshape(-1)
    far = np.append(steps, np.ldexp(1.0, _FIRST + _OCTAVES))
    return np.concatenate([-far[:0:-1], np.arange(-_EQUAL, _EQUAL) / _PER_UNIT, far])
