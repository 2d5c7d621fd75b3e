"""Block after block of stars: windows, model, solver, and what is to be said about the result."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from losbench.arrays import Bools, Floats, Indices, Ints
from losbench.imaging.results import SpotFlag
from losbench.imaging.smeared.cutting import Cut
from losbench.imaging.smeared.joint import solve_jointly
from losbench.imaging.smeared.methods import NARROWEST, Joint, Recipe, Single
from losbench.imaging.smeared.model import StreakModel, carried
from losbench.imaging.smeared.result import AidedCentroids
from losbench.imaging.smeared.solvers import closed_form
from losbench.imaging.smeared.windows import Windows, prepare
from losbench.optics.camera import Camera
from losbench.optics.motion.path import AttitudePath
from losbench.records import changed, join

__all__ = ["Scene", "measure_jointly", "measure_singly"]

_FAINTEST = 5.0  # flux in units of its error
_CROWDED_SIGMAS = 6.0
_WHOLE_SIGMAS = 3.0  # of a star on either side of its track, for its window to hold it


@dataclass(frozen=True)
class Scene:
    """What was seen, and through which camera on which path."""

    path: AttitudePath
    camera: Camera
    sigma: Floats
    cut: Cut
    background: Floats | None
    full_scale: float

    @property
    def shape(self) -> tuple[int, ...]:
        """Batch axes and number of stars."""
        return (*self.cut.batch, self.cut.stars)

    @cached_property
    def exposures(self) -> AttitudePath:
        """The path with one batch axis, that of all images; where one path serves all, a view of it
        for each.
        """
        images = math.prod(self.cut.batch)
        turns, epochs = (
            np.broadcast_to(part.reshape(-1, *part.shape[-3:]), (images, *part.shape[-3:]))
            for part in (self.path.turns, self.path.epochs)
        )
        return replace(self.path, turns=turns, epochs=epochs)

    @cached_property
    def reach(self) -> Floats:
        """How far tracks go from their start, low and high corner, (images, 2, 2): that of a star
        on the axis.
        """
        centre = np.asarray(self.camera.principal_px)
        track = np.ascontiguousarray(
            np.moveaxis(carried(self.camera, centre, self.exposures.turns) - centre, 1, 2)
        )
        return np.stack([track.min(axis=2), track.max(axis=2)], axis=1)

    def boxes(self, start: Floats, image: Indices) -> Floats:
        """Box around each star's track, (M, 2, 2): low and high corner."""
        return start[:, None, :] + self.reach[image]

    def block(self, part: slice, how: Recipe) -> Windows:
        """Prepare some of the windows."""
        level = None if self.background is None else self.background[part]
        windows = prepare(
            self.cut.pixels[part],
            self.cut.origin[part],
            background=level,
            detector=how.detector,
            full_scale=self.full_scale,
        )
        return windows if how.threshold is None else windows.above(how.threshold)


def measure_singly(scene: Scene, how: Recipe, method: Single) -> AidedCentroids:
    """Measure every star on its own."""
    path, camera, image = scene.exposures, scene.camera, scene.cut.image
    found, boxes = [], []
    for part in _blocks(len(image), method.block):
        of, data = image[part], scene.block(part, how)
        size = data.light.shape[1:]
        solution = method.refined(
            partial(StreakModel.of, path, of, camera, scene.sigma, data.origin, size),
            data,
            how,
            closed_form(data, camera, path.mean_back[of]),
            scene.cut.pixels[part] < scene.full_scale,
        )
        boxes.append(scene.boxes(solution.xy, of))
        found.append(
            AidedCentroids(
                carried(camera, solution.xy, path.epochs[of, how.epoch]),
                np.sqrt(np.diagonal(solution.cov, axis1=1, axis2=2)),
                solution.flux,
                solution.n_iter,
                solution.converged,
                _flags(scene, data, solution.flux, solution.converged, boxes[-1]),
            )
        )
    return _finished(found, boxes, scene, how)


