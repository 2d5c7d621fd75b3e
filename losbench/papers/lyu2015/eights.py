"""Whether the eight aided errors of Table 1 can be draws of the precision that the paper states."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from losbench.arrays import Floats
from losbench.optics.motion.path import AttitudePath
from losbench.papers.lyu2015.results import quiet
from losbench.papers.lyu2015.scenario import TABLE_1
from losbench.papers.lyu2015.twin import Exposures

__all__ = ["aided_eights", "as_printed"]


def aided_eights(
    shots: Exposures, path: AttitudePath, *, threshold: float = 0.0, flux_e: float | None = None
) -> Floats:
    """Aided errors of the first eight stars of each exposure that has as many, (sets, 8) in px.

    Parameters
    ----------
    shots : Exposures
    path : AttitudePath
        What the gyro tells of each exposure.
    threshold : float
        Pixels below this part of a star's light are left out, of data and model each by its own.
    flux_e : float, optional
        Light of every star, for shot and read noise; none without.
    """
    count = np.bincount(shots.image)
    full = np.flatnonzero(count >= 8)
    stars = ((np.cumsum(count) - count)[full, None] + np.arange(8)).ravel()
    parts = {
        name: getattr(shots, name)[stars]
        for name in ("image", "start", "magnitude", "windows", "origin")
    }
    some = replace(shots, **parts)
    choices: dict[str, Any] = {"threshold": threshold, "region": "own"}
    if flux_e is not None:
        setting = shots.setting
        choices |= {
            "frames": setting.detector.expose(
                some.windows * flux_e + setting.background_e, setting.seed
            ),
            "noise": setting.detector,
            "background": setting.background_dn,
        }
    return quiet(some, path, **choices).reshape(-1, 8)


def as_printed(eights: Floats) -> float:
    """Share of sets whose mean and whose largest error are at least Table 1's (inertial-30)."""
    told = TABLE_1["aided"]
    return float(np.mean((eights.mean(axis=1) >= told.mean()) & (eights.max(axis=1) >= told.max())))
