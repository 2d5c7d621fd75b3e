"""How noisy the pixels of a window are, which decides every predicted error."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Pixels
from losbench.imaging.background import Plane
from losbench.imaging.detector import Detector
from losbench.imaging.ranks import digit_step

__all__ = ["Gain", "PixelNoise", "Transfer", "peak_reading", "pixel_noise", "saturated", "step_of"]


_SAMPLES = 2048  # readings that tell their step
_TELLING = 8  # different ones
_PLATEAU = 5  # pixels


@dataclass(frozen=True, eq=False)
class Transfer:
    """How variance grows with signal, to be drawn.

    Attributes
    ----------
    signal_dn : (B,) array, DN
        Without background.
    variance_dn2, error_dn2 : (B,) arrays, DN squared
        Of the readings with about that signal, and its one-sigma error.
    floor_dn2, level_dn : float
        Median variance and level of the rings.
    """

    signal_dn: Floats
    variance_dn2: Floats
    error_dn2: Floats
    floor_dn2: float
    level_dn: float


@dataclass(frozen=True)
class Gain:
    """Noise of readings, as `estimate_gain` finds it: the scatter of the ring squared, and
    ``per_dn`` times the signal, make up the variance.

    Parameters
    ----------
    per_dn : float, DN
        Inverse of the gain in electrons per DN.
    std_error : float, DN
        Its one-sigma error; infinite where the frames do not tell, so that predicted errors are
        lower bounds.
    step_dn : float, DN
        Step of the readings, 0 for those that are not whole numbers.
    curve : Transfer, optional
        What it was read from.

    Examples
    --------
    Known from elsewhere, 2 e-/DN, without offset or read noise:

    >>> Gain(per_dn=0.5, std_error=0.0).known, Gain(per_dn=0.0, std_error=np.inf).known
    (True, False)
    """

    per_dn: float
    std_error: float
    step_dn: float = 0.0
    curve: Transfer | None = field(default=None, compare=False, repr=False)

    @property
    def coarse(self) -> bool:
        """Whether the noise is below half a step, so that predicted errors are too large."""
        return self.curve is not None and self.curve.floor_dn2 < (self.step_dn / 2.0) ** 2

    @property
    def rounding(self) -> float:
        """Least variance of a reading, for its rounding, DN squared."""
        # More than a twelfth: with noise below half a step neighbours are rounded the same way.
        return self.step_dn**2 / 8.0

    @property
    def known(self) -> bool:
        """Whether the frames told it."""
        return bool(np.isfinite(self.std_error))


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
    lost : (M,) array, DN squared, or None
        What a pixel without light lacks of the floor, as black is clipped.
    """

    floor: Floats
    per_dn: float
    plane: Floats
    lost: Floats | None = None

    def of(self, some: NDArray[Any] | slice) -> PixelNoise:
        """Return that of some of the windows."""
        lost = None if self.lost is None else self.lost[some]
        return PixelNoise(self.floor[some], self.per_dn, self.plane[some], lost)


def pixel_noise(plane: Plane, noise: Detector | Gain, last_digit: Floats) -> PixelNoise:
    """Variance of the pixels on that background, by a detector, or by the ring and a gain.

    ``last_digit`` (M,) is the precision of readings that are not whole, DN.
    """
    per_dn = noise.per_dn
    if isinstance(noise, Gain):
        # Frames without any noise are known to their last digit, not to nothing.
        least = noise.rounding if noise.step_dn else last_digit**2
        floor = np.maximum(plane.noise**2, least)
        ring = np.fmax(plane.scatter**2, least)
    else:
        ring = floor = noise.variance_dn(plane.level)
    of_plane = np.empty((len(floor), 3))
    of_plane[:, 0] = plane.level_variance * ring
    of_plane[:, 1:] = plane.slope_variance * ring[:, None]
    return PixelNoise(floor, per_dn, of_plane, floor - ring)


def peak_reading(raw: Pixels, missing: Bools | None) -> Floats:
    """Highest reading of each stamp, of the pixels that were read."""
    pixels = raw.reshape(-1, raw.shape[1] * raw.shape[2])
    top = pixels.max(axis=1) if missing is None else np.nan_to_num(pixels).max(axis=1)
    return top.astype(np.float64)


def saturated(
    raw: Pixels, missing: Bools | None, level: Floats, full_scale_dn: float
) -> tuple[Bools, Pixels]:
    """Whether full scale is reached, or more pixels share the maximum than whole numbers make of a
    round top, (M,); and from which reading on pixels are saturated (M, 1, 1).
    """
    side = raw.shape[1] - 2
    inner = raw[:, 1:-1, 1:-1].reshape(-1, side * side)
    if missing is not None:
        inner = np.where(np.isnan(inner), -np.inf, inner)
    top = inner.max(axis=1)
    sharing = np.add.reduce((inner == top[:, None]).view(np.uint8), axis=1, dtype=np.uint32)
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = inner.shape[1] / (top - level)
        plateau = (top > level) & (sharing >= _PLATEAU + chance)
    return (top >= full_scale_dn) | plateau, np.minimum(top, full_scale_dn)[:, None, None]


def step_of(stack: NDArray[Any]) -> float:
    """Step of whole readings: 16 where twelve bits are aligned to the left, 1 where few tell; 0 for
    readings that are not whole.
    """
    sample = stack.reshape(-1)[:: max(1, stack.size // _SAMPLES) | 1].astype(np.float64)
    sample = sample[np.isfinite(sample)]
    step = digit_step(sample) if sample.size else 0.0
    return step if step <= 1.0 or len(np.unique(sample)) >= _TELLING else 1.0