def measure_jointly(
    scene: Scene, how: Recipe, predicted: Floats, rate_prior_rad_s: float
) -> AidedCentroids:
    """Measure the stars of each image together."""
    path, camera, stars = scene.exposures, scene.camera, scene.cut.stars
    known = ~np.isnan(predicted).any(axis=-1, keepdims=True).reshape(-1, stars, 1)
    places = np.where(known, predicted.reshape(-1, stars, 2), np.asarray(camera.principal_px))
    found, boxes, joints = [], [], []
    for part in _blocks(len(places), max(1, Joint.block // stars)):
        some = slice(part.start * stars, part.stop * stars)
        here, of, data = (
            path.part(part),
            scene.cut.image[some],
            scene.block(some, how).only(known[part].ravel()),
        )
        model = StreakModel.of(path, of, camera, scene.sigma, data.origin, data.light.shape[1:])
        to_start = np.swapaxes(here.epochs[:, None, how.epoch], -1, -2)
        start = carried(camera, places[part], to_start)
        epoch_s = how.epoch / 2 * path.exposure_s
        joint = solve_jointly(
            model, data, here, epoch_s, start, how.stop, rate_prior_rad_s=rate_prior_rad_s
        )
        xy, cov = joint.positions(camera, places[part])
        xy = np.where(known[part], xy, np.nan)
        settled, rounds = np.repeat(joint.converged, stars), np.repeat(joint.n_iter, stars)
        boxes.append(scene.boxes(carried(camera, xy, to_start).reshape(-1, 2), of))
        flags = _flags(scene, data, joint.flux.ravel(), settled, boxes[-1])
        sigma_xy = np.where(
            known[part], np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1)), np.nan
        ).reshape(-1, 2)
        told = np.where(np.isnan(sigma_xy), np.nan, xy.reshape(-1, 2))
        found.append(AidedCentroids(told, sigma_xy, joint.flux.ravel(), rounds, settled, flags))
        joints.append(joint)
    joint = join(joints)
    return replace(
        _finished(found, boxes, scene, how),
        turn_rad=joint.turn_rad.reshape(*scene.cut.batch, 3),
        rate_rad_s=joint.rate_rad_s.reshape(*scene.cut.batch, 3),
    )


def _finished(
    found: list[AidedCentroids], boxes: list[Floats], scene: Scene, how: Recipe
) -> AidedCentroids:
    """Join the blocks and look at neighbours."""
    result = changed(join(found), lambda flat: flat.reshape(*scene.shape, *flat.shape[1:]))
    result.flags[_crowded(np.concatenate(boxes), scene)] |= SpotFlag.NEIGHBOUR
    if how.method.slow_if_narrow and scene.sigma.min() < NARROWEST:
        result.flags[...] |= SpotFlag.SLOW
    failed = int(np.count_nonzero(result.flags & SpotFlag.NOT_CONVERGED))
    if failed:
        warnings.warn(
            f"{failed} of {result.converged.size} stars did not converge in {how.stop.max_iter} "
            "rounds, see .converged",
            RuntimeWarning,
            stacklevel=4,
        )
    return result


def _flags(scene: Scene, data: Windows, flux: Floats, converged: Bools, boxes: Floats) -> Ints:
    low, high = boxes[:, 0], boxes[:, 1]
    first, beyond = data.origin - 0.5, data.origin + data.light.shape[:0:-1] - 0.5
    reach = _WHOLE_SIGMAS * scene.sigma
    cut = (low - reach < first) | (high + reach > beyond)
    outside = ((low < -0.5) | (high > np.array(scene.camera.shape[::-1]) - 0.5) | cut).any(axis=1)
    bright = flux > _FAINTEST * data.flux_error
    return (
        SpotFlag.NOT_CONVERGED * (~converged & np.isfinite(boxes[:, 0, 0]))
        | SpotFlag.EDGE * ((data.incomplete | outside) & ~data.missing)
        | SpotFlag.SATURATED * data.saturated
        | SpotFlag.TOO_FAINT * (~bright & ~data.missing)
        | SpotFlag.MISSING * data.missing
    ).astype(np.int64)


def _crowded(boxes: Floats, scene: Scene) -> Bools:
    """Stars whose track, six sigma around it, meets the track of another star of the image, (...,
    n).
    """
    meets: Bools = ~np.eye(scene.cut.stars, dtype=bool)
    for axis in (0, 1):
        low, high = np.moveaxis(boxes.reshape(*scene.shape, 2, 2)[..., axis], -1, 0).copy()
        near = low[..., :, None] - high[..., None, :] <= _CROWDED_SIGMAS * scene.sigma[axis]
        meets = meets & near & np.swapaxes(near, -1, -2)  # not a number is near nothing
    return np.asarray(meets.any(axis=-1))


def _blocks(count: int, size: int) -> Iterator[slice]:
    """Slices of at most ``size``; one of them even if there is nothing."""
    for first in range(0, max(count, 1), size):
        yield slice(first, min(first + size, count))
