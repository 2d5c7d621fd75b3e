"""Batches of small linear systems, brought to a form in which every solve is safe.

Columns and right-hand sides are scaled by powers of two (no rounding, no overflow), and the columns of A are replaced
by an orthonormal basis Q of what they span: A = Q R. In that basis the matrix Q' W Q of a weighted solve is as well
conditioned as the weights allow, whatever A was, and a step of Newton's kind needs no more than its p x p inverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.checks import finite

__all__ = ["Problem", "combine", "project", "read_problem", "spd_inverse"]

Floats = NDArray[np.float64]

_CLOSED_FORM_COLUMNS = 3
_NEARLY_PARALLEL = 1e-4  # sine of the angle to earlier columns below which Gram-Schmidt hands over to the SVD
_NEARLY_SINGULAR = 1e-10  # determinant, relative to the mean eigenvalue, below which the closed form hands over


@dataclass(frozen=True)
class Problem:
    """B systems of n rows and p columns; arrays of A lead with 1 instead of B where all share one A."""

    columns: Floats  # (B or 1, p, n), scaled
    basis: Floats  # (B or 1, p, n), orthonormal; zero rows beyond the rank
    to_x: Floats  # (B or 1, p, p), coordinates in the basis -> scaled unknowns
    rank: NDArray[np.int64]  # (B or 1,)
    y: Floats  # (B, n), scaled
    column_unit: Floats  # (B or 1, p), powers of two
    y_unit: Floats  # (B,), powers of two
    batch: tuple[int, ...]

    @property
    def x_unit(self) -> Floats:
        """What one scaled unknown is worth in the user's units, (B, p)."""
        return self.y_unit[:, None] / self.column_unit

    def least_squares(self) -> Floats:
        """Coordinates (B, p) of the least-squares solution, refined once."""
        z = project(self.basis, self.y)
        return z - project(self.basis, combine(z, self.basis) - self.y)

    def residuals(self, z: Floats) -> Floats:
        """Scaled residuals A x - y at coordinates ``z`` (B, p)."""
        return combine(combine(z, np.swapaxes(self.to_x, -1, -2)), self.columns) - self.y

    def unknowns(self, z: Floats) -> Floats:
        """Unknowns in the user's units at coordinates ``z`` (B, p)."""
        return combine(z, np.swapaxes(self.to_x, -1, -2)) * self.x_unit

    def coordinates(self, x: Floats) -> Floats:
        """Coordinates in the basis of unknowns ``x`` (B, p) in the user's units."""
        return project(self.basis, combine(x / self.x_unit, self.columns))

    def chunk(self, part: slice) -> Problem:
        """Some of the systems."""
        own = part if len(self.columns) > 1 else slice(None)
        return Problem(
            self.columns[own],
            self.basis[own],
            self.to_x[own],
            self.rank[own],
            self.y[part],
            self.column_unit[own],
            self.y_unit[part],
            (len(self.y[part]),),
        )


def read_problem(A: ArrayLike, y: ArrayLike) -> Problem:
    """Check A (n, p) or (..., n, p) and y (..., n), and factorise."""
    matrix, right = finite("A", A), finite("y", y)
    if matrix.ndim < 2:
        raise ValueError(f"A must have shape (..., n, p), got {matrix.shape}")
    n, p = matrix.shape[-2:]
    if right.ndim < 1 or right.shape[-1] != n:
        raise ValueError(f"y must have shape (..., {n}) to match the {n} rows of A, got {right.shape}")
    if n < p:
        raise ValueError(f"A must have at least as many rows as columns, got {n} rows and {p} columns")
    try:
        batch = np.broadcast_shapes(matrix.shape[:-2], right.shape[:-1])
    except ValueError:
        raise ValueError(f"A and y must share their batch axes, got {matrix.shape} and {right.shape}") from None
    systems = (1,) if matrix.ndim == 2 else batch
    columns = np.swapaxes(np.broadcast_to(matrix, (*systems, n, p)).reshape(-1, n, p), 1, 2)
    columns, column_unit = _scaled(np.ascontiguousarray(columns))
    right, y_unit = _scaled(np.broadcast_to(right, (*batch, n)).reshape(-1, n))
    basis, to_x, rank = _orthonormal(columns)
    return Problem(columns, basis, to_x, rank, right, column_unit, y_unit, batch)


def project(rows: Floats, vectors: Floats) -> Floats:
    """Scalar products of (B or 1, k, n) rows with (B, n) vectors: (B, k)."""
    return vectors @ rows[0].T if len(rows) == 1 else np.matvec(rows, vectors)


