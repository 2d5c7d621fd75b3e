"""Section 3's thermal experiment on the twin: 18 to 25 degC, spots, drift, and what one degree does
(Fig. 4 and 5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.estimation.smoothing import kalman_smooth
from losbench.papers.liu2026.results.centroiding import measure_windows
from losbench.papers.liu2026.scenario import ThermalBench
from losbench.papers.liu2026.twin import WarmUp, Windows, expose_windows, warm_up
from losbench.pointing.attitude import solve_attitude
from losbench.pointing.thermal import fit_sensitivity
from losbench.units import arcsec_to_rad, rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Drift", "figure_5", "sensitivities", "sensitivity_contest"]


@dataclass(frozen=True)
class Drift:
    """What the twin's camera makes of a warm-up.

    Attributes
    ----------
    truth : WarmUp
    windows : Windows
        The frames, cut to the spots (Fig. 4).
    xy_px, smoothed_px : (F, 2, 2) arrays
        EIWA centroids, and the same after the Kalman smoother (Fig. 5).
    angles_rad : (F, 3) array
        From the smoothed displacements since the first frame, by the exact rows.
    """

    truth: WarmUp
    windows: Windows
    xy_px: Floats
    smoothed_px: Floats
    angles_rad: Floats


def figure_5(setting: ThermalBench) -> Drift:
    """Run section 3's chain on the warm-up: frames, EIWA, Kalman, displacement from the first
    frame, angles.
    """
    truth = warm_up(setting)
    windows = expose_windows(setting, truth.truth_px, np.random.default_rng(setting.seed))
    xy, _ = measure_windows(windows, setting, "eiwa")
    smoothed = kalman_smooth(xy.reshape(len(xy), -1)).smoothed.reshape(xy.shape)
    shifts_mm = (smoothed - smoothed[0]) * setting.camera.pixel_mm
    angles = solve_attitude(setting.points_mm, shifts_mm, method="ls").angles
    return Drift(truth, windows, xy, smoothed, angles)


def sensitivities(
    drift: Drift,
    setting: ThermalBench,
    *,
    bad_share: float = 0.0,
    bad_arcsec: float = 0.0,
    seed: int = 0,
) -> pd.DataFrame:
    """Arcseconds per degree about each axis by LS and IRLS, with a first-order lag, some angles
    spoiled on the way.

    Angles are about the line of sight. The truth beside them is the tilt of the whole camera one
    degree warmer. Spoiled frames are off by ``bad_arcsec`` to one side, as if a reflection had
    caught the centroid.
    """
    import pandas as pd

    bad = np.random.default_rng(seed).random(len(drift.angles_rad)) < bad_share
    angles = drift.angles_rad @ setting.field_turn.T + bad[:, None] * arcsec_to_rad(bad_arcsec)
    columns = {"truth": setting.steady_arcsec_per_degC}
    methods: tuple[Literal["ls", "irls"], ...] = ("ls", "irls")
    for method in methods:
        fit = fit_sensitivity(
            drift.truth.room_degC,
            angles,
            time_s=drift.truth.time_s,
            lag_s="fit",
            method=method,
        )
        columns |= {
            method: fit.k_arcsec_per_degC,
            f"{method}_lag_min": fit.lag_s / 60.0,
            f"{method}_rms": rad_to_arcsec(fit.rms),
        }
    return pd.DataFrame(columns, index=pd.Index(["alpha", "beta", "gamma"], name="angle"))


def sensitivity_contest(
    drift: Drift,
    setting: ThermalBench,
    *,
    bad_share: float = 0.0,
    bad_arcsec: float = 0.0,
    noise_arcsec: float = 0.0,
    seeds: int = 100,
) -> NDArray[np.bool_]:
    """Whether IRLS is nearer than LS to the true sensitivity on all three axes, (seeds,).

    Parameters
    ----------
    drift, setting, bad_share, bad_arcsec
        As for `sensitivities`; the lag is fitted once, on the clean angles.
    noise_arcsec : float
        Normal noise on every angle, so that seeds differ where nothing is bad.
    seeds : int
        How often the bad frames are drawn.
    """
    truth = np.array(setting.sensitivity_arcsec_per_degC).sum(axis=1)
    clean = fit_sensitivity(
        drift.truth.room_degC, drift.angles_rad, time_s=drift.truth.time_s, lag_s="fit", method="ls"
    )
    methods: tuple[Literal["ls", "irls"], ...] = ("ls", "irls")
    nearer = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        bad = rng.random(len(drift.angles_rad)) < bad_share
        noise = noise_arcsec * rng.standard_normal(drift.angles_rad.shape)
        angles = drift.angles_rad + arcsec_to_rad(bad[:, None] * bad_arcsec + noise)
        miss = [
            [
                abs(
                    fit_sensitivity(
                        drift.truth.room_degC,
                        angles[:, axis],
                        time_s=drift.truth.time_s,
                        lag_s=float(clean.lag_s[axis]),
                        method=method,
                    ).k_arcsec_per_degC
                    - truth[axis]
                )
                for axis in range(3)
            ]
            for method in methods
        ]
        nearer.append(bool((np.array(miss[1]) < miss[0]).all()))
    return np.array(nearer)
