"""What may be wrong with windows that have come to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.imaging.background import Plane
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Estimate
from losbench.imaging.results import Measured, SpotFlag
from losbench.imaging.stamps import RING
from losbench.imaging.window import look

__all__ = ["Cut", "judged"]


_FAINTEST = 5.0  # flux in units of its error
_LEAK = 0.01  # of the peak
_SURE = 5.0  # sigma
_MOST_UNREAD = 0.15  # of the pixels of a window, that a template goes without


@dataclass(frozen=True)
class Cut:
    """M windows as they were read, the background under them, what is left, what was not read, and
    which pixels a template is fitted to (None: all), the highest reading, whether it is saturated,
    and the sides of window and ring.
    """

    raw: Pixels
    signal: Pixels
    missing: Bools | None
    kept: Pixels | None
    peak: Floats
    saturated: Bools
    plane: Plane
    noise: PixelNoise
    window: int
    ring: int

    def of(self, some: NDArray[Any]) -> Cut:
        """Return some of the windows."""
        return Cut(
            self.raw[some],
            self.signal[some],
            None if self.missing is None else self.missing[some],
            None if self.kept is None else self.kept[some],
            self.peak[some],
            self.saturated[some],
            self.plane.of(some),
            self.noise.of(some),
            self.window,
            self.ring,
        )


def judged(shape: tuple[int, ...], middle: Indices, cut: Cut, fit: Estimate) -> Measured:
    """Flags of windows that have come to rest."""
    level = cut.plane.at(fit.centroid)
    half = np.array(shape[::-1]) / 2
    off = middle - (half - 0.5)  # from the middle of the frame
    leaves = (np.abs(fit.middle + off) + cut.window / 2 > half + 1e-9).any(axis=1)
    clipped = (np.abs(off) + cut.ring // 2 + RING > half).any(axis=1)
    holes, n_bad = np.zeros(len(middle), dtype=bool), np.zeros(len(middle), dtype=np.int64)
    if cut.missing is not None:
        unread = look(cut.missing.astype(np.float64), np.nan_to_num(fit.middle), cut.window).total
        borne = 0.0 if cut.kept is None else _MOST_UNREAD * cut.window**2
        holes = (unread > 1e-9) & (unread > borne) & ~leaves
        n_bad = np.where(holes | leaves, 0, np.rint(unread)).astype(np.int64)
    with np.errstate(invalid="ignore"):
        faint = ~(fit.flux > 0) | (fit.flux < _FAINTEST * fit.sigma_flux)

    said = {
        SpotFlag.NOT_CONVERGED: ~fit.converged & ~holes,
        SpotFlag.EDGE: leaves | clipped,
        SpotFlag.SATURATED: cut.saturated,
        SpotFlag.BAD_PIXEL: n_bad > 0,
        SpotFlag.TOO_FAINT: faint & ~holes,
        SpotFlag.SLOW: fit.slow,
        SpotFlag.RING: _leaks(cut, level) & ~faint & ~leaves & ~clipped,
        SpotFlag.MISFIT: fit.misfit & ~faint & ~leaves,
        SpotFlag.MISSING: holes,
        SpotFlag.CLIPPED: cut.plane.clipped,
    }
    flags = np.array([*said], dtype=np.int64) @ np.array([*said.values()])  # bits add up
    nowhere = (leaves | holes | faint)[:, None]
    xy = np.where(nowhere, np.nan, fit.centroid + middle)
    sigma = np.where(np.isnan(xy), np.nan, fit.sigma)
    return Measured(xy, sigma, fit.flux, level, fit.n_iter.copy(), flags, n_bad)


def _leaks(cut: Cut, level: Floats) -> Bools:
    """The ring grows brighter towards the spot: surely, and by more than a hundredth of the spot's
    peak.
    """
    excess, least = cut.plane.excess, _LEAK * (cut.peak - level)
    with np.errstate(invalid="ignore"):
        leaks: Bools = (excess > _SURE * cut.plane.excess_error) & (excess > least)
    return leaks
