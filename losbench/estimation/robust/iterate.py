"""The reweighting loop, over a pool of systems that is refilled as they settle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.estimation.losses import Loss
from losbench.estimation.robust.problem import Problem, combine, products, project, spd_inverse
from losbench.estimation.robust.scales import ScaleRule

__all__ = ["Groups", "Method", "blocks", "iterate"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_POOL_ELEMENTS = 2**15  # residuals worked on at once: few enough to stay in the processor's cache


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


def blocks(count: int, n: int) -> Iterator[slice]:
    """Parts of ``count`` systems of ``n`` rows that stay in the processor's cache."""
    size = max(16, _POOL_ELEMENTS // n)
    return (slice(first, first + size) for first in range(0, count, size))


def iterate(problem: Problem, method: Method, start: Floats) -> tuple[Floats, NDArray[np.int64], NDArray[np.bool_]]:
    """Coordinates (B, p) where each system settled, its number of weighted solves, and whether it did settle."""
    count, p = start.shape
    z, n_iter, converged = start.copy(), np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    size = next(blocks(*problem.y.shape)).stop
    pool, queue = _load(problem, start, np.arange(min(size, count))), np.arange(size, count)
    while len(pool.systems):
        step, scale = _step(pool, method)
        pool.z -= step
        pool.age += 1
        reach = np.maximum(_norm(pool.z), scale * np.sqrt(p))
        settled = _norm(step) <= method.tol * reach
        done = settled | (pool.age == method.max_iter)
        if done.any():
            out = pool.systems[done]
            z[out], n_iter[out], converged[out] = pool.z[done], pool.age[done], settled[done]
            pool, queue = _refill(pool, done, problem, start, queue)
    return z, n_iter, converged


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


def _load(problem: Problem, start: Floats, systems: Indices) -> _Pool:
    some = problem.part(systems)
    age = np.zeros(len(systems), dtype=np.int64)
    return _Pool(systems, age, start[systems], some.y, some.floor, some.basis, products(some.basis), some.unused())


def _refill(
    pool: _Pool, done: NDArray[np.bool_], problem: Problem, start: Floats, queue: Indices
) -> tuple[_Pool, Indices]:
    """Put the next systems of the queue in the places of those done; once it is empty, close ranks."""
    if not len(queue):
        return _rows(pool, ~done), queue
    places = np.flatnonzero(done)[: len(queue)]
    fresh = _load(problem, start, queue[: len(places)])
    for name, mine in vars(pool).items():
        if len(mine) == len(done):
            mine[places] = getattr(fresh, name)
    done[places] = False
    return (_rows(pool, ~done) if done.any() else pool), queue[len(places) :]


def _rows(pool: _Pool, keep: NDArray[np.bool_]) -> _Pool:
    return _Pool(*(mine[keep] if len(mine) == len(keep) else mine for mine in vars(pool).values()))


def _step(pool: _Pool, method: Method) -> tuple[Floats, Floats]:
    """One weighted solve: what to subtract from the coordinates (b, p), and the scale (b,) it used."""
    residuals = combine(pool.z, pool.basis) - pool.y
    scale = np.maximum(method.scale(residuals, pool.systems), pool.floor)
    weights = method.loss.weights(method.scaled(residuals, scale))
    inverse = spd_inverse(project(pool.products, weights) + pool.unused, pool.z.shape[1])
    return np.matvec(inverse, project(pool.basis, weights * residuals)), scale


def _norm(vectors: Floats) -> Floats:
    return np.sqrt(np.vecdot(vectors, vectors))
