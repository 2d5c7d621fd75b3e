"""The width of a spot from its moments, in an aperture that holds it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from losbench.arrays import Bools, Floats
from losbench.imaging.ownlight import STANDS_OUT, without_others
from losbench.units import SIGMA_PER_MAD

__all__ = ["moment_sigma", "plane_under"]


_RIDGE = 1e-9 * np.eye(3)
_FEWEST = 12  # pixels of a ring that tell a plane
_BRIGHT = 20.0  # errors of the flux, for a second moment to tell
_ROUNDS = 12
_SETTLED = 0.02  # of a width
_LONG = 1.2  # ratio of the axes from which on a spot is not round
_LEAKS = 0.05  # of the peak, what is brighter than the other side
_LEAST = 0.04  # pixels squared
_ALIKE = 3.0  # errors of a moment, within which a spot is taken for a Gaussian


def moment_sigma(signal: Floats, noise: float, core: Bools, first: float) -> float:
    """Gaussian sigma of a spot, in pixels, from a first guess and the pixels above half its peak.

    The second moment in a window of six sigma about its own centre, of a Gaussian cut off there, is
    iterated. It is right for any shape, but noise at the rim of the window has long arms. Where a
    Gaussian of the width that `_matched` finds explains it within its error, or the spot is too
    faint for it, that width is the better one.
    """
    row, column = np.nonzero(core)
    centre, sigma = np.array([column.mean(), row.mean()]), np.array([first, first])
    error = np.full(2, np.inf)
    least = max(_LEAKS * float(signal[core].max()), np.sqrt(2.0) * STANDS_OUT * noise)
    for _ in range(_ROUNDS):
        half = max(int(np.rint(3.0 * sigma.max())), 1)
        seen = _Light.around(signal, centre, half).alone(centre, least, noise)
        flux = float(seen.light.sum())
        if flux < _BRIGHT * noise * np.sqrt(seen.light.size):
            error, sigma = np.full(2, np.inf), np.array([first, first])
            break
        sums = seen.light.sum(axis=0), seen.light.sum(axis=1)
        centre = np.array([sums[0] @ seen.x, sums[1] @ seen.y]) / flux
        square = (seen.x - centre[0]) ** 2, (seen.y - centre[1]) ** 2
        kept = _kept_variance((half + 0.5) / sigma) * flux
        variance = [line @ arm for line, arm in zip(sums, square, strict=True)] / kept - 1.0 / 12.0
        error = noise * np.array([_long_arm(arm, seen) for arm in square]) / kept
        found = np.sqrt(np.clip(variance, _LEAST, None)).clip(0.6 * first, 3.0 * first)
        done = bool((np.abs(found - sigma) < _SETTLED * sigma).all())
        sigma = found
        if done:
            break
    matched = _matched(seen, centre, sigma)
    if (np.abs(matched**2 - sigma**2) <= _ALIKE * error).all():
        sigma = matched.clip(0.6 * first, 3.0 * first)
    wider = float(sigma.max())
    return wider if wider > _LONG * sigma.min() else float(sigma.mean())


@dataclass(frozen=True)
class _Light:
    """A square of a spot, the plane through the ring around it off, where its columns and rows are,
    and how many pixels the ring has.
    """

    light: Floats
    x: Floats
    y: Floats
    ring: int

    @classmethod
    def around(cls, signal: Floats, centre: Floats, half: int) -> _Light:
        window, beyond = (
            _square(signal, centre, half),
            _square(signal, centre, half + max(half // 3, 2)),
        )
        # Only what lies around is looked at: the square of the window within the larger one.
        inner = tuple(
            slice(a.start - b.start, a.stop - b.start) for a, b in zip(window, beyond, strict=True)
        )
        ring = np.ones(signal[beyond].shape, bool)
        ring[inner] = False
        light = signal[window] - plane_under(signal[beyond], ring)[inner]
        y, x = (np.arange(part.start, part.stop, dtype=np.float64) for part in window)
        return cls(light, x, y, int(ring.sum()))

    def alone(self, centre: Floats, least: float, noise: float) -> _Light:
        """Without what other spots add to that at the centre."""
        corner = np.array([self.x[0], self.y[0]])
        return replace(self, light=without_others(self.light, centre - corner, least, noise))


def _long_arm(square: Floats, seen: _Light) -> float:
    """Error of a second moment for pixels with an error of one, and of the level under them."""
    across = seen.light.size / len(square)
    of_level = (across * square.sum()) ** 2 / max(seen.ring, 1)
    return float(np.sqrt(across * (square**2).sum() + of_level))


def _matched(seen: _Light, centre: Floats, sigma: Floats) -> Floats:
    """Sigma along x and y from moments weighted by the very Gaussian that they tell of, as least
    squares has it: a pixel counts as much as there is light in it. NaN where there is none.
    """
    at, variance = centre, sigma**2 + 1.0 / 12.0
    for _ in range(_ROUNDS):
        arms = seen.x - at[0], seen.y - at[1]
        across, down = (np.exp(-0.5 * arm**2 / v) for arm, v in zip(arms, variance, strict=True))
        lines = down @ seen.light * across, seen.light @ across * down
        total, mean, square = (
            np.array([line @ arm**power for line, arm in zip(lines, arms, strict=True)])
            for power in range(3)
        )
        if not (total > 0).all():
            return np.full(2, np.nan)
        weighted = square / total - (mean / total) ** 2
        if not ((weighted > _LEAST) & (weighted < variance)).all():
            return np.full(2, np.nan)
        # Two Gaussians multiplied: their inverse variances add up.
        inverse = 1.0 / weighted - 1.0 / variance
        done = bool((np.abs(inverse * variance - 1.0) < 0.1 * _SETTLED).all())
        at, variance = at + 2.0 * mean / total, 1.0 / inverse
        if done:
            break
    return np.sqrt(np.clip(variance - 1.0 / 12.0, _LEAST, None))


def plane_under(pixels: Floats, ring: Bools) -> Floats:
    """Plane (rows, columns) through a ring, without what stands out of it."""
    row, column = np.nonzero(ring)
    if len(row) < _FEWEST:
        return np.full(pixels.shape, np.median(pixels[ring]) if len(row) else 0.0)
    basis = np.stack([np.ones(len(row)), column, row], axis=-1)
    values, kept = pixels[ring], np.ones(len(row), bool)
    for _ in range(2):
        some = basis[kept]
        plane = np.linalg.solve(some.T @ some + _RIDGE, some.T @ values[kept])
        rest = values - basis @ plane
        rest -= np.median(rest)
        kept = np.abs(rest) <= 3.0 * SIGMA_PER_MAD * np.median(np.abs(rest)) + 1e-12
        if kept.sum() < _FEWEST:
            break
    y, x = np.arange(pixels.shape[0])[:, None], np.arange(pixels.shape[1])
    return plane[0] + plane[1] * x + plane[2] * y


def _square(signal: Floats, centre: Floats, half: int) -> tuple[slice, slice]:
    """The pixels within so many of the one that holds the centre."""
    x, y = (int(at) for at in np.rint(centre))
    return (
        slice(max(y - half, 0), min(y + half + 1, len(signal))),
        slice(max(x - half, 0), min(x + half + 1, signal.shape[1])),
    )


def _kept_variance(reach: Floats) -> Floats:
    """Part of a Gaussian's variance that is left when it is cut off at so many sigma."""
    bell = np.exp(-0.5 * reach**2) * np.sqrt(2.0 / np.pi)
    kept: Floats = 1.0 - reach * bell / erf(reach / np.sqrt(2.0))
    return kept
