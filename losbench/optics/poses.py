"""Rays carried into the frame of an optic that has moved, grown or bent, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, shaped
from losbench.optics.rays import Rays

__all__ = ["Moved"]


@dataclass(frozen=True)
class Moved:
    """Poses, growths and bendings with axes for spots and rays behind the batch."""

    pivot: Floats  # (4, 3)
    shift: Floats  # (..., 1, 1, 4, 3)
    turn: Floats  # (..., 1, 1, 4, 3, 3)
    size: Floats  # (..., 1, 1, 4)
    curvature: Floats  # (..., 1, 1, 3)

    @classmethod
    def of(
        cls,
        pivot_mm: Floats,
        motion: ArrayLike | None,
        growth: ArrayLike | None,
        bending: ArrayLike | None,
    ) -> Moved:
        """Return the poses of `ThreeMirror.trace`, by default at rest."""
        from scipy.spatial.transform import Rotation  # slow to import

        pose = finite("motion", np.zeros((4, 6)) if motion is None else motion)
        size = 1.0 + finite("growth", np.zeros(4) if growth is None else growth)
        curvature = finite("bending", np.zeros(3) if bending is None else bending)
        shaped("motion", pose, ("...", 4, 6))
        shaped("growth", size, ("...", 4))
        shaped("bending", curvature, ("...", 3))
        turn = Rotation.from_rotvec(pose[..., 3:].reshape(-1, 3)).as_matrix()
        return cls(
            pivot_mm,
            pose[..., None, None, :, :3],
            turn.reshape(*pose.shape[:-1], 3, 3)[..., None, None, :, :, :],
            size[..., None, None, :],
            curvature[..., None, None, :],
        )

    def enter(self, i: int, rays: Rays) -> Rays:
        """Return the rays as the optic sees them."""
        back = self.turn[..., i, :, :]
        off = rays.origin_mm - self.pivot[i] - self.shift[..., i, :]
        origin = self.pivot[i] + _times(off, back) / self.size[..., i, None]
        return Rays(origin, _times(rays.direction, back))

    def leave(self, i: int, rays: Rays) -> Rays:
        """Return the optic's rays as the room sees them."""
        out = np.swapaxes(self.turn[..., i, :, :], -1, -2)
        off = _times(rays.origin_mm - self.pivot[i], out) * self.size[..., i, None]
        return Rays(off + self.pivot[i] + self.shift[..., i, :], _times(rays.direction, out))

    def bend(self, i: int) -> tuple[Floats, Floats]:
        """Return curvature added to a mirror and the point that it is added about."""
        return self.curvature[..., i], self.pivot[i]


def _times(vectors: Floats, matrix: Floats) -> Floats:
    """Row vectors (..., 3) times matrices (..., 3, 3)."""
    return np.matmul(vectors[..., None, :], matrix)[..., 0, :]
