"""How many bad observations a design survives, before any is taken; and how bad ones hide each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.checks import finite
from losbench.estimation.highbreakdown.search import Units
from losbench.estimation.robust.problem import read_problem
from losbench.estimation.robust.result import RobustFit

__all__ = ["DesignBreakdown", "deletion_residuals", "design_breakdown"]

Floats = NDArray[np.float64]

_SUBSETS = 20_000
_DIRECTIONS = 4000
_POLISHED = 40
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
        Bad units that every M-estimate with a monotone psi (Huber) and a known scale survives, wherever they are.
    any : int
        Bad units that some regression equivariant estimate survives: LTS does.
    shares : (units + 1,) array
        Largest part of the pull that k = 0 .. units bad ones can have in any direction; below 1/2 is survived.
    direction : (p,) array
        Where the first k that is too much does its work: the combination of unknowns that it can carry away.
    """

    units: int
    monotone: int
    any: int
    shares: Floats
    direction: Floats


def design_breakdown(A: ArrayLike, *, group: ArrayLike | None = None) -> DesignBreakdown:
    """Count the bad observations that a design survives, for monotone M-estimates and for any estimate.

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
        If ``A`` is no matrix with n >= p, or is not finite.

    Notes
    -----
    k bad units are survived by a monotone M-estimate if in every direction d of the unknowns the k largest of |A_g d|
    make less than half of their sum (Ellis and Morgenthaler, J. Amer. Statist. Assoc. 87, 143 (1992)); by any estimate
    if k <= (m - N - 1) / 2, with N the most units that one direction leaves untouched (Mizera and Mueller, J. Statist.
    Plann. Inference 80, 231 (1999)). The worst direction is exact for single rows while there are at most 20 000
    subsets of p - 1 of them, and searched for otherwise.

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
    rows, units = np.ascontiguousarray(problem.basis[0].T), Units.read(group, len(matrix))
    rng = np.random.default_rng(0)
    still = np.array(list(_null_directions(rows, units, rng))).reshape(-1, rows.shape[1])
    random = rng.standard_normal((_DIRECTIONS, rows.shape[1]))
    directions = _unit(np.concatenate([still, random]))
    pulls = _pulls(rows, units, directions)
    untouched = int((pulls < _ZERO * pulls.max()).sum(axis=1).max())
    shares, worst = _greatest_shares(rows, units, directions, rng)
    monotone = int(np.flatnonzero(shares < 0.5 - _ZERO).max())
    return DesignBreakdown(
        units=len(units.sizes),
        monotone=monotone,
        any=max(0, (len(units.sizes) - untouched - 1) // 2),
        shares=shares,
        direction=problem.to_x[0] @ worst[monotone + 1],
    )


def deletion_residuals(fit: RobustFit) -> Floats:
    """Externally studentised residuals of least squares: how far each row is from what all others say, (..., n).

    The classical hunt for outliers, one row at a time; two bad rows that vouch for each other pass it.

    Parameters
    ----------
    fit : RobustFit
        From `lstsq`.

    Returns
    -------
    (..., n) array
        Student's t with dof - 1 degrees of freedom for a good row among good ones; infinite where the others fit
        perfectly, NaN where a row fixes an unknown alone.

    Notes
    -----
    t = r / (s_(i) sqrt(1 - h)), with s_(i) made without the row (Belsley, Kuh and Welsch 1980, eq. 2.26).

    Examples
    --------
    >>> import losbench as lb
    >>> deletion_residuals(lb.lstsq(np.ones((5, 1)), [1.0, 1.1, 0.9, 1.0, 8.0])).round(1)
    array([-0.4, -0.4, -0.5, -0.4, 76.7])
    """
    free = 1.0 - fit.leverage
    with np.errstate(divide="ignore", invalid="ignore"):
        own = fit.residuals**2 / free
        others = np.maximum((fit.residuals**2).sum(axis=-1, keepdims=True) - own, 0.0) / (fit.dof[..., None] - 1)
        return -fit.residuals / np.sqrt(others * free)


def _null_directions(rows: Floats, units: Units, rng: np.random.Generator) -> Iterator[Floats]:
    """Directions (p,) that leave as many units untouched as a direction can: those that a few units do not fix."""
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


def _greatest_shares(rows: Floats, units: Units, directions: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Largest share (m + 1,) of k units in the pull, with its direction (m + 1, p), after a random walk uphill."""
    shares = _shares(_pulls(rows, units, directions))
    at, best = directions[shares.argmax(axis=0)], shares.max(axis=0)
    for reach in np.geomspace(0.3, 1e-6, _ROUNDS):
        trial = _unit(at[:, None] + reach * rng.standard_normal((len(at), _POLISHED, at.shape[1])))
        found = _shares(_pulls(rows, units, trial))[np.arange(len(at)), :, np.arange(len(at))]
        winner = found.argmax(axis=1)
        better = found.max(axis=1) > best
        at = np.where(better[:, None], trial[np.arange(len(at)), winner], at)
        best = np.where(better, found.max(axis=1), best)
    return best, at


def _pulls(rows: Floats, units: Units, directions: Floats) -> Floats:
    """Size of what each unit sees of each direction, (..., p) -> (..., m)."""
    return np.sqrt(units.sums((directions @ rows.T) ** 2))


def _shares(pulls: Floats) -> Floats:
    """Part of the pull that the k largest have, (..., m) -> (..., m + 1)."""
    running = np.cumsum(-np.sort(-pulls, axis=-1), axis=-1)
    return np.concatenate([np.zeros((*pulls.shape[:-1], 1)), running / running[..., -1:]], axis=-1)


def _unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
