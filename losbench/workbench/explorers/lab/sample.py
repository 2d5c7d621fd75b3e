"""The straight line that most scenes fit, and how its fits are drawn."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from losbench.arrays import Floats
from losbench.estimation.highbreakdown import lts, mm
from losbench.estimation.robust import RobustFit, irls, lstsq
from losbench.figures import COLOURS

__all__ = ["ERROR", "HEAD", "TRUTH", "all_fits", "design", "line", "lines"]


TRUTH = np.array([1.0, 0.5])
ERROR = 0.3
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

HEAD = f"""\
import numpy as np
import losbench as lb

rng = np.random.default_rng({{seed}})
x = np.arange({{count}}.0)
y = {TRUTH[0]} + {TRUTH[1]} * x + {ERROR} * rng.standard_normal({{count}})
"""


def line(count: int, seed: int) -> tuple[Floats, Floats]:
    """Return x = 0 .. count - 1 and y on the true line with noise."""
    x = np.arange(float(count))
    return x, TRUTH[0] + TRUTH[1] * x + ERROR * np.random.default_rng(seed).standard_normal(count)


def design(x: Floats) -> Floats:
    """Design matrix (..., n, 2) of a straight line."""
    return np.stack([np.ones_like(x), x], axis=-1)


def all_fits(A: Floats, y: Floats, names: Sequence[str]) -> dict[str, RobustFit]:
    """Fit by the methods named; what does not settle in time is shown as far as it got."""
    methods: dict[str, Any] = {
        "least squares": lstsq,
        "Huber": lambda A, y: irls(A, y, max_iter=300, tol=1e-6, on_fail="ignore"),
        "LTS": lts,
        "MM": lambda A, y: mm(A, y, on_fail="ignore"),
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
