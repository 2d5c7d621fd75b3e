"""From temperatures to line of sight: unknowns, intervals that hold, and what the record cannot
tell.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats
from losbench.checks import choice, number
from losbench.estimation.solvers import Solver, as_part, read_solver
from losbench.pointing.thermal.axis import AxisFit, fit_axis
from losbench.pointing.thermal.correlated import Noise
from losbench.pointing.thermal.design import Design, bind, read_series
from losbench.pointing.thermal.fitted import FittedModel
from losbench.pointing.thermal.notes import notes_of
from losbench.pointing.thermal.states import LackOfFit
from losbench.pointing.thermal.terms import Adds
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Identification", "identify"]


@dataclass(frozen=True, repr=False)
class Identification:
    """What a record says of a model; arrays lead with the axes of the angles (none for a series).

    Attributes
    ----------
    fitted : FittedModel
        The model with the solver's unknowns: predicts, compensates, can be saved.
    of : tuple of str
        What the m sensitivities are to: sensors, differences, lagged sensors.
    sensitivity, interval, dof : (..., m), (..., m, 2), (..., m) arrays
        Arcseconds per degree (per unit of the sensor), confidence interval, degrees of freedom.
        For a lagged sensor: at rest. NaN where the record cannot tell.
    law : (...) array of str
        "as given", or "all lags" where one lag is a wrong law, by the tests or as asked for, and
        the sensitivities to lagged sensors are sums over every lag.
    tau_s, tau_interval_s : (..., l), (..., l, 2) arrays
        Fitted lags; NaN and 0 to infinity where not identifiable.
    tau_state : (..., l) array of str
        "identified", "weak" (the interval reaches a third of the record), "no lag seen", "not
        identifiable".
    noise : tuple of Noise
        For each axis.
    weights : (n, ...) array
        The solver's, of each sample; 0 where a sample was not used.
    rejected : (n, ...) bool array
        Samples beyond four robust sigma, which the intervals leave out.
    residuals : (n, ...) array
        Angle less model, radians; NaN where a sample was not used.
    condition, vif : (...), (..., p) arrays
        Condition of the centred, scaled columns, and variance inflation of each.
    lack_of_fit : tuple of LackOfFit
        For each axis.
    converged : (...) bool array
    notes : tuple of str
        What the reader must know, a line each.
    """

    fitted: FittedModel
    of: tuple[str, ...]
    sensitivity: Floats
    interval: Floats
    dof: Floats
    law: NDArray[np.str_]
    tau_s: Floats
    tau_interval_s: Floats
    tau_state: NDArray[np.str_]
    noise: tuple[Noise, ...]
    weights: Floats
    rejected: Bools
    residuals: Floats
    condition: Floats
    vif: Floats
    lack_of_fit: tuple[LackOfFit, ...]
    converged: Bools
    notes: tuple[str, ...]

    def predict(self, sensors: Mapping[str, ArrayLike], time_s: ArrayLike) -> Floats:
        """Angles (n, ...) in radians; see `FittedModel.predict`."""
        return self.fitted.predict(sensors, time_s)

    def compensate(
        self, angles: ArrayLike, sensors: Mapping[str, ArrayLike], time_s: ArrayLike
    ) -> Floats:
        """Angles less the prediction, radians."""
        return self.fitted.compensate(angles, sensors, time_s)

    def save(self, path: str | Path) -> None:
        """Write the model as TOML, for `FittedModel.from_toml`."""
        self.fitted.save(path)

    def table(self) -> pd.DataFrame:
        """Sensitivities in arcseconds per degree, a row for each axis and sensor."""
        import pandas as pd

        k = len(self.noise)
        m = len(self.of)
        columns = {
            "axis": np.repeat(np.arange(1, k + 1), m),
            "to": self.of * k,
            "arcsec_per_degC": self.sensitivity.reshape(-1),
            "from": self.interval[..., 0].reshape(-1),
            "until": self.interval[..., 1].reshape(-1),
            "dof": self.dof.reshape(-1),
            "law": np.repeat(np.atleast_1d(self.law), m),
        }
        return pd.DataFrame(columns)

    def __repr__(self) -> str:
        """Sensitivities and notes."""
        head = self.table().to_string(index=False) if self.of else "no sensitivities"
        return "\n".join([head, *self.notes])


def identify(
    model: Adds,
    angles: ArrayLike,
    sensors: Mapping[str, ArrayLike],
    time_s: ArrayLike,
    *,
    solver: Solver | str = "irls",
    errors: Literal["ou+white", "white"] = "ou+white",
    confidence: float = 0.95,
) -> Identification:
    """Fit a model of `losbench.terms` to angles, axis by axis, with intervals that hold.

    Parameters
    ----------
    model : term or sum of terms
        E.g. ``Offset() + Lagged("T1") + Trend(1)``.
    angles : (n,) or (n, k) array, radians
        NaN marks a missing sample.
    sensors : dict of (n,) arrays, degC
        By name; others than the model names serve to look for omitted variables.
    time_s : (n,) array
        Increasing, with any gaps.
    solver : solver object, or "irls", "ls", "mm", "lts"
        Makes the unknowns that predict. Intervals come from generalised least squares without the
        samples that it leaves beyond four of its scales.
    errors : "ou+white" or "white"
        Errors with memory (an Ornstein-Uhlenbeck process and white noise, by restricted maximum
        likelihood; degrees of freedom by Satterthwaite's rule), or without.
    confidence : float
        Of the intervals.

    Returns
    -------
    Identification

    Raises
    ------
    ValueError
        If shapes do not fit, times do not increase, a sensor is missing or constant, or samples are
        too few.

    Notes
    -----
    Where the F test of more lags beside the fitted one rejects it, the sensitivity at rest is a sum
    over all lags with a common prior (`Lagged(tau_s="spectrum")` asks for that at once): wider, and
    right for a structure of several bodies.

    Examples
    --------
    >>> from losbench.pointing.thermal.lag import lagged
    >>> from losbench.pointing.thermal.terms import Lagged, Offset
    >>> t = np.arange(0.0, 9000.0, 30.0)
    >>> room = np.interp(t, [600.0, 5400.0], [18.0, 25.0])
    >>> noise = 1e-7 * np.random.default_rng(1).standard_normal(t.size)
    >>> angle = 5e-6 * lagged(room, t, 700.0) + noise
    >>> found = identify(Offset() + Lagged("room"), angle, {"room": room}, t)
    >>> found.tau_state.tolist(), found.sensitivity.round(2).tolist()
    (['identified'], [1.03])
    """
    design = bind(model, sensors, time_s)
    series = read_series(angles, design.time_s.size)
    choice("errors", errors, ("ou+white", "white"))
    level = number("confidence", confidence, low=0.0, high=1.0)
    chosen = as_part(read_solver(solver, None, default="irls"))
    axes = [fit_axis(design, column, chosen, errors, level, sensors) for column in series.T]
    found = _joined(design.model.labels, axes, design, np.ndim(angles) == 1)
    warn_unsettled(found.converged, stacklevel=3)
    return found


def warn_unsettled(converged: Bools, *, stacklevel: int) -> None:
    """Warn once of the axes (...) that did not converge."""
    failed = int(np.size(converged) - np.sum(converged))
    if failed:
        warnings.warn(
            f"{failed} of {np.size(converged)} axes did not converge, see .converged",
            RuntimeWarning,
            stacklevel=stacklevel,
        )


def _joined(
    labels: tuple[str, ...], axes: list[AxisFit], design: Design, series: bool
) -> Identification:
    def stack(name: str, *, last: bool = False) -> NDArray[Any]:
        parts = [getattr(axis, name) for axis in axes]
        return np.asarray(parts[0]) if series else np.stack(parts, axis=-1 if last else 0)

    fitted = FittedModel(
        design.model,
        np.stack([axis.coefficients for axis in axes]),
        np.stack([axis.point_tau_s for axis in axes]),
        design.reference,
        series=series,
    )
    return Identification(
        fitted=fitted,
        of=tuple(labels[i] for i in design.sensitive()),
        sensitivity=rad_to_arcsec(stack("sensitivity")),
        interval=rad_to_arcsec(stack("interval")),
        dof=stack("dof"),
        law=stack("law"),
        tau_s=stack("tau_s"),
        tau_interval_s=stack("tau_interval_s"),
        tau_state=stack("tau_state"),
        noise=tuple(axis.noise for axis in axes),
        weights=stack("weights", last=True),
        rejected=stack("rejected", last=True),
        residuals=stack("residuals", last=True),
        condition=stack("condition"),
        vif=stack("vif"),
        lack_of_fit=tuple(axis.lack_of_fit for axis in axes),
        converged=stack("converged"),
        notes=notes_of(axes, design, series),
    )
