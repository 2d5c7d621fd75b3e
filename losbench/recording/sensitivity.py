"""The sensitivity of a measurement's angles to its first temperature, and how well it is told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from losbench.arrays import Bools, Floats
from losbench.pointing.thermal import Identification, identify
from losbench.pointing.thermal.terms import Lagged, Linear, Offset
from losbench.recording.measurement import Measurement
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["AXES", "Sensitivity", "finite", "sensitivity_of", "temperature_columns"]

AXES = {"alpha": "X", "beta": "Y", "gamma": "Z"}
_FEWEST = 10  # frames with a temperature, for a sensitivity
_SMALLEST_RANGE_DEGC = 0.5
_SHORTEST_LAG = 0.2  # steps from frame to frame; a lag that may be shorter is none


def temperature_columns(table: pd.DataFrame) -> list[str]:
    """Names of the columns of temperatures, the first one first."""
    return [
        name for name in table.columns if name.startswith("temperature") and name.endswith("_degC")
    ]


@dataclass(frozen=True)
class Sensitivity:
    """What the angles of F frames owe to one temperature.

    Attributes
    ----------
    column : str
        Of the measurement's table, to which it is.
    found : Identification
        Every lag of that temperature, about three axes.
    used : (F,) bool array
        Frames with a time and that temperature.
    predicted : (F, 3) array, radians
        Angles that go with the temperature; NaN at frames that were not used.
    shortest_lag_s : float
        A lag that may be shorter is none.
    """

    column: str
    found: Identification
    used: Bools
    predicted: Floats
    shortest_lag_s: float

    @property
    def one_lag_arcsec_per_degC(self) -> Floats:
        """What the best single lag says, (3,); its interval would be too narrow."""
        return rad_to_arcsec(self.found.fitted.coefficients[:, 1])

    @property
    def lag_s(self) -> Floats:
        """Lag of each axis (3,), zero where none was fitted or none can be told from the data."""
        if not self.found.tau_s.shape[1]:
            return np.zeros(3)
        told = self.found.tau_interval_s[:, 0, 0] > self.shortest_lag_s
        return np.where(told, self.found.fitted.tau_s[:, 0], 0.0)

    @property
    def lag_state(self) -> list[str]:
        """State of each axis's lag, "given" where none was fitted."""
        states = self.found.tau_state
        return states[:, 0].tolist() if states.shape[1] else ["given"] * 3

    @property
    def rms_arcsec(self) -> Floats:
        """What compensation leaves over, (3,)."""
        return rad_to_arcsec(np.sqrt(np.nanmean(self.found.residuals**2, axis=0)))

    def numbers(self) -> dict[str, dict[str, Any]]:
        """By axis, what `sentences` says, as report.json has it; a lag of zero is none."""
        found, lags = self.found, self.found.tau_s.shape[1]
        return {
            axis: {
                "arcsec_per_degC": finite(found.sensitivity[i, 0]),
                "interval_95_arcsec_per_degC": [finite(v) for v in found.interval[i, 0]],
                "one_lag_arcsec_per_degC": finite(self.one_lag_arcsec_per_degC[i]),
                "lag_s": finite(self.lag_s[i], 3),
                "lag_interval_95_s": [finite(v, 3) for v in found.tau_interval_s[i, :1].ravel()],
                "lag_state": self.lag_state[i],
                "one_lag_p_value": finite(found.lack_of_fit[i].f_p_value, 30) if lags else None,
                "white_p_value": finite(found.lack_of_fit[i].neumann_p_value, 30) if lags else None,
                "rejected_frames": int(found.rejected[:, i].sum()),
                "rms_arcsec": finite(self.rms_arcsec[i]),
            }
            for i, axis in enumerate(AXES)
        }

    def sentences(self) -> list[str]:
        """Say it, an axis a line, and then what must be known about it."""
        k, (low, high) = self.found.sensitivity[:, 0], self.found.interval[:, 0].T
        lines = []
        for i, (name, lag_s) in enumerate(zip(AXES.values(), self.lag_s, strict=True)):
            lag = f"lag {lag_s / 60:.1f} min" if lag_s > 0 else "no lag"
            one = self.one_lag_arcsec_per_degC[i]
            if not low[i] <= one <= high[i]:
                lag += f", over all lags: one alone gives {one:+.4f}"
            if self.lag_state[i] == "not identifiable":
                lag += ", not identifiable: one as long as the record fits as well"
            lines.append(
                f"Sensitivity about {name} to {self.column}: {k[i]:+.4f} arcsec/degC (95 %: "
                f"{low[i]:+.4f} to {high[i]:+.4f}), {lag}, {self.rms_arcsec[i]:.4f} arcsec rms "
                "left after compensation"
            )
        return lines

    def notes(self) -> list[str]:
        """What the identification noticed, by the names of the axes."""
        named = {f"Axis {i}: ": f"About {name}: " for i, name in enumerate(AXES.values(), 1)}
        notes = []
        for note in self.found.notes:
            start = next((start for start in named if note.startswith(start)), "")
            notes.append(named.get(start, "") + note.removeprefix(start))
        return notes

    def compensated(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return the table with the angles less what goes with the temperature."""
        columns = {
            f"{axis}_compensated_arcsec": table[f"{axis}_arcsec"]
            - rad_to_arcsec(self.predicted[:, i])
            for i, axis in enumerate(AXES)
        }
        return table.assign(**columns)


def sensitivity_of(measurement: Measurement) -> Sensitivity | None:
    """Fit the first temperature column, if it says anything; with every lag where the frames have
    times. The other columns tell whether one was left out.
    """
    table = measurement.table
    columns = temperature_columns(table)
    if measurement.attitude is None or not columns:
        return None
    column, time_s = columns[0], table["time_s"].to_numpy()
    used = np.isfinite(table[[column, "time_s"]].to_numpy()).all(axis=1)
    angles, celsius = measurement.attitude.angles[used], table[column].to_numpy()[used]
    present = int(np.isfinite(angles).all(axis=-1).sum())
    if present < _FEWEST or np.ptp(celsius) < _SMALLEST_RANGE_DEGC:
        return None
    timed = bool((np.diff(time_s[used]) > 0).all())
    clock = time_s[used] if timed else np.arange(float(celsius.size))
    sensors = {name: table[name].to_numpy()[used] for name in columns}
    term = Lagged(column, tau_s="spectrum") if timed else Linear(column)
    found = identify(Offset() + term, angles, sensors, clock)
    predicted = np.full((len(table), 3), np.nan)
    predicted[used] = found.predict({column: celsius}, clock)
    shortest_s = _SHORTEST_LAG * float(np.nanmedian(np.diff(time_s)))
    return Sensitivity(column, found, used, predicted, shortest_s)


def finite(value: float, digits: int = 6) -> float | None:
    """Return a number for a file, None where there is none: JSON knows no NaN."""
    return round(float(value), digits) if np.isfinite(value) else None
