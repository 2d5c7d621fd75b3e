"""Loss functions of robust regression, each a small object with its tuning constant.

With u a residual over its scale: ``rho(u)`` is the loss, ``psi(u)`` its derivative, ``weights(u) =
psi(u) / u`` what iteratively reweighted least squares multiplies a row by, and ``psi_deriv(u)``
what its covariance needs. `irls` asks for ``weights`` alone, so any object will do whose weights
take arrays of any shape and are 1 at zero: the norms of statsmodels too, all but ``MQuantileNorm``,
which takes one dimension only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from losbench.arrays import Floats
from losbench.checks import choice, number

__all__ = ["Bisquare", "Cauchy", "Hampel", "Huber", "Loss", "Welsch", "psi_deriv", "read_loss"]


_FAR = 26.0  # exp(-26^2) is the last power of its kind that a double holds to full precision


class Loss(Protocol):
    """What `irls` asks of a loss: a weight per scaled residual, in arrays of any shape (...)."""

    def weights(self, u: Floats, /) -> Floats:
        """Weight of each scaled residual: 1 at u = 0, never NaN."""


@dataclass(frozen=True)
class Huber:
    r"""Huber's loss: squares up to ``c`` scales, straight lines beyond; monotone, so the start does
    not matter.

    Parameters
    ----------
    c : float
        Threshold in scales; 1.345 keeps 95 % of the efficiency of least squares on normal errors.

    Notes
    -----
    .. math:: w(u) = \min(1,\ c / |u|)

    liu2026, eq. (9); Huber, Ann. Math. Statist. 35, 73 (1964).

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
    r"""Tukey's bisquare: beyond ``c`` scales a row counts for nothing; redescending, so the start
    decides.

    Parameters
    ----------
    c : float
        Rejection point in scales; 4.685 keeps 95 % of the efficiency of least squares on normal
        errors.

    Notes
    -----
    .. math:: w(u) = \max(0,\ 1 - (u/c)^2)^2

    Beaton and Tukey, Technometrics 16, 147 (1974).

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


@dataclass(frozen=True)
class Cauchy:
    r"""Cauchy's loss: no row is ever rejected, but the farther the less its pull; redescending
    without an end.

    Parameters
    ----------
    c : float
        Where the pull is greatest, in scales; 2.385 keeps 95 % of the efficiency of least squares
        on normal errors.

    Notes
    -----
    .. math:: w(u) = \frac{1}{1 + (u/c)^2}

    The likelihood of Student's t with one degree of freedom;
    Holland and Welsch, Comm. Statist. A 6, 813 (1977).

    Examples
    --------
    >>> Cauchy(2.0).weights(np.array([0.0, 2.0, 6.0]))
    array([1. , 0.5, 0.1])
    """

    c: float = 2.385

    def __post_init__(self) -> None:
        _check_constant(self.c)

    def rho(self, u: Floats) -> Floats:
        """Loss, which grows as a logarithm."""
        return self.c**2 / 2.0 * np.log1p(self._squared(u))

    def psi(self, u: Floats) -> Floats:
        """Derivative of the loss."""
        return u * self.weights(u)

    def weights(self, u: Floats) -> Floats:
        """Weight psi(u) / u."""
        return 1.0 / (1.0 + self._squared(u))

    def psi_deriv(self, u: Floats) -> Floats:
        """Slope of psi, negative beyond c."""
        weights = self.weights(u)
        return weights * (2.0 * weights - 1.0)

    def _squared(self, u: Floats) -> Floats:
        return np.minimum(np.abs(u) / self.c, 1e150) ** 2


@dataclass(frozen=True)
class Welsch:
    r"""Welsch's loss: a row's weight falls as a bell curve, smoothly and fast; redescending, so the
    start decides.

    Parameters
    ----------
    c : float
        Width of the bell in scales; 2.985 keeps 95 % of the efficiency of least squares on normal
        errors.

    Notes
    -----
    .. math:: w(u) = \exp(-(u/c)^2)

    Holland and Welsch, Comm. Statist. A 6, 813 (1977).

    Examples
    --------
    >>> Welsch(2.0).weights(np.array([0.0, 2.0, 80.0])).round(4)
    array([1.    , 0.3679, 0.    ])
    """

    c: float = 2.985

    def __post_init__(self) -> None:
        _check_constant(self.c)

    def rho(self, u: Floats) -> Floats:
        """Loss, which levels off at c^2 / 2."""
        return -(self.c**2) / 2.0 * np.expm1(-(self._distance(u) ** 2))

    def psi(self, u: Floats) -> Floats:
        """Derivative of the loss."""
        return u * self.weights(u)

    def weights(self, u: Floats) -> Floats:
        """Weight psi(u) / u."""
        distance = self._distance(u)
        return np.where(distance < _FAR, np.exp(-(distance**2)), 0.0)

    def psi_deriv(self, u: Floats) -> Floats:
        """Slope of psi, negative beyond c / sqrt(2)."""
        return (1.0 - 2.0 * self._distance(u) ** 2) * self.weights(u)

    def _distance(self, u: Floats) -> Floats:
        return np.minimum(np.abs(u) / self.c, _FAR)


@dataclass(frozen=True)
class Hampel:
    """Hampel's three-part loss: squares to ``a`` scales, full pull to ``b``, none beyond ``c``;
    redescending.

    Parameters
    ----------
    a, b, c : float
        Corners of psi in scales, 0 < a <= b < c; 0.9016 times (1.5, 3.5, 8) keeps 95 % of the
        efficiency of least squares on normal errors.

    Notes
    -----
    psi rises with slope 1 to ``a``, is level to ``b`` and falls to zero at ``c``: Hampel and
    others, Robust Statistics (1986), section 2.6.

    Examples
    --------
    >>> Hampel(1.0, 2.0, 4.0).psi(np.array([0.5, 1.5, 3.0, 5.0]))
    array([0.5, 1. , 0.5, 0. ])
    """

    a: float = 0.9016 * 1.5
    b: float = 0.9016 * 3.5
    c: float = 0.9016 * 8.0

    def __post_init__(self) -> None:
        for name in ("a", "b", "c"):
            _check_constant(getattr(self, name), name)
        if not self.a <= self.b < self.c:
            raise ValueError(
                f"a, b, c must rise, a <= b < c, got {self.a:g}, {self.b:g}, {self.c:g}"
            )

    def rho(self, u: Floats) -> Floats:
        """Loss, which levels off at a (b + c - a) / 2."""
        inner = np.minimum(np.abs(u), self.a)
        level = np.clip(np.abs(u), self.a, self.b) - self.a
        falling = 0.5 * (self.c - self.b) * (1.0 - self._fall(u) ** 2)
        return 0.5 * inner**2 + self.a * (level + falling)

    def psi(self, u: Floats) -> Floats:
        """Derivative of the loss."""
        return np.clip(u, -self.a, self.a) * self._fall(u)

    def weights(self, u: Floats) -> Floats:
        """Weight psi(u) / u."""
        return self.a / np.maximum(np.abs(u), self.a) * self._fall(u)

    def psi_deriv(self, u: Floats) -> Floats:
        """Slope of psi: 1, 0, -a / (c - b), 0."""
        size = np.abs(u)
        return np.where(
            size <= self.a,
            1.0,
            np.where((size > self.b) & (size < self.c), -self.a / (self.c - self.b), 0),
        )

    def _fall(self, u: Floats) -> Floats:
        return np.clip((self.c - np.abs(u)) / (self.c - self.b), 0.0, 1.0)


_NAMED: dict[str, Callable[[], Loss]] = {
    "huber": Huber,
    "bisquare": Bisquare,
    "cauchy": Cauchy,
    "welsch": Welsch,
    "hampel": Hampel,
}


def read_loss(loss: Loss | str) -> Loss:
    """Return the loss of that name, with the constants of 95 % efficiency, or the object if it can
    be used as one.

    >>> read_loss("huber")
    Huber(c=1.345)
    """
    if isinstance(loss, str):
        return _NAMED[choice("loss", loss, _NAMED)]()
    if isinstance(loss, type):
        raise ValueError(
            f"loss must be an object, {loss.__name__}(...), got the class {loss.__name__} itself"
        )
    if not callable(getattr(loss, "weights", None)):
        raise ValueError(f"loss must have a method weights(u), got {loss!r}")
    at_zero = np.zeros((2, 3))
    try:
        with np.errstate(all="ignore"):
            weights = np.asarray(loss.weights(at_zero), dtype=np.float64)
    except (IndexError, TypeError, ValueError) as problem:
        raise ValueError(
            f"loss must have weights(u) for arrays u of any shape, those of {loss!r} fail at (2, "
            f"3): {problem}"
        ) from None
    if weights.shape != at_zero.shape or not np.isfinite(weights).all():
        raise ValueError(
            "loss must give each u a finite weight, u = 0 of a perfect fit too, "
            f"got {weights.tolist()} for zeros of shape (2, 3) from {loss!r}"
        )
    return loss


def psi_deriv(loss: Loss, u: Floats) -> Floats:
    """Slope of psi at ``u``, by central difference where the loss does not give it."""
    exact = getattr(loss, "psi_deriv", None)
    if exact is not None:
        return np.asarray(exact(u), dtype=np.float64)
    step = 1e-5 * np.maximum(np.abs(u), 1.0)
    above, below = u + step, u - step
    return (above * loss.weights(above) - below * loss.weights(below)) / (above - below)


def _check_constant(value: float, name: str = "c") -> None:
    if number(name, value, low=0.0) == 0.0:
        raise ValueError(f"{name} must be positive, got 0")
