"""What a smeared star should look like in its window, and how that changes as it moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf

from losbench.arrays import Floats, Indices
from losbench.checks import named_twice, positive
from losbench.optics.camera import Camera
from losbench.optics.motion.path import AttitudePath

__all__ = ["Gradient", "StreakModel", "carried", "spot_width"]


_TAIL = 5.0  # erf is 1 to 1.5e-12 from here on


class Gradient(NamedTuple):
    """Unit-flux images (M, h, w) of smeared stars and their derivatives with respect to position,
    per pixel.
    """

    image: Floats
    by_x: Floats
    by_y: Floats


@dataclass(frozen=True)
class StreakModel:
    """Model of M stars, each in its own window, flat: no batch axes.

    Parameters
    ----------
    turns : (M, S, 3, 3) array
        Rotations from the start of the exposure to each node, of each star's image.
    share : (S,) array
    focal_px : float
    principal_px : (2,) array
    sigma : (2,) array, pixels
    origin : (M, 2) array, pixels
        Frame position (x, y) of each window's first pixel.
    shape : (h, w)
    """

    turns: Floats
    share: Floats
    focal_px: float
    principal_px: Floats
    sigma: Floats
    origin: Floats
    shape: tuple[int, int]

    @classmethod
    def of(
        cls,
        path: AttitudePath,
        image: Indices,
        camera: Camera,
        sigma: Floats,
        origin: Floats,
        shape: tuple[int, int],
    ) -> StreakModel:
        """Gather the rotations of each star's image (M,) from a path with one batch axis."""
        focal_px, principal = camera.focal_px, np.asarray(camera.principal_px)
        return cls(path.turns[image], path.share, focal_px, principal, sigma, origin, shape)

    def keep(self, chosen: Indices) -> StreakModel:
        """Return the model of some of the stars."""
        return StreakModel(
            self.turns[chosen],
            self.share,
            self.focal_px,
            self.principal_px,
            self.sigma,
            self.origin[chosen],
            self.shape,
        )

    def tracks(self, xy: Floats) -> Floats:
        """Track of each star, (M, S, 2), from its position at the start, (M, 2)."""
        rays = np.empty((len(xy), 3, 1))
        rays[:, :2, 0] = (xy - self.principal_px) / self.focal_px
        rays[:, 2] = 1.0
        turned = (self.turns.reshape(len(xy), -1, 3) @ rays).reshape(len(xy), -1, 3)
        return self.focal_px * turned[..., :2] / turned[..., 2:] + self.principal_px

    def centres(self, tracks: Floats) -> Floats:
        """Grey centre (M, 2) of each star's whole window, without drawing it: sums over pixels
        telescope.
        """
        totals, moments = zip(*(self._sums(tracks, axis) for axis in (0, 1)), strict=True)
        light = (totals[0] * totals[1]) @ self.share
        x, y = (moments[0] * totals[1]) @ self.share, (totals[0] * moments[1]) @ self.share
        return np.stack([x, y], axis=-1) / light[:, None] + self.origin

    def images(self, tracks: Floats) -> Floats:
        """Unit-flux images, (M, h, w)."""
        across, down = (0.5 * np.diff(self._steps(self._edges(tracks, axis))) for axis in (0, 1))
        return np.matmul(np.swapaxes(down * self.share[:, None], 1, 2), across)

    def gradient(self, tracks: Floats) -> Gradient:
        """Images with their derivatives; the track is taken to move as a whole."""
        return self.moments(tracks, self.share)

    def moments(self, tracks: Floats, weight: Floats) -> Gradient:
        """Like `gradient`, with any weight (S,) of the nodes."""
        across, down = (self._edges(tracks, axis) for axis in (0, 1))
        x, y = (0.5 * np.diff(self._steps(u)) for u in (across, down))
        dx, dy = (
            -np.diff(np.exp(-(u**2))) / (np.sqrt(2.0 * np.pi) * s)
            for u, s in zip((across, down), self.sigma, strict=True)
        )
        rows, slopes = (np.swapaxes(part * weight[:, None], 1, 2) for part in (y, dy))
        return Gradient(rows @ x, rows @ dx, slopes @ x)

    def _edges(self, tracks: Floats, axis: int) -> Floats:
        """Distance of pixel edges from the star at each node, in units of sqrt(2) sigma, (M, S, w +
        1).
        """
        edges = np.arange(self.shape[1 - axis] + 1) - 0.5
        scale = 1.0 / (np.sqrt(2.0) * self.sigma[axis])
        return edges * scale - ((tracks[..., axis] - self.origin[:, None, axis]) * scale)[..., None]

    @staticmethod
    def _steps(u: Floats) -> Floats:
        """Return erf, computed only where it is not 1 to twelve digits: most edges are far from the
        star.
        """
        step = np.sign(u)
        near = np.abs(u) < _TAIL
        step[near] = erf(u[near])
        return step

    def _sums(self, tracks: Floats, axis: int) -> tuple[Floats, Floats]:
        """Light of one axis and its first moment, (M, S): sum of E(j + 1) - E(j), and of j times
        that.
        """
        step = self._steps(self._edges(tracks, axis))
        last = step.shape[-1] - 2
        inner = step[..., 1:-1].sum(axis=-1)
        return 0.5 * (step[..., -1] - step[..., 0]), 0.5 * (last * step[..., -1] - inner)


def spot_width(width: ArrayLike | None, sigma: ArrayLike | None) -> Floats:
    """Return the width that was given by either name as (sx, sy), or raise ``ValueError``."""
    name, given = named_twice("width", width, None, sigma=sigma)
    if given is None:
        raise ValueError("width must be given: sigma in pixels of a star that does not move")
    sides = positive(name, given)
    if sides.shape not in ((), (2,)):
        raise ValueError(f"{name} must be one number or (sx, sy), got shape {sides.shape}")
    return np.broadcast_to(sides, (2,))


def carried(camera: Camera, xy: Floats, turns: Floats) -> Floats:
    """Positions (..., 2) in pixels after rotations (..., 3, 3) of their rays."""
    focal_px, principal = camera.focal_px, np.asarray(camera.principal_px)
    x, y = np.moveaxis((xy - principal) / focal_px, -1, 0)
    # Written out: a matrix product of three by three at a time costs several times as much.
    u, v, w = (turns[..., k, 0] * x + turns[..., k, 1] * y + turns[..., k, 2] for k in range(3))
    return np.stack([u / w, v / w], axis=-1) * focal_px + principal
