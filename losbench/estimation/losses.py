"""Loss functions of robust regression, each a small object with its tuning constant.

With u a residual over its scale: ``rho(u)`` is the loss, ``psi(u)`` its derivative, ``weights(u) = psi(u) / u`` what
iteratively reweighted least squares multiplies a row by, and ``psi_deriv(u)`` what its covariance needs.
`irls` asks for ``weights`` alone, so any object with that method will do, the norms of statsmodels included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from losbench.checks import number

__all__ = ["Bisquare", "Huber", "Loss", "psi_deriv"]

Floats = NDArray[np.float64]


class Loss(Protocol):
    """What `irls` asks of a loss."""

    def weights(self, u: Floats, /) -> Floats:
        """Weight of each scaled residual: 1 at u = 0, never NaN."""


@dataclass(frozen=True)
class Huber:
    """Huber's loss: squares up to ``c`` scales, straight lines beyond; monotone, so the start does not matter.

    Parameters
    ----------
    c : float
        Threshold in scales; 1.345 keeps 95 % of the efficiency of least squares on normal errors.

    Notes
    -----
    weights(u) = min(1, c / abs(u)): liu2026, eq. (9); Huber, Ann. Math. Statist. 35, 73 (1964).

    Examples
    --------
    >>> Huber(2.0).weights(np.array([-8.0, 1.0, 4.0]))
    array([0.25, 1.  , 0.5 ])
    """

    c: float = 1.345

    def __post_init__(self) -> None:
        _check_constant(self.c)

    def rho(self, u: Floats) -> Floats:
        """Loss u^2 / 2 within ``c``, c abs(u) - c^2 / 2 beyond."""
        inner = np.minimum(np.abs(u), self.c)
        return inner * (np.abs(u) - 0.5 * inner)

    def psi(self, u: Floats) -> Floats:
        """Derivative of the loss: u clipped to -c .. c."""
        return np.clip(u, -self.c, self.c)

    def weights(self, u: Floats) -> Floats:
        """Weight psi(u) / u."""
        return self.c / np.maximum(np.abs(u), self.c)

    def psi_deriv(self, u: Floats) -> Floats:
        """Slope of psi."""
        return (np.abs(u) <= self.c).astype(np.float64)


@dataclass(frozen=True)
class Bisquare:
    """Tukey's bisquare: beyond ``c`` scales a row counts for nothing; redescending, so the start decides.

    Parameters
    ----------
    c : float
        Rejection point in scales; 4.685 keeps 95 % of the efficiency of least squares on normal errors.

    Notes
    -----
    weights(u) = (1 - (u/c)^2)^2 within c, else 0: Beaton and Tukey, Technometrics 16, 147 (1974).

    Examples
    --------
    >>> Bisquare(2.0).weights(np.array([0.0, 1.0, 4.0]))
    array([1.    , 0.5625, 0.    ])
    """

    c: float = 4.685

    def __post_init__(self) -> None:
        _check_constant(self.c)

    def rho(self, u: Floats) -> Floats:
        """Loss, which levels off at c^2 / 6."""
        return self.c**2 / 6.0 * (1.0 - self._inside(u) ** 3)

    def psi(self, u: Floats) -> Floats:
        """Derivative of the loss."""
        return u * self._inside(u) ** 2

    def weights(self, u: Floats) -> Floats:
        """Weight psi(u) / u."""
        return self._inside(u) ** 2

    def psi_deriv(self, u: Floats) -> Floats:
        """Slope of psi, negative between c / sqrt(5) and c."""
        inside = self._inside(u)
        return inside * (5.0 * inside - 4.0)

    def _inside(self, u: Floats) -> Floats:
        return 1.0 - np.minimum(np.abs(u) / self.c, 1.0) ** 2


def psi_deriv(loss: Loss, u: Floats) -> Floats:
    """Slope of psi at ``u``, by central difference where the loss does not give it."""
    exact = getattr(loss, "psi_deriv", None)
    if exact is not None:
        return np.asarray(exact(u), dtype=np.float64)
    step = 1e-5 * np.maximum(np.abs(u), 1.0)
    above, below = u + step, u - step
    return (above * loss.weights(above) - below * loss.weights(below)) / (above - below)


def _check_constant(c: float) -> None:
    if number("c", c, low=0.0) == 0.0:
        raise ValueError("c must be positive, got 0")
