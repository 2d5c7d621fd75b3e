"""Which drift does one degree cause? Line-of-sight angles fitted as a function of temperature."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from losbench.arrays import Bools, Floats
from losbench.checks import boolean, choice, finite_or_nan, number, positive, shaped
from losbench.estimation.losses import Huber, Loss
from losbench.estimation.robust import RobustFit, irls, lstsq
from losbench.estimation.robust.scales import Scale
from losbench.pointing.thermal.network import ThermalNetwork, increasing_times
from losbench.units import rad_to_arcsec

__all__ = ["SensitivityFit", "fit_sensitivity"]


_LAGS_TRIED = 40
_NUDGE = 1.001  # factor on the lag for its derivative


@dataclass(frozen=True)
class SensitivityFit:
    """Angle = offset + k (T - reference) + quadratic (T - reference)^2, with T lagged by ``lag_s``
    where asked for.

    Every array leads with the axes of the angles that were fitted: none for a series (n,), (k,) for
    (n, k).

    Attributes
    ----------
    k, k_interval : (...,), (..., 2) arrays
        Sensitivity at the reference temperature and its confidence interval, radians per degree.
    offset, quadratic : (...,) arrays
        Angle at the reference temperature, radians, and curvature, radians per degree squared (zero
        unless fitted).
    lag_s, lag_interval_s : (...,), (..., 2) arrays
        First-order time constant and its confidence interval (NaN unless fitted), seconds; zero
        without a lag. The interval goes from 0 to infinity where no lag shows.
    reference_degC : float
        Mean of the temperatures given.
    rms : (...,) array
        Root mean square of what compensation leaves over, radians, outliers included.
    residuals, weights : (n, ...) arrays
        Model minus angle, radians, and weight of each sample; NaN and 0 where a sample was left
        out.
    correlation : (...,) array
        Of neighbouring residuals, by which the intervals were widened; 0 for independent errors.
    converged : (...,) bool array
    """

    k: Floats
    k_interval: Floats
    offset: Floats
    quadratic: Floats
    lag_s: Floats
    lag_interval_s: Floats
    reference_degC: float
    rms: Floats
    residuals: Floats
    weights: Floats
    correlation: Floats
    converged: Bools

    @property
    def k_arcsec_per_degC(self) -> Floats:
        """Sensitivity in arcseconds per degree."""
        return rad_to_arcsec(self.k)

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
        change = _lagged(temperature, time, self.lag_s) - self.reference_degC
        return self.offset + self.k * change + self.quadratic * change**2


def fit_sensitivity(
    temperature_degC: ArrayLike,
    angles: ArrayLike,
    *,
    time_s: ArrayLike | None = None,
    lag_s: float | Literal["fit"] | None = None,
    quadratic: bool = False,
    method: Literal["irls", "ls"] = "irls",
    loss: Loss | None = None,
    scale: Scale = "mad",
    confidence: float = 0.95,
) -> SensitivityFit:
    """Fit line-of-sight angles as a function of temperature, one fit per axis.

    Parameters
    ----------
    temperature_degC : (n,) array
        Temperature at each sample.
    angles : (n,) or (n, k) array, radians
        Angles at each sample. A sample without temperature or angle (NaN) is left out.
    time_s : (n,) array, optional
        Increasing times; needed with a lag.
    lag_s : float or "fit", optional
        Time constant of a first-order lag between this temperature and the structure, known or to
        be fitted. The structure starts in equilibrium with the first temperature, which runs
        straight between its samples.
    quadratic : bool
        Fit a curvature as well.
    method : "irls" or "ls"
        Robust, or least squares.
    loss : loss object, optional
        For "irls"; Huber(1.345) unless given.
    scale : str or float
        For "irls": as `irls` takes it.
    confidence : float
        Of the intervals, which follow Student's t distribution, widened by sqrt((1 + r) / (1 - r))
        where neighbouring residuals have the correlation r (Bayley and Hammersley 1946). They hold
        if the law does: what one lag cannot describe moves k itself.

    Returns
    -------
    SensitivityFit

    Raises
    ------
    ValueError
        If shapes do not match, the temperature does not vary, samples are too few or a lag comes
        without times.

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
    lag = (
        0.0
        if lag_s is None
        else lag_s
        if lag_s == "fit"
        else float(positive("lag_s", number("lag_s", lag_s)))
    )
    choice("method", method, ("irls", "ls"))
    law = _Law(
        temperature,
        _times(time_s, temperature, needed=lag != 0.0),
        columns=3 if boolean("quadratic", quadratic) else 2,
        loss=None if method == "ls" else loss or Huber(),
        scale=scale,
    )
    level = number("confidence", confidence, low=0.0, high=1.0)
    fits = [law.fit(column, lag, level) for column in series.reshape(temperature.size, -1).T]
    failed = sum(not fit.converged for fit in fits)
    if failed:
        warnings.warn(
            f"{failed} of {len(fits)} axes did not converge, see .converged",
            RuntimeWarning,
            stacklevel=2,
        )
    return _join(fits) if series.ndim > 1 else fits[0]


