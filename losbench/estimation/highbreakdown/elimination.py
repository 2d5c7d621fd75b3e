"""Thousands of small symmetric systems solved in step, by the pivots they share.

Every operation runs over all systems at once; no row is exchanged, as the matrices are positive. A
system with a pivot that nearly vanishes is named, for somebody slower to look at.
"""

from __future__ import annotations

import numpy as np

from losbench.arrays import Bools, Floats
from losbench.estimation.robust.problem import Problem, places, products, spd_inverse, unused

__all__ = ["inverses", "misfits"]


_LEAST_PIVOT = 1e-6  # of the diagonal it was: what is left then has ten digits
_MANY = 256  # matrices; fewer are inverted faster one by one


def misfits(problem: Problem, weights: Floats) -> tuple[Floats, Bools]:
    """Sums (B, k) of the squared residuals that each subset leaves at its own fit, for weights (k,
    n) of 1 and 0; and which of the systems (B,) had no subset close to singular.

    With y as one column more, what elimination leaves in its corner is y'y less what the others
    explain: no fit is made for it.
    """
    count, n = problem.y.shape
    p = problem.basis.shape[1]
    columns = np.concatenate(
        [np.broadcast_to(problem.basis, (count, p, n)), problem.y[:, None]], axis=1
    )
    sums = products(columns) @ weights.T  # (B, packed, k)
    at = places(p + 1)
    inner = at[np.triu_indices(p)]
    sums[:, inner] += unused(np.broadcast_to(problem.rank, count), p)[..., None]
    safe: Bools = np.ones(count, dtype=bool)
    diagonal = sums[:, np.diagonal(at)[:p]].copy()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for j in range(p):
            pivot = sums[:, at[j, j]]
            safe &= (pivot > _LEAST_PIVOT * diagonal[:, j]).all(axis=1)
            for i in range(j + 1, p + 1):
                factor = sums[:, at[j, i]] / pivot
                for k in range(i, p + 1):
                    sums[:, at[i, k]] -= factor * sums[:, at[j, k]]
    return sums[:, at[p, p]], safe


def inverses(packed: Floats, p: int) -> Floats:
    """Inverses (N, p, p) of positive matrices given by their upper triangles (N, p (p + 1) / 2),
    as `spd_inverse` makes them.
    """
    if p <= 3 or len(packed) < _MANY:
        return spd_inverse(packed, p)
    at = places(p)
    swept = np.array(packed.T, order="C")  # a copy: it is worked on in place
    diagonal = swept[np.diagonal(at)].copy()
    safe: Bools = np.ones(len(packed), dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for k in range(p):
            safe &= swept[at[k, k]] > _LEAST_PIVOT * diagonal[k]
            share = 1.0 / swept[at[k, k]]
            others = [i for i in range(p) if i != k]
            for place, i in enumerate(others):
                part = swept[at[i, k]] * share
                for j in others[place:]:
                    swept[at[i, j]] -= part * swept[at[j, k]]
            for i in others:
                swept[at[i, k]] *= share
            swept[at[k, k]] = -share
    inverse = -swept[at].transpose(2, 0, 1)
    if not safe.all():
        inverse[~safe] = spd_inverse(packed[~safe], p)
    return inverse
