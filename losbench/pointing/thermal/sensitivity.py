"""Which drift does one degree cause? Line-of-sight angles fitted as a function of temperature."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats
from losbench.checks import boolean, finite_or_nan, increasing, number, positive, shaped
from losbench.estimation.losses import Loss
from losbench.estimation.robust.scales import Scale
from losbench.estimation.solvers import Solver, read_solver
from losbench.pointing.thermal.identify import Identification, identify, warn_unsettled
from losbench.pointing.thermal.lag import lagged
from losbench.pointing.thermal.terms import Lagged, Linear, Offset
from losbench.units import arcsec_to_rad, rad_to_arcsec

__all__ = ["SensitivityFit", "fit_sensitivity"]

_NAME = "temperature"


@dataclass(frozen=True)
class SensitivityFit:
    """Angle = offset + k (T - reference) + quadratic (T - reference)^2, with T lagged by ``lag_s``
    where asked for.

    Every array leads with the axes of the angles that were fitted: none for a series (n,), (k,) for
    (n, k).

    Attributes
    ----------
    k : (...,) array
        Sensitivity at the reference temperature by the solver, with its one lag, radians per
        degree.
    k_at_rest, k_interval : (...), (..., 2) arrays
        Sensitivity at rest and its confidence interval. With a fitted lag both are of the sum over
        all lags, for one lag is a wrong law for most structures: the interval is wider than the
        scatter of ``k``, and need not hold it.
    offset, quadratic : (...,) arrays
        Angle at the reference temperature, radians, and curvature, radians per degree squared (zero
        unless fitted).
    lag_s, lag_interval_s : (...,), (..., 2) arrays
        First-order time constant and its confidence interval (NaN unless fitted), seconds; zero
        without a lag. The interval goes from 0 to infinity where no lag shows.
    lag_state : (...,) array of str
        "identified", "weak", "no lag seen" or "not identifiable" (a lag as long as the record fits
        as well, and neither ``k`` nor ``lag_s`` is to be used); "given" unless fitted.
    one_lag_p_value : (...,) array
        Of an F test that one lag describes it; NaN unless fitted.
    reference_degC : float
        Mean of the temperatures given.
    rms : (...,) array
        Root mean square of what compensation leaves over, radians, outliers included.
    residuals, weights : (n, ...) arrays
        Model minus angle, radians, and weight of each sample; NaN and 0 where a sample was left
        out.
    converged : (...,) bool array
        Whether the solver settled on a lag that is identifiable.
    """

    k: Floats
    k_at_rest: Floats
    k_interval: Floats
    offset: Floats
    quadratic: Floats
    lag_s: Floats
    lag_interval_s: Floats
    lag_state: NDArray[np.str_]
    one_lag_p_value: Floats
    reference_degC: float
    rms: Floats
    residuals: Floats
    weights: Floats
    converged: Bools

    @property
    def k_arcsec_per_degC(self) -> Floats:
        """Sensitivity in arcseconds per degree."""
        return rad_to_arcsec(self.k)

    @property
    def k_at_rest_arcsec_per_degC(self) -> Floats:
        """Sensitivity at rest, which the interval is about, in arcseconds per degree."""
        return rad_to_arcsec(self.k_at_rest)

    @property
    def k_interval_arcsec_per_degC(self) -> Floats:
        """Confidence interval of the sensitivity in arcseconds per degree."""
        return rad_to_arcsec(self.k_interval)

    def predict(self, temperature_degC: ArrayLike, *, time_s: ArrayLike | None = None) -> Floats:
        """Angles, radians (n, ...), that go with a series of temperatures (n,); NaN where the
        temperature is NaN.

        A fit with a lag needs the times (n,) and starts in equilibrium with the first temperature.
        """
        temperature = finite_or_nan("temperature_degC", temperature_degC, ndim=1)
        time = _times(time_s, temperature, needed=bool((self.lag_s > 0).any()))
        known = np.isfinite(temperature)
        change = np.empty((temperature.size, self.lag_s.size))
        for i, lag_s in enumerate(self.lag_s.ravel()):
            change[:, i] = temperature - self.reference_degC
            if time is not None:
                change[known, i] = lagged(change[known, i], time[known], float(lag_s))
        change = change.reshape(temperature.size, *self.lag_s.shape)
        return self.offset + self.k * change + self.quadratic * change**2


def fit_sensitivity(
    temperature_degC: ArrayLike,
    angles: ArrayLike,
    *,
    time_s: ArrayLike | None = None,
    lag_s: float | Literal["fit"] | None = None,
    quadratic: bool = False,
    solver: Solver | str | None = None,
    errors: Literal["ou+white", "white"] = "ou+white",
    confidence: float = 0.95,
    method: Solver | str | None = None,
    loss: Loss | str | None = None,
    scale: Scale | None = None,
) -> SensitivityFit:
    """Fit line-of-sight angles as a function of one temperature, one fit per axis.

    The small case of `identify`, which takes several temperatures, trends, steps and seasons.

    Parameters
    ----------
    temperature_degC : (n,) array
        Temperature at each sample.
    angles : (n,) or (n, k) array, radians
        Angles at each sample. A sample without temperature or angle (NaN) is left out.
    time_s : (n,) array, optional
        Increasing times; needed with a lag, evenly spaced samples unless given.
    lag_s : float or "fit", optional
        Time constant of a first-order lag between this temperature and the structure, known or to
        be fitted. The structure starts in equilibrium with the first temperature, which runs
        straight between its samples.
    quadratic : bool
        Fit a curvature as well.
    solver : IRLS(...), LeastSquares(), LTS(...), MM(...), their name, or any with a ``fit``
        Makes the unknowns, as for `identify`; `IRLS` unless given.
    errors : "ou+white" or "white"
        Whether errors have a memory, as for `identify`.
    confidence : float
        Of the intervals, as for `identify`.
    method
        Second word for ``solver``.
    loss, scale
        Beside a solver's name, its options: ``method="irls", loss="cauchy"`` is
        ``solver=IRLS("cauchy")``.

    Returns
    -------
    SensitivityFit

    Raises
    ------
    ValueError
        If shapes do not match, the temperature does not vary, samples are too few, a lag comes
        without times, or options come beside a solver that is an object.

    Examples
    --------
    >>> temperature = np.linspace(18.0, 25.0, 50)
    >>> angle = 1e-6 * (temperature - 18.0)
    >>> angle[7] = 1.0
    >>> fit = fit_sensitivity(temperature, angle)
    >>> round(float(fit.k_arcsec_per_degC), 4)
    0.2063
    """
    temperature = finite_or_nan("temperature_degC", temperature_degC, ndim=1)
    series = finite_or_nan("angles", angles)
    shape: tuple[int | str, ...] = (
        (temperature.size,) if series.ndim < 2 else (temperature.size, "k")
    )
    shaped("angles", series, shape, why="to match temperature_degC")
    fitted = lag_s == "fit"
    lag = 0.0
    if lag_s is not None and not fitted:
        lag = float(positive("lag_s", number("lag_s", lag_s)))
    chosen = read_solver(solver, method, default="irls", loss=loss, scale=scale)
    degree = 2 if boolean("quadratic", quadratic) else 1
    time = _times(time_s, temperature, needed=lag_s is not None)
    for column in series.reshape(temperature.size, -1).T:
        used = np.isfinite(column) & np.isfinite(temperature)
        _check_enough(temperature[used], degree + 1, degree + 1 + fitted)
    term: Linear | Lagged = Linear(_NAME, degree=degree)
    if lag_s is not None:
        # Nobody says here that one lag is the law, so the interval is to hold for any lags.
        term = Lagged(_NAME, tau_s="spectrum" if fitted else lag, degree=degree)
    clock = np.arange(float(temperature.size)) if time is None else time
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # said below, of the user's own line
        found = identify(
            Offset() + term,
            series,
            {_NAME: temperature},
            clock,
            solver=chosen,
            errors=errors,
            confidence=confidence,
        )
    warn_unsettled(found.converged, stacklevel=3)
    return _of(found, lag)


def _of(found: Identification, lag_s: float) -> SensitivityFit:
    """Return the numbers of the only sensor."""
    shape = found.sensitivity.shape[:-1]
    x = found.fitted.coefficients.reshape(*shape, -1)
    fitted = found.tau_state.shape[-1] > 0
    states = found.tau_state[..., 0] if fitted else np.full(shape, "given")
    tests = [test.f_p_value for test in found.lack_of_fit]
    return SensitivityFit(
        k=x[..., 1],
        k_at_rest=arcsec_to_rad(found.sensitivity[..., 0]),
        k_interval=arcsec_to_rad(found.interval[..., 0, :]),
        offset=x[..., 0],
        quadratic=x[..., 2] if x.shape[-1] > 2 else np.zeros(shape),
        lag_s=found.fitted.tau_s.reshape(shape) if fitted else np.full(shape, lag_s),
        lag_interval_s=found.tau_interval_s[..., 0, :] if fitted else np.full((*shape, 2), np.nan),
        lag_state=states,
        one_lag_p_value=np.reshape(tests, shape),
        reference_degC=found.fitted.reference[_NAME],
        rms=np.sqrt(np.nanmean(found.residuals**2, axis=0)),
        residuals=-found.residuals,
        weights=found.weights,
        converged=found.converged,
    )


def _times(time_s: ArrayLike | None, temperature: Floats, *, needed: bool) -> Floats | None:
    if time_s is None:
        if needed:
            raise ValueError("time_s must be given with a lag")
        return None
    time = increasing("time_s", time_s)
    shaped("time_s", time, temperature.shape, why="to match temperature_degC")
    return time


def _check_enough(temperature: Floats, levels: int, unknowns: int) -> None:
    if temperature.size <= unknowns:
        raise ValueError(
            f"angles must hold more than {unknowns} samples with a temperature, to fit as many "
            f"unknowns, got {temperature.size}"
        )
    spread = np.ptp(temperature)
    if spread <= 1e-9 * np.abs(temperature).max():
        raise ValueError(
            f"temperature_degC must vary to give a sensitivity, got {temperature[0]:g} throughout"
        )
    if np.unique(temperature).size < levels:
        raise ValueError(
            f"temperature_degC must take at least {levels} values for a quadratic fit, got 2"
        )
