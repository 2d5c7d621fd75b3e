"""What reports say of a sensitivity to temperature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats
from losbench.page import section, sentences, table
from losbench.pointing.thermal import Identification, identify
from losbench.pointing.thermal.terms import Lagged, Linear, Offset
from losbench.pointing.told.numbers import between, finite, short, together
from losbench.units import arcsec_to_rad, rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["Sensitivity", "compensated_figure", "sensitivity_section", "sensitivity_to"]

_FEWEST = 10  # samples with a temperature, for a sensitivity
_SMALLEST_RANGE_DEGC = 0.5
_SHORTEST_LAG = 0.2  # median steps; a lag that may be shorter is none
_MANY = 3000  # points of a line, beyond which it is drawn as an image


@dataclass(frozen=True)
class Sensitivity:
    """What k series of n samples owe to one temperature.

    Attributes
    ----------
    column : str
        The temperature.
    names : dict of str
        Words for each series, by its key.
    found : Identification
        Every lag of that temperature.
    used : (n,) bool array
        Samples with a time and that temperature.
    predicted : (n, k) array, radians
        What goes with the temperature; NaN at samples that were not used.
    shortest_lag_s : float
        A lag that may be shorter is none.
    """

    column: str
    names: Mapping[str, str]
    found: Identification
    used: Bools
    predicted: Floats
    shortest_lag_s: float

    @property
    def one_lag_arcsec_per_degC(self) -> Floats:
        """What the best single lag says, (k,); its interval would be too narrow."""
        return rad_to_arcsec(self.found.fitted.coefficients[:, 1])

    @property
    def lag_s(self) -> Floats:
        """Lag of each series (k,), zero where none was fitted or none can be told from the data."""
        if not self.found.tau_s.shape[1]:
            return np.zeros(len(self.names))
        told = self.found.tau_interval_s[:, 0, 0] > self.shortest_lag_s
        return np.where(told, self.found.fitted.tau_s[:, 0], 0.0)

    @property
    def lag_state(self) -> list[str]:
        """State of each series' lag, "given" where none was fitted."""
        states = self.found.tau_state
        return states[:, 0].tolist() if states.shape[1] else ["given"] * len(self.names)

    @property
    def rms_arcsec(self) -> Floats:
        """What compensation leaves over, (k,)."""
        return rad_to_arcsec(np.sqrt(np.nanmean(self.found.residuals**2, axis=0)))

    def numbers(self) -> dict[str, dict[str, Any]]:
        """By series, what `sentences` says, as report.json has it; a lag of zero is none."""
        found, lags = self.found, self.found.tau_s.shape[1]
        return {
            key: {
                "arcsec_per_degC": finite(found.sensitivity[i, 0]),
                "interval_95_arcsec_per_degC": [finite(v) for v in found.interval[i, 0]],
                "one_lag_arcsec_per_degC": finite(self.one_lag_arcsec_per_degC[i]),
                "lag_s": finite(self.lag_s[i], 3),
                "lag_interval_95_s": [finite(v, 3) for v in found.tau_interval_s[i, :1].ravel()],
                "lag_state": self.lag_state[i],
                "one_lag_p_value": finite(found.lack_of_fit[i].f_p_value, 30) if lags else None,
                "white_p_value": finite(found.lack_of_fit[i].neumann_p_value, 30) if lags else None,
                "set_aside": int(found.rejected[:, i].sum()),
                "rms_arcsec": finite(self.rms_arcsec[i]),
            }
            for i, key in enumerate(self.names)
        }

    def sentences(self) -> list[str]:
        """Say it, a series a line."""
        k, (low, high) = self.found.sensitivity[:, 0], self.found.interval[:, 0].T
        lines = []
        for i, (name, lag_s) in enumerate(zip(self.names.values(), self.lag_s, strict=True)):
            lag = f"lag {lag_s / 60:.1f} min" if lag_s > 0 else "no lag"
            one = self.one_lag_arcsec_per_degC[i]
            if not low[i] <= one <= high[i]:
                lag += f", over all lags: one alone gives {one:+.4f}"
            if self.lag_state[i] == "not identifiable":
                lag += ", not identifiable: one as long as the record fits as well"
            lines.append(
                f"Sensitivity {name} to {self.column}: {k[i]:+.4f} arcsec/degC (95 %: "
                f"{low[i]:+.4f} to {high[i]:+.4f}), {lag}, {self.rms_arcsec[i]:.4f} arcsec rms "
                "left after compensation"
            )
        return lines

    def notes(self) -> list[str]:
        """What the identification noticed, by the names of the series."""
        named = {
            f"Axis {i}: ": f"{name[0].upper()}{name[1:]}: "
            for i, name in enumerate(self.names.values(), 1)
        }
        notes = []
        for note in self.found.notes:
            start = next((start for start in named if note.startswith(start)), "")
            notes.append(named.get(start, "") + note.removeprefix(start))
        return notes

    def compensated(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a table of ``KEY_arcsec`` with the same less what goes with the temperature."""
        columns = {
            f"{key}_compensated_arcsec": frame[f"{key}_arcsec"]
            - rad_to_arcsec(self.predicted[:, i])
            for i, key in enumerate(self.names)
        }
        return frame.assign(**columns)


def sensitivity_to(
    column: str, frame: pd.DataFrame, names: Mapping[str, str], *, others: tuple[str, ...] = ()
) -> Sensitivity | None:
    """Fit columns ``KEY_arcsec`` of a table to one of temperatures, if it says anything; with every
    lag where times (``time_s``) increase. Other temperatures tell whether one was left out.
    """
    time_s = frame["time_s"].to_numpy()
    angles = arcsec_to_rad(np.stack([frame[f"{key}_arcsec"].to_numpy() for key in names], axis=1))
    used = np.isfinite(frame[[column, "time_s"]].to_numpy()).all(axis=1)
    celsius, seen = frame[column].to_numpy()[used], np.isfinite(angles[used]).all(axis=1)
    if seen.sum() < _FEWEST or np.ptp(celsius[seen]) < _SMALLEST_RANGE_DEGC:
        return None
    timed = bool((np.diff(time_s[used]) > 0).all())
    clock = time_s[used] if timed else np.arange(float(celsius.size))
    sensors = {name: frame[name].to_numpy()[used] for name in dict.fromkeys((column, *others))}
    term = Lagged(column, tau_s="spectrum") if timed else Linear(column)
    found = identify(Offset() + term, angles[used], sensors, clock)
    predicted = np.full(angles.shape, np.nan)
    predicted[used] = found.predict({column: celsius}, clock)
    shortest_s = _SHORTEST_LAG * float(np.nanmedian(np.diff(time_s)))
    return Sensitivity(column, names, found, np.asarray(used), predicted, shortest_s)


def sensitivity_section(fit: Sensitivity, *drawn: str, title: str = "") -> str:
    """Of a page: a row a series, whether to trust it, and pictures."""
    heads = [
        "series",
        "sensitivity (arcsec/degC)",
        "95 % interval",
        "by one lag",
        "lag (s)",
        "lag is",
        "one lag fits, p",
        "left after compensation (arcsec rms)",
        "samples set aside",
    ]
    rows = [
        [
            together(fit.names[key]),
            short(each["arcsec_per_degC"]),
            between(*each["interval_95_arcsec_per_degC"]),
            short(each["one_lag_arcsec_per_degC"]),
            "" if each["lag_s"] is None else f"{each['lag_s']:.0f}",
            each["lag_state"],
            "" if each["one_lag_p_value"] is None else f"{each['one_lag_p_value']:.2g}",
            short(each["rms_arcsec"]),
            each["set_aside"],
        ]
        for key, each in fit.numbers().items()
    ]
    return section(
        f"Sensitivity to temperature{title}",
        table(heads, rows, caption=f"Sensitivity to {fit.column}, at rest"),
        sentences(fit.notes()),
        *drawn,
    )


def compensated_figure(
    fit: Sensitivity, frame: pd.DataFrame, along: NDArray[Any], label: str
) -> Figure:
    """Over time, each series beside what the temperature predicts, and what that leaves over."""
    from matplotlib.figure import Figure

    frame, many = fit.compensated(frame), len(frame) > _MANY
    fig = Figure(figsize=(8.0, 2.0 * len(fit.names) + 0.6))
    axes = fig.subplots(len(fit.names), 2, sharex=True, squeeze=False)
    far = np.zeros(fit.predicted.shape, dtype=bool)
    far[fit.used] = fit.found.rejected
    for i, (row, (key, name)) in enumerate(zip(axes, fit.names.items(), strict=True)):
        row[0].plot(along, frame[f"{key}_arcsec"], ".", ms=3, label="measured", rasterized=many)
        predicted = rad_to_arcsec(fit.predicted[:, i])
        row[0].plot(along, predicted, lw=1.2, label="by temperature", rasterized=many)
        row[0].set_ylabel(f"{name} (arcsec)")
        left = frame[f"{key}_compensated_arcsec"].to_numpy()
        row[1].plot(along, left, ".", ms=3, rasterized=many)
        row[1].plot(along[far[:, i]], left[far[:, i]], "x", color="#D55E00", label="set aside")
        row[1].set_ylabel("left over (arcsec)")
    axes[0, 0].legend()
    if far.any():
        axes[int(np.argmax(far.any(axis=0))), 1].legend()
    for axis in axes[-1]:
        axis.set_xlabel(label)
    return fig
