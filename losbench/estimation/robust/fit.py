"""Least squares and iteratively reweighted least squares for batches of small systems."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.checks import choice, finite, integer, number
from losbench.estimation.losses import Huber, Loss, psi_deriv
from losbench.estimation.robust.problem import Problem, combine, project, read_problem, spd_inverse
from losbench.estimation.robust.result import RobustFit
from losbench.estimation.robust.scales import Scale, ScaleRule

__all__ = ["irls", "lstsq"]

Floats = NDArray[np.float64]

_ROUNDING = 64 * np.finfo(float).eps  # residuals of a perfect fit stay below this part of the largest abs y
_CHUNK_ELEMENTS = 2**18  # residuals worked on at once: bounds the memory, keeps the arrays near the processor


def lstsq(A: ArrayLike, y: ArrayLike, *, scale: float | ArrayLike | None = None) -> RobustFit:
    """Solve A x = y by least squares, for one system or a batch.

    Parameters
    ----------
    A : (n, p) or (..., n, p) array
        Design matrix, n >= p; one for all systems, or one each.
    y : (..., n) array
        Observations.
    scale : float or (...) array, unit of y, optional
        Standard deviation of ``y`` if it is known; estimated as sqrt(sum r^2 / dof) otherwise.

    Returns
    -------
    RobustFit
        With weights of 1 and cov = scale^2 (A'A)^-1.

    Raises
    ------
    ValueError
        If shapes disagree, n < p, a value is NaN or infinite, or ``scale`` is not positive.

    Notes
    -----
    liu2026, eq. (7). Solved through an orthonormal basis of scaled columns, never through A'A.

    Examples
    --------
    >>> fit = lstsq([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]], [1.0, 3.0, 5.0])
    >>> fit.x.round(12)
    array([1., 2.])
    """
    problem = read_problem(A, y)
    z = problem.least_squares()
    residuals = problem.residuals(z)
    n = residuals.shape[1]
    dof = np.broadcast_to(n - problem.rank, len(residuals))
    if scale is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            working = np.where(dof > 0, np.sqrt(np.vecdot(residuals, residuals) / dof), np.nan)
        working = np.maximum(working, _floor(problem))
    else:
        working = ScaleRule(scale, problem.batch, problem.y_unit)(residuals, np.arange(len(residuals)))
    solved = _Solved(
        z=z,
        residuals=residuals,
        weights=np.broadcast_to(1.0, residuals.shape),
        scale=working,
        cov=working[:, None, None] ** 2 * (problem.to_x @ np.swapaxes(problem.to_x, 1, 2)),
        n_iter=np.zeros(len(z), dtype=np.int64),
        converged=np.ones(len(z), dtype=bool),
    )
    return _result(problem, solved, loss="least squares", scale_method="sqrt(RSS/dof)" if scale is None else "given")


def irls(
    A: ArrayLike,
    y: ArrayLike,
    *,
    loss: Loss = Huber(1.345),  # noqa: B008 - frozen
    scale: Scale = "mad",
    group: ArrayLike | None = None,
    x0: ArrayLike | None = None,
    max_iter: int = 100,
    tol: float = 1e-10,
    on_fail: str = "warn",
) -> RobustFit:
    """Solve A x = y robustly by iteratively reweighted least squares, for one system or a batch.

    Parameters
    ----------
    A : (n, p) or (..., n, p) array
        Design matrix, n >= p; one for all systems, or one each.
    y : (..., n) array
        Observations.
    loss : Huber, Bisquare or any object with ``weights(u)``
        What a residual of u scales counts.
    scale : str, float, (...) array, or callable
        How the residual scale is made anew in each iteration: "mad" (median abs r / 0.6744897501960817, about zero),
        "std" (population; the one of liu2026), "std1" (sample), "rms" (about zero); a known value in the unit of y; or
        a callable that turns residuals (b, n) into scales (b,).
    group : (n,) labels, optional
        Rows with the same label share one weight (the x and y of a spot): u is then the Euclidean norm of the group's
        residuals over the scale. Estimated scales still come from single rows.
    x0 : (p,) or (..., p) array, optional
        Start; least squares otherwise. It matters for losses that redescend.
    max_iter, tol : int, float
        Stop when the fitted values move by at most ``tol`` times the larger of their norm and scale sqrt(p); the same
        as the relative change of the unknowns in orthonormal columns, so units do not matter.
    on_fail : "warn", "raise" or "ignore"
        What to do where ``max_iter`` was not enough; the last iterate is kept in any case but "raise".

    Returns
    -------
    RobustFit
        ``cov`` is, with an estimated scale, s^2 kappa^2 / m^2 * sum psi^2 / (n - p) * (A'A)^-1, where m is the mean of
        psi' and kappa = 1 + p var(psi') / (n m^2) with ddof 1 (Huber 1981, eq. 7.6.11, and R's ``summary.rlm``); with
        a known scale, scale^2 (A'WA)^-1, in which a doubted row counts by its weight.

    Raises
    ------
    ValueError
        If shapes disagree, n < p, a value is NaN or infinite, or an option is not one of those above.
    RuntimeError
        If ``on_fail="raise"`` and a system did not converge.

    Notes
    -----
    liu2026, eq. (8)-(10), which takes Huber(1.345) and scale="std".

    Examples
    --------
    >>> fit = irls([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0], [1.0, 4.0]], [1.0, 3.0, 5.0, 7.0, 90.0])
    >>> fit.x.round(6)
    array([1., 2.])
    >>> fit.outliers()
    array([False, False, False, False,  True])
    """
    problem = read_problem(A, y)
    method = _Method(
        _checked_loss(loss),
        ScaleRule(scale, problem.batch, problem.y_unit),
        None if group is None else _Groups.read(group, problem.y.shape[1]),
        integer("max_iter", max_iter, low=1),
        number("tol", tol, low=0.0),
    )
    choice("on_fail", on_fail, ("warn", "raise", "ignore"))
    start = problem.least_squares() if x0 is None else _start(problem, x0)
    count, n = problem.y.shape
    size = max(1, _CHUNK_ELEMENTS // n)
    parts = [slice(first, first + size) for first in range(0, count, size)]
    chunks = [_iterate(problem.chunk(part), method, start[part], np.arange(count)[part]) for part in parts]
    solved = _Solved.join(chunks)
    _report(solved.converged, method.max_iter, on_fail)
    labels = None if method.groups is None else method.groups.labels
    return _result(problem, solved, loss=_name(loss), scale_method=method.scale.name, group=labels)


@dataclass(frozen=True)
class _Groups:
    """Rows that share a weight."""

    labels: NDArray[np.intp]  # (n,), 0 .. number of groups - 1
    order: NDArray[np.intp]  # rows sorted by group
    first: NDArray[np.intp]  # where each group begins in that order

    @classmethod
    def read(cls, group: ArrayLike, n: int) -> _Groups:
        given = np.asarray(group)
        if given.shape != (n,):
            raise ValueError(f"group must have shape ({n},) to match the {n} rows of A, got {given.shape}")
        _, labels = np.unique(given, return_inverse=True)
        order = np.argsort(labels, kind="stable")
        return cls(labels, order, np.flatnonzero(np.diff(labels[order], prepend=-1)))

    def root_mean_squares(self, residuals: Floats) -> Floats:
        """Root mean square of each row's group, (b, n)."""
        return np.sqrt(np.add.reduceat(residuals[:, self.order] ** 2, self.first, axis=1))[:, self.labels]

    def sizes(self) -> NDArray[np.intp]:
        """Number of rows in each row's group, (n,)."""
        return np.bincount(self.labels)[self.labels]


@dataclass(frozen=True)
class _Method:
    """How to iterate."""

    loss: Loss
    scale: ScaleRule
    groups: _Groups | None
    max_iter: int
    tol: float

    def scaled(self, residuals: Floats, scale: Floats) -> Floats:
        """What the loss sees of each row, (b, n)."""
        size = residuals if self.groups is None else self.groups.root_mean_squares(residuals)
        return size / scale[:, None]


@dataclass(frozen=True)
class _Solved:
    """Solution of a flattened batch, in scaled units."""

    z: Floats
    residuals: Floats
    weights: Floats
    scale: Floats
    cov: Floats
    n_iter: NDArray[np.int64]
    converged: NDArray[np.bool_]

    @classmethod
    def join(cls, parts: list[_Solved]) -> _Solved:
        if len(parts) == 1:
            return parts[0]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in cls.__annotations__})


