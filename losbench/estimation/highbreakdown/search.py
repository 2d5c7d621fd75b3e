"""Many candidate fits of every system of a batch at once: what the high-breakdown estimates search
among.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, combinations, islice
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats, Indices, Ints
from losbench.checks import generator, named_twice
from losbench.estimation.highbreakdown.elimination import inverses, misfits
from losbench.estimation.robust.iterate import Groups
from losbench.estimation.robust.problem import Problem, products, spd_inverse, unused

__all__ = [
    "EXHAUSTIVE",
    "LONG",
    "Random",
    "Search",
    "Subsets",
    "Units",
    "chunks",
    "default_starts",
    "least",
    "least_of_subsets",
    "random_source",
    "thinned",
]

Random = np.random.Generator | int | None

EXHAUSTIVE = 10_000  # subsets that are all tried rather than drawn from
_CHUNK_ELEMENTS = 2**19  # numbers of all candidates held at once in one array
_BLOCK_ELEMENTS = (
    2**22
)  # numbers of one block of subsets with all columns, which bounds the memory of a long system
_STARTS = (500, 5000)
LONG = 4000  # units, from which on candidates are ranked on some of them
_THIN = 2000
_LONG_ROWS, _FEW_SYSTEMS = 1000, 10


@dataclass(frozen=True)
class Units:
    """What is good or bad as a whole: m groups of rows, or the n rows themselves."""

    groups: Groups | None
    sizes: Ints  # (m,), rows of each

    @classmethod
    def read(cls, group: ArrayLike | None, n: int) -> Units:
        """Check labels (n,)."""
        if group is None:
            return cls(None, np.ones(n, dtype=np.int64))
        groups = Groups.read(group, n)
        return cls(groups, np.bincount(groups.labels))

    @property
    def rows(self) -> int:
        """Rows of a typical unit."""
        return max(1, round(float(self.sizes.mean())))

    def needed(self, rank: int) -> int:
        """Number of units that determine ``rank`` unknowns, whichever they are."""
        return min(len(self.sizes), 1 + int(np.searchsorted(np.cumsum(np.sort(self.sizes)), rank)))

    def majority(self, rank: int) -> int:
        """Number of units that must agree, so that as many bad ones as can be are survived."""
        return min(len(self.sizes), (len(self.sizes) + self.needed(rank) + 1) // 2)

    def sums(self, values: Floats) -> Floats:
        """Sums over the rows of each unit, (..., n) -> (..., m)."""
        if self.groups is None:
            return values
        return np.add.reduceat(values[..., self.groups.order], self.groups.first, axis=-1)

    def spread(self, values: Floats) -> Floats:
        """What each row has from its unit, (..., m) -> (..., n)."""
        return values if self.groups is None else values[..., self.groups.labels]

    def choose(
        self, size: int, *, most: int, starts: int, rng: np.random.Generator, columns: int
    ) -> Iterator[Floats]:
        """Weights (k, n) of all subsets of ``size`` units if they are at most ``most``, of random
        ones otherwise.

        They come in blocks that with ``columns`` unknowns fit into a little memory: one, unless
        systems are long.
        """
        count = len(self.sizes)
        block = max(1, _BLOCK_ELEMENTS // (int(self.sizes.sum()) * columns))
        if comb(count, size) <= most:
            every = combinations(range(count), size)
            while len(
                chosen := np.fromiter(chain.from_iterable(islice(every, block)), dtype=np.intp)
            ):
                yield self._weights(chosen.reshape(-1, size))
        else:
            for first in range(0, starts, block):
                drawn = rng.random((min(block, starts - first), count))
                yield self._weights(np.argpartition(drawn, size - 1, axis=1)[:, :size])

    def _weights(self, chosen: Indices) -> Floats:
        weights = np.zeros((len(chosen), len(self.sizes)))
        np.put_along_axis(weights, chosen, 1.0, axis=1)
        return self.spread(weights)


def thinned(problem: Problem, units: Units, rng: np.random.Generator) -> tuple[Problem, Units]:
    """Return the same unknowns with random units of a long system: enough to tell good candidates
    from bad ones.
    """
    chosen = np.sort(rng.choice(len(units.sizes), _THIN, replace=False))
    rows = chosen
    if units.groups is not None:
        rows = np.flatnonzero(np.isin(units.groups.labels, chosen))
    some = None if units.groups is None else units.groups.labels[rows]
    thin = replace(problem, basis=problem.basis[..., rows], y=problem.y[:, rows])
    return thin, Units.read(some, len(rows))


class Search:
    """Weighted fits of B systems, k candidates each: coordinates (B, k, p) and residuals (B, k,
    n).
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._pairs = np.swapaxes(products(problem.basis), 1, 2)
        self._unused = unused(problem.rank, problem.basis.shape[1])[:, None]

    def fits(self, weights: Floats) -> Floats:
        """Coordinates (B, k, p) of weighted least squares with weights (B, k, n)."""
        return np.matvec(self.inverse(weights), self.pulls(weights))

    def pulls(self, weights: Floats) -> Floats:
        """Right-hand sides (B, k, p) of weighted least squares."""
        return (weights * self.problem.y[:, None]) @ np.swapaxes(self.problem.basis, 1, 2)

    def residuals(self, z: Floats) -> Floats:
        """Residuals (B, k, n) at coordinates (B, k, p), scaled as the problem is."""
        return z @ self.problem.basis - self.problem.y[:, None]

    def covariance(self, weights: Floats, size: Floats) -> Floats:
        """Covariance (B, p, p) in the user's units: size^2 (A'WA)^-1 for weights (B, n) and scaled
        sizes (B,).
        """
        normal = self._normal(weights[:, None])[:, 0]
        inverse = spd_inverse(normal, self.problem.basis.shape[1])
        return self.problem.weighted_covariance(inverse, normal, size)

    def inverse(self, weights: Floats) -> Floats:
        """Inverses (B or 1, k, p, p) of the normal matrices with weights (B or 1, k, n)."""
        packed = self._normal(weights)
        p = self.problem.basis.shape[1]
        return inverses(packed.reshape(-1, packed.shape[-1]), p).reshape(*packed.shape[:-1], p, p)

    def _normal(self, weights: Floats) -> Floats:
        return weights @ self._pairs + self._unused


