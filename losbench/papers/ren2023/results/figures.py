"""Figures 4-6 and Table 1 as numbers: the trend over two months and the split of the short-term
error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from losbench.arrays import Floats
from losbench.estimation.stability import ErrorSplit, split_error
from losbench.optics.camera import design_matrix
from losbench.papers.ren2023.scenario import Pair
from losbench.papers.ren2023.twin import attitude_error, simulate
from losbench.pointing.starcamera import correct_pair, smooth_drift
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Campaign", "Tracks", "campaign", "evaluate", "first_order", "table_1"]


@dataclass(frozen=True)
class Tracks:
    """Angles less the angle as built: ``before`` and ``after`` (tracks, n) in arcsec, at ``days``
    and ``time_s``.
    """

    days: Floats
    time_s: Floats
    before: Floats
    after: Floats

    @property
    def change_before(self) -> float:
        """Return by how much the mean uncorrected angle changed from the first day to the last."""
        return float(self.before[-1].mean() - self.before[0].mean())

    @property
    def change_after(self) -> float:
        """Return the same of the corrected angle."""
        return float(self.after[-1].mean() - self.after[0].mean())


def evaluate(
    setting: Pair, seed: int | None = None, *, smooth_s: float | None = None, pixels: bool = False
) -> Tracks:
    """Simulate the pair and run the chain.

    Parameters
    ----------
    setting : Pair
        The scenario.
    seed : int, optional
        Of the simulation.
    smooth_s : float, optional
        Low-pass the drift before it corrects.
    pixels : bool
        Start from images of the spots.

    Returns
    -------
    Tracks
    """
    telemetry = simulate(setting, seed, pixels=pixels).telemetry
    pair = correct_pair(telemetry, sigma_mm=setting.spot_noise_um * 1e-3, smooth_s=smooth_s)
    built = np.radians(setting.angle_deg)
    before, after = (
        rad_to_arcsec(angle - built).reshape(len(setting.days), -1)
        for angle in (pair.before_rad, pair.after_rad)
    )
    time = np.arange(before.shape[1]) / setting.rate_hz
    return Tracks(np.array(setting.days), time, before, after)


def first_order(setting: Pair, seed: int | None = None, *, smooth_s: float | None = None) -> Tracks:
    """Return what `evaluate` finds, to 1e-4 arcsec and several times sooner: drifts and errors
    without any attitude.

    Parameters
    ----------
    setting, seed, smooth_s
        As for `evaluate`; the same seed draws the same noise.

    Returns
    -------
    Tracks

    Notes
    -----
    Both cameras' x axes lie along n = z1 x z2, so that d alpha = delta2_x - delta1_x.
    """
    rng = np.random.default_rng(setting.seed if seed is None else seed)
    t, points = setting.time_s, setting.points_mm
    drift = setting.drift_rad(t)[..., 0]
    error = attitude_error(setting, rng)[..., 0]
    spots = setting.spot_noise_um * 1e-3 * rng.standard_normal((2, len(t), 2 * len(points)))
    seen = drift - spots @ np.linalg.pinv(design_matrix(points))[0]
    if smooth_s is not None:
        seen = smooth_drift(t, seen.T, window_s=smooth_s).T
    before, after = (
        rad_to_arcsec(x[1] - x[0]).reshape(len(setting.days), -1)
        for x in (drift + error, drift + error - seen)
    )
    return Tracks(
        np.array(setting.days), np.arange(before.shape[1]) / setting.rate_hz, before, after
    )


@dataclass(frozen=True)
class Campaign:
    """Many seeds of the paper's experiment, (seeds,) each: changes over two months, and splits of
    the last track.
    """

    change_before: Floats
    change_after: Floats
    before: ErrorSplit
    after: ErrorSplit

    def table(self) -> pd.DataFrame:
        """Return mean, scatter from seed to seed, and error of the mean, for every quantity of the
        pair.
        """
        import pandas as pd

        series = {
            "change, raw": self.change_before,
            "change, corrected": self.change_after,
            "total, raw": self.before.total,
            "total, corrected": self.after.total,
            "LSFE, raw": self.before.lsfe,
            "LSFE, corrected": self.after.lsfe,
            "NEA, raw": self.before.nea,
            "NEA, corrected": self.after.nea,
            "total, corrected / raw": self.after.total / self.before.total,
        }
        rows = {
            name: {
                "mean": v.mean(),
                "scatter": v.std(ddof=1),
                "error of mean": v.std(ddof=1) / np.sqrt(len(v)),
            }
            for name, v in series.items()
        }
        return pd.DataFrame(rows).T.rename_axis("arcsec, 3 sigma")


def campaign(
    setting: Pair,
    seeds: int = 60,
    *,
    smooth_s: float | None = None,
    pixels: bool = False,
    progress: bool = False,
) -> Campaign:
    """Run `evaluate` for seeds 0, 1, ... and split the error of the last track as the paper does.

    Parameters
    ----------
    setting : Pair
        The scenario.
    seeds : int
        How many.
    smooth_s, pixels
        As for `evaluate`.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Campaign
    """
    runs = [
        evaluate(setting, seed, smooth_s=smooth_s, pixels=pixels)
        for seed in tqdm(range(seeds), desc="seeds", delay=2, disable=not progress)
    ]
    last = [
        np.stack([getattr(run, which)[-1] for run in runs], axis=1) for which in ("before", "after")
    ]
    return Campaign(
        np.array([run.change_before for run in runs]),
        np.array([run.change_after for run in runs]),
        *(split_error(series, window=setting.window) for series in last),
    )


def table_1(
    before: ArrayLike, after: ArrayLike, *, window: int = 5, unbiased: bool = False
) -> pd.DataFrame:
    """Table 1: total error, LSFE and NEA of the pair and of one camera, before and after, arcsec, 3
    sigma.

    Parameters
    ----------
    before, after : (n,) arrays, arcsec
        Angle of one track.
    window : int
        Samples of the sliding mean.
    unbiased : bool
        The unbiased forms in place of the paper's.

    Returns
    -------
    DataFrame
        A row each; columns total, LSFE and NEA, and a one-sigma uncertainty beside each.
    """
    import pandas as pd

    rows = {}
    for name, series in (("before", before), ("after", after)):
        split = split_error(series, window=window, unbiased=unbiased)
        for what, one in (("pair", split), ("one camera", split.per_camera())):
            rows[f"{what}, {name}"] = {
                "total": float(one.total),
                "+- total": float(one.total_sigma),
                "LSFE": float(one.lsfe),
                "+- LSFE": float(one.lsfe_sigma),
                "NEA": float(one.nea),
                "+- NEA": float(one.nea_sigma),
            }
    order = ["pair, before", "pair, after", "one camera, before", "one camera, after"]
    return pd.DataFrame(rows).T.loc[order].rename_axis("arcsec, 3 sigma")
