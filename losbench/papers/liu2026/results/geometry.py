"""Section 2 of the paper: the noise-free check, the Monte Carlo of Fig. 1, and why two spots make
IRLS equal to LS.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from losbench.arrays import Floats
from losbench.checks import choice
from losbench.estimation.montecarlo import monte_carlo
from losbench.estimation.robust import irls, lstsq
from losbench.optics.camera import design_matrix, rotate
from losbench.papers.liu2026.scenario import MonteCarlo
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "NOISE_FORMS",
    "Simulation",
    "beam_angle_deg",
    "figure_1",
    "noise_free_readings",
    "two_spot_difference",
]


NOISE_FORMS = {"clipped": 1 / 3, "gaussian": 1.0, "truncated": 0.5396, "uniform": 3**-0.5}
"""What "0.1 px, in the range +-0.1 px" may mean, with sigma over precision: a third of it,
clipped; sigma itself; sigma, cut at +-p; anything within +-p.
"""


@dataclass(frozen=True)
class Simulation:
    """Errors of a Monte Carlo: ``errors_arcsec`` (trials, precisions, 3) about X, Y and Z."""

    precisions_px: tuple[float, ...]
    errors_arcsec: Floats

    @property
    def sigma_arcsec(self) -> Floats:
        """Root mean square error, (precisions, 3)."""
        return np.sqrt(np.mean(self.errors_arcsec**2, axis=0))

    @property
    def peak_arcsec(self) -> Floats:
        """Largest absolute error of all trials, (precisions, 3)."""
        return np.abs(self.errors_arcsec).max(axis=0)


def beam_angle_deg(points: ArrayLike) -> float:
    """Angle between two vectors (2, 3), in degrees.

    >>> round(beam_angle_deg(MonteCarlo().points_mm), 4)
    1.1914
    """
    a, b = np.asarray(points, dtype=np.float64)
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def figure_1(setting: MonteCarlo, *, model: str = "paper", progress: bool = False) -> Simulation:
    """Run the Monte Carlo behind Fig. 1: noise on the four elements of b, angles by least squares.

    The displacements without noise follow ``model`` too, so that only the noise is seen; with two
    spots IRLS gives the same angles (`two_spot_difference`). The same draws serve every precision.

    Parameters
    ----------
    setting : MonteCarlo
        The scenario.
    model : "paper" or "pinhole"
        As for `design_matrix`.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Simulation
    """
    matrix = design_matrix(setting.points_mm, model)  # type: ignore[arg-type]
    truth = setting.angles_rad
    precision_mm = np.array(setting.precisions_px) * setting.pixel_um * 1e-3

    def trial(rng: np.random.Generator, size: int) -> dict[str, Floats]:
        unit = unit_noise(rng, (size, 1, len(matrix)), setting.noise)
        found = lstsq(matrix, matrix @ truth + precision_mm[:, None] * unit).x
        return {"error": rad_to_arcsec(found - truth)}

    result = monte_carlo(trial, setting.trials, seed=setting.seed, progress=progress)
    return Simulation(setting.precisions_px, result["error"])


def unit_noise(rng: np.random.Generator, shape: tuple[int, ...], noise: str) -> Floats:
    """Draw noise for a precision of one, of one of the `NOISE_FORMS`."""
    choice("noise", noise, NOISE_FORMS)
    if noise == "uniform":
        return rng.uniform(-1.0, 1.0, shape)
    if noise == "truncated":
        # The quantile of a uniform draw between those of -1 and +1: nothing is drawn again.
        return np.asarray(ndtri(rng.uniform(ndtr(-1.0), ndtr(1.0), shape)))
    draws = rng.standard_normal(shape)
    return np.clip(draws / 3.0, -1.0, 1.0) if noise == "clipped" else draws


def two_spot_difference(
    setting: MonteCarlo, *, model: str = "paper", scale: str = "std", precision_px: float = 0.1
) -> Simulation:
    """Return by how much IRLS differs from LS over the Monte Carlo's trials, in arcseconds.

    Model "paper": rows 1 and 3 of A are the same, so the residuals are (d, 0, -d, 0) and their
    weights equal: the weighted normal equations have the least-squares solution, whatever the
    weights (liu2026, eq. 8-10).
    """
    matrix = design_matrix(setting.points_mm, model)  # type: ignore[arg-type]
    rng = np.random.default_rng(setting.seed)
    noise = (
        precision_px
        * setting.pixel_um
        * 1e-3
        * unit_noise(rng, (setting.trials, len(matrix)), setting.noise)
    )
    y = matrix @ setting.angles_rad + noise
    difference = irls(matrix, y, scale=scale, on_fail="ignore").x - lstsq(matrix, y).x
    return Simulation((precision_px,), rad_to_arcsec(difference)[:, None])


def noise_free_readings(setting: MonteCarlo) -> pd.DataFrame:
    """Every reading of section 2.2's check without noise: the errors in percent that eq. (2) makes
    on its own.

    Columns: rotation (eq. 1 or exact), z of the rotated vectors (kept, overwritten with -475,
    projected back on the plane -475), vectors (as they are, normalised after z was set, normalised
    before, only the rotated ones normalised), and the errors of the three angles in percent.
    """
    import pandas as pd

    rows = []
    for labels, before, after in _readings(setting):
        found = lstsq(design_matrix(before, "paper"), (after - before)[:, :2].ravel()).x
        error = 100.0 * (found / setting.angles_rad - 1.0)
        rows.append(
            {**labels, **dict(zip(("X_percent", "Y_percent", "Z_percent"), error, strict=True))}
        )
    return pd.DataFrame(rows)


def _readings(setting: MonteCarlo) -> Iterator[tuple[dict[str, str], Floats, Floats]]:
    points, angles = setting.points_mm, setting.angles_rad
    a, b, g = angles
    small = np.array([[1.0, -g, b], [g, 1.0, -a], [-b, a, 1.0]])
    unit_points, length = _unit(points), np.linalg.norm(points[0])
    for rotation, turned in {"eq. (1)": points @ small.T, "exact": rotate(points, angles)}.items():
        for z, reset in {
            "kept": lambda q, _: q,
            "overwritten": _overwrite,
            "projected": _project_back,
        }.items():
            yield (
                {"rotation": rotation, "z": z, "vectors": "as they are"},
                points,
                reset(turned, points),
            )
            yield (
                {"rotation": rotation, "z": z, "vectors": "set z, then normalise"},
                unit_points,
                _unit(reset(turned, points)),
            )
            yield (
                {"rotation": rotation, "z": z, "vectors": "normalise, then set z"},
                unit_points,
                reset(_unit(turned), unit_points),
            )
            yield (
                {"rotation": rotation, "z": z, "vectors": "rotated ones rescaled"},
                points,
                length * _unit(reset(turned, points)),
            )


def _unit(p: Floats) -> Floats:
    return p / np.linalg.norm(p, axis=-1, keepdims=True)


def _overwrite(turned: Floats, reference: Floats) -> Floats:
    return np.concatenate([turned[:, :2], reference[:, 2:]], axis=1)


def _project_back(turned: Floats, reference: Floats) -> Floats:
    return turned * (reference[:, 2:] / turned[:, 2:])
