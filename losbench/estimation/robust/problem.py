"""Batches of small linear systems, brought to a form in which every solve is safe.

Columns and right-hand sides whose squares would leave the range of numbers are scaled by powers of
two, and the columns of A are replaced by an orthonormal basis Q of what they span: A = Q R. In that
basis the matrix Q' W Q of a weighted solve is as well conditioned as the weights allow, whatever A
was, and a step needs no more than its p x p inverse.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats, Indices, Ints
from losbench.checks import finite

__all__ = [
    "ROUNDING",
    "Problem",
    "blanked",
    "blocks",
    "combine",
    "gram",
    "places",
    "products",
    "project",
    "read_problem",
    "spd_inverse",
    "times_unit",
    "unused",
]


_CLOSED_FORM_COLUMNS = 3
ROUNDING = (
    16 * np.finfo(float).eps
)  # residuals of a perfect fit stay below this part of the norm of y
_TINY = float(np.finfo(float).tiny)
_SAFE_NORMS = (1e-100, 1e100)
_BLOCK_ELEMENTS = 2**15  # residuals worked on at once: few enough to stay in the processor's cache
_DETERMINED = 1e-9  # share of a unit null vector that an unknown may have by rounding alone
_NEARLY_PARALLEL = (
    1e-2  # sine of the angle to earlier columns below which Gram-Schmidt hands over to the SVD
)
# determinant, relative to the trace to the power p, below which the closed form hands over
_NEARLY_SINGULAR = 1e-12
# Cofactors of a packed 3 x 3 matrix: product of the first two elements less that of the others.
_COFACTORS = np.array(
    [[3, 2, 1, 0, 1, 0], [5, 4, 4, 5, 2, 3], [4, 1, 2, 2, 0, 1], [4, 5, 3, 2, 4, 1]]
)


@dataclass(frozen=True)
class Problem:
    """B systems of n rows and p columns; arrays of A lead with 1 instead of B where all share one
    A.
    """

    basis: Floats  # (B or 1, p, n), orthonormal; zero rows beyond the rank
    to_x: Floats  # (B or 1, p, p), coordinates in the basis -> unknowns in units of x_unit
    rank: Ints  # (B or 1,)
    estimable: Bools  # (B or 1, p), unknowns that A determines
    y: Floats  # (B, n), in units of y_unit
    y_unit: Floats  # (B,), powers of two
    x_unit: Floats  # (B,)
    floor: Floats  # (B,), smallest scale that residuals can tell from rounding
    batch: tuple[int, ...]

    def least_squares(self) -> Floats:
        """Coordinates (B, p) of the least-squares solution."""
        return project(self.basis, self.y)

    def residuals(self, z: Floats) -> Floats:
        """Scaled residuals A x - y (B, n) at coordinates ``z`` (B, p)."""
        fitted = combine(z, self.basis)
        fitted -= self.y
        return fitted

    def unknowns(self, z: Floats) -> Floats:
        """Unknowns in the user's units at coordinates ``z`` (B, p)."""
        return times_unit(combine(z, np.swapaxes(self.to_x, 1, 2)), self.x_unit)

    def coordinates(self, fitted: Floats) -> Floats:
        """Coordinates in the basis of fitted values A x (B, n) in the user's units."""
        return project(self.basis, fitted / self.y_unit[:, None])

    def covariance(self, size: Floats) -> Floats:
        """Covariance (B, p, p) in the user's units: (A'A)^-1 times the square of a scaled residual
        size (B,).
        """
        with np.errstate(over="ignore", under="ignore"):
            cov = (self.to_x @ np.swapaxes(self.to_x, 1, 2)) * ((size * self.x_unit) ** 2)[
                :, None, None
            ]
        return blanked(cov, self.estimable)

    def weighted_covariance(self, inverse: Floats, normal: Floats, size: Floats) -> Floats:
        """Covariance (B, p, p) in the user's units: (A'WA)^-1 times size (B,) squared, from Q'WQ,
        packed, and its inverse in the basis.
        """
        cov = self.to_x @ inverse @ np.swapaxes(self.to_x, 1, 2)
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            cov = cov * ((size * self.x_unit) ** 2)[:, None, None]
        return blanked(cov, self.estimable & self.left_by(inverse, normal))

    def left_by(self, inverse: Floats, normal: Floats) -> Bools:
        """Unknowns (B, p) that weighted rows still determine."""
        p = inverse.shape[-1]
        seen = inverse @ normal[:, places(p)]  # the projector on what the rows can tell
        short = np.einsum("bii->b", seen) < p - 0.5
        left: Bools = np.ones(seen.shape[:2], dtype=bool)
        if short.any():
            to_x = np.broadcast_to(self.to_x, seen.shape)[short]
            lost = np.linalg.norm(to_x @ seen[short] - to_x, axis=-1)
            left[short] = lost <= _DETERMINED * np.linalg.norm(to_x, axis=-1)
        return left

    def leverage(self) -> Floats:
        """Diagonals (B, n) of the hat matrices."""
        return np.broadcast_to((self.basis**2).sum(axis=1), self.y.shape)

    def part(self, systems: slice | Indices) -> Problem:
        """Some of the systems, as a flat batch."""
        own = systems if len(self.basis) > 1 else slice(None)
        y = self.y[systems]
        return Problem(
            basis=self.basis[own],
            to_x=self.to_x[own],
            rank=self.rank[own],
            estimable=self.estimable[own],
            y=y,
            y_unit=self.y_unit[systems],
            x_unit=self.x_unit[systems],
            floor=self.floor[systems],
            batch=(len(y),),
        )


