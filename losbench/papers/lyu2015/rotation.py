"""Whether the eight errors of Table 1 can be those of one small rotation of the camera."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from losbench.arrays import Floats
from losbench.imaging.smeared.windows import grey_centre
from losbench.optics.camera import design_matrix
from losbench.papers.lyu2015.scenario import TABLE_1, Setting
from losbench.papers.lyu2015.twin import expose

__all__ = ["one_rotation", "rotation_misfits"]


def one_rotation() -> tuple[Floats, Floats]:
    """Distances that a rotation of the camera gives Table 1's stars, the best for the traditional
    errors; and it.
    """
    rows, errors = _rows(), TABLE_1["traditional"]
    starts = np.random.default_rng(0).normal(0.0, 5e-4, (20, 3))
    best = min((_fit(rows, errors, start) for start in starts), key=lambda fit: fit[1])[0]
    return np.linalg.norm(rows @ best, axis=1), best


def rotation_misfits(
    setting: Setting, *, threshold: float = 0.0, flux_e: float | None = None, images: int = 60
) -> Floats:
    """What the best rotation leaves of the errors of eight simulated stars, (images,) RMS in px.

    Parameters
    ----------
    setting : Setting
        Draws the vibrations; the stars end where Table 1's do.
    threshold : float
        Pixels below this part of a star's light are left out.
    flux_e : float, optional
        Light of every star, for shot and read noise; none without.
    images : int
        Vibrations.
    """
    rng = np.random.default_rng(setting.seed)
    motion = setting.vibrations(images, rng)
    end = TABLE_1["xy"] - 0.5
    start = setting.truth(motion).carry(end, setting.camera, start="end", end="start")
    image = np.repeat(np.arange(images), len(end))
    shots = expose(setting, motion, image, start.reshape(-1, 2), np.zeros(images * len(end)))
    windows = shots.windows[:, 0]
    if flux_e is not None:
        read = setting.detector.expose(windows * flux_e + setting.background_e, rng)
        windows = np.asarray((read - setting.background_dn) / flux_e, dtype=np.float64)
    found = grey_centre(np.where(windows >= threshold, windows, 0.0), shots.origin[:, 0])
    moved = (found - shots.end).reshape(images, len(end), 2)
    rows = _rows()
    misfits = []
    for one in moved:
        # The rotation that fits the vectors is near the one that fits their lengths.
        near: Floats = np.linalg.pinv(rows.reshape(-1, 3)) @ one.ravel()
        misfits.append(_fit(rows, np.linalg.norm(one, axis=1), near)[1])
    return np.array(misfits)


def _rows() -> Floats:
    camera = Setting().camera
    points = camera.points_mm(TABLE_1["xy"] - 0.5)
    return design_matrix(points).reshape(-1, 2, 3) / camera.pixel_mm


def _fit(rows: Floats, errors: Floats, start: Floats) -> tuple[Floats, float]:
    """Rotation whose displacements have these lengths, and the RMS of what is left."""

    def misfit(turn: Floats) -> Floats:
        return np.asarray(np.linalg.norm(rows @ turn, axis=1) - errors)

    fit = least_squares(misfit, start, x_scale=1e-4)
    return fit.x, float(np.sqrt(np.mean(fit.fun**2)))
