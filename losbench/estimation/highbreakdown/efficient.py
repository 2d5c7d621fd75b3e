"""MM-estimates: a start that survives anything, then a step that wastes nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import integer, number
from losbench.estimation.highbreakdown.mscale import MScale
from losbench.estimation.highbreakdown.search import (
    LONG,
    Random,
    Search,
    Subsets,
    Units,
    chunks,
    default_starts,
    least,
    least_of_subsets,
    random_source,
    thinned,
)
from losbench.estimation.influence import tuned
from losbench.estimation.losses import Bisquare
from losbench.estimation.robust.fit import irls
from losbench.estimation.robust.problem import Problem, read_problem
from losbench.estimation.robust.result import RobustFit
from losbench.estimation.robust.scales import known_scale

__all__ = ["mm"]


_BEST = 5
_RANKED, _LONG_BEST = 50, 3
_STEPS = 100
_SETTLED = 1e-6  # the least scale is flat in the coordinates: twelve digits of it
_ALL = 1000  # subsets that are all tried rather than drawn from


def mm(
    A: ArrayLike,
    y: ArrayLike,
    *,
    efficiency: float = 0.95,
    group: ArrayLike | None = None,
    scale: float | ArrayLike | None = None,
    starts: int | None = None,
    seed: Random = None,
    on_fail: str = "warn",
    rng: Random = None,
) -> RobustFit:
    """Solve A x = y by an MM-estimate: breakdown of one half, and the efficiency of choice, for one
    system or a batch.

    This is the call; `MM` is the same choice as an object, to be handed on.

    Parameters
    ----------
    A : (n, p) or (..., n, p) array
        Design matrix, n >= p; one for all systems, or one each.
    y : (..., n) array
        Observations.
    efficiency : float
        On normal errors, against least squares.
    group : (n,) labels, optional
        Rows that are good or bad together, such as the x and y of a spot.
    scale : float or (...) array, unit of y, optional
        Standard deviation of a good row, if known; that of the S-estimate otherwise.
    starts : int, optional
        Random starts, where there are more than 1000 subsets; 500 unless given, and more, up to
        5000, from 14 unknowns on. The notes of `lts` say what they are good for.
    seed : int or Generator, optional
        Source of the random starts; the same ones every time unless given. ``rng`` is a second word
        for it.
    on_fail : "warn", "raise" or "ignore"
        What to do where the last act does not settle, or A does not determine every unknown, as in
        `irls`.

    Returns
    -------
    RobustFit
        ``scale`` is the frozen one. ``cov`` is, with R's kappa as in `irls`, kappa^2 sum psi^2 / (n
        - p) / m^2 times mean(w) (A'WA)^-1, so that rows that were thrown out lend it no leverage;
        at a known scale as that of `irls`.

    Raises
    ------
    ValueError
        If shapes disagree, n < p, a value is NaN or infinite, or the efficiency is not one the
        bisquare can have.

    Notes
    -----
    Yohai, Ann. Statist. 15, 642 (1987), in three acts: (1) the S-estimate, the fit whose scale s,
    the solution of sum rho(r / s) = (n - p) rho(inf) / 2, is the least (Rousseeuw and Yohai 1984),
    found from subsets that just determine the unknowns (Salibian-Barrera and Yohai 2006); (2) its
    scale is frozen; (3) `irls` from there with Tukey's bisquare of the efficiency asked for, 4.685
    for 95 %. With 95 % as R's robustbase::lmrob.

    Examples
    --------
    >>> A = np.stack([np.ones(7), np.arange(7.0)], axis=-1)
    >>> mm(A, [1.1, 2.9, 5.2, 6.9, 90.0, 91.0, 13.1]).x.round(2)
    array([1.03, 2.01])
    """
    problem = read_problem(A, y)
    units = Units.read(group, problem.y.shape[1])
    loss = tuned(Bisquare(), number("efficiency", efficiency, low=0.0, high=1.0), rows=units.rows)
    count = None if starts is None else integer("starts", starts, low=1)
    start, size = _s_estimate(problem, units, count, random_source(seed, rng))
    if scale is not None:
        size = known_scale(scale, problem)(size[:, None], np.arange(len(size)))
    size = (size * problem.y_unit).reshape(problem.batch)
    x0 = problem.unknowns(start).reshape(*problem.batch, -1)
    # In units of the frozen scale, which `irls` would otherwise make anew.
    with np.errstate(over="ignore", under="ignore"):
        fit = irls(
            A,
            np.asarray(y, dtype=np.float64) / size[..., None],
            loss=loss,
            scale=1.0,
            group=group,
            x0=x0 / size[..., None],
            max_iter=1000,
            on_fail=on_fail,
        )
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return replace(
            fit,
            x=fit.x * size[..., None],
            residuals=fit.residuals * size[..., None],
            scale=fit.scale * size,
            cov=_covariance(problem, units, fit, loss, size)
            if scale is None
            else fit.cov * (size**2)[..., None, None],
            loss=f"MM, bisquare of {100.0 * efficiency:g} %",
            scale_method="S" if scale is None else "given",
        )


def _covariance(
    problem: Problem, units: Units, fit: RobustFit, loss: Bisquare, size: Floats
) -> Floats:
    """Covariance in the user's units; the fit is in units of its scale (...)."""
    n = fit.residuals.shape[-1]
    residuals, weights = fit.residuals.reshape(-1, n), fit.weights.reshape(-1, n)
    rms = np.sqrt(units.sums(residuals**2) / units.sizes)
    slope = units.spread(loss.psi_deriv(rms))
    rows = units.spread(units.sizes.astype(np.float64))
    slope = weights + (slope - weights) / rows
    mean, rank = slope.mean(axis=1), fit.rank.reshape(-1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        kappa = 1.0 + rank * slope.var(axis=1) / max(n - 1, 1) / mean**2
        spread = np.sqrt(
            np.vecdot(weights * residuals, weights * residuals) / (n - rank) * weights.mean(axis=1)
        )
        scaled = spread * kappa / mean * size.reshape(-1) / problem.y_unit
    cov = Search(problem).covariance(weights, np.where(rank < n, scaled, np.nan))
    return cov.reshape(*problem.batch, *cov.shape[1:])


def _s_estimate(
    problem: Problem, units: Units, starts: int | None, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Coordinates (B, p) and scaled scale (B,) of the S-estimate."""
    count, p, n = len(problem.y), *problem.basis.shape[1:]
    needed = units.needed(int(problem.rank.max()))
    starts = default_starts(needed) if starts is None else starts
    if len(units.sizes) > LONG:
        z, size = _best_of_long(problem, units, starts, rng)
    else:
        blocks = units.choose(needed, most=max(_ALL, starts), starts=starts, rng=rng, columns=p)
        z, size = least_of_subsets(
            problem, blocks, partial(_tried, units=units), count=_BEST, numbers=n
        )
    parts = []
    for part in chunks(count, z.shape[1] * n):
        search = Search(problem.part(part))
        parts.append(_downhill(search, z[part], size[part], MScale(search.problem, units)))
    z, size = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return z[:, 0], size[:, 0]


def _tried(search: Search, subsets: Subsets, units: Units) -> tuple[Floats, Floats]:
    """Candidates (B, k, p) after one step, with their scales, roughly."""
    z, measure = subsets.fits(search), MScale(search.problem, units)
    z, size = measure.step(search, z, measure.start(search.residuals(z)))
    return z, measure.better(search.residuals(z), size, rounds=2)


def _best_of_long(
    problem: Problem, units: Units, starts: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Candidates (B, k, p) of long systems and their scales (B, k): many ranked on few rows by
    their median residual, some of them improved there, the best of these on all rows.
    """
    count, p = len(problem.y), problem.basis.shape[1]
    thin, some = thinned(problem, units, rng)
    needed = some.needed(int(problem.rank.max()))
    blocks = some.choose(needed, most=0, starts=starts, rng=rng, columns=p)
    z, size = least_of_subsets(
        thin, blocks, partial(_ranked, units=some), count=_RANKED, numbers=thin.y.shape[1]
    )
    for stage, members, kept in ((thin, some, 2 * _BEST), (problem, units, _LONG_BEST)):
        parts = []
        for part in chunks(count, z.shape[1] * stage.y.shape[1]):
            search = Search(stage.part(part))
            measure = MScale(search.problem, members)
            at, scale = z[part], measure.start(search.residuals(z[part]))
            for _ in range(2):
                at, scale = measure.step(search, at, scale)
            parts.append(least(at, measure.better(search.residuals(at), scale, rounds=2), kept))
        z, size = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return z, size


def _ranked(search: Search, subsets: Subsets, units: Units) -> tuple[Floats, Floats]:
    """Candidates (B, k, p) as they are, with the median of what they leave."""
    z = subsets.fits(search)
    return z, MScale(search.problem, units).start(search.residuals(z))


def _downhill(search: Search, z: Floats, size: Floats, measure: MScale) -> tuple[Floats, Floats]:
    """Follow a few candidates (B, k, p) downhill; coordinates (B, 1, p) and scale (B, 1) of the
    lowest place.
    """
    # Steps with a scale that is one fixed-point step old: both settle together.
    for _ in range(_STEPS):
        before, (z, size) = z, measure.step(search, z, size)
        moved = np.abs(z - before).max(axis=-1)
        if (moved <= _SETTLED * np.maximum(size, np.abs(z).max(axis=-1))).all():
            break
    z, size = least(z, measure.better(search.residuals(z), size, rounds=20), 1)
    return z, measure.better(search.residuals(z), size, rounds=_STEPS)
