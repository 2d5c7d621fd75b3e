"""What the angle between two heads owes to temperature, and its pointing metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats
from losbench.pointing.performance import PointingMetrics, pointing_metrics
from losbench.pointing.told import Sensitivity, sensitivity_to
from losbench.series import runs
from losbench.units import arcsec_to_rad

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["metrics_of", "names_of", "sensitivity_of"]

_NAMES = {"before": "of the angle uncorrected", "after": "of the angle corrected"}
_FEWEST = 10  # windows in the longest stretch without a gap


def names_of(angle: pd.DataFrame) -> dict[str, str]:
    """Which angles there are, with words for them."""
    return {key: name for key, name in _NAMES.items() if f"{key}_arcsec" in angle}


def metrics_of(angle: pd.DataFrame, window: int) -> PointingMetrics | None:
    """Metrics of the angle over windows of so many samples, those that split LSFE from NEA; the
    PRE between tracks. None where samples are too few.
    """
    time_s = angle["time_s"].to_numpy()
    series = np.stack([angle[f"{key}_arcsec"].to_numpy() for key in names_of(angle)], axis=1)
    whole = np.asarray(np.isfinite(series).all(axis=1))
    pieces = runs(time_s, whole)
    if max((piece.stop - piece.start for piece in pieces), default=0) < _FEWEST * window:
        return None
    return pointing_metrics(
        arcsec_to_rad(series),
        time_s,
        window * float(np.median(np.diff(time_s))),
        observations=angle["track"].to_numpy(),
    )


def sensitivity_of(angle: pd.DataFrame, sensors: Mapping[str, Floats]) -> Sensitivity | None:
    """Sensitivity of the angle to the first sensor, if it says anything."""
    if not sensors:
        return None
    first, *others = sensors
    return sensitivity_to(first, angle.assign(**sensors), names_of(angle), others=tuple(others))