@dataclass(frozen=True)
class _Law:
    """A temperature history, and how angles are to follow it."""

    temperature: Floats
    time: Floats | None
    columns: int
    loss: Loss | None
    scale: Scale

    @property
    def reference(self) -> float:
        return float(np.nanmean(self.temperature))

    def fit(self, angle: Floats, lag: float | str, level: float) -> SensitivityFit:
        """Fit one axis."""
        used = np.isfinite(angle) & np.isfinite(self.temperature)
        _check_enough(self.temperature[used], self.columns, self.columns + (lag == "fit"))
        lag_s = self._best_lag(angle, used) if lag == "fit" else float(lag)
        design = self._design(lag_s)[used]
        solved = self._solve(design, angle[used])
        covariance, lag_interval = solved.cov, np.full(2, np.nan)
        correlation = _correlation(solved.weights * solved.residuals)
        quantile = stdtrit(solved.dof - (lag == "fit"), 0.5 + 0.5 * level) * np.sqrt(
            (1.0 + correlation) / (1.0 - correlation)
        )
        if lag == "fit":
            # To first order the logarithm of the lag is one more unknown, and takes its share of
            # the information.
            slope = (self._design(lag_s * _NUDGE) - self._design(lag_s / _NUDGE))[used] / (
                2 * np.log(_NUDGE)
            )
            covariance = self._solve(np.column_stack([design, slope @ solved.x]), angle[used]).cov
            with np.errstate(over="ignore"):  # where no lag shows, any is possible
                lag_interval = lag_s * np.exp(
                    quantile * np.sqrt(covariance[-1, -1]) * np.array([-1, 1])
                )
        residuals, weights = np.full(angle.size, np.nan), np.zeros(angle.size)
        residuals[used], weights[used] = solved.residuals, solved.weights
        return SensitivityFit(
            k=solved.x[1],
            k_interval=solved.x[1] + quantile * np.sqrt(covariance[1, 1]) * np.array([-1, 1]),
            offset=solved.x[0],
            quadratic=np.asarray(solved.x[2] if self.columns > 2 else 0.0),
            lag_s=np.asarray(lag_s),
            lag_interval_s=lag_interval,
            reference_degC=self.reference,
            rms=np.sqrt(np.mean(solved.residuals**2)),
            residuals=residuals,
            weights=weights,
            correlation=np.asarray(correlation),
            converged=np.asarray(solved.converged),
        )

    def _best_lag(self, angle: Floats, used: Bools) -> float:
        """Lag with the smallest loss between a tenth of a sample and the whole record."""
        from scipy.optimize import minimize_scalar  # slow to import

        assert self.time is not None
        span_s = self.time[-1] - self.time[0]
        tried = np.geomspace(0.1 * span_s / (self.time.size - 1), span_s, _LAGS_TRIED)
        design = np.moveaxis(self._design(tried)[used], 0, 1)
        solved = self._solve(design, np.broadcast_to(angle[used], design.shape[:2]))
        unit = np.min(solved.scale)

        def cost(residuals: Floats) -> Floats:
            u = residuals / unit
            return np.sum(u**2 if self.loss is None else _rho(self.loss, u), axis=-1)

        best = int(np.argmin(cost(solved.residuals)))
        around = np.log(tried[[max(best - 1, 0), min(best + 1, _LAGS_TRIED - 1)]])
        found = minimize_scalar(
            lambda log_lag: float(
                cost(self._solve(self._design(np.exp(log_lag))[used], angle[used]).residuals)
            ),
            bounds=tuple(around),
            method="bounded",
            options={"xatol": 1e-7},
        )
        return float(np.exp(found.x))

    def _design(self, lag_s: ArrayLike) -> Floats:
        """Columns 1, change, change squared for one lag (n, p) or several (n, lags, p)."""
        change = _lagged(self.temperature, self.time, np.asarray(lag_s)) - self.reference
        return change[..., None] ** np.arange(self.columns)

    def _solve(self, design: Floats, angle: Floats) -> RobustFit:
        if self.loss is None:
            return lstsq(design, angle)
        return irls(design, angle, loss=self.loss, scale=self.scale, on_fail="ignore")


