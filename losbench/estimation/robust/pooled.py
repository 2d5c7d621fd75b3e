"""One scale for a whole batch: the systems are then no longer independent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from losbench.arrays import Bools, Floats, Ints
from losbench.estimation.robust.iterate import Method, iterate
from losbench.estimation.robust.problem import Problem, blocks

__all__ = ["iterate_pooled"]


def iterate_pooled(
    problem: Problem, method: Method, start: Floats
) -> tuple[Floats, Ints, Bools, Method]:
    """As `iterate`, with the scale of all systems made anew from all their residuals; and the
    method at that scale.

    Every round lets the systems settle at one scale, each from where it is and by its own shortest
    way. What their residuals then have in common falls as the scale rises: where the two are equal
    is sought by secants, which stay between scales known to be too small and too large. (To put the
    one for the other in every round may go back and forth for ever.)
    """
    z, n_iter = start, np.zeros(len(start), dtype=np.int64)
    settled, stable = np.zeros(len(start), dtype=bool), False
    size = _size(problem, method, z)
    low, high, last = 0.0, np.inf, (np.nan, np.nan)
    for _ in range(method.max_iter):
        z, steps, settled = iterate(problem, replace(method, scale=method.scale.at(size)), z)
        n_iter += steps
        excess = _size(problem, method, z) - size
        stable = abs(excess) <= max(method.tolerance * size, np.finfo(float).tiny)
        if stable:
            break
        low, high = (size, high) if excess > 0 else (low, size)
        slope = (excess - last[1]) / (size - last[0]) if size != last[0] else np.nan
        last, size = (size, excess), size - excess / (slope if slope < 0 else -1.0)
        if not low < size < high:
            size = 0.5 * (low + high) if high < np.inf else 2.0 * low
    return z, n_iter, settled & stable, replace(method, scale=method.scale.at(size))


def _size(problem: Problem, method: Method, z: Floats) -> float:
    """Root mean square of all residuals, in the user's unit."""
    total = 0.0
    for part in blocks(*problem.y.shape):
        some = problem.part(part)
        judged = method.judged(
            some.residuals(z[part]), np.arange(part.start, part.start + len(some.y))
        )
        total += float(np.sum(np.vecdot(judged, judged) * some.y_unit**2))
    return float(np.sqrt(total / problem.y.size))
