"""Two star cameras with reference spots: from telemetry to the angle between them, before and after
correction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Floats
from losbench.checks import shaped
from losbench.pointing.starcamera.attitude import boresight_angle, correct_drift
from losbench.pointing.starcamera.convention import QuaternionConvention
from losbench.pointing.starcamera.drift import DriftFit, drift_from_spots
from losbench.pointing.starcamera.timing import interpolate_drift, smooth_drift

__all__ = ["CorrectedPair", "PairTelemetry", "correct_pair"]


@dataclass(frozen=True, kw_only=True)
class PairTelemetry:
    """What two star cameras report on one clock.

    Attributes
    ----------
    time_s : (n,) array
        Increasing.
    quaternions : (2, n, 4) array
        Attitudes of both heads; a row with NaN is missing.
    points_mm : (2, m, 3) array
        Reference points (x, y, f) of each head's m spots.
    shifts_mm : (2, n, m, 2) array
        Displacements of the spots; NaN where a spot is missing.
    convention : QuaternionConvention
        Order and direction of the quaternions.
    installation : (2, 3, 3) array
        Rotation from each monitor's axes to its head's.
    boresight : (3,)
        Line of sight in the heads' axes.
    """

    time_s: Floats
    quaternions: Floats
    points_mm: Floats
    shifts_mm: Floats
    convention: QuaternionConvention
    installation: Floats
    boresight: tuple[float, ...] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        n, m = len(self.time_s), self.points_mm.shape[1]
        shaped("quaternions", self.quaternions, (2, n, 4), why=f"to match {n} times")
        shaped("points_mm", self.points_mm, (2, m, 3))
        shaped("shifts_mm", self.shifts_mm, (2, n, m, 2), why=f"to match {n} times and {m} spots")
        shaped("installation", self.installation, (2, 3, 3))


@dataclass(frozen=True)
class CorrectedPair:
    """A pair's telemetry with the drift taken out.

    Attributes
    ----------
    drift : (2, n, 3) array, radians
        Each head's own turn at the attitude times, in monitor axes.
    fits : (DriftFit, DriftFit)
        The same as measured, with covariance and residuals.
    quaternions : (2, n, 4) array
        Corrected attitudes, in the telemetry's convention.
    before_rad, after_rad : (n,) arrays
        Angle between the boresights; NaN where something is missing.
    """

    drift: Floats
    fits: tuple[DriftFit, DriftFit]
    quaternions: Floats
    before_rad: Floats
    after_rad: Floats


def correct_pair(
    telemetry: PairTelemetry,
    *,
    sigma_mm: float | None = None,
    smooth_s: float | None = None,
    max_gap_s: float = 10.0,
) -> CorrectedPair:
    """Run the whole chain of ren2023, Fig. 2: spots, drift, correction, angle.

    Parameters
    ----------
    telemetry : PairTelemetry
        Both heads.
    sigma_mm : float, optional
        Standard deviation of the spot positions, for the drift's covariance.
    smooth_s : float, optional
        Low-pass the drift over this many seconds before it is used.
    max_gap_s : float
        Drifts missing for no longer than this are interpolated.

    Returns
    -------
    CorrectedPair
        With the angle between the boresights of every sample, an (F,) array, before and after.

    Raises
    ------
    ValueError
        If times do not increase, a quaternion is not of unit length, or too few spots were seen.
    """
    t = telemetry.time_s
    fits, drifts, corrected = [], [], []
    for k in range(2):
        fit = drift_from_spots(telemetry.points_mm[k], telemetry.shifts_mm[k], sigma=sigma_mm)
        drift = fit.delta if smooth_s is None else smooth_drift(t, fit.delta, window_s=smooth_s)
        if np.isnan(drift).any():
            drift = interpolate_drift(t, drift, t, max_gap_s=max_gap_s)
        fits.append(fit)
        drifts.append(drift)
        corrected.append(
            correct_drift(
                telemetry.quaternions[k],
                drift,
                convention=telemetry.convention,
                installation=telemetry.installation[k],
            )
        )
    return CorrectedPair(
        np.stack(drifts),
        (fits[0], fits[1]),
        np.stack(corrected),
        boresight_angle(
            *telemetry.quaternions, convention=telemetry.convention, boresight=telemetry.boresight
        ),
        boresight_angle(*corrected, convention=telemetry.convention, boresight=telemetry.boresight),
    )
