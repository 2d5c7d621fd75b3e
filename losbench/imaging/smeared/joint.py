"""All stars of an image at once: one rotation, and perhaps one rate error of the gyro, explain
every star's pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Bools, Floats, Ints
from losbench.imaging.smeared.model import StreakModel
from losbench.imaging.smeared.solvers import Stop
from losbench.imaging.smeared.windows import Windows
from losbench.optics.camera import Camera, design_matrix, rotate
from losbench.optics.motion.path import AttitudePath

__all__ = ["JointSolution", "solve_jointly"]


_LONGEST_TURN_PX = 1.0  # of one round, on the optical axis
_RATE_KNOWN_RAD_S = 1e-12  # a prior this narrow leaves the rate at zero


@dataclass(frozen=True)
class JointSolution:
    """Of F images with n stars each.

    Parameters
    ----------
    turn_rad : (F, 3) array
        Rotation that carries the predicted rays at the epoch into the observed ones.
    rate_rad_s : (F, 3) array
        Constant rate that the stars' rays have on top of the gyro's path.
    cov : (F, 6, 6) array
        Covariance of both.
    flux : (F, n) array
    n_iter, converged : (F,) arrays
    """

    turn_rad: Floats
    rate_rad_s: Floats
    cov: Floats
    flux: Floats
    n_iter: Ints
    converged: Bools

    def positions(self, camera: Camera, predicted: Floats) -> tuple[Floats, Floats]:
        """Positions (F, n, 2) at the epoch that the rotation gives, and their covariance (F, n, 2,
        2).
        """
        rays = camera.points_mm(predicted)
        rows = design_matrix(rays[..., None, :], "pinhole") / camera.pixel_mm
        cov = rows @ self.cov[:, None, :3, :3] @ np.swapaxes(rows, -1, -2)
        return camera.pixels(rotate(rays, self.turn_rad)), cov


def solve_jointly(
    model: StreakModel,
    data: Windows,
    path: AttitudePath,
    epoch_s: float,
    start: Floats,
    stop: Stop,
    *,
    rate_prior_rad_s: float,
) -> JointSolution:
    """Fit one small rotation theta and rate b per image, exp(theta + b (t - epoch)) on top of the
    gyro's path.

    ``start`` (F, n, 2) are the predicted positions, carried to the start of the exposure.
    Gauss-Newton on pixels weighted by inverse variance, each star's flux eliminated; the rate has a
    Gaussian prior of width ``rate_prior_rad_s`` about zero.
    """
    from scipy.spatial.transform import Rotation  # half the time that `import losbench` may take

    images, stars = start.shape[:2]
    since = path.time_s - epoch_s
    turn, rate = np.zeros((images, 3)), np.zeros((images, 3))
    flux = np.maximum(data.flux, 0.0)
    known = np.repeat([0.0, max(rate_prior_rad_s, _RATE_KNOWN_RAD_S) ** -2], 3)
    cov, n_iter = np.full((images, 6, 6), np.nan), np.zeros(images, dtype=np.int64)
    converged = np.zeros(images, dtype=bool)
    for _ in range(stop.max_iter):
        if converged.all():
            break
        small = turn[:, None] + rate[:, None] * since[:, None]
        extra = (
            Rotation.from_rotvec(small.reshape(-1, 3)).as_matrix().reshape(images, len(since), 3, 3)
        )
        # The turn acts on the rays after the gyro's: its matrix stands in front of the path's.
        normal, right, flux = _normal_equations(
            model, data, np.repeat(extra @ path.turns, stars, axis=0), start, since, flux
        )
        right[:, 3:] -= known[3:] * rate  # the prior pulls the whole rate to zero, not its step
        step, inverse = _solved(normal + np.diag(known), right)
        move = model.focal_px * np.linalg.norm(step[:, :3], axis=1)
        active = ~converged
        step *= (active * np.minimum(1.0, _LONGEST_TURN_PX / np.maximum(move, 1e-300)))[:, None]
        turn += step[:, :3]
        rate += step[:, 3:]
        cov[active] = inverse[active]
        n_iter[active] += 1
        reach = model.focal_px * np.abs(step[:, 3:]).max(axis=1) * path.exposure_s
        converged |= (
            (move < stop.tolerance) & (reach < stop.tolerance) & np.isfinite(inverse[:, 0, 0])
        )
    return JointSolution(turn, rate, cov, flux.reshape(images, stars), n_iter, converged)


def _normal_equations(
    model: StreakModel,
    data: Windows,
    turns: Floats,
    start: Floats,
    since: Floats,
    flux: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Normal matrix (F, 6, 6) and right side (F, 6) of all pixels of each image, and the fluxes
    that fit best, (M,).
    """
    images, stars = start.shape[:2]
    turned = StreakModel(
        turns,
        model.share,
        model.focal_px,
        model.principal_px,
        model.sigma,
        model.origin,
        model.shape,
    )
    tracks = turned.tracks(start.reshape(-1, 2))
    place, drift = turned.gradient(tracks), turned.moments(tracks, model.share * since)
    # Variance of the model's pixels: that of the data's own would favour dark ones.
    weight = data.weight(place.image * flux[:, None, None])
    power = np.einsum("mij,mij,mij->m", weight, place.image, place.image)
    flux = np.einsum("mij,mij,mij->m", weight, place.image, data.light) / np.where(
        power > 0, power, np.inf
    )

    # One ray for a whole track: over a streak the slope by a turn changes by its length over f.
    rays = np.concatenate(
        [tracks.mean(axis=1) - model.principal_px, np.full((len(tracks), 1), model.focal_px)],
        axis=1,
    )
    by_angle = design_matrix(rays[:, None], "pinhole").reshape(-1, 2, 3)
    slopes = [
        np.stack([part.by_x, part.by_y], axis=1).reshape(len(flux), 2, -1)
        for part in (place, drift)
    ]
    columns = (
        np.concatenate([np.swapaxes(by_angle, 1, 2) @ slope for slope in slopes], axis=1)
        * flux[:, None, None]
    )
    image, flat = place.image.reshape(len(flux), -1), weight.reshape(len(flux), -1)
    # What a change of flux can explain is no evidence for a turn.
    shadow = (columns @ (flat * image)[..., None]) / np.where(power > 0, power, np.inf)[
        :, None, None
    ]
    columns = columns - shadow * image[:, None, :]
    residual = data.light.reshape(len(flux), -1) - flux[:, None] * image
    weighted = columns * flat[:, None, :]
    normal = (weighted @ np.swapaxes(columns, 1, 2)).reshape(images, stars, 6, 6).sum(axis=1)
    right = (weighted @ residual[..., None])[..., 0].reshape(images, stars, 6).sum(axis=1)
    return normal, right, flux


def _solved(normal: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Step (F, 6) and covariance (F, 6, 6); 0 and NaN for an image whose stars leave a rotation
    undetermined.
    """
    scale = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    outer = scale[:, :, None] * scale[:, None, :]
    scaled = normal / np.where(outer > 0, outer, np.inf)
    blind = ~(np.linalg.det(scaled) > 1e-12)
    scaled[blind], outer[blind] = np.eye(6), np.inf
    inverse = np.linalg.inv(scaled) / outer
    step = (inverse @ right[..., None])[..., 0]
    inverse[blind] = np.nan
    return step, inverse
