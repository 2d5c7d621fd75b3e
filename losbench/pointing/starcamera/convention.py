"""What four numbers called a quaternion mean. It is the caller who knows; nothing here guesses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from losbench.arrays import Bools, Floats
from losbench.checks import choice, unit_quaternions

__all__ = ["Attitudes", "QuaternionConvention"]


Scalar = Literal["last", "first"]
Direction = Literal["camera_to_inertial", "inertial_to_camera"]
_SCALAR: tuple[Scalar, ...] = ("last", "first")
_DIRECTION: tuple[Direction, ...] = ("camera_to_inertial", "inertial_to_camera")


@dataclass(frozen=True, kw_only=True)
class QuaternionConvention:
    """Order and direction of stored attitude quaternions (Hamilton's product).

    Parameters
    ----------
    scalar : "last" or "first"
        (x, y, z, w) or (w, x, y, z).
    direction : "camera_to_inertial" or "inertial_to_camera"
        Which components the rotation takes to which. A quaternion in the notation of Shuster or
        Wertz, whose attitude matrix A(q) takes inertial components to the camera's, has the numbers
        of "camera_to_inertial".

    Raises
    ------
    ValueError
        If a word is none of these.

    Examples
    --------
    >>> print(QuaternionConvention(scalar="first", direction="camera_to_inertial"))
    scalar first, camera to inertial
    """

    scalar: Scalar
    direction: Direction

    def __post_init__(self) -> None:
        choice("scalar", self.scalar, _SCALAR)
        choice("direction", self.direction, _DIRECTION)

    @property
    def to_inertial(self) -> bool:
        """Whether the stored rotation takes camera components to inertial ones."""
        return self.direction == "camera_to_inertial"

    @classmethod
    def every(cls) -> tuple[QuaternionConvention, ...]:
        """Return all four conventions."""
        return tuple(cls(scalar=s, direction=d) for s in _SCALAR for d in _DIRECTION)

    def __str__(self) -> str:
        return f"scalar {self.scalar}, {self.direction.replace('_', ' ')}"


@dataclass(frozen=True)
class Attitudes:
    """Stored quaternions as rotations, in one flat row; a gap is an identity marked as missing."""

    stored: Rotation  # (n,), in the convention's direction
    missing: Bools  # (n,)
    shape: tuple[int, ...]  # batch axes
    convention: QuaternionConvention

    @classmethod
    def read(
        cls, quaternions: ArrayLike, convention: QuaternionConvention, name: str = "quaternions"
    ) -> Attitudes:
        """Check quaternions (..., 4); a row with NaN is missing, a length other than one an
        error.
        """
        if not isinstance(convention, QuaternionConvention):
            raise ValueError(f"convention must be a QuaternionConvention, got {convention!r}")
        q = unit_quaternions(name, quaternions)
        flat = q.reshape(-1, 4)
        missing = np.isnan(flat.sum(axis=-1))
        first_scalar = convention.scalar == "first"
        if missing.any():
            flat = np.where(
                missing[:, None],
                [1.0, 0.0, 0.0, 0.0] if first_scalar else [0.0, 0.0, 0.0, 1.0],
                flat,
            )
        return cls(
            Rotation.from_quat(flat, scalar_first=first_scalar), missing, q.shape[:-1], convention
        )

    def quaternions(self, stored: Rotation, *, also_missing: Bools | None = None) -> Floats:
        """Return rotations of the stored direction as quaternions (..., 4) of the convention; NaN
        where missing.
        """
        rows = stored.as_quat(scalar_first=self.convention.scalar == "first")
        if also_missing is not None:
            rows[also_missing] = np.nan
        return self.restored(rows)

    def direction(self, axis: Floats) -> Floats:
        """Inertial components (n, 3) of an axis of the camera."""
        return self.stored.apply(axis, inverse=not self.convention.to_inertial)

    def matrices(self) -> Floats:
        """Return matrices (n, 3, 3) that take camera components to inertial ones."""
        matrices = self.stored.as_matrix()
        return matrices if self.convention.to_inertial else np.swapaxes(matrices, 1, 2)

    def restored(self, rows: Floats) -> Floats:
        """Give flat rows their batch axes back, and NaN where the attitude is missing."""
        if self.missing.any():
            rows[self.missing] = np.nan
        return rows.reshape((*self.shape, *rows.shape[1:]))
