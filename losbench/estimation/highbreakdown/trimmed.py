"""Least trimmed squares: the half of the rows that agree best decides."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import comb

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammainc, gammaincinv

from losbench.arrays import Floats
from losbench.checks import choice, integer
from losbench.estimation.highbreakdown.mscale import MScale
from losbench.estimation.highbreakdown.search import (
    EXHAUSTIVE,
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
from losbench.estimation.robust.fit import ON_FAIL, as_fit, report_rank
from losbench.estimation.robust.problem import Problem, read_problem
from losbench.estimation.robust.result import RobustFit
from losbench.estimation.robust.scales import known_scale

__all__ = ["lts"]


_KEPT = 0.98758  # share of good units that reweighting keeps: 2.5 sigma for single rows
_BEST = 10  # candidates that concentration steps carry on with, of random starts
_LEAST = 3  # and of all subsets, which rounding may fail to tell apart
_STEPS = 100
_DROWNED = 1e-12  # of y'y: sums of squares below it are rounding, with more rows than a few


def lts(
    A: ArrayLike,
    y: ArrayLike,
    *,
    h: int | None = None,
    group: ArrayLike | None = None,
    scale: float | ArrayLike | None = None,
    starts: int | None = None,
    seed: Random = None,
    on_fail: str = "warn",
    rng: Random = None,
) -> RobustFit:
    """Solve A x = y by least trimmed squares, for one system or a batch, and refit without what it
    exposes.

    This is the call; `LTS` is the same choice as an object, to be handed on.

    Parameters
    ----------
    A : (n, p) or (..., n, p) array
        Design matrix, n >= p; one for all systems, or one each.
    y : (..., n) array
        Observations.
    h : int, optional
        Number of rows (groups, if grouped) that must fit; floor((m + q + 1) / 2) of m unless given,
        where q of them determine the unknowns: the choice that survives most bad ones.
    group : (n,) labels, optional
        Rows that are good or bad together, such as the x and y of a spot.
    scale : float or (...) array, unit of y, optional
        Standard deviation of a good row, if known; estimated otherwise.
    starts : int, optional
        Random starts, where there are too many subsets to try them all; 500 unless given, and more,
        up to 5000, from 14 unknowns on. See the notes for what they are good for.
    seed : int or Generator, optional
        Source of the random starts; the same ones every time unless given. ``rng`` is a second word
        for it.
    on_fail : "warn", "raise" or "ignore"
        What to do where A does not determine every unknown, as in `lstsq`.

    Returns
    -------
    RobustFit
        Least squares over the rows kept, ``weights`` 1 and 0. ``scale`` is the root mean square of
        their residuals with p taken off and cutting allowed for, ``cov`` = scale^2 (A'WA)^-1, which
        takes the choice of rows as given: the scatter on normal errors is larger, by 24 % at n = 40
        and 11 % at n = 200 with three unknowns.

    Raises
    ------
    ValueError
        If shapes disagree, n < p, a value is NaN or infinite, or ``h`` is too small or too large.

    Notes
    -----
    Minimises the sum of the h smallest squared residuals: over all subsets of h while they are at
    most 10 000, else by FAST-LTS, from subsets that just determine the unknowns by concentration
    steps (Rousseeuw and Van Driessen, Data Min. Knowl. Discov. 12, 29 (2006)). Rows beyond 2.5
    scales of that fit are left out of the final one; its scale is the M-scale of all residuals with
    a breakdown of one half, as in `mm`, which keeps its size in small samples.

    A random start is clean with a chance of about (1 - e)^q where a share e of the units is bad and
    q of them fix the unknowns. 500 starts hold a clean one with 99 % up to q = 13 at e = 0.3, up to
    q = 9 at e = 0.4 and q = 6 at e = 0.5; 5000 starts up to q = 19, 13 and 10. With more unknowns
    than that, nothing is promised: give more ``starts``.

    Examples
    --------
    >>> A = np.stack([np.ones(7), np.arange(7.0)], axis=-1)
    >>> fit = lts(A, [1.1, 2.9, 5.2, 6.9, 90.0, 91.0, 13.1])
    >>> fit.x.round(2)
    array([1.03, 2.01])
    >>> fit.weights
    array([1., 1., 1., 1., 0., 0., 1.])
    """
    problem = read_problem(A, y)
    report_rank(problem, choice("on_fail", on_fail, ON_FAIL))
    units = Units.read(group, problem.y.shape[1])
    rank, count = int(problem.rank.max()), len(units.sizes)
    needed, majority = units.needed(rank), units.majority(rank)
    h = majority if h is None else integer("h", h, low=needed, high=count)
    known = None if scale is None else known_scale(scale, problem)
    exact = comb(count, h) <= EXHAUSTIVE
    starts = default_starts(needed) if starts is None else integer("starts", starts, low=1)
    # What least squares leaves: the sums of squares that are compared then lose the fewest digits.
    start = problem.least_squares()
    left = replace(problem, y=-problem.residuals(start))
    candidates = partial(
        _candidates, units=units, h=h, starts=starts, source=random_source(seed, rng), exact=exact
    )
    best, objective = candidates(left)
    drowned = objective.min(axis=1) <= _DROWNED * np.vecdot(left.y, left.y)
    if exact and drowned.any():
        # Rows that are off by a million scales leave the sums no digits to differ in: look again,
        # from the best of them, which has thrown the worst rows out.
        nearest = least(best, objective, 1)[0][:, 0]
        start = start + np.where(drowned[:, None], nearest, 0.0)
        left = replace(problem, y=-problem.residuals(start))
        best, _ = candidates(left)
    parts = []
    for part in chunks(len(start), best.shape[1] * left.basis.shape[2]):
        search = Search(left.part(part))
        z = _settled(search, best[part], units, h)
        given = None if known is None else known(z, np.arange(len(start))[part])
        parts.append(_reweighted(search, z, units, given, h=h, survive=count - max(h, majority)))
    z, weights, working, cov = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    z += start
    return as_fit(
        problem,
        z,
        (problem.residuals(z), weights, working, cov),
        n_iter=np.zeros(len(z), dtype=np.int64),
        converged=np.ones(len(z), dtype=bool),
        loss=f"least trimmed squares, h = {h} of {count}, reweighted",
        scale_method="sqrt(RSS/dof) of the rows kept" if known is None else "given",
        group=None if units.groups is None else units.groups.labels,
    )


def _candidates(
    problem: Problem,
    units: Units,
    h: int,
    *,
    starts: int,
    source: np.random.Generator,
    exact: bool,
) -> tuple[Floats, Floats]:
    """A few coordinates (B, k, p) to refine, with what they leave."""
    count, needed = len(units.sizes), units.needed(int(problem.rank.max()))
    tried, some = thinned(problem, units, source) if count > LONG else (problem, units)
    blocks = some.choose(
        h if exact else needed,
        most=max(EXHAUSTIVE if exact else 0, starts),
        starts=starts,
        rng=source,
        columns=problem.basis.shape[1],
    )
    enough = max(needed, -(-h * len(some.sizes) // count))
    return least_of_subsets(
        tried,
        blocks,
        partial(_tried, units=some, h=enough, exact=exact),
        count=_LEAST if exact else _BEST,
        numbers=_numbers(tried, exact=exact),
    )


def _tried(
    search: Search, subsets: Subsets, units: Units, h: int, *, exact: bool
) -> tuple[Floats, Floats]:
    """Candidates (B, k, p) and what they leave: subsets of h units themselves, if exact, or starts
    after two refits.
    """
    if exact:
        return subsets.best(search, _LEAST)
    z = subsets.fits(search)
    for _ in range(2):
        z = search.fits(_kept(search, z, units, h))
    return z, _trimmed(search, z, units, h)


def _numbers(problem: Problem, *, exact: bool) -> int:
    """Numbers held at once for each candidate."""
    p = problem.basis.shape[1]
    if not exact:
        return problem.basis.shape[2]
    return p if len(problem.basis) == 1 else (p + 1) * (p + 2) // 2


def _settled(search: Search, z: Floats, units: Units, h: int) -> Floats:
    """Coordinates (B, p) of the best candidate where refitting changes nothing any more."""
    for _ in range(_STEPS):
        before, z = z, search.fits(_kept(search, z, units, h))
        if np.array_equal(before, z):
            break
    return least(z, _trimmed(search, z, units, h), 1)[0][:, 0]


def _kept(search: Search, z: Floats, units: Units, h: int) -> Floats:
    """Weights (B, k, n): 1 for the rows of the h units that fit best."""
    sizes = units.sums(search.residuals(z) ** 2)
    chosen = np.argpartition(sizes, h - 1, axis=-1)[..., :h]
    weights = np.zeros(sizes.shape)
    np.put_along_axis(weights, chosen, 1.0, axis=-1)
    return units.spread(weights)


def _trimmed(search: Search, z: Floats, units: Units, h: int) -> Floats:
    """Sum (B, k) of the h smallest squared sizes of the units."""
    return np.partition(units.sums(search.residuals(z) ** 2), h - 1, axis=-1)[..., :h].sum(axis=-1)


def _reweighted(
    search: Search, z: Floats, units: Units, given: Floats | None, *, h: int, survive: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Final coordinates, weights and scale, scaled, and the covariance in the user's units."""
    problem, residuals = search.problem, search.residuals(z[:, None])
    first = given
    if first is None:
        measure = MScale(problem, units, survive)
        first = measure.better(residuals, measure.start(residuals))[:, 0]
    first = np.maximum(first, problem.floor)
    with np.errstate(over="ignore"):
        sizes = units.sums((residuals[:, 0] / first[:, None]) ** 2) / units.sizes
    limit = 2.0 * gammaincinv(0.5 * units.sizes, _KEPT) / units.sizes
    trimmed = _kept(search, z[:, None], units, h)[:, 0]
    # The h that were found to fit are kept whatever the cut says of them.
    weights = np.maximum(units.spread((sizes <= limit).astype(np.float64)), trimmed)
    z = search.fits(weights[:, None])[:, 0]
    residuals = problem.residuals(z)
    dof = weights.sum(axis=1) - problem.rank
    spread = np.sqrt(
        np.vecdot(weights, residuals**2) / np.maximum(dof, 1.0) / _truncated(_KEPT, units.rows)
    )
    scale = np.maximum(spread if given is None else given, problem.floor)
    size = np.where(dof > 0, scale, np.nan) if given is None else scale
    return z, weights, scale, search.covariance(weights, size)


def _truncated(share: float, rows: int) -> float:
    """Mean square per row of the ``share`` of units of ``rows`` standard normal errors that are
    smallest.
    """
    half = float(gammaincinv(0.5 * rows, share))
    return float(gammainc(0.5 * rows + 1.0, half)) / share
