"""The reweighting loop, over a pool of systems that is topped up as they settle.

A plain step is H Q' W r, with H the inverse of Q' W Q: it shrinks the distance to the solution by a
constant factor. Once that is seen to happen and little distance is left, H is no longer made anew
but corrected by what the last step did (Broyden, Math. Comp. 19, 577 (1965)). That needs only Q' W
r, which is zero at the same places, and the factor shrinks from step to step. Where it does not,
the next step is a plain one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats, Indices, Ints
from losbench.estimation.losses import Loss
from losbench.estimation.robust.problem import Problem, blocks, combine, gram, project, spd_inverse
from losbench.estimation.robust.scales import ScaleRule

__all__ = ["Groups", "Left", "Method", "finish", "iterate"]

Left = tuple[Floats, Floats, Floats]  # residuals (B, n), weights (B, n) and scale (B,), scaled


# scales, per root of p: a step this short may be followed by a corrected one that is no longer
_NEAR = 0.03


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
            raise ValueError(
                f"group must have shape ({n},) to match the {n} rows of A, got {given.shape}"
            )
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
    tolerance: float
    stretch: Floats | None = (
        None  # (B or 1, n), what residuals are multiplied by before they are judged
    )

    def judged(self, residuals: Floats, systems: Indices) -> Floats:
        """Residuals (b, n) of these systems as scale and loss see them: adjusted for leverage, if
        that is asked for.
        """
        if self.stretch is None:
            return residuals
        return residuals * (self.stretch if len(self.stretch) == 1 else self.stretch[systems])

    def scaled(self, residuals: Floats, scale: Floats) -> Floats:
        """What the loss sees of each row, (b, n)."""
        size = residuals if self.groups is None else self.groups.rms(residuals)
        return size / scale[:, None]


def iterate(problem: Problem, method: Method, start: Floats) -> tuple[Floats, Ints, Bools]:
    """Coordinates (B, p) where each system settled, its number of steps, and whether it did
    settle.
    """
    count = len(start)
    z, n_iter, converged = (
        start.copy(),
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=bool),
    )
    pool = _Pool(problem, start)
    with np.errstate(divide="ignore", invalid="ignore"):
        while len(pool.systems):
            unit = _advance(pool, method)
            moved = _dot(pool.step, pool.step)
            settled = moved <= method.tolerance**2 * np.maximum(_dot(pool.z, pool.z), unit)
            done = np.flatnonzero(settled | (pool.age == method.max_iter))
            if len(done):
                out = pool.systems[done]
                z[out], n_iter[out], converged[out] = (
                    pool.z[:, done].T,
                    pool.age[done],
                    settled[done],
                )
                pool.replace(done)
    return z, n_iter, converged


def finish(problem: Problem, method: Method, z: Floats) -> Left:
    """What is left at coordinates ``z`` (B, p)."""
    residuals, weights, scale = (np.empty_like(a) for a in (problem.y, problem.y, problem.floor))
    for part in blocks(*problem.y.shape):
        systems = np.arange(part.start, part.stop)
        residuals[part] = problem.part(part).residuals(z[part])
        judged = method.judged(residuals[part], systems)
        scale[part] = np.maximum(method.scale(judged, systems), problem.floor[part])
        weights[part] = method.loss.weights(method.scaled(judged, scale[part]))
    return residuals, weights, scale


def _advance(pool: _Pool, method: Method) -> Floats:
    """Take one step with every system of the pool; p times the squared scales (b,) it used, by
    which to judge it.
    """
    residuals = combine(pool.z.T, pool.basis)
    residuals -= pool.y  # in place, here and below: at this size memory is what takes the time
    judged = method.judged(residuals, pool.systems)
    scale = np.maximum(method.scale(judged, pool.systems), pool.floor)
    weights = method.loss.weights(method.scaled(judged, scale))
    residuals *= weights
    pull = np.ascontiguousarray(project(pool.basis, residuals).T)
    unit = len(pull) * scale**2
    # Corrected for all, then made anew for those that are not to be trusted: to pick out the others
    # first would cost more than it saves.
    plain = np.flatnonzero(~_correct(pool, pull, _NEAR**2 * unit))
    if len(plain):
        basis, rank = (
            (pool.basis, pool.rank)
            if pool.shared
            else (pool.basis.take(plain, 0), pool.rank.take(plain))
        )
        inverse = spd_inverse(gram(basis, weights.take(plain, 0), rank), len(pull)).transpose(
            1, 2, 0
        )
        pool.inverse[..., plain] = inverse
        pool.step[:, plain] = _times(inverse, pull.take(plain, 1))
    pool.z -= pool.step
    pool.age += 1
    return unit


def _correct(pool: _Pool, pull: Floats, near: Floats) -> Bools:
    """Correct inverses by what the last step did, replace that by the next, and tell where this is
    to be trusted.
    """
    last = pool.step
    length = _dot(last, last)
    ahead = _times(pool.inverse, pull)
    pool.step = ahead / (1.0 - _dot(last, ahead) / length)
    pool.inverse += (pool.step / length)[:, None] * np.einsum("ib,ijb->jb", last, pool.inverse)
    # Where the factor does not shrink, or a kink of the loss was crossed, the step grows instead.
    return (length <= near) & (_dot(pool.step, pool.step) <= length)


def _times(matrix: Floats, vector: Floats) -> Floats:
    return np.einsum("ijb,jb->ib", matrix, vector)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("ib,ib->b", a, b)


class _Pool:
    """Systems at work: what belongs to their rows has the batch axis first, what steps are made of
    has it last.
    """

    def __init__(self, problem: Problem, start: Floats) -> None:
        self._problem, self._start = problem, start
        first = next(blocks(*problem.y.shape))
        self._waiting = first.stop  # the first system that was not taken in yet
        self.shared = len(problem.basis) == 1
        own = slice(None) if self.shared else first
        self.basis = problem.basis[own].copy()  # (b or 1, p, n)
        self.rank = problem.rank[own].copy()  # (b or 1,)
        self.systems = np.arange(first.stop)  # (b,), their places in the batch
        self.age = np.zeros(first.stop, dtype=np.int64)  # (b,), steps so far
        self.y = problem.y[first].copy()  # (b, n)
        self.floor = problem.floor[first].copy()  # (b,)
        self.z = start[first].T.copy()  # (p, b)
        self.step = np.zeros_like(self.z)  # (p, b), the last one
        self.inverse = np.zeros((len(self.z), *self.z.shape))  # (p, p, b), H

    def replace(self, done: Indices) -> None:
        """Put waiting systems in the places of those that are done; once none is left, close
        ranks.
        """
        fresh = slice(self._waiting, min(self._waiting + len(done), len(self._start)))
        self._waiting = fresh.stop
        here, empty = done[: fresh.stop - fresh.start], done[fresh.stop - fresh.start :]
        if len(here):
            if not self.shared:
                self.basis[here] = self._problem.basis[fresh]
                self.rank[here] = self._problem.rank[fresh]
            self.y[here] = self._problem.y[fresh]
            self.floor[here] = self._problem.floor[fresh]
            self.systems[here] = np.arange(fresh.start, fresh.stop)
            self.age[here] = 0
            self.z[:, here] = self._start[fresh].T
            self.step[:, here] = 0.0  # then 0 / 0 is no shorter than anything: a plain step
        if len(empty):
            self._remove(empty)

    def _remove(self, empty: Indices) -> None:
        kept = np.delete(np.arange(len(self.systems)), empty)
        if not self.shared:
            self.basis, self.rank = self.basis[kept], self.rank[kept]
        self.systems, self.age = self.systems[kept], self.age[kept]
        self.y, self.floor = self.y[kept], self.floor[kept]
        self.z, self.step = self.z[:, kept], self.step[:, kept]
        self.inverse = self.inverse[..., kept]
