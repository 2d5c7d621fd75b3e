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


def stands_for_all(problem: Problem, method: Method) -> bool:
    """Whether the systems share a design with one redundant row, and make their scales of
    residuals.
    """
    rows = problem.y.shape[1]
    return len(problem.basis) == 1 and rows - problem.rank[0] == 1 and method.scale.proportional


def iterate_as_one(problem: Problem, method: Method) -> tuple[Floats, Ints, Bools, Left]:
    """As `iterate` and `finish` from least squares, for designs of which one `stands_for_all`."""
    over = np.eye(problem.y.shape[1]) - problem.basis[0].T @ problem.basis[0]
    over = over[over.diagonal().argmax()]
    over = over / np.sqrt(np.vecdot(over, over))
    both = np.stack([over, -over])
    unit = replace(
        problem,
        y=both,
        y_unit=np.ones(2),
        x_unit=np.ones(2),
        floor=np.full(2, ROUNDING),
        batch=(2,),
    )
    moved, n_iter, converged = iterate(unit, method, unit.least_squares())
    residuals, weights, scale = finish(unit, method, moved)

    size = problem.y @ both.T
    np.maximum(size, 0.0, out=size)
    sign = (size[:, 1] > 0.0).astype(np.intp)
    z, n_iter, converged = problem.least_squares(), n_iter[sign], converged[sign]
    z += size @ moved
    residuals, weights, scale = size @ residuals, weights.take(sign, axis=0), size @ scale
    # What is left over of these is of the size of rounding, which is no multiple of anything.
    rest = np.flatnonzero(scale <= problem.floor)
    if rest.size:
        some = problem.part(rest)
        z[rest], n_iter[rest], converged[rest] = iterate(some, method, some.least_squares())
        residuals[rest], weights[rest], scale[rest] = finish(some, method, z[rest])
    return z, n_iter, converged, (residuals, weights, scale)
