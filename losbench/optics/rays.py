"""Rays, the pupil that they fill, and where they meet a conic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Floats

__all__ = ["Rays", "disc", "meet"]


@dataclass(frozen=True)
class Rays:
    """Rays in flight, all broadcast against each other.

    Attributes
    ----------
    origin_mm : (..., 3) array
        A point of each ray.
    direction : (..., 3) array
        Unit vectors.
    """

    origin_mm: Floats
    direction: Floats

    def at(self, length_mm: Floats) -> Floats:
        """Return the points (..., 3) that lie so far along."""
        return self.origin_mm + length_mm[..., None] * self.direction


def meet(
    rays: Rays, c: float, k: float, bend: Floats | float, about: Floats
) -> tuple[Floats, Floats]:
    """Points where rays that start near the vertex meet a conic, and unit normals.

    Bending adds a paraboloid about a point: with the factor that makes its curvature that of the
    sag, the surface stays a quadric and the root closed.
    """
    square = np.array([1.0, 1.0, 1.0 + k]) * c
    added = np.asarray(bend * (1.0 - c * (1.0 + k) * about[2]))[..., None] * np.array(
        [1.0, 1.0, 0.0]
    )
    o, d = rays.origin_mm, rays.direction
    off = o - about
    up = np.array([0.0, 0.0, 1.0])
    aa = np.sum((square + added) * d * d, axis=-1)
    bb = np.sum(d * (square * o - up + added * off), axis=-1)
    cc = np.sum(square * o * o + added * off * off, axis=-1) - 2.0 * o[..., 2]
    # The root that stays finite for a flat mirror, without cancellation.
    hit = rays.at(-cc / (bb + np.copysign(np.sqrt(bb * bb - aa * cc), bb)))
    normal = square * hit - up + added * (hit - about)
    return hit, normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def disc(rings: int) -> Floats:
    """Points of the unit disc, (1 + 3 rings (rings + 1), 2): the middle, then rings of 6, 12 ..."""
    points = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        angle = 2 * np.pi * np.arange(6 * ring) / (6 * ring)
        points.append(ring / rings * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    return np.concatenate(points)
