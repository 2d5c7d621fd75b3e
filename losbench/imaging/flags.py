"""What may be wrong with windows that have come to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.imaging.background import RING, Plane
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Estimate
from losbench.imaging.results import Measured, SpotFlag
from losbench.imaging.window import look

__all__ = ["Cut", "judged", "saturated"]


_FAINTEST = 5.0  # flux in units of its error
_PLATEAU = 5  # pixels
_LEAK = 0.01  # of the peak
_SURE = 5.0  # sigma


@dataclass(frozen=True)
class Cut:
    """M windows as they were read, the background under them, what is left, what was not read, and
    the highest reading; the sides of window and ring, and the reading of a saturated pixel.
    """

    raw: Pixels
    signal: Pixels
    missing: Bools | None
    peak: Floats
    plane: Plane
    noise: PixelNoise
    window: int
    ring: int
    full_scale_dn: float


def judged(shape: tuple[int, ...], middle: Indices, cut: Cut, fit: Estimate) -> Measured:
    """Flags of windows that have come to rest."""
    level = cut.plane.at(fit.centroid)
    at, half = fit.middle + middle, cut.window / 2
    end = np.array(shape[::-1]) - 0.5
    leaves = ((at - half < -0.5 - 1e-9) | (at + half > end + 1e-9)).any(axis=1)
    reach = cut.ring // 2 + RING
    clipped = ((middle < reach) | (middle + reach > end)).any(axis=1)
    holes = np.zeros(len(middle), dtype=bool)
    if cut.missing is not None:
        unread = look(cut.missing.astype(np.float64), np.nan_to_num(fit.middle), cut.window)
        holes = (unread.total > 1e-9) & ~leaves
    with np.errstate(invalid="ignore"):
        faint = ~(fit.flux > 0) | (fit.flux < _FAINTEST * fit.sigma_flux)

    flags = np.zeros(len(middle), dtype=np.int64)
    for flag, where in (
        (SpotFlag.NOT_CONVERGED, ~fit.converged & ~holes),
        (SpotFlag.EDGE, leaves | clipped),
        (SpotFlag.SATURATED, saturated(cut, level)),
        (SpotFlag.TOO_FAINT, faint & ~holes),
        (SpotFlag.SLOW, fit.slow),
        (SpotFlag.RING, _leaks(cut, level) & ~faint & ~leaves & ~clipped),
        (SpotFlag.MISFIT, fit.misfit & ~faint & ~leaves),
        (SpotFlag.MISSING, holes),
    ):
        flags[where] |= flag
    nowhere = (leaves | holes | faint)[:, None]
    xy = np.where(nowhere, np.nan, fit.centroid + middle)
    sigma = np.where(np.isnan(xy), np.nan, fit.sigma)
    return Measured(xy, sigma, fit.flux, level, fit.n_iter.copy(), flags)


def saturated(cut: Cut, level: Floats) -> Bools:
    """Full scale is reached, or more pixels share the maximum than whole numbers make of a
    round top.
    """
    inner = cut.raw[:, 1:-1, 1:-1].reshape(len(level), -1)
    if cut.missing is not None:
        inner = np.where(np.isnan(inner), -np.inf, inner)
    top = inner.max(axis=1)
    sharing = (inner == top[:, None]).astype(np.float32).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = cut.window**2 / (top - level)
        plateau = (top > level) & (sharing >= _PLATEAU + chance)
    return (top >= cut.full_scale_dn) | plateau


def _leaks(cut: Cut, level: Floats) -> Bools:
    """The ring grows brighter towards the spot: surely, and by more than a hundredth of the spot's
    peak.
    """
    excess, least = cut.plane.excess, _LEAK * (cut.peak - level)
    with np.errstate(invalid="ignore"):
        leaks: Bools = (excess > _SURE * cut.plane.excess_error) & (excess > least)
    return leaks
