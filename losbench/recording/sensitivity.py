"""The sensitivity of a measurement's angles to its first temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING

from losbench.pointing.told import Sensitivity, sensitivity_to
from losbench.recording.measurement import Measurement

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ABOUT", "AXES", "sensitivity_of", "temperature_columns"]

AXES = {"alpha": "X", "beta": "Y", "gamma": "Z"}
ABOUT = {key: f"about {name}" for key, name in AXES.items()}


def temperature_columns(table: pd.DataFrame) -> list[str]:
    """Names of the columns of temperatures, the first one first."""
    return [
        name for name in table.columns if name.startswith("temperature") and name.endswith("_degC")
    ]


def sensitivity_of(measurement: Measurement) -> Sensitivity | None:
    """Fit the angles to the first temperature column, if it says anything."""
    columns = temperature_columns(measurement.table)
    if measurement.attitude is None or not columns:
        return None
    return sensitivity_to(columns[0], measurement.table, ABOUT, others=tuple(columns))
