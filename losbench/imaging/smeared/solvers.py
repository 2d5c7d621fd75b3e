"""Single stars: the position at the start of the exposure whose smeared image is the one that was
measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Indices, Ints
from losbench.imaging.smeared.model import Gradient, StreakModel, carried
from losbench.imaging.smeared.windows import Windows, centre_covariance, grey_centre
from losbench.optics.camera import Camera

__all__ = ["Region", "Solution", "Stop", "closed_form", "iterate", "least_squares"]


_LONGEST_STEP = 1.0  # pixels


@dataclass(frozen=True)
class Solution:
    """Positions at the start (M, 2), their covariance (M, 2, 2), fluxes (M,), iterations, and
    whether they settled.
    """

    xy: Floats
    cov: Floats
    flux: Floats
    n_iter: Ints
    converged: Bools

    def where(self, chosen: Bools, other: Solution) -> Solution:
        """Return this solution for the chosen stars and the other for the rest."""
        column = chosen[:, None]
        return Solution(
            xy=np.where(column, self.xy, other.xy),
            cov=np.where(column[..., None], self.cov, other.cov),
            flux=np.where(chosen, self.flux, other.flux),
            n_iter=np.where(chosen, self.n_iter, self.n_iter + other.n_iter),
            converged=np.where(chosen, self.converged, other.converged),
        )


@dataclass(frozen=True)
class Stop:
    """When to end: with a step below ``tolerance`` pixels, or after ``max_iter`` rounds."""

    tolerance: float
    max_iter: int


@dataclass(frozen=True)
class Region:
    """Pixels of the model that count: those ``used``, and of these the ones above ``own_part`` of
    the star's flux.
    """

    used: Bools
    own_part: float = -1.0

    @property
    def whole(self) -> bool:
        """Whether every pixel counts."""
        return self.own_part < 0 and bool(self.used.all())

    def keep(self, chosen: Indices) -> Region:
        """Return the region of some of the stars."""
        return Region(self.used[chosen], self.own_part)

    def of(self, values: Floats, image: Floats | None = None) -> Floats:
        """Return values (M, h, w) where they count and 0 elsewhere; ``image`` is the model, by
        default the values.
        """
        model = values if image is None else image
        return np.where(self.used & (model > self.own_part), values, 0.0)


def closed_form(data: Windows, camera: Camera, mean_back: Floats) -> Solution:
    """Measured centre, taken back to the start by the mean rotation: the first step of the
    iteration, and no more.
    """
    centre, cov = centre_covariance(data)
    here = carried(camera, centre, mean_back)
    return Solution(here, cov, data.flux, np.ones(len(here), dtype=np.int64), ~np.isnan(here[:, 0]))


def iterate(
    model: StreakModel,
    data: Windows,
    region: Region,
    stop: Stop,
    first: Solution,
    *,
    damping: float,
) -> Solution:
    """Move the position by measured centre minus model centre until they agree (lyu2015, section
    1.3).

    A star that has settled is dropped from the rounds.
    """
    goal, xy, n_iter = grey_centre(data.light, data.origin), first.xy.copy(), first.n_iter.copy()
    converged = np.zeros(len(xy), dtype=bool)
    left = np.flatnonzero(first.converged)
    whole = region.whole and data.whole
    some, counted = model.keep(left), region.keep(left)
    for _ in range(stop.max_iter):
        if not left.size:
            break
        tracks = some.tracks(xy[left])
        centre = (
            some.centres(tracks)
            if whole
            else grey_centre(counted.of(some.images(tracks)), some.origin)
        )
        step = np.nan_to_num(goal[left] - centre)
        xy[left] += damping * np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        n_iter[left] += 1
        settled = np.abs(step).max(axis=1) < stop.tolerance
        converged[left[settled]] = True
        if settled.any():
            stay = np.flatnonzero(~settled)
            left, some, counted = left[stay], some.keep(stay), counted.keep(stay)
    cov, flux = first.cov, first.flux
    if not whole:
        response, part = _response(model, region, xy)
        inverse = np.linalg.inv(response)
        cov, flux = inverse @ cov @ np.swapaxes(inverse, 1, 2), flux / part
    return Solution(xy, cov, flux, n_iter, converged)


def least_squares(model: StreakModel, data: Windows, stop: Stop, first: Solution) -> Solution:
    """Fit position and flux to the pixels, weighted by their inverse variance (lyu2015, eq. 11-12),
    by Gauss-Newton.

    The variance is that of the model's pixels, not of the noisy ones: no bias towards dark pixels.
    """
    xy, flux = first.xy.copy(), np.maximum(first.flux, 0.0)
    cov = np.full((len(xy), 2, 2), np.nan)
    n_iter = np.zeros(len(xy), dtype=np.int64)
    converged = np.zeros(len(xy), dtype=bool)
    left = np.flatnonzero(~np.isnan(xy[:, 0]) & (flux > 0))
    some, part = model.keep(left), data.keep(left)
    for _ in range(stop.max_iter):
        if not left.size:
            break
        seen = some.gradient(some.tracks(xy[left]))
        weight = part.weight(seen.image * flux[left, None, None])
        step, inverse = _gauss_newton(seen, part.light, weight, flux[left])
        xy[left] += np.clip(step[:, :2], -_LONGEST_STEP, _LONGEST_STEP)
        flux[left] = np.maximum(flux[left] + step[:, 2], 0.1 * flux[left])
        cov[left] = inverse[:, :2, :2]
        n_iter[left] += 1
        settled = (np.abs(step[:, :2]).max(axis=1) < stop.tolerance) & np.isfinite(inverse[:, 0, 0])
        converged[left[settled]] = True
        if settled.any():
            stay = np.flatnonzero(~settled)
            left, some, part = left[stay], some.keep(stay), part.keep(stay)
    return Solution(xy, cov, flux, n_iter, converged)


def _response(model: StreakModel, region: Region, xy: Floats) -> tuple[Floats, Floats]:
    """How the model's centre follows its position, (M, 2, 2), and the part of its light that
    counts, (M,).

    Not a number where it does not follow, or no pixel counts.
    """
    seen = model.gradient(model.tracks(np.nan_to_num(xy)))
    image, *slopes = (region.of(part, seen.image) for part in seen)
    light = image.sum(axis=(1, 2))
    light[light <= 0] = np.nan
    offset = grey_centre(image, model.origin) - model.origin
    x = np.arange(image.shape[2]) - offset[:, :1]
    y = np.arange(image.shape[1]) - offset[:, 1:]
    columns = [
        np.stack([np.einsum("mij,mj->m", by, x), np.einsum("mij,mi->m", by, y)], axis=-1)
        for by in slopes
    ]
    response = np.stack(columns, axis=-1) / light[:, None, None]
    response[~(np.abs(np.linalg.det(np.nan_to_num(response))) > 1e-6)] = np.nan
    return response, light


def _gauss_newton(
    seen: Gradient, light: Floats, weight: Floats, flux: Floats
) -> tuple[Floats, Floats]:
    """Step in x, y and flux, (M, 3), and inverse normal matrix, (M, 3, 3); 0 and NaN where the star
    tells nothing.
    """
    count = len(flux)
    flat = [part.reshape(count, -1) for part in (seen.by_x, seen.by_y, seen.image, weight, light)]
    columns = np.stack([flat[0] * flux[:, None], flat[1] * flux[:, None], flat[2]], axis=1)
    weighted = columns * flat[3][:, None]
    normal = weighted @ np.swapaxes(columns, 1, 2)
    right = weighted @ (flat[4] - flux[:, None] * flat[2])[..., None]
    scale = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    scaled = normal / (scale[:, :, None] * scale[:, None, :])
    blind = ~(np.linalg.det(np.nan_to_num(scaled)) > 1e-10)
    scaled[blind], scale[blind] = np.eye(3), 1.0
    inverse = np.linalg.inv(scaled) / (scale[:, :, None] * scale[:, None, :])
    step = (inverse @ right)[..., 0]
    step[blind], inverse[blind] = 0.0, np.nan
    return step, inverse
