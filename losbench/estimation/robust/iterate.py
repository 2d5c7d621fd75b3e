"""The reweighting loop, over a pool of systems that is refilled as they settle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.estimation.losses import Loss
from losbench.estimation.robust.problem import Problem, blocks, combine, products, project, spd_inverse, unused
from losbench.estimation.robust.scales import ScaleRule

__all__ = ["Groups", "Method", "iterate"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Groups:
    """Rows that share a weight."""

    labels: Indices  # (n,), 0 .. number of groups - 1
    order: Indices  # rows sorted by group
    first: Indices  # where each group begins in that order
    sizes: Indices  # (n,), number of rows in each row's group

    @classmethod
    def read(cls, group: ArrayLike, n: int) -> Groups:
        """Check labels (n,)."""
        given = np.asarray(group)
        if given.shape != (n,):
            raise ValueError(f"group must have shape ({n},) to match the {n} rows of A, got {given.shape}")
        _, labels, counts = np.unique(given, return_inverse=True, return_counts=True)
        order = np.argsort(labels, kind="stable")
        return cls(labels, order, np.cumsum(counts) - counts, counts[labels])

    def rms(self, residuals: Floats) -> Floats:
        """Root mean square of each row's group, (b, n)."""
        total = np.add.reduceat(residuals[:, self.order] ** 2, self.first, axis=1)
        return np.sqrt(total[:, self.labels] / self.sizes)


@dataclass(frozen=True)
class Method:
    """How to reweight, and when to stop."""

    loss: Loss
    scale: ScaleRule
    groups: Groups | None
    max_iter: int
    tol: float

    def scaled(self, residuals: Floats, scale: Floats) -> Floats:
        """What the loss sees of each row, (b, n)."""
        size = residuals if self.groups is None else self.groups.rms(residuals)
        return size / scale[:, None]


def iterate(problem: Problem, method: Method, start: Floats) -> tuple[Floats, NDArray[np.int64], NDArray[np.bool_]]:
    """Coordinates (B, p) where each system settled, its number of weighted solves, and whether it did settle."""
    count, p = start.shape
    z, n_iter, converged = start.copy(), np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    queue = _Queue(problem, start)
    pool = queue.take(count)
    while pool is not None and len(pool.systems):
        step, scale = _step(pool, method)
        pool.z -= step
        pool.age += 1
        reach = np.maximum(np.vecdot(pool.z, pool.z), p * scale**2)
        settled = np.vecdot(step, step) <= method.tol**2 * reach
        done = settled | (pool.age == method.max_iter)
        places = np.flatnonzero(done)
        if len(places):
            out = pool.systems[places]
            z[out], n_iter[out], converged[out] = pool.z[places], pool.age[places], settled[places]
            pool = _refill(pool, places, queue)
    return z, n_iter, converged


def _step(pool: _Pool, method: Method) -> tuple[Floats, Floats]:
    """One weighted solve: what to subtract from the coordinates (b, p), and the scale (b,) it used."""
    residuals = combine(pool.z, pool.basis) - pool.y
    scale = np.maximum(method.scale(residuals, pool.systems), pool.floor)
    weights = method.loss.weights(method.scaled(residuals, scale))
    inverse = spd_inverse(project(pool.products, weights) + pool.unused, pool.z.shape[1])
    return np.matvec(inverse, project(pool.basis, weights * residuals)), scale


@dataclass
class _Pool:
    """Systems at work; arrays of A lead with 1 where all share one A."""

    systems: Indices  # (b,), their places in the batch
    age: NDArray[np.int64]  # (b,), weighted solves so far
    z: Floats  # (b, p)
    y: Floats  # (b, n)
    floor: Floats  # (b,)
    basis: Floats  # (b or 1, p, n)
    products: Floats  # (b or 1, p (p + 1) / 2, n)
    unused: Floats  # (b or 1, p (p + 1) / 2)

    def rows(self, which: slice | NDArray[np.bool_]) -> _Pool:
        """Some of the systems."""
        count = len(self.systems)
        return _Pool(*(mine[which] if len(mine) == count else mine for mine in vars(self).values()))


class _Queue:
    """Systems still to come, made ready a block at a time."""

    def __init__(self, problem: Problem, start: Floats) -> None:
        self._blocks = (_load(problem, start, part) for part in blocks(*problem.y.shape))
        self._ready = next(self._blocks, None)

    def take(self, count: int) -> _Pool | None:
        """Up to ``count`` systems, fewer where a block ends, None where the queue does."""
        if self._ready is None:
            return None
        taken, rest = self._ready.rows(slice(count)), len(self._ready.systems) - count
        self._ready = self._ready.rows(slice(count, None)) if rest > 0 else next(self._blocks, None)
        return taken


def _load(problem: Problem, start: Floats, part: slice) -> _Pool:
    some = problem.part(part)
    return _Pool(
        systems=np.arange(len(start))[part],
        age=np.zeros(len(some.y), dtype=np.int64),
        z=start[part].copy(),
        y=some.y.copy(),
        floor=some.floor.copy(),
        basis=some.basis.copy(),
        products=products(some.basis),
        unused=unused(some.rank, start.shape[1]),
    )


def _refill(pool: _Pool, places: Indices, queue: _Queue) -> _Pool:
    """Put the next systems of the queue in these places; once it is empty, close ranks."""
    count = len(pool.systems)
    while len(places) and (fresh := queue.take(len(places))) is not None:
        here, places = places[: len(fresh.systems)], places[len(fresh.systems) :]
        for name, mine in vars(pool).items():
            if len(mine) == count:
                mine[here] = getattr(fresh, name)
    if not len(places):
        return pool
    keep = np.ones(count, dtype=bool)
    keep[places] = False
    return pool.rows(keep)