def _iterate(problem: Problem, method: _Method, z: Floats, systems: NDArray[np.intp]) -> _Solved:
    """Reweight and solve until every system has settled; settled ones leave the batch in batches."""
    count, p = z.shape
    final, n_iter = z.copy(), np.full(count, method.max_iter)
    converged = np.zeros(count, dtype=bool)
    products, unused = _products(problem.basis), _unused(problem)
    active, waiting = np.arange(count), np.ones(count, dtype=bool)
    basis, y, floor = problem.basis, problem.y, _floor(problem)
    for iteration in range(1, method.max_iter + 1):
        residuals = combine(z, basis) - y
        scale = np.maximum(method.scale(residuals, systems[active]), floor)
        weights = method.loss.weights(method.scaled(residuals, scale))
        inverse = spd_inverse(project(products, weights) + unused, p)
        step = np.matvec(inverse, project(basis, weights * residuals))
        z = z - step
        size = np.maximum(np.sqrt(np.vecdot(z, z)), scale * np.sqrt(p))
        settled = waiting & (np.sqrt(np.vecdot(step, step)) <= method.tol * size)
        final[active[settled]], n_iter[active[settled]], converged[active[settled]] = z[settled], iteration, True
        waiting &= ~settled
        left = np.count_nonzero(waiting)
        if left == 0:
            break
        if left < 0.85 * len(waiting):
            if len(basis) > 1:
                basis, products, unused = basis[waiting], products[waiting], unused[waiting]
            active, z, y, floor = active[waiting], z[waiting], y[waiting], floor[waiting]
            waiting = waiting[waiting]
    final[active[waiting]] = z[waiting]
    return _finish(problem, method, final, n_iter, converged, systems)


