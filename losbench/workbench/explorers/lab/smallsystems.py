"""Small fixed geometries, where robustness is won or lost by design: spots on a ring, and frames of
two spots.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from losbench.arrays import Floats
from losbench.checks import integer
from losbench.estimation.robust import irls, lstsq

__all__ = ["METHODS", "ring_errors", "spot_rows", "stacked_errors"]


METHODS: dict[str, dict[str, Any]] = {
    "least squares": {},
    "Huber, std": {"scale": "std"},
    "Huber, MAD": {"scale": "mad"},
    "known sigma": {"scale": 1.0},
    "known, per spot": {"scale": 1.0, "group": True},
}
_OFF = 100.0  # of the bad spot, in standard deviations of a good one


def spot_rows(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rows (1, 0, -v) and (0, 1, u) of spots at (u, v), (2 n, 3): two shifts and a turn."""
    A = np.zeros((len(u), 2, 3))
    A[:, 0, 0] = A[:, 1, 1] = 1.0
    A[:, 0, 2], A[:, 1, 2] = -v, u
    return A.reshape(-1, 3)


def ring_errors(spots: int, *, trials: int = 4000, seed: int = 0) -> dict[str, float]:
    """Root mean square errors of the first unknown, by method, for spots on a unit circle with one
    bad among them.

    Parameters
    ----------
    spots : int
        At least 2, equally spaced.
    trials : int
        Draws of unit noise; in each, one random spot is off by 100 in a random direction.
    seed : int
        Of the draws.

    Returns
    -------
    dict
        By the names of ``METHODS``, in standard deviations of a shift.

    Examples
    --------
    >>> errors = ring_errors(8, trials=500)
    >>> errors["least squares"] > 10 * errors["Huber, MAD"]
    True
    """
    count, draws = integer("spots", spots, low=2), integer("trials", trials, low=1)
    turn = 2.0 * np.pi * np.arange(count) / count
    rng = np.random.default_rng(seed)
    y = rng.standard_normal((draws, count, 2))
    heading, bad = rng.uniform(0.0, 2.0 * np.pi, draws), rng.integers(0, count, draws)
    y[np.arange(draws), bad] += _OFF * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return _errors(spot_rows(np.cos(turn), np.sin(turn)), y.reshape(draws, -1))


def stacked_errors(frames: int, *, trials: int = 4000, seed: int = 0) -> dict[str, float]:
    """Root mean square errors of the first unknown, by method, for frames of two spots at (+-1, 0)
    solved together.

    One spot is off by 100 along x in one frame of five, at least in one.

    Parameters
    ----------
    frames : int
        Frames that share the unknowns.
    trials : int
        Draws of unit noise.
    seed : int
        Of the draws.

    Returns
    -------
    dict
        By the names of ``METHODS``, in standard deviations of a shift.

    Examples
    --------
    >>> errors = stacked_errors(10, trials=500)
    >>> errors["Huber, std"] > 5 * errors["Huber, MAD"]
    True
    """
    count, draws = integer("frames", frames, low=1), integer("trials", trials, low=1)
    y = np.random.default_rng(seed).standard_normal((draws, count, 2, 2))
    y[:, : max(1, count // 5), 0, 0] += _OFF
    pair = spot_rows(np.array([1.0, -1.0]), np.zeros(2))
    return _errors(np.tile(pair, (count, 1)), y.reshape(draws, -1))


def _errors(A: Floats, y: Floats) -> dict[str, float]:
    spot = np.arange(A.shape[0]) // 2
    found = {}
    for name, options in METHODS.items():
        chosen = options | ({"group": spot} if "group" in options else {})
        fit = (
            irls(A, y, max_iter=300, tol=1e-8, on_fail="ignore", **chosen)
            if options
            else lstsq(A, y)
        )
        found[name] = float(np.sqrt(np.mean(fit.x[:, 0] ** 2)))
    return found