class Subsets:
    """The same k subsets of rows in all systems: where all share one A, their fits are one matrix
    product. A few long systems would not pay for the matrix.
    """

    def __init__(self, problem: Problem, weights: Floats) -> None:
        self.weights = weights  # (k, n), 1 for the rows of the subset
        self._matrices: tuple[Floats, Floats] | None = None
        count, n = problem.y.shape
        if len(problem.basis) == 1 and (n <= _LONG_ROWS or count > _FEW_SYSTEMS):
            pull = problem.basis * weights[:, None]
            fit = Search(problem.part(slice(0, 1))).inverse(weights[None])[0] @ pull
            self._matrices = pull.reshape(-1, n), fit.reshape(-1, n)

    def best(self, search: Search, count: int) -> tuple[Floats, Floats]:
        """Coordinates (B, count, p) of the subsets that leave least, and what they leave, (B,
        count).
        """
        if self._matrices is None:
            left, safe = misfits(search.problem, self.weights)
            if safe.all():
                chosen = least_places(left, count)
                z = search.fits(self.weights[chosen])
                return z, np.take_along_axis(left, chosen, axis=1)
        z = self.fits(search)
        return least(z, self.misfits(search, z), count)

    def fits(self, search: Search) -> Floats:
        """Coordinates (B, k, p) of least squares over each subset."""
        if self._matrices is None:
            return search.fits(self.weights)
        return self._shaped(search.problem.y @ self._matrices[1].T)

    def misfits(self, search: Search, z: Floats) -> Floats:
        """Sums (B, k) of the squared residuals of each subset at its own fit, to the rounding error
        of y'y.
        """
        y = search.problem.y
        pulls = (
            search.pulls(self.weights)
            if self._matrices is None
            else self._shaped(y @ self._matrices[0].T)
        )
        return y**2 @ self.weights.T - np.vecdot(pulls, z)

    def _shaped(self, values: Floats) -> Floats:
        return values.reshape(len(values), len(self.weights), -1)


def chunks(count: int, elements: int) -> Iterator[slice]:
    """Parts of ``count`` systems, with so many numbers for the candidates of each, that fit into a
    little memory.
    """
    size = max(1, _CHUNK_ELEMENTS // elements)
    return (slice(first, first + size) for first in range(0, count, size))


def least_places(objective: Floats, count: int) -> Indices:
    """Where the least objectives (B, k) are, (B, count)."""
    return np.argpartition(objective, min(count, objective.shape[1]) - 1, axis=1)[:, :count]


def least(z: Floats, objective: Floats, count: int) -> tuple[Floats, Floats]:
    """Coordinates (B, count, p) of the least objectives (B, k), and these."""
    chosen = least_places(objective, count)
    return np.take_along_axis(z, chosen[..., None], axis=1), np.take_along_axis(
        objective, chosen, axis=1
    )


def least_of_subsets(
    problem: Problem,
    blocks: Iterator[Floats],
    tried: Callable[[Search, Subsets], tuple[Floats, Floats]],
    *,
    count: int,
    numbers: int,
) -> tuple[Floats, Floats]:
    """Coordinates (B, count, p) of the least objectives (B, count) among all subsets, whose weights
    come in blocks.

    ``tried`` makes candidates (B, k, p) with objectives (B, k) of some systems and a block of k
    subsets, and holds so many ``numbers`` for each of them.
    """
    z, objective = (
        np.empty((len(problem.y), 0, problem.basis.shape[1])),
        np.empty((len(problem.y), 0)),
    )
    for weights in blocks:
        subsets = Subsets(problem, weights)
        parts = chunks(len(problem.y), len(weights) * numbers)
        found = [least(*tried(Search(problem.part(part)), subsets), count) for part in parts]
        fresh, values = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        z, objective = (
            np.concatenate([z, fresh], axis=1),
            np.concatenate([objective, values], axis=1),
        )
        z, objective = least(z, objective, count)
    return z, objective


def random_source(seed: Random, rng: Random) -> np.random.Generator:
    """Return the generator given by either name, or one of its own from a seed; the same one for
    None, so that results repeat.
    """
    word, source = named_twice("seed", seed, None, rng=rng)
    return generator(word, 0 if source is None else source)


def default_starts(needed: int) -> int:
    """Random subsets, so that one of them is clean with 99 % where 30 % of the units are bad; 500
    to 5000.

    >>> [default_starts(needed) for needed in (3, 13, 15, 18, 30)]
    [500, 500, 968, 2826, 5000]
    """
    return int(np.clip(np.ceil(np.log(0.01) / np.log1p(-(0.7**needed))), *_STARTS))
