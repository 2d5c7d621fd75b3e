"""What an outlier can do to an estimate, and what protection against it costs."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import lru_cache
from math import exp, lgamma, log
from typing import Any, TypeVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, integer, number
from losbench.estimation.losses import Loss, read_loss

__all__ = [
    "efficiency",
    "gross_error_sensitivity",
    "influence_function",
    "normal_mean",
    "sensitivity_curve",
    "tuned",
]

AnyLoss = TypeVar("AnyLoss", bound=Loss)

_FARTHEST = 12.0  # standard deviations: beyond, a normal density is nothing to a double
_PANELS = np.linspace(0.0, _FARTHEST, 241)
_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(8)


def influence_function(loss: Loss | str, u: ArrayLike) -> Floats:
    r"""Influence of an error of ``u`` scales on a location estimate with this loss, in scales, at
    normal errors.

    Parameters
    ----------
    loss : loss object or name
        E.g. ``Huber()`` or "huber".
    u : (...) array
        Error of one observation of many, in scales.

    Returns
    -------
    (...) array
        Shift of the estimate, times the number of observations.

    Notes
    -----
    .. math:: IF(u) = \psi(u) / E\,\psi'

    Hampel and others, Robust Statistics (1986), eq. (2.3.18).

    Examples
    --------
    >>> from losbench.estimation.losses import Huber
    >>> influence_function(Huber(), [-1.0, 0.0, 10.0, 1000.0]).round(3)
    array([-1.217,  0.   ,  1.637,  1.637])
    """
    at, loss = finite("u", u), read_loss(loss)
    return at * loss.weights(at) / _mean_slope(loss, 1)


def efficiency(loss: Loss | str, *, rows: int = 1) -> float:
    r"""Efficiency of an estimate with this loss on normal errors, against least squares.

    Parameters
    ----------
    loss : loss object or name
        E.g. ``Huber()`` or "huber".
    rows : int
        Rows that share one weight, as with ``group`` of `irls`.

    Returns
    -------
    float
        Ratio of variances, least squares over this one, with many observations and a known scale.

    Notes
    -----
    .. math:: e = (E\,\psi')^2 / E\,\psi^2

    by Gauss-Legendre quadrature (Huber 1981, eq. 3.2.6), with E psi' = E u psi(u) for normal
    errors, so that the weights are all that is needed. For g rows with one weight, u is their root
    mean square.

    Examples
    --------
    >>> from losbench.estimation.losses import Bisquare, Huber
    >>> round(efficiency(Huber(1.345)), 4), round(efficiency(Bisquare(4.685)), 4)
    (0.95, 0.95)
    """
    loss, rows = read_loss(loss), integer("rows", rows, low=1)
    try:
        return _cached_efficiency(cast(Hashable, loss), rows)
    except TypeError:  # not hashable, as the norms of other libraries may be
        return _efficiency(loss, rows)


@overload
def tuned(loss: AnyLoss, efficiency: float = ..., *, rows: int = ...) -> AnyLoss: ...
@overload
def tuned(loss: str, efficiency: float = ..., *, rows: int = ...) -> Loss: ...
def tuned(loss: Loss | str, efficiency: float = 0.95, *, rows: int = 1) -> Loss:
    """Scale the constants of a loss so that it has the efficiency asked for.

    Parameters
    ----------
    loss : dataclass with ``weights(u)``, or name
        Huber, Bisquare, Cauchy, Welsch, Hampel (whose three constants keep their ratios), or
        another like them.
    efficiency : float
        On normal errors, against least squares.
    rows : int
        Rows that share one weight.

    Returns
    -------
    loss object
        Of the same kind.

    Raises
    ------
    ValueError
        If no constant gives that efficiency, or the loss is no dataclass.

    Examples
    --------
    >>> from losbench.estimation.losses import Bisquare, Huber
    >>> round(tuned(Bisquare(), 0.95).c, 4), round(tuned(Huber(), 0.85).c, 4)
    (4.6851, 0.7317)
    """
    loss = read_loss(loss)
    if not _constants(loss):
        raise ValueError(f"loss must be a dataclass whose fields are its constants, got {loss!r}")
    wanted = number("efficiency", efficiency, low=0.0, high=1.0)
    return cast(Loss, _tuned(cast(Hashable, loss), wanted, integer("rows", rows, low=1)))


def gross_error_sensitivity(loss: Loss | str) -> float:
    """Most that one bad observation can do: the largest absolute influence, in scales; infinite for
    least squares, and for any loss whose pull still grows at 1e12 scales.

    Notes
    -----
    Hampel and others (1986), eq. (2.1.13). The median has the least of all location estimates,
    sqrt(pi / 2).

    Examples
    --------
    >>> from losbench.estimation.losses import Bisquare, Huber
    >>> round(gross_error_sensitivity(Huber()), 3), round(gross_error_sensitivity(Bisquare()), 3)
    (1.637, 1.77)
    """
    loss = read_loss(loss)
    u = np.geomspace(1e-4, 1e12, 500_001)
    pull = u * loss.weights(u)
    if pull[-1] > 1.01 * pull[u < 6e11].max():  # it grows to the end, be it by a logarithm
        return float("inf")
    return float(pull.max()) / _mean_slope(loss, 1)


def sensitivity_curve(
    estimate: Callable[[Floats], ArrayLike], sample: ArrayLike, at: ArrayLike
) -> Floats:
    """Effect on an estimate of one more observation, wherever it falls: the influence function of a
    finite sample.

    Parameters
    ----------
    estimate : callable
        From observations (k, n) to estimates (k,), along axis=-1: ``lambda y: np.median(y,
        axis=-1)``.
    sample : (n,) array
        Observations so far.
    at : (k,) array
        Values of the one more.

    Returns
    -------
    (k,) array
        (n + 1) times the change of the estimate (Tukey 1970).

    Raises
    ------
    ValueError
        If a value is NaN or infinite, or ``estimate`` does not return one number for each sample.

    Examples
    --------
    >>> sample = [-1.0, -0.5, 0.0, 0.5, 1.0]
    >>> sensitivity_curve(lambda y: y.mean(axis=-1), sample, [-6.0, 0.0, 60.0])
    array([-6.,  0., 60.])
    >>> sensitivity_curve(lambda y: np.median(y, axis=-1), sample, [-6.0, 0.0, 60.0])
    array([-1.5,  0. ,  1.5])
    """
    base, more = finite("sample", sample, ndim=1), finite("at", at, ndim=1)
    joined = np.concatenate([np.broadcast_to(base, (len(more), len(base))), more[:, None]], axis=1)
    after, before = np.asarray(estimate(joined)), np.asarray(estimate(base[None]))
    if after.shape != (len(more),) or before.shape != (1,):
        raise ValueError(
            "estimate must work along axis=-1 and return one number for each sample, "
            f"shape {(len(more),)} for samples {joined.shape}, got {after.shape}"
        )
    return np.asarray(len(joined[0]) * (after - before), dtype=np.float64)


def normal_mean(
    function: Callable[[Floats], Floats], *, rows: int = 1, corners: tuple[float, ...] = ()
) -> float:
    """Mean of an even function of u, the root mean square of ``rows`` standard normal errors.

    ``corners`` are where the function has kinks.

    >>> round(normal_mean(lambda u: u**2), 12), round(normal_mean(lambda u: u**4, rows=2), 12)
    (1.0, 2.0)
    """
    edges = np.union1d(_PANELS, [c for c in corners if 0.0 < c < _FARTHEST])
    half = 0.5 * np.diff(edges)[:, None]
    u = edges[:-1, None] + half * (1.0 + _NODES)
    g = float(rows)
    log_density = (
        0.5 * g * log(0.5 * g) - lgamma(0.5 * g) + log(2.0) + (g - 1.0) * np.log(u) - 0.5 * g * u**2
    )
    return float(np.sum(half * _NODE_WEIGHTS * np.exp(log_density) * function(u)))


def _constants(loss: Loss) -> dict[str, float]:
    return {name: getattr(loss, name) for name in getattr(loss, "__dataclass_fields__", ())}


def _corners(loss: Loss) -> tuple[float, ...]:
    return tuple(_constants(loss).values())


def _mean_slope(loss: Loss, rows: int) -> float:
    return normal_mean(lambda u: u**2 * loss.weights(u), rows=rows, corners=_corners(loss))


def _efficiency(loss: Loss, rows: int) -> float:
    power = normal_mean(lambda u: (u * loss.weights(u)) ** 2, rows=rows, corners=_corners(loss))
    return _mean_slope(loss, rows) ** 2 / power


_cached_efficiency = lru_cache(maxsize=1024)(_efficiency)


@lru_cache(maxsize=256)
def _tuned(loss: Any, wanted: float, rows: int) -> Any:
    from scipy.optimize import (
        brentq,  # a tenth of a second that `import losbench` need not wait for
    )

    def scaled(log_factor: float) -> Any:
        constants = {name: value * exp(log_factor) for name, value in _constants(loss).items()}
        return replace(loss, **constants)

    def missing(log_factor: float) -> float:
        return _efficiency(scaled(log_factor), rows) - wanted

    low, high = -2.5, 2.0
    if not missing(low) < 0.0 < missing(high):
        reach = f"{missing(low) + wanted:.3f} to {missing(high) + wanted:.5f}"
        raise ValueError(
            f"efficiency must be within what {type(loss).__name__} can have, {reach}, got "
            f"{wanted:g}"
        )
    return scaled(brentq(missing, low, high, xtol=1e-12))
