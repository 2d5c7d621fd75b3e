"""Models judged on what they have not seen: folds left out, baselines beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats
from losbench.checks import choice, integer, shaped
from losbench.estimation.solvers import Solver, as_part, read_solver
from losbench.pointing.thermal.design import Design, bind, read_series
from losbench.pointing.thermal.search import fit_point
from losbench.pointing.thermal.terms import Adds
from losbench.units import SIGMA_PER_MAD, rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["CrossValidation", "check_folds", "cross_validate", "read_folds", "sigma_about_zero"]

YEAR_S = 31_557_600.0
DAY_S = 86_400.0


@dataclass(frozen=True, repr=False)
class CrossValidation:
    """Errors of predictions for folds that were left out.

    Attributes
    ----------
    errors : (n, ...) array, radians
        Angle less prediction; NaN where there is none.
    fold : (n,) array
        Label of each sample's fold.
    sigma : (...) array, radians
        Of all errors: 1.4826 times the median absolute error about zero, for an offset is an error
        too.
    by_fold, median_by_fold : (folds, ...) arrays, radians
        The same of each fold, and its median error: the offset.
    baselines : dict of (...) arrays, radians
        Sigma of what needs no model: "constant" and "trend" by the same folds, and "last", "1 d",
        "30 d": the last angle, and the last one at least so long before (None where the record is
        shorter).
    labels : array
        Of the folds.
    not_predictable : tuple
        Folds without which a term has nothing to stand on, such as the one that holds a step.
    """

    errors: Floats
    fold: NDArray[np.generic]
    sigma: Floats
    by_fold: Floats
    median_by_fold: Floats
    baselines: Mapping[str, Floats]
    labels: NDArray[np.generic]
    not_predictable: tuple[str, ...]

    def table(self) -> pd.DataFrame:
        """Sigma by fold in arcseconds, then of all, then of the baselines."""
        import pandas as pd

        rows = {
            f"fold {label}": value for label, value in zip(self.labels, self.by_fold, strict=True)
        }
        rows |= {"all": self.sigma} | dict(self.baselines)
        return pd.DataFrame(
            {name: np.atleast_1d(rad_to_arcsec(value)) for name, value in rows.items()}
        ).T

    def __repr__(self) -> str:
        """The table in arcseconds."""
        text = self.table().round(3).to_string(header=False)
        if self.not_predictable:
            text += f"\nnot predictable: {', '.join(self.not_predictable)}"
        return text


def cross_validate(
    model: Adds,
    angles: ArrayLike,
    sensors: Mapping[str, ArrayLike],
    time_s: ArrayLike,
    *,
    folds: str | int | ArrayLike = 5,
    horizon: Literal["left out", "forward"] = "left out",
    solver: Solver | str = "irls",
) -> CrossValidation:
    """Fit a model without each fold in turn and predict it.

    Parameters
    ----------
    model, angles, sensors, time_s, solver
        As for `identify`. Lags follow the whole record of the sensors, the left-out part included:
        temperatures are known when angles are not.
    folds : "year", int or (n,) array
        Julian years from the first sample, so many blocks of equal length in samples, or labels.
    horizon : "left out" or "forward"
        Fit on all other folds, or on those before alone.

    Returns
    -------
    CrossValidation

    Raises
    ------
    ValueError
        As `identify`; if there are fewer than two folds, or one holds no sample.

    Examples
    --------
    >>> from losbench.pointing.thermal.terms import Linear, Offset
    >>> t = np.arange(400.0)
    >>> room = np.sin(t / 20.0)
    >>> angle = 1e-6 * room + 1e-8 * np.random.default_rng(1).standard_normal(400)
    >>> found = cross_validate(Offset() + Linear("room"), angle, {"room": room}, t, folds=4)
    >>> round(float(found.sigma) * 1e8, 1)
    0.9
    """
    design = bind(model, sensors, time_s)
    series = read_series(angles, design.time_s.size)
    choice("horizon", horizon, ("left out", "forward"))
    chosen = as_part(read_solver(solver, None, default="irls"))
    fold, labels = read_folds(folds, design.time_s)
    usable = design.known[:, None] & np.isfinite(series)
    check_folds(fold, labels, np.asarray(usable.any(axis=1)))
    errors = np.full(series.shape, np.nan)
    lost: dict[str, None] = {}
    for axis in range(series.shape[1]):
        for i, label in enumerate(labels):
            train = fold < i if horizon == "forward" else fold != i
            predicted = _predict(design, series[:, axis], chosen, train, fold == i)
            if predicted is None:
                lost[str(label)] = None
                continue
            errors[fold == i, axis] = series[fold == i, axis] - predicted
    errors[~design.known] = np.nan
    shape = np.shape(angles)[1:]
    by_fold = np.stack([sigma_about_zero(errors[fold == i]) for i in range(len(labels))])
    middle = np.stack([_median(errors[fold == i]) for i in range(len(labels))])
    baselines = _baselines(series, design.time_s, fold, len(labels), horizon)
    return CrossValidation(
        errors=errors.reshape(np.shape(angles)),
        fold=np.asarray(labels)[fold],
        sigma=sigma_about_zero(errors).reshape(shape),
        by_fold=by_fold.reshape(-1, *shape),
        median_by_fold=middle.reshape(-1, *shape),
        baselines={name: value.reshape(shape) for name, value in baselines.items()},
        labels=np.asarray(labels),
        not_predictable=tuple(lost),
    )


def sigma_about_zero(errors: Floats) -> Floats:
    """1.4826 times the median absolute error along axis 0, NaN left out."""
    return _median(np.abs(errors)) * SIGMA_PER_MAD


def read_folds(folds: str | int | ArrayLike, time_s: Floats) -> tuple[NDArray[np.intp], list[str]]:
    """Number of each sample's fold, in order of time, and the folds' labels."""
    if isinstance(folds, str):
        choice("folds", folds, ("year",))
        year = np.floor((time_s - time_s[0]) / YEAR_S).astype(int)
        values, number = np.unique(year, return_inverse=True)
        labels = [f"year {value + 1}" for value in values]
    elif np.ndim(folds) == 0:
        count = integer("folds", folds, low=2, high=time_s.size)
        number = np.arange(time_s.size) * count // time_s.size
        labels = [f"block {i + 1}" for i in range(count)]
    else:
        given = np.asarray(folds)
        shaped("folds", given, (time_s.size,), why="to match time_s")
        if (nameless := given != given).any():
            raise ValueError(f"folds must name every sample's fold, got {nameless.sum()} NaN")
        values, first, inverse = np.unique(given, return_index=True, return_inverse=True)
        order = np.argsort(first)
        place = np.empty(order.size, dtype=np.intp)
        place[order] = np.arange(order.size)
        number, labels = place[inverse], [str(values[i]) for i in order]
    if len(labels) < 2:
        raise ValueError(f"folds must be at least two, got {len(labels)}")
    return number.astype(np.intp), labels


def check_folds(fold: NDArray[np.intp], labels: list[str], usable: Bools) -> None:
    """Refuse folds without a usable sample (n,)."""
    for i, label in enumerate(labels):
        if not usable[fold == i].any():
            raise ValueError(f"folds must each hold samples, got none in {label}")


def _predict(design: Design, y: Floats, solver: Solver, train: Bools, test: Bools) -> Floats | None:
    """Angles of the test rows, or None where the training rows cannot tell them."""
    rows = train & design.known & np.isfinite(y)
    if rows.sum() <= len(design.model.labels) + len(design.lags):
        return None
    if design.alike(rows).any():
        return None
    point = fit_point(design, y, solver, use=train)
    predicted: Floats = design.matrix(point.tau_s)[test] @ point.fit.x
    return predicted


def _baselines(
    series: Floats, time_s: Floats, fold: NDArray[np.intp], count: int, horizon: str
) -> dict[str, Floats]:
    """Sigma (k,) of a constant, of a trend, and of what was measured last."""
    from losbench.estimation.robust import irls

    found = {}
    centred = time_s - time_s.mean()
    for name, degree in (("constant", 0), ("trend", 1)):
        errors = np.full(series.shape, np.nan)
        columns = centred[:, None] ** np.arange(degree + 1)
        for i in range(count):
            train = fold < i if horizon == "forward" else fold != i
            for axis, y in enumerate(series.T):
                rows = train & np.isfinite(y)
                if rows.sum() > degree + 1:
                    x = irls(columns[rows], y[rows], on_fail="ignore").x
                    errors[fold == i, axis] = y[fold == i] - columns[fold == i] @ x
        found[name] = sigma_about_zero(errors)
    for name, wait_s in (("last", 0.0), ("1 d", DAY_S), ("30 d", 30 * DAY_S)):
        if wait_s < np.ptp(time_s):
            found[name] = sigma_about_zero(_changes(series, time_s, wait_s))
    return found


def _changes(series: Floats, time_s: Floats, wait_s: float) -> Floats:
    """Each angle less the last one that was known at least ``wait_s`` before."""
    changes = np.full(series.shape, np.nan)
    for axis, y in enumerate(series.T):
        known = np.flatnonzero(np.isfinite(y))
        last = np.searchsorted(time_s[known], time_s[known] - wait_s, side="right") - 1
        if wait_s == 0.0:
            last = last - 1
        seen = last >= 0
        changes[known[seen], axis] = y[known[seen]] - y[known[last[seen]]]
    return changes


def _median(errors: Floats) -> Floats:
    known = np.isfinite(errors).any(axis=0)
    median = np.full(errors.shape[1:], np.nan)
    median[known] = np.nanmedian(errors[:, known], axis=0)
    return median