def _finish(
    problem: Problem,
    method: _Method,
    z: Floats,
    n_iter: NDArray[np.int64],
    converged: NDArray[np.bool_],
    systems: NDArray[np.intp],
) -> _Solved:
    residuals = problem.residuals(z)
    scale = np.maximum(method.scale(residuals, systems), _floor(problem))
    u = method.scaled(residuals, scale)
    weights = method.loss.weights(u)
    if method.scale.known:
        inverse = spd_inverse(project(_products(problem.basis), weights) + _unused(problem), z.shape[1])
        cov = scale[:, None, None] ** 2 * (problem.to_x @ inverse @ np.swapaxes(problem.to_x, 1, 2))
    else:
        slope = psi_deriv(method.loss, u)
        if method.groups is not None:
            slope = weights + (slope - weights) / method.groups.sizes()
        spread = _kappa_variance(residuals * weights, slope, problem.rank)
        cov = spread[:, None, None] * (problem.to_x @ np.swapaxes(problem.to_x, 1, 2))
    enough = np.count_nonzero(weights, axis=1) >= problem.rank
    return _Solved(z, residuals, weights, scale, cov, n_iter, converged & enough)


def _kappa_variance(pulls: Floats, slope: Floats, rank: NDArray[np.int64]) -> Floats:
    """Factor of (A'A)^-1 in the covariance: NaN where no row is redundant."""
    n = pulls.shape[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = slope.mean(axis=1)
        kappa = 1.0 + rank * slope.var(axis=1) / max(n - 1, 1) / mean**2
        return np.where(rank < n, np.vecdot(pulls, pulls) / (n - rank) * (kappa / mean) ** 2, np.nan)


def _products(basis: Floats) -> Floats:
    """Products of all pairs of basis rows, (B or 1, p (p + 1) / 2, n): weighted sums of them make Q'WQ."""
    count, p, n = basis.shape
    products = np.empty((count, p * (p + 1) // 2, n))
    for k, (i, j) in enumerate(zip(*np.triu_indices(p), strict=True)):
        np.multiply(basis[:, i], basis[:, j], out=products[:, k])
    return products


def _unused(problem: Problem) -> Floats:
    """Ones on the diagonal of Q'WQ for directions beyond the rank, whose rows of Q are zero."""
    p = problem.basis.shape[1]
    first, second = np.triu_indices(p)
    return ((first == second) & (first >= problem.rank[:, None])).astype(np.float64)


def _floor(problem: Problem) -> Floats:
    return np.maximum(_ROUNDING * np.abs(problem.y).max(axis=1), np.finfo(float).tiny)


def _result(problem: Problem, solved: _Solved, **labels: Any) -> RobustFit:
    """From scaled units and a flat batch to the user's."""
    n, p = problem.y.shape[1], problem.basis.shape[1]
    batch = problem.batch
    unit = problem.y_unit
    per_system = (len(unit),)
    rank = np.broadcast_to(problem.rank, per_system)
    leverage = np.vecdot(problem.basis, problem.basis, axis=1)
    x_unit = problem.x_unit
    with np.errstate(over="ignore", under="ignore"):
        return RobustFit(
            x=problem.unknowns(solved.z).reshape(*batch, p),
            residuals=(solved.residuals * unit[:, None]).reshape(*batch, n),
            weights=solved.weights.reshape(*batch, n),
            scale=(solved.scale * unit).reshape(batch),
            cov=(solved.cov * x_unit[:, :, None] * x_unit[:, None, :]).reshape(*batch, p, p),
            dof=(n - rank).reshape(batch),
            n_iter=solved.n_iter.reshape(batch),
            converged=solved.converged.reshape(batch),
            leverage=np.broadcast_to(leverage, (*per_system, n)).reshape(*batch, n),
            rank=rank.reshape(batch),
            **labels,
        )


def _checked_loss(loss: Loss) -> Loss:
    if not callable(getattr(loss, "weights", None)):
        raise ValueError(f"loss must have a method weights(u), got {loss!r}")
    return loss


def _name(loss: Loss) -> str:
    return repr(loss) if type(loss).__repr__ is not object.__repr__ else type(loss).__name__


def _start(problem: Problem, x0: ArrayLike) -> Floats:
    x = finite("x0", x0)
    wanted = (*problem.batch, problem.basis.shape[1])
    try:
        return problem.coordinates(np.broadcast_to(x, wanted).reshape(-1, wanted[-1]))
    except ValueError:
        raise ValueError(f"x0 must broadcast to {wanted}, got {x.shape}") from None


def _report(converged: NDArray[np.bool_], max_iter: int, on_fail: str) -> None:
    failed = int(np.count_nonzero(~converged))
    if not failed or on_fail == "ignore":
        return
    message = f"irls: {failed} of {converged.size} systems did not converge in {max_iter} iterations"
    if on_fail == "raise":
        raise RuntimeError(message)
    warnings.warn(f"{message}; their last iterate is kept, see .converged", RuntimeWarning, stacklevel=3)
