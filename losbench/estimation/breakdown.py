"""How many bad observations a design survives, before any is taken; and how bad ones hide each
other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats, Ints
from losbench.checks import finite
from losbench.estimation.highbreakdown.search import Units
from losbench.estimation.robust.problem import read_problem
from losbench.estimation.robust.result import RobustFit

__all__ = ["DesignBreakdown", "deletion_residuals", "design_breakdown"]


_SUBSETS = 20_000
_DIRECTIONS = 4000
_CLIMBERS = 6000  # climbs, shared by all numbers of bad units
_FEW, _MANY = 8, 150  # and at least and at most so many for each
_ROUNDS = 60
_ZERO = 1e-9


@dataclass(frozen=True)
class DesignBreakdown:
    """What a design survives.

    Attributes
    ----------
    units : int
        Rows, or groups of rows, of the design.
    monotone : int
        Bad units that every M-estimate with a monotone psi (Huber) and a known scale survives,
        wherever they are.
    any : int
        Bad units that some regression equivariant estimate survives: LTS does.
    shares : (units + 1,) array
        Largest part of the pull that k = 0 .. units bad ones can have in any direction, as far as
        it was found; below 1/2 is survived.
    direction : (p,) array
        Where the first k that is too much does its work: the combination of unknowns that it can
        carry away.
    """

    units: int
    monotone: int
    any: int
    shares: Floats
    direction: Floats


def design_breakdown(A: ArrayLike, *, group: ArrayLike | None = None) -> DesignBreakdown:
    """Count the bad observations that a design survives, for monotone M-estimates and for any
    estimate.

    Parameters
    ----------
    A : (n, p) array
        Design matrix.
    group : (n,) labels, optional
        Rows that are bad together, such as the x and y of a spot.

    Returns
    -------
    DesignBreakdown

    Raises
    ------
    ValueError
        If ``A`` is no matrix of full rank with n >= p, or is not finite.

    Notes
    -----
    k bad units are survived by a monotone M-estimate if in every direction d of the unknowns the k
    largest of ``|A_g d|`` make less than half of their sum (Ellis and Morgenthaler, J. Amer.
    Statist. Assoc. 87, 143 (1992)); by any estimate if k <= (m - N - 1) / 2, with N the most units
    that one direction leaves untouched (Mizera and Mueller, J. Statist. Plann. Inference 80, 231
    (1999)).

    For single rows, of which at most 20 000 subsets of p - 1 exist, both numbers are exact: the
    worst direction then leaves p - 1 rows untouched, and all of those are tried. Otherwise they are
    the result of a search, which may miss the worst direction and so claim too much, never too
    little: of shares by climbs from the best of many directions (to six digits, where another
    method was tried), of N among the directions that a few units, drawn at random where they are
    many, leave free.

    Examples
    --------
    A straight line through eleven equidistant points, and with one of them far out:

    >>> x = np.arange(11.0)
    >>> even = design_breakdown(np.stack([np.ones(11), x], axis=-1))
    >>> x[10] = 100.0
    >>> lever = design_breakdown(np.stack([np.ones(11), x], axis=-1))
    >>> (even.monotone, even.any), (lever.monotone, lever.any)
    ((2, 4), (0, 4))
    """
    matrix = finite("A", A, ndim=2)
    problem = read_problem(matrix, np.zeros(len(matrix)))
    if problem.rank[0] < matrix.shape[1]:
        raise ValueError(
            f"A must determine all {matrix.shape[1]} unknowns, got a matrix of rank "
            f"{problem.rank[0]}"
        )
    rows, units = np.ascontiguousarray(problem.basis[0].T), Units.read(group, len(matrix))
    rng = np.random.default_rng(0)
    still = np.array(list(_null_directions(rows, units, rng))).reshape(-1, rows.shape[1])
    random = rng.standard_normal((_DIRECTIONS, rows.shape[1]))
    directions = _unit(np.concatenate([still, random]))
    pulls = _pulls(rows, units, directions)
    untouched = int((pulls < _ZERO * pulls.max()).sum(axis=1).max())
    shares, worst = _greatest_shares(rows, units, directions)
    monotone = int(np.argmax(shares >= 0.5 - _ZERO)) - 1
    return DesignBreakdown(
        units=len(units.sizes),
        monotone=monotone,
        any=max(0, (len(units.sizes) - untouched - 1) // 2),
        shares=shares,
        direction=problem.to_x[0] @ worst[monotone + 1],
    )


def deletion_residuals(fit: RobustFit) -> Floats:
    """Externally studentised residuals of least squares: how far each row is from what all others
    say, (..., n).

    The classical hunt for outliers, one row at a time; two bad rows that vouch for each other pass
    it.

    Parameters
    ----------
    fit : RobustFit
        From `lstsq`.

    Returns
    -------
    (..., n) array
        Student's t with dof - 1 degrees of freedom for a good row among good ones; infinite where
        the others fit perfectly, NaN where a row fixes an unknown alone.

    Notes
    -----
    t = r / (s_(i) sqrt(1 - h)), with s_(i) made without the row (Belsley, Kuh and Welsch 1980, eq.
    2.26).

    Examples
    --------
    >>> import losbench as lb
    >>> deletion_residuals(lb.lstsq(np.ones((5, 1)), [1.0, 1.1, 0.9, 1.0, 8.0])).round(1)
    array([-0.4, -0.4, -0.5, -0.4, 76.7])
    """
    free = 1.0 - fit.leverage
    with np.errstate(divide="ignore", invalid="ignore"):
        own = fit.residuals**2 / free
        others = np.maximum((fit.residuals**2).sum(axis=-1, keepdims=True) - own, 0.0) / (
            fit.dof[..., None] - 1
        )
        return -fit.residuals / np.sqrt(others * free)


def _null_directions(rows: Floats, units: Units, rng: np.random.Generator) -> Iterator[Floats]:
    """Directions (p,) that leave as many units untouched as a direction can: those that a few units
    do not fix.
    """
    p, count = rows.shape[1], len(units.sizes)
    labels = units.spread(np.arange(float(count)))
    for size in range(max(1, units.needed(p) - 1), p):
        if comb(count, size) <= _SUBSETS:
            chosen: Iterator[tuple[int, ...]] = combinations(range(count), size)
        else:
            chosen = (tuple(rng.choice(count, size, replace=False)) for _ in range(_SUBSETS))
        for some in chosen:
            _, singular, right = np.linalg.svd(rows[np.isin(labels, some)])
            if len(singular) < p or singular[-1] < _ZERO:
                yield right[-1]


def _greatest_shares(rows: Floats, units: Units, directions: Floats) -> tuple[Floats, Floats]:
    """Largest share (m + 1,) of k units in the pull, with its direction (m + 1, p), after climbs
    from the best few.
    """
    shares, bad = _shares(_pulls(rows, units, directions)), np.arange(len(units.sizes) + 1)
    climbers = int(np.clip(_CLIMBERS // len(bad), _FEW, _MANY))
    at = directions[np.argsort(-shares, axis=0, kind="stable")[:climbers]]
    ahead = at
    for _ in range(_ROUNDS):
        ahead = _climbed(rows, units, ahead, bad)
    at = np.concatenate([at, ahead])
    own = _shares(_pulls(rows, units, at))[:, bad, bad]
    best, worst = np.append(0.0, own.max(axis=0)[1:]), at[own.argmax(axis=0), bad]
    # What k units can do, k + 1 can: the share never falls, and neither does what was found of it.
    source = np.maximum.accumulate(np.where(best >= np.maximum.accumulate(best), bad, 0))
    return best[source], worst[source]


def _climbed(rows: Floats, units: Units, at: Floats, bad: Ints) -> Floats:
    """Directions (s, m + 1, p) in which as many units as are ``bad`` have no smaller a share than
    in ``at``.

    With S those of the greatest pull, the pull of S is convex in d and so at least c'd, c being its
    gradient; that of the others falls when d goes to M^-1 c, with M their normal matrix weighted by
    one over their pulls (Weiszfeld).
    """
    seen = at @ rows.T
    pulls = np.sqrt(units.sums(seen**2))
    floor = 1e-10 * pulls.max(axis=-1, keepdims=True)
    chosen = np.zeros(pulls.shape)
    first = np.broadcast_to(np.arange(pulls.shape[-1]) < bad[:, None], pulls.shape)
    np.put_along_axis(chosen, np.argsort(-pulls, axis=-1), first, axis=-1)
    weights = units.spread(1.0 / np.maximum(pulls, floor))
    own = units.spread(chosen) * weights
    gradient = (own * seen) @ rows
    p = rows.shape[1]
    outer = (rows[:, :, None] * rows[:, None]).reshape(len(rows), p * p)
    others = ((weights - own) @ outer).reshape(*at.shape, p)
    scale = np.trace(others, axis1=-2, axis2=-1)[..., None, None]
    others += np.where(scale > 0.0, 1e-13 * scale, 1.0) * np.eye(p)
    ahead = np.asarray(np.linalg.solve(others, gradient[..., None])[..., 0], dtype=np.float64)
    return np.where(np.any(ahead != 0.0, axis=-1, keepdims=True), _unit(ahead), at)


def _pulls(rows: Floats, units: Units, directions: Floats) -> Floats:
    """Size of what each unit sees of each direction, (..., p) -> (..., m)."""
    return np.sqrt(units.sums((directions @ rows.T) ** 2))


def _shares(pulls: Floats) -> Floats:
    """Part of the pull that the k largest have, (..., m) -> (..., m + 1)."""
    running = np.cumsum(-np.sort(-pulls, axis=-1), axis=-1)
    return np.concatenate([np.zeros((*pulls.shape[:-1], 1)), running / running[..., -1:]], axis=-1)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)
