"""The sensitivity of a measurement's angles to its first temperature, and how well it is told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from losbench.arrays import Bools, Floats
from losbench.pointing.thermal import SensitivityFit, fit_sensitivity
from losbench.recording.measurement import Measurement
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "AXES",
    "at_rest",
    "numbers",
    "sensitivity_of",
    "sentences",
    "temperature_columns",
    "timed",
]

AXES = {"alpha": "X", "beta": "Y", "gamma": "Z"}
_FEWEST = 10  # frames with a temperature, for a sensitivity
_SMALLEST_RANGE_DEGC = 0.5
_SHORTEST_LAG = 0.2  # steps from frame to frame; a lag that may be shorter is none


def temperature_columns(table: pd.DataFrame) -> list[str]:
    """Names of the columns of temperatures, the first one first."""
    return [
        name for name in table.columns if name.startswith("temperature") and name.endswith("_degC")
    ]


def timed(table: pd.DataFrame) -> Bools:
    """Which frames have a time and the temperature that the sensitivity is for."""
    return np.isfinite(table[[temperature_columns(table)[0], "time_s"]].to_numpy()).all(axis=1)


def sensitivity_of(measurement: Measurement) -> SensitivityFit | None:
    """Fit the first temperature column, if it says anything; with a lag where the frames have
    times.
    """
    columns = temperature_columns(measurement.table)
    if measurement.attitude is None or not columns:
        return None
    celsius = measurement.table[columns[0]].to_numpy()
    time_s = measurement.table["time_s"].to_numpy()
    use = timed(measurement.table)
    present = np.isfinite(measurement.attitude.angles[use]).all(axis=-1).sum()
    if present < _FEWEST or np.ptp(celsius[use]) < _SMALLEST_RANGE_DEGC:
        return None
    angles = measurement.attitude.angles[use]
    if (np.diff(time_s[use]) > 0).all():
        return fit_sensitivity(celsius[use], angles, time_s=time_s[use], lag_s="fit")
    return fit_sensitivity(celsius[use], angles)


def _lag_s(fit: SensitivityFit, table: pd.DataFrame) -> Floats:
    """Return the lag of each axis, zero where none was fitted or none can be told from the data."""
    shortest_s = _SHORTEST_LAG * np.nanmedian(np.diff(table["time_s"]))
    return np.where(fit.lag_interval_s[:, 0] > shortest_s, fit.lag_s, 0.0)


def at_rest(fit: SensitivityFit) -> tuple[Floats, Bools]:
    """Sensitivity (3,) that the interval is about, arcsec/degC, and where one lag misses that.

    One lag is a wrong law for most structures: where its sensitivity leaves the interval over all
    lags, the middle of that is printed.
    """
    low, high = np.moveaxis(fit.k_interval_arcsec_per_degC, -1, 0)
    k = fit.k_arcsec_per_degC
    missed = ~((low <= k) & (k <= high))
    return np.where(missed, (low + high) / 2, k), missed


def numbers(fit: SensitivityFit, table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """By axis, what `sentences` says; a lag of zero is none."""
    rms_arcsec, lag_s = rad_to_arcsec(fit.rms), _lag_s(fit, table)
    k, _ = at_rest(fit)
    return {
        axis: {
            "arcsec_per_degC": round(float(k[i]), 6),
            "interval_95_arcsec_per_degC": fit.k_interval_arcsec_per_degC[i].round(6).tolist(),
            "one_lag_arcsec_per_degC": round(float(fit.k_arcsec_per_degC[i]), 6),
            "lag_s": round(float(lag_s[i]), 3),
            "lag_state": str(fit.lag_state[i]),
            "rms_arcsec": round(float(rms_arcsec[i]), 6),
        }
        for i, axis in enumerate(AXES)
    }


def sentences(fit: SensitivityFit, table: pd.DataFrame) -> list[str]:
    """Say it, an axis a line."""
    low, high = np.moveaxis(fit.k_interval_arcsec_per_degC, -1, 0)
    rms = rad_to_arcsec(fit.rms)
    k, missed = at_rest(fit)
    column = temperature_columns(table)[0]
    lines = []
    for i, (axis, minutes) in enumerate(zip(AXES.values(), _lag_s(fit, table) / 60, strict=True)):
        lag = f"lag {minutes:.1f} min" if minutes > 0 else "no lag"
        if missed[i]:
            lag += f", the middle over all lags: one alone gives {fit.k_arcsec_per_degC[i]:+.4f}"
        if fit.lag_state[i] == "not identifiable":
            lag += ", not identifiable: one as long as the record fits as well"
        lines.append(
            f"Sensitivity about {axis} to {column}: {k[i]:+.4f} arcsec/degC (95 %: "
            f"{low[i]:+.4f} to {high[i]:+.4f}), {lag}, {rms[i]:.4f} arcsec rms left after "
            "compensation"
        )
    return lines
