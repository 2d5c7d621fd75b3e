"""Least squares and iteratively reweighted least squares for batches of small systems."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats, Ints
from losbench.checks import boolean, choice, finite, integer, named_twice, number
from losbench.estimation.losses import Huber, Loss, psi_deriv, read_loss
from losbench.estimation.robust.failures import warn_of_failures
from losbench.estimation.robust.iterate import Groups, Method, finish, iterate
from losbench.estimation.robust.pooled import iterate_pooled
from losbench.estimation.robust.problem import (
    Problem,
    blanked,
    gram,
    read_problem,
    spd_inverse,
    times_unit,
)
from losbench.estimation.robust.redundancy import iterate_as_one, stands_for_all
from losbench.estimation.robust.result import RobustFit
from losbench.estimation.robust.scales import Scale, ScaleRule, known_scale

__all__ = ["ON_FAIL", "as_fit", "irls", "lstsq", "report_rank"]


ON_FAIL = ("warn", "raise", "ignore")
_GREATEST_LEVERAGE = 0.9999
_TOLERANCE = 1e-10


def lstsq(
    A: ArrayLike,
    y: ArrayLike,
    *,
    scale: float | ArrayLike | None = None,
    on_fail: str = "warn",
) -> RobustFit:
    r"""Solve A x = y by least squares, for one system or a batch.

    This is the call; `LeastSquares` is the same choice as an object, to be handed on.

    Parameters
    ----------
    A : (n, p) or (..., n, p) array
        Design matrix, n >= p; one for all systems, or one each.
    y : (..., n) array
        Observations.
    scale : float or (...) array, unit of y, optional
        Standard deviation of ``y`` if it is known; estimated as sqrt(sum r^2 / dof) otherwise.
    on_fail : "warn", "raise" or "ignore"
        What to do where A does not determine every unknown; the covariance of those it leaves open
        is NaN in any case but "raise".

    Returns
    -------
    RobustFit
        With weights of 1 and cov = scale^2 (A'A)^-1.

    Raises
    ------
    ValueError
        If shapes disagree, n < p, a value is NaN or infinite, or ``scale`` is not positive.
    RuntimeError
        If ``on_fail="raise"`` and an unknown is not determined.

    Warns
    -----
    RuntimeWarning
        Once, if an unknown is not determined.

    Notes
    -----
    .. math:: \hat x = (A^T A)^{-1} A^T y

    liu2026, eq. (7). Solved through an orthonormal basis of scaled columns, never through A'A.

    Examples
    --------
    >>> fit = lstsq([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]], [1.0, 3.0, 5.0])
    >>> fit.x.round(12)
    array([1., 2.])
    """
    problem = read_problem(A, y)
    report_rank(problem, choice("on_fail", on_fail, ON_FAIL))
    z = problem.least_squares()
    residuals = problem.residuals(z)
    n = residuals.shape[1]
    if scale is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = np.sqrt(np.vecdot(residuals, residuals) / (n - problem.rank))
        working = np.where(problem.rank < n, np.maximum(spread, problem.floor), np.nan)
    else:
        working = known_scale(scale, problem)(residuals, np.arange(len(residuals)))
    return as_fit(
        problem,
        z,
        (
            residuals,
            np.broadcast_to(1.0, residuals.shape),
            working,
            partial(problem.covariance, working),
        ),
        n_iter=np.zeros(len(z), dtype=np.int64),
        converged=np.ones(len(z), dtype=bool),
        loss="least squares",
        scale_method="sqrt(RSS/dof)" if scale is None else "given",
    )


def irls(
    A: ArrayLike,
    y: ArrayLike,
    *,
    loss: Loss | str = Huber(1.345),  # noqa: B008 - frozen
    scale: Scale = "mad",
    group: ArrayLike | None = None,
    leverage: bool = False,
    x0: ArrayLike | None = None,
    max_iter: int = 100,
    tolerance: float = _TOLERANCE,
    on_fail: str = "warn",
    tol: float | None = None,
) -> RobustFit:
    r"""Solve A x = y robustly by iteratively reweighted least squares, for one system or a batch.

    This is the call; `IRLS` is the same choice as an object, to be handed on.

    Parameters
    ----------
    A : (n, p) or (..., n, p) array
        Design matrix, n >= p; one for all systems, or one each.
    y : (..., n) array
        Observations.
    loss : Huber, Bisquare or any object with ``weights(u)``, or a name
        What a residual of u scales counts; "huber", "bisquare", "cauchy", "welsch" and "hampel"
        have the constants of 95 % efficiency.
    scale : str, float, (...) array, or callable
        How the residual scale is made anew in each iteration: "mad" (median abs r /
        0.6744897501960817, about zero), "std" (population; the one of liu2026), "std1" (sample),
        "rms" (about zero); "pooled" (rms of all residuals of the batch, one scale for all its
        systems); a known value in the unit of y; or a callable that turns residuals (b, n) into
        scales (b,).
    group : (n,) labels, optional
        Rows with the same label share one weight (the x and y of a spot): u is then the root mean
        square of the group's residuals over the scale, which stays that of a single row.
    leverage : bool
        Judge residuals over sqrt(1 - h), h being the leverage of their row, at most 0.9999, as GSL
        and MATLAB's robustfit do; "mad" is then the median of what is left without the p - 1
        smallest of them, over 0.6745.
    x0 : (p,) or (..., p) array, optional
        Start; least squares otherwise. It matters for losses that redescend.
    max_iter, tolerance : int, float
        Stop when the fitted values move by at most ``tolerance`` times the larger of their norm and
        scale sqrt(p); the same as the relative change of the unknowns in orthonormal columns, so
        units do not matter. ``tol`` is a second word for it.
    on_fail : "warn", "raise" or "ignore"
        What to do where ``max_iter`` was not enough, or A does not determine every unknown; the
        last iterate is kept, and the covariance of what is left open NaN, in any case but "raise".

    Returns
    -------
    RobustFit
        ``cov`` is, with an estimated scale, s^2 kappa^2 / m^2 * sum psi^2 / (n - p) * (A'A)^-1,
        where m is the mean of psi' and kappa = 1 + p var(psi') / (n m^2) with ddof 1 (Huber 1981,
        chapter 7, and R's ``summary.rlm``), with a pooled scale over all rows of the batch as over
        one sample; with a known scale, scale^2 (A'WA)^-1, in which a doubted row counts by its
        weight.

    Raises
    ------
    ValueError
        If shapes disagree, n < p, a value is NaN or infinite, or an option is not one of those
        above.
    RuntimeError
        If ``on_fail="raise"`` and a system did not converge, or an unknown is not determined.

    Warns
    -----
    RuntimeWarning
        Once each, if a system did not converge or an unknown is not determined.

    Notes
    -----
    .. math:: \hat x = (A^T W A)^{-1} A^T W y, \qquad W_{ii} = w(r_i / s), \quad r = y - A \hat x

    liu2026, eq. (8)-(10), which takes Huber(1.345) and scale="std". Close to the solution, the
    inverse of A'WA is corrected by Broyden's secant instead of made anew, which reaches the same
    place in about half as many steps.

    A design with one row more than unknowns, such as two spots for three angles, gives all systems
    the same weights wherever the scale is made of their residuals: IRLS is linear in y there.

    Examples
    --------
    >>> fit = irls(
    ...     [[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0], [1.0, 4.0]], [1.1, 2.9, 50.0, 7.1, 8.9]
    ... )
    >>> fit.x.round(2)
    array([1.1 , 1.98])
    >>> fit.outliers()
    array([False, False,  True, False, False])
    """
    problem = read_problem(A, y)
    adjusted = boolean("leverage", leverage)
    dropped = max(int(problem.rank.max()) - 1, 0) if adjusted else None
    method = Method(
        read_loss(loss),
        ScaleRule(scale, problem.batch, problem.y_unit, dropped=dropped),
        None if group is None else Groups.read(group, problem.y.shape[1]),
        integer("max_iter", max_iter, low=1),
        number(*named_twice("tolerance", tolerance, _TOLERANCE, tol=tol), low=0.0),
        1.0 / np.sqrt(1.0 - np.minimum((problem.basis**2).sum(axis=1), _GREATEST_LEVERAGE))
        if adjusted
        else None,
    )
    choice("on_fail", on_fail, ON_FAIL)
    with np.errstate(over="ignore", under="ignore"):
        if x0 is None and stands_for_all(problem, method):
            z, n_iter, settled, left = iterate_as_one(problem, method)
        else:
            start = problem.least_squares() if x0 is None else _start(problem, A, x0)
            if method.scale.pooled:
                z, n_iter, settled, method = iterate_pooled(problem, method, start)
            else:
                z, n_iter, settled = iterate(problem, method, start)
            left = finish(problem, method, z)
    residuals, weights, working = left
    converged = settled
    if not weights.min(initial=1.0) > 0.0:
        converged = settled & (np.count_nonzero(weights, axis=1) >= problem.rank)
    report_rank(problem, on_fail)
    _report(converged, method.max_iter, on_fail)
    # The residuals of the fit are the user's to write to, whenever the covariance is asked for.
    cov = partial(_covariance, problem, method, residuals.copy(), working)
    return as_fit(
        problem,
        z,
        (residuals, weights, working, cov),
        n_iter=n_iter,
        converged=converged,
        loss=_name(method.loss),
        scale_method=method.scale.name,
        group=None if method.groups is None else method.groups.labels,
    )


def _covariance(problem: Problem, method: Method, residuals: Floats, scale: Floats) -> Floats:
    """Covariance in the user's units, from scaled residuals."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        u = method.scaled(method.judged(residuals, np.arange(len(residuals))), scale)
        weights = method.loss.weights(u)
        if method.scale.known:
            normal = gram(problem.basis, weights, problem.rank)
            inverse = spd_inverse(normal, problem.basis.shape[1])
            return problem.weighted_covariance(inverse, normal, scale)
        slope = psi_deriv(method.loss, u)
        if method.groups is not None:
            slope = weights + (slope - weights) / method.groups.sizes
        pulls = residuals * weights
        if method.scale.pooled:
            # All systems are one sample: what is common to them is known from all their rows.
            rank = np.broadcast_to(problem.rank, len(residuals)).sum(keepdims=True)
            pulls = pulls * problem.y_unit[:, None]
            size = _kappa_size(pulls.reshape(1, -1), slope.reshape(1, -1), rank) / problem.y_unit
        else:
            size = _kappa_size(pulls, slope, problem.rank)
        cov = problem.covariance(size)
        if weights.min() > 0.0:
            return cov
        # (A'A)^-1 counts rejected rows too, but an unknown that hangs on them alone is not known.
        normal = gram(problem.basis, weights, problem.rank)
        left = problem.left_by(spd_inverse(normal, problem.basis.shape[1]), normal)
        return blanked(cov, left)


def _kappa_size(pulls: Floats, slope: Floats, rank: Ints) -> Floats:
    """Residual size whose square times (A'A)^-1 is the covariance: NaN where no row is
    redundant.
    """
    n = pulls.shape[1]
    mean = slope @ np.full(n, 1.0 / n)
    variance = (np.vecdot(slope, slope) / n - mean**2) * n / max(n - 1, 1)
    kappa = 1.0 + rank * variance / (n * mean**2)
    return np.where(rank < n, np.sqrt(np.vecdot(pulls, pulls) / (n - rank)) * kappa / mean, np.nan)


def as_fit(
    problem: Problem,
    z: Floats,
    found: tuple[Floats, Floats, Floats, Floats | Callable[[], Floats]],
    *,
    n_iter: Ints,
    converged: Bools,
    **labels: Any,
) -> RobustFit:
    """From scaled units and a flat batch to the user's, in which the covariance already is.

    Found are residuals, weights, scale and covariance; the last, if a function, waits until
    somebody asks for it.
    """
    residuals, weights, scale, cov = found
    count, n = problem.y.shape
    p, batch = z.shape[1], problem.batch
    rank = np.broadcast_to(problem.rank, count)
    with np.errstate(over="ignore", under="ignore"):
        return RobustFit(
            x=problem.unknowns(z).reshape(*batch, p),
            residuals=times_unit(residuals, problem.y_unit).reshape(*batch, n),
            weights=weights.reshape(*batch, n),
            scale=(scale * problem.y_unit).reshape(batch),
            cov=lambda: (cov() if callable(cov) else cov).reshape(*batch, p, p),
            dof=(n - rank).reshape(batch),
            n_iter=n_iter.reshape(batch),
            converged=converged.reshape(batch),
            leverage=lambda: problem.leverage().reshape(*batch, n),
            rank=rank.reshape(batch),
            **labels,
        )


def _name(loss: Loss) -> str:
    return repr(loss) if type(loss).__repr__ is not object.__repr__ else type(loss).__name__


def _start(problem: Problem, A: ArrayLike, x0: ArrayLike) -> Floats:
    x = finite("x0", x0)
    wanted = (*problem.batch, problem.basis.shape[1])
    try:
        x = np.broadcast_to(x, wanted)
    except ValueError:
        raise ValueError(f"x0 must broadcast to {wanted}, got {x.shape}") from None
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        fitted = np.matvec(np.asarray(A, dtype=np.float64), x)
    return problem.coordinates(finite("A x0", fitted).reshape(-1, fitted.shape[-1]))


def report_rank(problem: Problem, on_fail: str) -> None:
    """Say so, once, if systems do not determine every unknown."""
    p = problem.basis.shape[1]
    if problem.rank.min() < p:
        short = np.count_nonzero(np.broadcast_to(problem.rank, len(problem.y)) < p)
        _tell(
            f"{short} of {len(problem.y)} systems do not determine every unknown",
            "errors of what they leave open are NaN, see .rank",
            on_fail,
        )


def _report(converged: Bools, max_iter: int, on_fail: str) -> None:
    failed = int(np.count_nonzero(~converged))
    if not failed:
        return
    what = f"irls: {failed} of {converged.size} systems did not converge in {max_iter} iterations"
    if on_fail == "raise":
        raise RuntimeError(what)
    if on_fail == "warn":
        said = f"{what}; their last iterate is kept, see .converged"
        warn_of_failures(failed, said, stacklevel=3)


def _tell(what: str, consequence: str, on_fail: str) -> None:
    if on_fail == "raise":
        raise RuntimeError(what)
    if on_fail == "warn":
        warnings.warn(f"{what}; {consequence}", RuntimeWarning, stacklevel=4)
