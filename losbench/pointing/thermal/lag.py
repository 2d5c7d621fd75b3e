"""A temperature behind a first-order lag, exact for a record that runs straight between samples."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dtbtrs

from losbench.arrays import Floats

__all__ = ["lag_grid", "lagged"]


def lagged(temperature: Floats, time_s: Floats, tau_s: float) -> Floats:
    """Temperature (n,) behind a lag: x' = (T - x) / tau, in equilibrium with the first sample.

    e = x - T obeys e[i + 1] - d e[i] = -(dT/dt) tau (1 - d) with d = exp(-step / tau): a bidiagonal
    system, solved in one go.
    """
    if tau_s <= 0.0 or temperature.size < 2:
        return temperature
    step = np.diff(time_s)
    right = np.zeros(temperature.size)
    right[1:] = np.diff(temperature) / step * tau_s * np.expm1(-step / tau_s)
    bands = np.ones((2, temperature.size), order="F")
    bands[1, :-1] = -np.exp(-step / tau_s)
    behind: Floats = dtbtrs(bands, right, uplo="L", diag="U")[0]
    return temperature + behind


def lag_grid(time_s: Floats, count: int, *, shortest: float = 0.5) -> Floats:
    """Lags from ``shortest`` median steps to the record, log-spaced."""
    span = float(time_s[-1] - time_s[0])
    return np.geomspace(min(shortest * float(np.median(np.diff(time_s))), span), span, count)