def read_problem(A: ArrayLike, y: ArrayLike) -> Problem:
    """Check A (n, p) or (..., n, p) and y (..., n), and factorise."""
    matrix, right = finite("A", A), finite("y", y)
    if matrix.ndim < 2:
        raise ValueError(f"A must have shape (..., n, p), got {matrix.shape}")
    n, p = matrix.shape[-2:]
    if right.ndim < 1 or right.shape[-1] != n:
        raise ValueError(
            f"y must have shape (..., {n}) to match the {n} rows of A, got {right.shape}"
        )
    if n < p:
        raise ValueError(
            f"A must have at least as many rows as columns, got {n} rows and {p} columns"
        )
    try:
        batch = np.broadcast_shapes(matrix.shape[:-2], right.shape[:-1])
    except ValueError:
        raise ValueError(
            f"A and y must share their batch axes, got {matrix.shape} and {right.shape}"
        ) from None
    if matrix.ndim == 2 and matrix.size <= _BLOCK_ELEMENTS:
        design = _design_of_one(matrix.tobytes(), n, p)
    else:
        systems = (1,) if matrix.ndim == 2 else batch
        design = _design(np.broadcast_to(matrix, (*systems, n, p)).reshape(-1, n, p))
    if right.shape[:-1] != batch:
        right = np.broadcast_to(right, (*batch, n))
    right, y_unit, size = _in_range(right.reshape(-1, n))
    with np.errstate(over="ignore", under="ignore"):
        x_unit = y_unit / design.unit  # the rest of the columns' sizes is in to_x
    if not np.isfinite(x_unit).all():
        raise ValueError(
            "y must not exceed A by a factor of 1e308 or more: the unknowns would be infinite"
        )
    return Problem(
        basis=design.basis,
        to_x=design.to_x,
        rank=design.rank,
        estimable=design.estimable,
        y=right,
        y_unit=y_unit,
        x_unit=x_unit,
        floor=np.maximum(ROUNDING * size, _TINY),
        batch=batch,
    )


@dataclass(frozen=True)
class _Design:
    """What A alone tells, as in `Problem`, and the unit of columns (B or 1,), one for all."""

    basis: Floats
    to_x: Floats
    rank: Ints
    estimable: Bools
    unit: Floats


def _design(matrix: Floats) -> _Design:
    basis, to_x, estimable, unit = _factorised(matrix)
    middle = np.sqrt(unit.min(axis=1)) * np.sqrt(unit.max(axis=1))
    rank = to_x.any(axis=1).sum(axis=1)
    return _Design(basis, to_x * (middle[:, None] / unit)[..., None], rank, estimable, middle)


# Every chunk of a study brings the same A, whose factors cost a third of the chunk's solve.
@lru_cache(maxsize=8)
def _design_of_one(matrix: bytes, n: int, p: int) -> _Design:
    design = _design(np.frombuffer(matrix).reshape(1, n, p))
    for array in vars(design).values():
        array.flags.writeable = False
    return design