def combine(coefficients: Floats, rows: Floats) -> Floats:
    """Sums of (B or 1, k, n) rows times (B, k) coefficients: (B, n)."""
    return coefficients @ rows[0] if len(rows) == 1 else np.vecmat(coefficients, rows)


def spd_inverse(packed: Floats, p: int) -> Floats:
    """Inverse (B, p, p) of symmetric matrices given by their upper triangles (B, p (p + 1) / 2).

    Closed form for p <= 3 while the matrix is well conditioned, pseudo-inverse by eigenvalues otherwise: a direction
    that no row determines gets a zero, never a NaN.
    """
    first, second = np.triu_indices(p)
    diagonal = first == second
    level = np.maximum(packed[:, diagonal].mean(axis=1), np.finfo(float).tiny)
    packed = packed / level[:, None]
    if p <= _CLOSED_FORM_COLUMNS:
        adjugate, determinant = _adjugate(packed, p)
        safe = determinant > _NEARLY_SINGULAR
        flat = adjugate / np.where(safe, determinant * level, 1.0)[:, None]
    else:
        flat, safe = np.empty_like(packed), np.zeros(len(packed), dtype=bool)
    square = np.empty((len(packed), p, p))
    square[:, first, second] = square[:, second, first] = flat
    if not safe.all():
        matrix = np.empty((int((~safe).sum()), p, p))
        matrix[:, first, second] = matrix[:, second, first] = packed[~safe]
        square[~safe] = np.linalg.pinv(matrix, rcond=1e-14, hermitian=True) / level[~safe, None, None]
    return square


def _adjugate(packed: Floats, p: int) -> tuple[Floats, Floats]:
    if p == 1:
        return np.ones_like(packed), packed[:, 0]
    if p == 2:
        a, b, c = packed.T
        return np.stack([c, -b, a], axis=1), a * c - b * b
    a, b, c, d, e, f = packed.T
    first = d * f - e * e, c * e - b * f, b * e - c * d
    adjugate = np.stack([*first, a * f - c * c, b * c - a * e, a * d - b * b], axis=1)
    return adjugate, a * first[0] + b * first[1] + c * first[2]


def _scaled(rows: Floats) -> tuple[Floats, Floats]:
    """Rows (..., n) in units of the power of two just above their largest element, and that unit."""
    exponent = np.frexp(np.abs(rows).max(axis=-1))[1]
    unit = np.ldexp(1.0, np.clip(exponent, -1000, 1000))
    return rows / unit[..., None], unit


def _orthonormal(columns: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Basis, map to the unknowns and rank of columns (B, p, n)."""
    count, p, _ = columns.shape
    if p > _CLOSED_FORM_COLUMNS:
        return _by_svd(columns)
    basis, to_x, safe = _by_gram_schmidt(columns)
    rank = np.full(count, p)
    if not safe.all():
        basis[~safe], to_x[~safe], rank[~safe] = _by_svd(columns[~safe])
    return basis, to_x, rank


def _by_gram_schmidt(columns: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Modified Gram-Schmidt, in which the inverse of R grows along with Q."""
    count, p, _ = columns.shape
    basis = np.empty_like(columns)
    to_x = np.zeros((count, p, p))
    safe = np.ones(count, dtype=bool)
    for j in range(p):
        vector = columns[:, j]
        to_x[:, j, j] = 1.0
        length = np.sqrt(np.vecdot(vector, vector))
        for i in range(j):
            part = np.vecdot(basis[:, i], vector)[:, None]
            vector = vector - part * basis[:, i]
            to_x[:, :, j] -= part * to_x[:, :, i]
        rest = np.sqrt(np.vecdot(vector, vector))
        safe &= rest > _NEARLY_PARALLEL * length
        rest = np.where(safe, rest, 1.0)[:, None]
        np.divide(vector, rest, out=basis[:, j])
        to_x[:, :, j] /= rest
    return basis, to_x, safe


def _by_svd(columns: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Basis of unit columns by SVD; where the rank is short, the unknowns have the smallest norm in unit columns."""
    length = np.sqrt(np.vecdot(columns, columns))
    length = np.where(length > 0.0, length, 1.0)[..., None]
    mixing, singular, basis = np.linalg.svd(columns / length, full_matrices=False)
    tolerance = max(columns.shape[1:]) * np.finfo(float).eps * singular[:, :1]
    kept = singular > tolerance
    to_x = mixing * np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)[:, None, :] / length
    return np.where(kept[..., None], basis, 0.0), to_x, kept.sum(axis=1)
