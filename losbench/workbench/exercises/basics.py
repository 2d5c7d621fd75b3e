"""Exercises 1 to 8: one-liners and short ones. Each draws its data and judges an answer to them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from losbench.estimation.breakdown import design_breakdown
from losbench.estimation.influence import efficiency
from losbench.estimation.losses import Huber
from losbench.estimation.robust import irls, lstsq
from losbench.units import MAD_PER_SIGMA
from losbench.workbench.explorers.lab.smallsystems import spot_rows

__all__ = [
    "close",
    "data_01",
    "data_02",
    "data_03",
    "data_04",
    "data_05",
    "data_06",
    "data_07",
    "data_08",
    "judge_01",
    "judge_02",
    "judge_03",
    "judge_04",
    "judge_05",
    "judge_06",
    "judge_07",
    "judge_08",
]


def data_01(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: Huber's location of values with a wild one."""
    y = rng.uniform(5.0, 9.0) + 0.1 * rng.standard_normal(11)
    y[rng.integers(11)] += 30.0
    return SimpleNamespace(A=np.ones((11, 1)), y=y)


def judge_01(d: SimpleNamespace, answer: Any) -> str:
    """Judge: Huber's location of values with a wild one."""
    if close(np.squeeze(answer), irls(d.A, d.y).x[0], rtol=0.0, atol=1e-3):
        return ""
    if abs(float(np.squeeze(answer)) - np.median(d.y)) > 0.5:
        return "That is far from where most points are. Which fit listens less to a wild value?"
    return "Near, but is it Huber's fit with the default constant and scale?"


def data_02(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: Huber's weights of given residuals."""
    return SimpleNamespace(
        residuals=np.round(rng.standard_t(2, 9) * 3.0, 2), scale=round(rng.uniform(0.5, 2.0), 2)
    )


def judge_02(d: SimpleNamespace, answer: Any) -> str:
    """Judge: Huber's weights of given residuals."""
    if close(answer, Huber(1.345).weights(d.residuals / d.scale)):
        return ""
    if close(answer, Huber(1.345).weights(d.residuals)):
        return "Large compared with what? The constant 1.345 is in units of the scale."
    if np.max(answer) > 1.0:
        return (
            "No row counts for more than 1: within 1.345 scales the weight does not rise any "
            "further."
        )
    return "Is the weight psi(u) / u, and what is psi of a residual of the other sign?"


def data_03(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: the scale by the median."""
    r = 2.0 * rng.standard_normal(15)
    r[:4] += 50.0
    return SimpleNamespace(residuals=r)


def judge_03(d: SimpleNamespace, answer: Any) -> str:
    """Judge: the scale by the median."""
    raw, answer = float(np.median(np.abs(d.residuals))), np.squeeze(answer)
    if close(answer, raw / MAD_PER_SIGMA):
        return ""
    if close(answer, raw):
        return (
            "The median of |r| of normal errors is not their standard deviation. By what must it "
            "be divided?"
        )
    if close(answer, np.median(np.abs(d.residuals - np.median(d.residuals))) / MAD_PER_SIGMA):
        return (
            "Residuals of a fit have their centre where the fit puts it. About which value are "
            "they measured here?"
        )
    return "Is it the median of the absolute residuals, made to agree with sigma on normal errors?"


def data_04(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: the constant of an efficiency."""
    return SimpleNamespace(percent=int(rng.integers(75, 99)))


def judge_04(d: SimpleNamespace, answer: Any) -> str:
    """Judge: the constant of an efficiency."""
    c = float(np.squeeze(answer))
    found = 100.0 * efficiency(Huber(c))
    if abs(found - d.percent) < 0.1:
        return ""
    return (
        f"That constant has {found:.1f} %. Should it be "
        f"{'larger' if found < d.percent else 'smaller'}, and why?"
    )


def data_05(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: how many infinite values a median survives."""
    n = int(rng.integers(9, 30))
    return SimpleNamespace(y=np.round(rng.standard_normal(n), 2))


def judge_05(d: SimpleNamespace, answer: Any) -> str:
    """Judge: how many infinite values a median survives."""
    n = len(d.y)
    truth = (n - 1) // 2
    if answer == truth:
        return ""
    if answer == truth + 1:
        return "With so many at infinity, is the middle one still one of the good?"
    return "Send values to infinity one by one. When does the middle of the sorted list go along?"


def data_06(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: the bad one of two spots."""
    points = np.array([[5.0, 75.0, -475.0], [-5.0, 75.0, -475.0]])
    shifts = 1e-3 * rng.standard_normal((2, 2))
    shifts[rng.integers(2), 0] += 0.05
    return SimpleNamespace(points=points, shifts=shifts)


def judge_06(d: SimpleNamespace, answer: Any) -> str:
    """Judge: the bad one of two spots."""
    if answer is None:
        return ""
    return (
        "Swap the two spots' residuals of the fit. Does anything change that would tell you which "
        "one is bad?"
    )


def data_07(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: what a layout survives."""
    count = int(rng.integers(6, 11))
    turn = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    reach = rng.uniform(0.5, 1.5, count)
    return SimpleNamespace(u=reach * np.cos(turn), v=reach * np.sin(turn))


def judge_07(d: SimpleNamespace, answer: Any) -> str:
    """Judge: what a layout survives."""
    count = len(d.u)
    rows = spot_rows(d.u, d.v)
    found = design_breakdown(rows, group=np.repeat(np.arange(count), 2))
    given = tuple(answer)
    if len(given) != 2:
        return (
            "Two numbers are asked for: what a monotone M-estimate survives, and what any estimate "
            "could."
        )
    if given == (found.monotone, found.any):
        return ""
    single = design_breakdown(rows)
    if given == (single.monotone, single.any):
        return "Those are bad rows. A spot goes bad as a whole: which rows belong together?"
    right = (
        "The other number is right. " if found.monotone == given[0] or found.any == given[1] else ""
    )
    if found.any != given[1]:
        return right + (
            "Any estimate, the second number: by how many must good spots outnumber the bad to "
            "be believed?"
        )
    return right + (
        "A monotone estimate, the first: is there a motion of which so few spots have half of "
        "the pull?"
    )


def data_08(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: the row of greatest leverage."""
    x = rng.uniform(0.0, 10.0, 14)
    x[rng.integers(14)] = rng.uniform(25.0, 40.0)
    y = 2.0 + 0.7 * x + 0.3 * rng.standard_normal(14)
    return SimpleNamespace(A=np.column_stack([np.ones(14), x]), y=y)


def judge_08(d: SimpleNamespace, answer: Any) -> str:
    """Judge: the row of greatest leverage."""
    row, value = answer
    leverage = lstsq(d.A, d.y).leverage
    if row == int(np.argmax(leverage)) and close(value, leverage.max()):
        return ""
    if row != int(np.argmax(leverage)):
        return "Leverage knows nothing of y. Which row's x is farthest from the others?"
    return "The right row. The leverage is a diagonal element of the hat matrix A (A'A)^-1 A'."


def close(answer: Any, truth: Any, *, rtol: float = 1e-3, atol: float = 0.0) -> bool:
    """Whether an answer has the shape of the truth and its values, nearly."""
    values, wanted = np.asarray(answer, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    return values.shape == wanted.shape and bool(np.allclose(values, wanted, rtol=rtol, atol=atol))