def blocks(count: int, n: int) -> Iterator[slice]:
    """Parts of ``count`` systems of ``n`` rows that stay in the processor's cache."""
    size = max(16, _BLOCK_ELEMENTS // n)
    return (slice(first, min(first + size, count)) for first in range(0, count, size))


def project(rows: Floats, vectors: Floats) -> Floats:
    """Scalar products of (B or 1, k, n) rows with (B, n) vectors: (B, k)."""
    if len(rows) > 1:
        return np.einsum("bkn,bn->bk", rows, vectors)
    # Many vectors are multiplied in half the time by what is no transposed view.
    many = len(vectors) > vectors.shape[1]
    return vectors @ (np.ascontiguousarray(rows[0].T) if many else rows[0].T)


def combine(coefficients: Floats, rows: Floats) -> Floats:
    """Sums of (B or 1, k, n) rows times (B, k) coefficients: (B, n)."""
    if len(rows) == 1:
        return coefficients @ np.ascontiguousarray(rows[0])
    return np.einsum("bk,bkn->bn", coefficients, rows)


def products(basis: Floats) -> Floats:
    """Products of all pairs of basis rows, (B or 1, p (p + 1) / 2, n): their weighted sums are
    Q'WQ, packed.
    """
    count, p, n = basis.shape
    pairs = np.empty((count, p * (p + 1) // 2, n))
    for k, (i, j) in enumerate(combinations_with_replacement(range(p), 2)):
        np.multiply(basis[:, i], basis[:, j], out=pairs[:, k])
    return pairs


def gram(basis: Floats, weights: Floats, rank: Ints) -> Floats:
    """Q'WQ, packed (B, p (p + 1) / 2), with ones on the diagonal for directions beyond the rank."""
    p = basis.shape[1]
    if len(basis) == 1:
        packed = project(products(basis), weights)
    else:
        full = (basis * weights[:, None]) @ np.swapaxes(basis, 1, 2)
        packed = full.reshape(len(full), p * p).T[_triangle(p)].T
    return packed if rank.min() == p else packed + unused(rank, p)


def unused(rank: Ints, p: int) -> Floats:
    """Ones on the diagonal of Q'WQ, packed, for directions beyond the rank, whose rows of Q are
    zero.
    """
    packed = np.zeros((len(rank), p * (p + 1) // 2))
    packed[:, np.diagonal(places(p))] = np.arange(p) >= rank[:, None]
    return packed


def spd_inverse(packed: Floats, p: int) -> Floats:
    """Inverse (B, p, p) of symmetric matrices given by their upper triangles (B, p (p + 1) / 2).

    Closed form for p <= 3 while the matrix is well conditioned, pseudo-inverse by eigenvalues
    otherwise: a direction that no row determines gets a zero, never a NaN.
    """
    place = places(p)
    if p > _CLOSED_FORM_COLUMNS:
        return np.asarray(
            np.linalg.pinv(packed[:, place], rcond=1e-14, hermitian=True), dtype=np.float64
        )
    adjugate, determinant, trace = _adjugate(np.ascontiguousarray(packed.T))
    # Against the trace, so that the size of the weights has no say.
    safe = determinant > _NEARLY_SINGULAR * trace**p
    inverse = (adjugate / np.where(safe, determinant, 1.0))[place].transpose(2, 0, 1)
    if not safe.all():
        inverse[~safe] = np.linalg.pinv(packed[~safe][:, place], rcond=1e-14, hermitian=True)
    return inverse


@cache
def _triangle(p: int) -> Indices:
    """Where the packed elements are in a flat (p, p) matrix."""
    return np.flatnonzero(np.triu(np.ones((p, p))))


@cache
def places(p: int) -> Indices:
    """Where the elements of a symmetric (p, p) matrix are in its packed upper triangle."""
    first, second = np.triu_indices(p)
    places = np.empty((p, p), dtype=np.intp)
    places[first, second] = places[second, first] = np.arange(len(first))
    return places


def _adjugate(packed: Floats) -> tuple[Floats, Floats, Floats]:
    """Packed adjugates, determinants and traces of packed (k, B) matrices."""
    if len(packed) == 1:
        return np.ones_like(packed), packed[0], packed[0]
    if len(packed) == 3:
        a, b, c = packed
        return np.stack([c, -b, a]), a * c - b * b, a + c
    first, second, third, fourth = packed[_COFACTORS]
    adjugate = first * second - third * fourth
    return (
        adjugate,
        np.einsum("ib,ib->b", packed[:3], adjugate[:3]),
        packed[0] + packed[3] + packed[5],
    )


def times_unit(values: Floats, unit: Floats) -> Floats:
    """Values (B, k) times units (B,), which are nearly always 1."""
    return values if (unit == 1.0).all() else values * unit[:, None]


def _in_range(rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Rows (..., n) over a power of two that keeps their squares in range, that unit, and their
    norm in it.
    """
    with np.errstate(over="ignore", under="ignore"):
        norm = np.sqrt(np.vecdot(rows, rows))
    if _SAFE_NORMS[0] < norm.min() and norm.max() < _SAFE_NORMS[1]:
        return rows, np.ones(rows.shape[:-1]), norm
    # Powers of two: scaling and its way back round nothing.
    unit = np.ldexp(1.0, np.clip(np.frexp(np.abs(rows).max(axis=-1))[1], -1000, 1000))
    rows = rows / unit[..., None]
    return rows, unit, np.sqrt(np.vecdot(rows, rows))


def _factorised(matrix: Floats) -> tuple[Floats, Floats, Bools, Floats]:
    """Basis, map to the unknowns over the units of columns, which unknowns are determined, and
    those units (B, p), of matrices (B, n, p).
    """
    count, n, p = matrix.shape
    basis, to_x = np.empty((count, p, n)), np.empty((count, p, p))
    estimable, unit = np.ones((count, p), dtype=bool), np.empty((count, p))
    for part in blocks(count, n):
        columns, unit[part], norm = _in_range(np.ascontiguousarray(np.swapaxes(matrix[part], 1, 2)))
        if p > _CLOSED_FORM_COLUMNS:
            basis[part], to_x[part], estimable[part] = _by_svd(columns)
            continue
        basis[part], to_x[part], safe = _by_gram_schmidt(columns, norm)
        if not safe.all():
            wrong = part.start + np.flatnonzero(~safe)
            basis[wrong], to_x[wrong], estimable[wrong] = _by_svd(columns[~safe])
    return basis, to_x, estimable, unit


def _by_gram_schmidt(columns: Floats, norm: Floats) -> tuple[Floats, Floats, Bools]:
    """Modified Gram-Schmidt on the columns of A with those of the identity below them, where the
    inverse of R grows.
    """
    count, p, n = columns.shape
    # What is done to a column is done to the identity below it, so that in the end it holds R^-1.
    work = np.empty((p, n + p, count))  # the batch axis last: many times faster along short columns
    work[:, :n], work[:, n:] = columns.transpose(1, 2, 0), np.eye(p)[..., None]
    safe = np.ones(count, dtype=bool)
    for j, vector in enumerate(work):
        rest = np.sqrt(_dot(vector[:n], vector[:n]))
        safe &= rest > _NEARLY_PARALLEL * norm[:, j]
        vector /= np.where(safe, rest, 1.0)
        for later in work[j + 1 :]:
            later -= _dot(vector[:n], later[:n]) * vector
    return work[:, :n].transpose(2, 0, 1), work[:, n:].transpose(2, 1, 0), safe


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("nb,nb->b", a, b)


def _by_svd(columns: Floats) -> tuple[Floats, Floats, Bools]:
    """Basis of unit columns by SVD; where the rank is short, the unknowns have the smallest norm in
    unit columns, and those that the null space moves are not determined.
    """
    length = np.sqrt(np.vecdot(columns, columns))
    length = np.where(length > 0.0, length, 1.0)[..., None]
    mixing, singular, basis = np.linalg.svd(columns / length, full_matrices=False)
    tolerance = max(columns.shape[1:]) * np.finfo(float).eps * singular[:, :1]
    kept = singular > tolerance
    to_x = mixing * np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)[:, None, :] / length
    moved = np.abs(np.where(kept[:, None, :], 0.0, mixing)).max(axis=-1)
    # Rounding tilts the null space by about its own share of the smallest direction kept.
    least = np.min(singular, axis=1, where=kept, initial=np.inf)[:, None]
    estimable = moved <= np.maximum(_DETERMINED, 10.0 * tolerance / least)
    return np.where(kept[..., None], basis, 0.0), to_x, estimable


def blanked(cov: Floats, known: Bools) -> Floats:
    """Covariances (B, p, p) without what belongs to unknowns that are not known (B or 1, p)."""
    return cov if known.all() else np.where(known[:, :, None] & known[:, None, :], cov, np.nan)