def _correlation(residuals: Floats) -> float:
    """Correlation of neighbours, between 0 and what n samples can tell from 1."""
    total = float(residuals @ residuals)
    found = float(residuals[1:] @ residuals[:-1]) / total if total > 0 else 0.0
    return float(np.clip(found, 0.0, 1.0 - 2.0 / residuals.size))


def _lagged(temperature: Floats, time: Floats | None, lag_s: Floats) -> Floats:
    """Temperature (n,) behind first-order lags (...): (n, ...); NaN stays NaN, the history runs
    straight over it.
    """
    known = np.isfinite(temperature)
    result = np.broadcast_to(
        temperature.reshape(-1, *[1] * lag_s.ndim), (temperature.size, *lag_s.shape)
    ).copy()
    if time is not None and (lag_s > 0).all():
        lags = {str(i): lag for i, lag in enumerate(lag_s.ravel())}
        network = ThermalNetwork(lags, {}, dict.fromkeys(lags, 1.0))
        result[known] = network.simulate(time[known], temperature[known]).reshape(-1, *lag_s.shape)
    return result


def _rho(loss: Loss, u: Floats) -> Floats:
    rho = getattr(loss, "rho", None)
    if rho is None:
        raise ValueError(f"loss must have a method rho(u) for a lag to be fitted, got {loss!r}")
    return np.asarray(rho(u), dtype=np.float64)


def _times(time_s: ArrayLike | None, temperature: Floats, *, needed: bool) -> Floats | None:
    if not needed:
        return None
    if time_s is None:
        raise ValueError("time_s must be given with a lag")
    time = increasing_times(time_s)
    shaped("time_s", time, temperature.shape, why="to match temperature_degC")
    return time


def _check_enough(temperature: Floats, levels: int, unknowns: int) -> None:
    if temperature.size <= unknowns:
        raise ValueError(
            f"angles must hold more than {unknowns} samples with a temperature, to fit as many "
            "unknowns, "
            f"got {temperature.size}"
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


def _join(fits: list[SensitivityFit]) -> SensitivityFit:
    """Fits of single axes as one, the axes leading but for series."""
    joined = {
        field.name: np.stack(
            [getattr(fit, field.name) for fit in fits],
            axis=-1 if field.name in {"residuals", "weights"} else 0,
        )
        for field in fields(SensitivityFit)
        if field.name != "reference_degC"
    }
    return SensitivityFit(reference_degC=fits[0].reference_degC, **joined)
