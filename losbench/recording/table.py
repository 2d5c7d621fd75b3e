"""The table of a measurement: one row a frame, units in the names of its columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from losbench.arrays import Floats, Ints
from losbench.logs import TemperatureLog
from losbench.pointing.attitude import AttitudeFit
from losbench.recording.readers import Recording
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["measurement_table", "temperatures"]

_AXES = ("alpha", "beta", "gamma")


def temperatures(
    recording: Recording, log: TemperatureLog | None
) -> tuple[dict[str, Floats], list[str]]:
    """Return the log's columns at the frames' times, and what is to be said about them."""
    if recording.times is None:
        unmatched = "" if log is None else ", temperatures are not matched"
        return {}, [f"No frame times were given: rows are numbered{unmatched}."]
    if log is None:
        return {}, list(recording.times.notes)
    notes = [*recording.times.notes, *log.notes]
    celsius = log.at(recording.times)
    without = int(np.isnan(celsius[:, 0]).sum())
    said = [
        f"{without} of {recording.n_frames} frames lie outside the temperature log or in a gap of "
        "it."
        + " Are both in one time zone?"
        * (recording.times.assumed_utc or log.times.assumed_utc)
    ]
    return dict(zip(log.names, celsius.T, strict=True)), [*notes, *said[: without > 0]]


def measurement_table(
    recording: Recording,
    celsius: dict[str, Floats],
    xy: Floats,
    sigma: Floats,
    flags: Ints,
    shifts: Floats,
    attitude: AttitudeFit | None,
) -> pd.DataFrame:
    """Lay out times, temperatures, positions (F, n, 2) with errors and flags, shifts, and angles if
    there are any.
    """
    import pandas as pd

    columns: dict[str, Any] = {"frame": np.arange(recording.n_frames)}
    source = [recording.label(k) for k in range(recording.n_frames)]
    if recording.times is not None:
        columns["time_s"] = recording.times.seconds
        if recording.times.start is not None:
            columns["time"] = [_iso(moment) for moment in recording.times.utc]
    columns |= celsius
    for n in range(xy.shape[1]):
        for i, axis in enumerate("xy"):
            columns[f"{axis}{n + 1}_px"] = xy[:, n, i]
        for i, axis in enumerate("xy"):
            columns[f"sigma_{axis}{n + 1}_px"] = sigma[:, n, i]
        for i, axis in enumerate("xy"):
            columns[f"d{axis}{n + 1}_px"] = shifts[:, n, i]
        columns[f"flags{n + 1}"] = flags[:, n]
    if attitude is not None:
        spread = rad_to_arcsec(np.sqrt(np.diagonal(attitude.cov, axis1=-2, axis2=-1)))
        for i, axis in enumerate(_AXES):
            columns[f"{axis}_arcsec"] = rad_to_arcsec(attitude.angles[:, i])
            columns[f"sigma_{axis}_arcsec"] = spread[:, i]
        columns["p_value"] = attitude.p_value
    columns["source"] = source
    return pd.DataFrame(columns)


def _iso(moment: np.datetime64) -> str:
    if np.isnat(moment):
        return ""
    return str((moment + np.timedelta64(500, "us")).astype("datetime64[ms]")) + "Z"
