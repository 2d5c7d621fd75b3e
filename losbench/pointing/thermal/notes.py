"""What the reader of an identification must know."""

from __future__ import annotations

import numpy as np

from losbench.pointing.thermal.axis import AxisFit
from losbench.pointing.thermal.design import Design

__all__ = ["notes_of"]

_WORST_CONDITION, _WORST_VIF = 30.0, 10.0
_STATES = {
    "weak": "the lag behind {name} is known weakly: a third of the record or more is possible",
    "no lag seen": "no lag behind {name} is seen",
    "not identifiable": (
        "the lag behind {name} is not identifiable, and so neither is the sensitivity: a lag as "
        "long as the record fits as well"
    ),
}
_OF_ALL_LAGS = {
    "not identifiable": (
        "the lag behind {name} is not identifiable: a lag as long as the record fits as well, and "
        "the sensitivity is at rest only as far as lags within the record"
    ),
}


def notes_of(axes: list[AxisFit], design: Design, series: bool) -> tuple[str, ...]:
    """Sentences about every axis."""
    return tuple(
        ("" if series else f"Axis {k}: ") + sentence
        for k, axis in enumerate(axes, 1)
        for sentence in _sentences(axis, design)
    )


def _sentences(axis: AxisFit, design: Design) -> list[str]:
    states = _STATES | (_OF_ALL_LAGS if axis.law == "all lags" else {})
    lines = [
        states[state].format(name=name)
        for state, (_, name) in zip(axis.tau_state, design.lags, strict=True)
        if state in states
    ]
    tests = axis.lack_of_fit
    if tests.rejects:
        lines.append(
            f"one lag does not describe it (F test of more lags: p = {tests.f_p_value:.2g}"
            + (
                f"; von Neumann's ratio: p = {tests.neumann_p_value:.2g})"
                if tests.neumann_p_value == tests.neumann_p_value
                else ")"
            )
            + (
                ": sensitivities to lagged sensors are sums over all lags"
                if axis.law == "all lags"
                else "; intervals hold only as far as the law"
            )
        )
    more = "all sensors" if axis.law == "all lags" else "trend, season and all sensors"
    lines += [f"with {more}, {text}" for text in axis.omitted]
    labels = design.model.labels
    worst = int(np.argmax(axis.vif))
    if axis.alike.any():
        names = ", ".join(label for label, one in zip(labels, axis.alike, strict=True) if one)
        lines.append(
            f"{names} cannot be told apart by these samples: no sensitivity to them is given, "
            "predictions are safe as long as they stay alike"
        )
    elif axis.condition > _WORST_CONDITION or axis.vif[worst] > _WORST_VIF:
        lines.append(
            f"columns are nearly collinear (condition {axis.condition:.3g}, variance of "
            f"{labels[worst]} inflated {axis.vif[worst]:.3g} times): read single sensitivities "
            "with care, predictions are safe"
        )
    if axis.thinned > 1:
        lines.append(
            f"the errors are smoother than noise, as of a series that was smoothed: one of "
            f"{axis.thinned} samples enters the intervals"
        )
    rejected = int(axis.rejected.sum())
    if rejected:
        used = int(np.isfinite(axis.residuals).sum())
        lines.append(f"{rejected} of {used} samples lie beyond four sigma and enter no interval")
    return lines
