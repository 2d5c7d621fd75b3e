"""A measurement on disk: the table, two or three pictures, and what the reader must know."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.__about__ import __version__
from losbench.arrays import Bools, Floats
from losbench.outputs import Claim, into
from losbench.pointing.thermal import SensitivityFit, fit_sensitivity
from losbench.recording.measurement import Measurement
from losbench.recording.readers import Recording
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["WRITTEN", "write_report"]

_AXES = {"alpha": "X", "beta": "Y", "gamma": "Z"}
WRITTEN = (
    "measurement.csv",
    "shifts.png",
    "angles.png",
    "angles-over-temperature.png",
)
_FEWEST = 10  # frames with a temperature, for a sensitivity
_SMALLEST_RANGE_DEGC = 0.5
_SHORTEST_LAG = 0.2  # steps from frame to frame; a lag that may be shorter is none


def write_report(
    measurement: Measurement,
    folder: Path | Claim,
    *,
    recording: Recording,
    other: Measurement | None = None,
) -> list[str]:
    """Write ``measurement.csv``, ``shifts.png``, with a camera ``angles.png``, and ``report.json``.

    With temperatures, ``angles-over-temperature.png`` and the sensitivity of each axis come too.

    Parameters
    ----------
    measurement : Measurement
        With positions as an (F, n, 2) array and its table.
    folder : Path or Claim
        Made if it is not there; what an earlier run left in it is replaced in one swap.
    recording : Recording
        What was measured.
    other : Measurement, optional
        The same spots by another centroid, for `Measurement.belief`.

    Returns
    -------
    list of str
        The report's lines, for the terminal.
    """
    table = measurement.table
    lines = [
        f"{len(table)} frames, {len(measurement.reference_px)} spots: "
        f"{recording.source.resolve().name}",
        *measurement.notes,
    ]
    belief = measurement.belief(other)
    lines += belief.sentences()
    sensitivity = _sensitivity(measurement)
    if sensitivity is not None:
        lines += _sentences(sensitivity, table)
    pictures = _pictures(measurement, sensitivity)
    report = {
        "losbench": __version__,
        "source": recording.source.resolve().name,
        "reference_px": measurement.reference_px.round(4).tolist(),
        "notes": list(measurement.notes),
        "belief": belief.to_dict(),
        "sensitivity_to": None if sensitivity is None else _temperature_columns(table)[0],
        "sensitivity": None if sensitivity is None else _numbers(sensitivity, table),
    }
    text = table.to_csv(index=False, lineterminator="\n", float_format="%.9g")
    files: dict[str, str | bytes] = {"measurement.csv": text, **pictures}
    with into(folder, WRITTEN) as results:
        for name, content in files.items():
            results.write(name, content)
        results.publish(report)
    names = ", ".join(["measurement.csv", "report.json", *pictures])
    return [*lines, f"Written to {results.folder}: {names}"]


def _temperature_columns(table: pd.DataFrame) -> list[str]:
    return [
        name for name in table.columns if name.startswith("temperature") and name.endswith("_degC")
    ]


def _timed(table: pd.DataFrame) -> Bools:
    """Which frames have a time and the temperature that the sensitivity is for."""
    return np.isfinite(table[[_temperature_columns(table)[0], "time_s"]].to_numpy()).all(axis=1)


def _sensitivity(measurement: Measurement) -> SensitivityFit | None:
    """Fit the first temperature column, if it says anything; with a lag where the frames have
    times.
    """
    columns = _temperature_columns(measurement.table)
    if measurement.attitude is None or not columns:
        return None
    celsius = measurement.table[columns[0]].to_numpy()
    time_s = measurement.table["time_s"].to_numpy()
    use = _timed(measurement.table)
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


def _at_rest(fit: SensitivityFit) -> tuple[Floats, Bools]:
    """Sensitivity (3,) that the interval is about, arcsec/degC, and where one lag misses that.

    One lag is a wrong law for most structures: where its sensitivity leaves the interval over all
    lags, the middle of that is printed.
    """
    low, high = np.moveaxis(fit.k_interval_arcsec_per_degC, -1, 0)
    k = fit.k_arcsec_per_degC
    missed = ~((low <= k) & (k <= high))
    return np.where(missed, (low + high) / 2, k), missed


def _numbers(fit: SensitivityFit, table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """By axis, what `_sentences` says; a lag of zero is none."""
    rms_arcsec, lag_s = rad_to_arcsec(fit.rms), _lag_s(fit, table)
    at_rest, _ = _at_rest(fit)
    return {
        axis: {
            "arcsec_per_degC": round(float(at_rest[i]), 6),
            "interval_95_arcsec_per_degC": fit.k_interval_arcsec_per_degC[i].round(6).tolist(),
            "one_lag_arcsec_per_degC": round(float(fit.k_arcsec_per_degC[i]), 6),
            "lag_s": round(float(lag_s[i]), 3),
            "lag_state": str(fit.lag_state[i]),
            "rms_arcsec": round(float(rms_arcsec[i]), 6),
        }
        for i, axis in enumerate(_AXES)
    }


def _sentences(fit: SensitivityFit, table: pd.DataFrame) -> list[str]:
    low, high = np.moveaxis(fit.k_interval_arcsec_per_degC, -1, 0)
    rms = rad_to_arcsec(fit.rms)
    at_rest, missed = _at_rest(fit)
    column = _temperature_columns(table)[0]
    lines = []
    for i, (axis, minutes) in enumerate(zip(_AXES.values(), _lag_s(fit, table) / 60, strict=True)):
        lag = f"lag {minutes:.1f} min" if minutes > 0 else "no lag"
        if missed[i]:
            lag += f", the middle over all lags: one alone gives {fit.k_arcsec_per_degC[i]:+.4f}"
        if fit.lag_state[i] == "not identifiable":
            lag += ", not identifiable: one as long as the record fits as well"
        lines.append(
            f"Sensitivity about {axis} to {column}: {at_rest[i]:+.4f} arcsec/degC (95 %: "
            f"{low[i]:+.4f} to {high[i]:+.4f}), {lag}, {rms[i]:.4f} arcsec rms left after "
            "compensation"
        )
    return lines


def _pictures(measurement: Measurement, sensitivity: SensitivityFit | None) -> dict[str, bytes]:
    from losbench.figures import png, styled

    with styled():
        pictures = {"shifts.png": png(_shifts(measurement))}
        if measurement.attitude is not None:
            pictures["angles.png"] = png(_angles(measurement))
        if sensitivity is not None:
            pictures["angles-over-temperature.png"] = png(
                _over_temperature(measurement, sensitivity)
            )
    return pictures


def _shifts(measurement: Measurement) -> Figure:
    along, label = _abscissa(measurement)
    fig, axes = _one_below_another(2, label)
    for axis, i, name in zip(axes, range(2), "xy", strict=True):
        for spot in range(measurement.shifts_px.shape[1]):
            axis.plot(
                along,
                measurement.shifts_px[:, spot, i],
                ".-",
                ms=3,
                lw=0.8,
                label=f"spot {spot + 1}",
            )
        axis.set_ylabel(f"shift along {name} (px)")
    axes[0].legend(ncols=4)
    return fig


def _angles(measurement: Measurement) -> Figure:
    along, label = _abscissa(measurement)
    fig, axes = _one_below_another(3, label)
    for axis, name in zip(axes, _AXES, strict=True):
        angle = measurement.table[f"{name}_arcsec"].to_numpy()
        sigma = measurement.table[f"sigma_{name}_arcsec"].to_numpy()
        axis.fill_between(along, angle - sigma, angle + sigma, alpha=0.25, lw=0, label="one sigma")
        axis.plot(along, angle, lw=1.0)
        axis.set_ylabel(f"about {_AXES[name]} (arcsec)")
    axes[0].legend()
    return fig


def _over_temperature(measurement: Measurement, fit: SensitivityFit) -> Figure:
    column = _temperature_columns(measurement.table)[0]
    table = measurement.table[_timed(measurement.table)]
    celsius = table[column].to_numpy()
    model = fit.predict(
        celsius, time_s=table["time_s"].to_numpy() if (fit.lag_s > 0).any() else None
    )
    fig, axes = _one_below_another(3, f"{column.removesuffix('_degC')} (degC)")
    for i, (axis, name) in enumerate(zip(axes, _AXES, strict=True)):
        axis.plot(celsius, table[f"{name}_arcsec"], ".", ms=3, label="measured")
        axis.plot(celsius, rad_to_arcsec(model[:, i]), lw=1.2, label="fit with lag")
        axis.set_ylabel(f"about {_AXES[name]} (arcsec)")
    axes[0].legend()
    return fig


def _abscissa(measurement: Measurement) -> tuple[NDArray[Any], str]:
    table = measurement.table
    return (
        (table["time_s"].to_numpy(), "time (s)")
        if "time_s" in table
        else (table["frame"].to_numpy(), "frame")
    )


def _one_below_another(n: int, label: str) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    fig = Figure(figsize=(8.0, 2.0 * n + 0.6))
    axes = list(fig.subplots(n, 1, sharex=True))
    axes[-1].set_xlabel(label, parse_math=False)  # a sensor may be called T_$1$
    return fig, axes
