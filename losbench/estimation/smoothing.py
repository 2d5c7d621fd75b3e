"""Kalman filter and smoother for slowly drifting series of centroids or angles, on statsmodels'
state space.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats
from losbench.checks import finite_or_nan, non_negative
from losbench.records import changed, stack

__all__ = ["Smoothed", "kalman_smooth"]


_FEWEST = 4  # present samples: two for the unknown start, two to tell noise from motion
_SAME_LIKELIHOOD = 1e-2
_ROUNDING = 64 * np.finfo(float).eps
_NOTHING = 1e-100  # error of a series of zeros, whose square is still a number
_STARTS = (
    (1.0, 1e-3, 1e-5),
    (0.1, 1.0, 1e-2),
)  # variances of a noisy and of a restless series, normalised


@dataclass(frozen=True)
class Smoothed:
    """A series as the local linear trend model sees it; n frames, any trailing axes (...).

    Attributes
    ----------
    smoothed, smoothed_std : (n, ...) arrays, unit of the series
        Level given all frames, and its standard error; missing frames are filled in, with the error
        this costs.
    filtered, filtered_std : (n, ...) arrays, unit of the series
        Level given the frames so far; NaN until two samples have been seen.
    slope, slope_std : (n, ...) arrays, unit of the series per frame
        Slope given all frames.
    variances : (3, ...) array, unit of the series squared
        Of the measurement noise, of the level's steps and of the slope's steps, each per frame.
    log_likelihood : (...) array
        Diffuse log likelihood: of what the samples say beyond the unknown start.
    converged : (...) bool array
        Whether the variances are given or their likelihood found a maximum; False, with NaN
        everywhere, for a series of fewer than 4 samples.
    """

    smoothed: Floats
    smoothed_std: Floats
    filtered: Floats
    filtered_std: Floats
    slope: Floats
    slope_std: Floats
    variances: Floats
    log_likelihood: Floats
    converged: Bools


def kalman_smooth(series: ArrayLike, *, variances: ArrayLike | None = None) -> Smoothed:
    """Filter and smooth series by a local linear trend with an unknown start.

    Parameters
    ----------
    series : (n, ...) array, any unit
        Evenly spaced samples along axis 0; NaN marks a missing frame. Each series is treated alone.
    variances : (3,) or (3, ...) array, unit of the series squared, optional
        Variances of the measurement noise, the level's steps and the slope's steps, not all zero;
        found by maximum likelihood otherwise.

    Returns
    -------
    Smoothed

    Raises
    ------
    ValueError
        If ``series`` has fewer than 4 frames or holds an infinity, or ``variances`` has the wrong
        shape, a negative value, or only zeros.

    Notes
    -----
    y_t = m_t + e_t, m_(t+1) = m_t + b_t + u_t, b_(t+1) = b_t + v_t (Durbin and Koopman 2012, eq.
    3.2), with exact diffuse initialisation. A series is normalised before it is fitted, so its unit
    does not matter.

    Examples
    --------
    >>> fit = kalman_smooth([0.0, 1.0, float("nan"), 3.0, 4.0], variances=[1.0, 0.0, 0.0])
    >>> fit.smoothed.round(6) + 0.0
    array([0., 1., 2., 3., 4.])
    """
    y = finite_or_nan("series", series)
    if y.ndim < 1 or len(y) < _FEWEST:
        raise ValueError(f"series must have at least {_FEWEST} frames, got shape {y.shape}")
    given = None if variances is None else _given(variances, y.shape[1:])
    columns = y.reshape(len(y), -1)
    fits = [
        _smooth(column, None if given is None else given[:, k])
        for k, column in enumerate(columns.T)
    ]
    failed = sum(not fit.converged for fit in fits)
    if failed:
        message = (
            f"kalman_smooth: {failed} of {len(fits)} series are too short or did not converge, see "
            ".converged"
        )
        warnings.warn(message, RuntimeWarning, stacklevel=2)
    shape = y.shape[1:]
    return changed(stack(fits, axis=-1), lambda array: array.reshape(array.shape[:-1] + shape))


def _given(variances: ArrayLike, shape: tuple[int, ...]) -> Floats:
    values = non_negative("variances", variances)
    if values.shape not in ((3,), (3, *shape)):
        wanted = ", ".join(map(str, (3, *shape)))
        raise ValueError(f"variances must have shape (3,) or ({wanted}), got {values.shape}")
    if not values.any(axis=0).all():
        raise ValueError("variances must not all be zero")
    return np.broadcast_to(values.reshape(3, -1), (3, int(np.prod(shape))))


def _smooth(y: Floats, variances: Floats | None) -> Smoothed:
    """Smooth one series (n,)."""
    present = np.flatnonzero(~np.isnan(y))
    if len(present) < _FEWEST:
        return _nothing(len(y))
    offset = y[present[0]]
    slopes = np.diff(y[present]) / np.diff(present)
    rounding = _ROUNDING * float(np.abs(y[present]).max())
    exact = bool(np.ptp(slopes) <= rounding)
    if variances is not None:
        unit = float(np.sqrt(variances.max()))
    elif exact:  # there is only rounding to normalise by, and of zeros not even that
        unit = rounding or _NOTHING
    else:  # noise alone leaves steps of sqrt(2) of its size
        unit = float(np.std(slopes)) / np.sqrt(2.0)
    model = _model((y - offset) / unit)
    if variances is not None:
        scaled, converged = variances / unit**2, True
    elif exact:
        scaled, converged = np.array([1.0, 0.0, 0.0]), True
    else:
        scaled, converged = _most_likely(model)
    result = model.smooth(scaled, cov_type="none")
    unseen = np.arange(len(y)) < present[1]
    return Smoothed(
        smoothed=offset + unit * result.smoothed_state[0],
        smoothed_std=unit * _root(result.smoothed_state_cov[0, 0]),
        filtered=np.where(unseen, np.nan, offset + unit * result.filtered_state[0]),
        filtered_std=np.where(unseen, np.nan, unit * _root(result.filtered_state_cov[0, 0])),
        slope=unit * result.smoothed_state[1],
        slope_std=unit * _root(result.smoothed_state_cov[1, 1]),
        variances=scaled * unit**2,
        log_likelihood=np.array(result.llf - (len(present) - 2) * np.log(unit)),
        converged=np.array(converged),
    )


def _nothing(n: int) -> Smoothed:
    missing = np.full(n, np.nan)
    return Smoothed(
        smoothed=missing,
        smoothed_std=missing,
        filtered=missing,
        filtered_std=missing,
        slope=missing,
        slope_std=missing,
        variances=np.full(3, np.nan),
        log_likelihood=np.array(np.nan),
        converged=np.array(False),
    )


def _model(y: Floats) -> Any:
    # Imported from where it lives: all of statsmodels.api takes seconds.
    from statsmodels.tsa.statespace.structural import UnobservedComponents

    return UnobservedComponents(y, "local linear trend", use_exact_diffuse=True)


def _most_likely(model: Any) -> tuple[Floats, bool]:
    options = {
        "method": "lbfgs",
        "maxiter": 200,
        "disp": 0,
        "warn_convergence": False,
        "cov_type": "none",
    }
    fits = [model.fit(start, **options) for start in _STARTS]
    best = max(fits, key=lambda fit: fit.llf)
    # A line search may fail on the last digits of a flat maximum; it is the maximum if another
    # start has found it too.
    equal = [fit for fit in fits if fit.llf > best.llf - _SAME_LIKELIHOOD]
    return np.asarray(best.params), any(fit.mle_retvals["converged"] for fit in equal)


def _root(variance: Floats) -> Floats:
    return np.sqrt(np.maximum(variance, 0.0))
