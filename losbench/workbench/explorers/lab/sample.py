"""The straight line that most scenes fit, and how its fits are drawn."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

import losbench as lb
from losbench.figures import COLOURS

__all__ = ["ERROR", "INTERCEPT", "SLOPE", "TRUTH", "all_fits", "design", "line", "lines"]


INTERCEPT, SLOPE, ERROR = 1.0, 0.5, 0.3
TRUTH = np.array([INTERCEPT, SLOPE])
_LOOKS: dict[str, dict[str, Any]] = {
    "least squares": {"color": COLOURS["orange"], "ls": "--"},
    "Huber": {
        "color": COLOURS["blue"],
        "ls": "-",
        "zorder": 1.9,
    },  # under the broken ones: they often coincide
    "LTS": {"color": COLOURS["purple"], "ls": ":"},
    "MM": {"color": COLOURS["green"], "ls": "-."},
}


def line(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return x = 0 .. count - 1 and y on the true line with noise."""
    x = np.arange(float(count))
    noise = ERROR * np.random.default_rng(seed).standard_normal(count)
    return x, INTERCEPT + SLOPE * x + noise


def design(x: np.ndarray) -> np.ndarray:
    """Design matrix (..., n, 2) of a straight line."""
    return np.stack([np.ones_like(x), x], axis=-1)


def all_fits(A: np.ndarray, y: np.ndarray, names: tuple[str, ...]) -> dict[str, lb.RobustFit]:
    """Fit by the methods named; what does not settle in time is shown as far as it got."""
    methods: dict[str, Callable[[np.ndarray, np.ndarray], lb.RobustFit]] = {
        "least squares": lb.lstsq,
        "Huber": lambda A, y: lb.irls(A, y, max_iter=300, tol=1e-6, on_fail="ignore"),
        "LTS": lb.lts,
        "MM": lambda A, y: lb.mm(A, y, on_fail="ignore"),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return {name: methods[name](A, y) for name in names}


def lines(axes: Axes, names: Sequence[str], *, label: bool = True, **style: Any) -> dict[str, Any]:
    """Empty lines, one per method, each with its own look."""
    return {
        name: axes.plot(
            [], [], label=name if label else None, **{"lw": 1.8, **_LOOKS[name], **style}
        )[0]
        for name in names
    }
