"""One axis identified: the robust fit, the noise it leaves, and what both say of every unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from losbench.arrays import Bools, Floats, Indices
from losbench.estimation.solvers import LeastSquares, Solver, as_part
from losbench.pointing.thermal.correlated import (
    CorrelatedFit,
    Noise,
    fit_noise,
    generalised,
    has_memory,
)
from losbench.pointing.thermal.design import Design
from losbench.pointing.thermal.lag import lag_grid, lagged
from losbench.pointing.thermal.ridge import ridge_sums
from losbench.pointing.thermal.search import PointFit, fit_point, profile
from losbench.pointing.thermal.states import LackOfFit, lack_of_fit, lag_set, lag_state
from losbench.pointing.thermal.terms import Fourier, Lagged, Trend

__all__ = ["AxisFit", "fit_axis"]

_REJECTED = 4.0  # robust sigmas
_RICH = 5  # lags beside the law, for the noise and the F test
_BANK = 24  # lags of the ridge, beside no lag
_PROFILE = 30
_SMOOTH = 0.15  # correlation of neighbouring steps of the errors
_FEWEST_THINNED = 40
_PERFECT = 1e-11  # of the largest angle: residuals so small hold no noise
_NO_POWER = 1e-15  # eigenvalue of a correlation matrix, of the largest
_YEAR_S = 31_557_600.0


@dataclass(frozen=True)
class AxisFit:
    """Everything `Identification` has, for one axis, in radians."""

    coefficients: Floats
    point_tau_s: Floats
    weights: Floats
    sensitivity: Floats
    interval: Floats
    dof: Floats
    law: str
    tau_s: Floats
    tau_interval_s: Floats
    tau_state: NDArray[np.str_]
    noise: Noise
    rejected: Bools
    residuals: Floats
    condition: float
    vif: Floats
    lack_of_fit: LackOfFit
    converged: bool
    omitted: tuple[str, ...]
    thinned: int
    alike: Bools


@dataclass(frozen=True)
class _Kept:
    """The samples that the intervals rest on, and the columns over them."""

    rows: Indices
    time_s: Floats
    y: Floats
    law: Floats  # columns of the model, then the slope of each fitted lag
    more: Floats  # other lags beside them


def fit_axis(
    design: Design,
    y: Floats,
    solver: Solver,
    errors: str,
    level: float,
    sensors: Mapping[str, ArrayLike],
) -> AxisFit:
    """Identify one axis (n,)."""
    point = fit_point(design, y, solver)
    every = _kept(design, point, y, np.ones(point.rows.size, dtype=bool))
    off, left = _outliers(every, point, solver)
    perfect = float(point.fit.scale) <= _PERFECT * float(np.abs(y[point.rows]).max())
    white = errors == "white" or perfect
    thinned = 1 if white else _thinning(left[~off], 2 * every.law.shape[1])
    chosen = np.zeros(off.size, dtype=bool)
    chosen[np.flatnonzero(~off)[::thinned]] = True
    kept = _kept(design, point, y, chosen)
    rich = np.column_stack([kept.law, kept.more])
    rich_noise = noise = Noise()
    if design.lags and not white:
        rich_noise = fit_noise(rich, kept.y, kept.time_s)
    # Where more lags than the law's leave white noise, the law is tested under that.
    if not white and (not design.lags or has_memory(rich, kept.y, kept.time_s, rich_noise)):
        noise = fit_noise(kept.law, kept.y, kept.time_s)
    if perfect or not design.lags:
        tests = LackOfFit(np.nan, np.nan)
    else:
        tests = lack_of_fit(kept.law, kept.more, kept.y, kept.time_s, noise)
    asked = any(isinstance(t, Lagged) and t.tau_s == "spectrum" for t in design.model.terms)
    all_lags = bool(design.lags) and (tests.rejects or asked) and _linear(design)
    if all_lags:
        noise = rich_noise  # what a wrong law leaves is not noise: more lags tell what is
    elif not white and noise.tau_s <= 0.0:
        noise = fit_noise(kept.law, kept.y, kept.time_s)
    fit = law = generalised(kept.law, kept.y, kept.time_s, noise)
    states, tau, tau_interval = _lags(design, point, y, off, law, level)
    if all_lags:
        others = len(design.sensitive()) > len(design.lags)
        fit = generalised(rich, kept.y, kept.time_s, noise, freedom=others)
    sensitivity, interval, dof = _sensitivities(design, kept, fit, noise, level, all_lags, states)
    alike = design.alike(kept.rows, every_lag=all_lags)
    withheld = alike[list(design.sensitive())]
    sensitivity[withheld] = interval[withheld] = dof[withheld] = np.nan
    residuals, weights = np.full(y.size, np.nan), np.zeros(y.size)
    residuals[point.rows], weights[point.rows] = -point.fit.residuals, point.fit.weights
    rejected = np.zeros(y.size, dtype=bool)
    rejected[point.rows[off]] = True
    condition, vif = _collinearity(kept.law[:, : len(design.model.labels)])
    return AxisFit(
        coefficients=point.fit.x,
        point_tau_s=point.tau_s,
        weights=weights,
        sensitivity=sensitivity,
        interval=interval,
        dof=dof,
        law="all lags" if all_lags else "as given",
        tau_s=tau,
        tau_interval_s=tau_interval,
        tau_state=states,
        noise=noise,
        rejected=rejected,
        residuals=residuals,
        condition=condition,
        vif=vif,
        lack_of_fit=tests,
        converged=point.converged,
        thinned=thinned,
        alike=alike,
        omitted=()
        if perfect or alike.any()
        else _omitted(design, kept, law, noise, sensors, all_lags),
    )


def _outliers(every: _Kept, point: PointFit, solver: Solver) -> tuple[Bools, Floats]:
    """Samples beyond four robust sigma, and the residuals that tell.

    About a law with more lags than the model's: what a wrong law leaves is no outlier.
    """
    fit = point.fit
    rich = np.column_stack([every.law, every.more])
    if every.more.shape[1] and every.y.size > 2 * rich.shape[1]:
        fit = as_part(solver).fit(rich, every.y)  # lags too alike to be told apart do no harm here
    far = np.abs(fit.residuals) > _REJECTED * fit.scale
    return np.asarray(far & (not isinstance(solver, LeastSquares))), fit.residuals


def _thinning(residuals: Floats, fewest: int) -> int:
    """Take every so many-th sample, for errors that are smoother than the noise model knows.

    Steps of an Ornstein-Uhlenbeck process are uncorrelated and those of white noise negatively so;
    of a series that a smoother has been over they are alike. Every sample of it would then count as
    news, and lags with huge gains of either sign would explain it all.
    """
    step = 1
    while residuals.size // (2 * step) >= max(fewest, _FEWEST_THINNED):
        change = np.diff(residuals[::step])
        total = float(change @ change)
        if total <= 0 or float(change[1:] @ change[:-1]) <= _SMOOTH * total:
            break
        step *= 2
    return step


def _kept(design: Design, point: PointFit, y: Floats, kept: Bools) -> _Kept:
    rows = point.rows[kept]
    columns = design.matrix(point.tau_s)
    law = np.column_stack([columns, design.slopes(point.tau_s, point.fit.x)])
    names = dict.fromkeys(name for _, name in design.lags)
    taus = np.r_[0.0, lag_grid(design.time_s, _RICH, shortest=2.0)]
    more = [lagged(design.sensors[name], design.time_s, tau) for name in names for tau in taus]
    others = np.stack(more, axis=1) if more else np.empty((y.size, 0))
    if rows.size <= law.shape[1] + others.shape[1]:
        others = others[:, :0]  # so short a record cannot tell other lags from noise
    return _Kept(rows, design.time_s[rows], y[rows], law[rows], others[rows])


def _linear(design: Design) -> bool:
    """Whether every fitted lag enters by its first power alone, so that gains can be summed."""
    return all(
        term.degree == 1 for term in design.model.terms if isinstance(term, Lagged) and term.free
    )


def _lags(
    design: Design,
    point: PointFit,
    y: Floats,
    off: Bools,
    fit: CorrelatedFit,
    level: float,
) -> tuple[NDArray[np.str_], Floats, Floats]:
    """State, value and interval of each fitted lag."""
    count, p = len(design.lags), len(design.model.labels)
    states = np.full(count, "not identifiable", dtype="U16")
    tau, interval = point.tau_s.copy(), np.empty((count, 2))
    grid = np.r_[0.0, lag_grid(design.time_s, _PROFILE, shortest=0.1)]
    weights = point.fit.weights * ~off
    left = (point.fit.residuals * np.sqrt(weights))[~off]
    total = float(left @ left)
    correlation = max(float(left[1:] @ left[:-1]) / total, 0.0) if total > 0 else 0.0
    for i in range(count):
        around = np.sort(np.r_[grid, point.tau_s[i]])
        rss = profile(design, point, y, i, around, weights)
        allowed = lag_set(rss, left.size, min(correlation, 1.0 - 2.0 / left.size))
        states[i] = lag_state(allowed, around)
        if states[i] == "not identifiable":
            tau[i], interval[i] = np.nan, (0.0, np.inf)
            continue
        half = stdtrit(fit.dof[p + i], 0.5 + 0.5 * level) * fit.sigma[p + i]
        with np.errstate(over="ignore"):
            interval[i] = tau[i] * np.exp([-half, half])
        if states[i] == "no lag seen":
            # Logarithms know no way to zero: the lags that the profile allows are the interval.
            longest = int(np.flatnonzero(allowed).max())
            interval[i] = 0.0, around[min(longest + 1, around.size - 1)]
    return states, tau, interval


def _sensitivities(
    design: Design,
    kept: _Kept,
    fit: CorrelatedFit,
    noise: Noise,
    level: float,
    all_lags: bool,
    states: NDArray[np.str_],
) -> tuple[Floats, Floats, Floats]:
    """Radians per degree with interval and degrees of freedom, for every sensitive column."""
    columns = list(design.sensitive())
    value, sigma, dof = fit.x[columns], fit.sigma[columns], fit.dof[columns]
    starts = [place.start for place in design.places]
    if all_lags:
        taus = np.r_[0.0, lag_grid(design.time_s, _BANK)]
        bank = np.concatenate(
            [
                np.stack([design.lagged(i, tau)[kept.rows, 0] for tau in taus], axis=1)
                for i in range(len(starts))
            ],
            axis=1,
        )
        sums = np.asarray(np.kron(np.eye(len(starts)), np.ones(taus.size)), dtype=np.float64)
        base = np.delete(kept.law[:, : len(design.model.labels)], starts, axis=1)
        ridge = ridge_sums(base, bank, sums, kept.y, kept.time_s, noise)
    for i, start in enumerate(starts):
        at = columns.index(start)
        if all_lags:
            value[at], sigma[at], dof[at] = ridge.total[i], ridge.sigma[i], ridge.dof
        elif states[i] == "not identifiable":
            value[at] = sigma[at] = dof[at] = np.nan
    half = np.where(np.isnan(dof), np.nan, stdtrit(np.nan_to_num(dof, nan=1.0), 0.5 + 0.5 * level))
    return value, value[:, None] + (half * sigma)[:, None] * np.array([-1.0, 1.0]), dof


def _collinearity(columns: Floats) -> tuple[float, Floats]:
    """Condition of centred, scaled columns and the variance inflation of each; constant ones
    aside.
    """
    centred = columns - columns.mean(axis=0)
    size = np.linalg.norm(centred, axis=0)
    varies = size > 1e-12 * np.linalg.norm(columns, axis=0)
    vif = np.ones(columns.shape[1])
    if np.count_nonzero(varies) < 2:
        return 1.0, vif
    scaled = centred[:, varies] / size[varies]
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    none = values <= _NO_POWER * values[-1]
    inflated = np.sum(vectors[:, ~none] ** 2 / values[~none], axis=1)
    lost = (np.abs(vectors[:, none]) > 1e-6).any(axis=1)
    vif[varies] = np.where(lost, np.inf, inflated)
    return float(np.sqrt(values[-1] / values[0])) if not none.any() else np.inf, vif


def _omitted(
    design: Design,
    kept: _Kept,
    fit: CorrelatedFit,
    noise: Noise,
    sensors: Mapping[str, ArrayLike],
    all_lags: bool,
) -> tuple[str, ...]:
    """Sensitivities that trend, seasons and the other sensors would change, a sentence each.

    Under all lags the other sensors alone: what one lag misses would look like a trend.
    """
    extra = []
    kinds = {type(term) for term in design.model.terms} | ({Trend, Fourier} if all_lags else set())
    if Trend not in kinds:
        extra.append(((kept.time_s - kept.time_s.mean()) / np.ptp(kept.time_s))[:, None])
    if Fourier not in kinds and np.ptp(kept.time_s) > 1.5 * _YEAR_S:
        extra.append(Fourier(_YEAR_S).columns({}, kept.time_s))
    for name in set(sensors) - set(design.model.sensors):
        series = np.asarray(sensors[name], dtype=np.float64)[kept.rows]
        if np.isfinite(series).all() and np.ptp(series) > 0:
            extra.append((series - series.mean())[:, None])
    if not extra or not design.sensitive():
        return ()
    wide = np.column_stack([kept.law, *extra])
    if kept.y.size <= wide.shape[1] + 2:
        return ()
    other = generalised(wide, kept.y, kept.time_s, noise, freedom=False)
    found = []
    for i in design.sensitive():
        one, two = float(fit.x[i]), float(other.x[i])
        error = float(np.hypot(fit.sigma[i], other.sigma[i]))
        if abs(one - two) > 2.0 * error:
            change = "changes sign" if one * two < 0 else "changes"
            found.append(
                f"{design.model.labels[i]} {change} from {one * 206264.806:+.3g} to "
                f"{two * 206264.806:+.3g} arcsec/degC"
            )
    return tuple(found)
