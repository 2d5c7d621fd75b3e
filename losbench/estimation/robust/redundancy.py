"""Designs with one redundant row, such as two spots for three angles: one system stands for all.

What least squares leaves over of any y is then a multiple of one vector. A scale made of residuals
takes the multiple out of them, so that every system is given the same weights, step by step, but
for its sign: IRLS is a linear function of y, and no outlier has a smaller weight than a common one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from losbench.arrays import Bools, Floats, Ints
from losbench.estimation.robust.iterate import Left, Method, finish, iterate
from losbench.estimation.robust.problem import ROUNDING, Problem

__all__ = ["iterate_as_one", "stands_for_all"]

_ABOVE_ROUNDING = 1e4  # leverage may stretch what rounding leaves over by as much


def stands_for_all(problem: Problem, method: Method) -> bool:
    """Whether the systems share a design with one redundant row, and make their scales of
    residuals.
    """
    rows = problem.y.shape[1]
    return len(problem.basis) == 1 and rows - problem.rank[0] == 1 and method.scale.proportional


def iterate_as_one(problem: Problem, method: Method) -> tuple[Floats, Ints, Bools, Left]:
    """As `iterate` and `finish` from least squares, for designs of which one `stands_for_all`.

    Solved are the two unit vectors along what least squares leaves over; every system is a multiple
    of one of them. Where they do not settle, or their scale is one of rounding, which is a multiple
    of nothing, each system takes its own steps.
    """
    normal = np.eye(problem.y.shape[1]) - problem.basis[0].T @ problem.basis[0]
    direction = normal[normal.diagonal().argmax()]
    direction = direction / np.sqrt(np.vecdot(direction, direction))
    both_ways = np.stack([direction, -direction])
    unit = replace(
        problem,
        y=both_ways,
        y_unit=np.ones(2),
        x_unit=np.ones(2),
        floor=np.full(2, ROUNDING),
        batch=(2,),
    )
    start = unit.least_squares()
    moved, n_iter, converged = iterate(unit, method, start)
    residuals, weights, scale = finish(unit, method, moved)
    least = np.minimum(scale, finish(unit, method, start)[2])

    multiple = problem.y @ both_ways.T
    np.maximum(multiple, 0.0, out=multiple)
    way = (multiple[:, 1] > 0.0).astype(np.intp)
    z, n_iter, converged = problem.least_squares(), n_iter[way], converged[way]
    z += multiple @ moved
    residuals, weights = multiple @ residuals, weights.take(way, axis=0)
    scale, least = multiple @ scale, multiple @ least
    rest = np.flatnonzero((least <= _ABOVE_ROUNDING * problem.floor) | ~converged)
    if rest.size:
        some = problem.part(rest)
        z[rest], n_iter[rest], converged[rest] = iterate(some, method, some.least_squares())
        residuals[rest], weights[rest], scale[rest] = finish(some, method, z[rest])
    return z, n_iter, converged, (residuals, weights, scale)
