"""Exercises 9 to 14: small projects. Each draws its data and judges an answer to them."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np

from losbench.arrays import Floats
from losbench.checks import integer, shaped
from losbench.estimation.breakdown import deletion_residuals
from losbench.estimation.influence import efficiency, gross_error_sensitivity
from losbench.estimation.losses import Bisquare, Cauchy, Huber, Welsch
from losbench.estimation.robust import irls, lstsq
from losbench.optics.camera import design_matrix
from losbench.workbench.exercises.basics import close

__all__ = [
    "data_09",
    "data_10",
    "data_11",
    "data_12",
    "data_13",
    "data_14",
    "judge_09",
    "judge_10",
    "judge_11",
    "judge_12",
    "judge_13",
    "judge_14",
]


_RIGHT = 2.0  # standard deviations of a frame without bad spots


def data_09(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: several bad rows that mask each other."""
    A, y = _line(rng, 20)
    bad = int(rng.integers(3, 6))
    y[-bad:] += rng.uniform(4.0, 6.0)
    return SimpleNamespace(A=A, y=y, hidden_truth=set(range(20 - bad, 20)))


def judge_09(d: SimpleNamespace, answer: Any) -> str:
    """Judge: several bad rows that mask each other."""
    named, truth = _rows(answer, len(d.y)), d.hidden_truth
    if truth <= named and named - truth in _borderline(d):
        return ""
    alone = set(np.flatnonzero(np.abs(deletion_residuals(lstsq(d.A, d.y))) > 3.0).tolist())
    if named == alone:
        return (
            "That is what one finds by leaving out one row at a time. Could several vouch for each "
            "other?"
        )
    if not named:
        return "No row is named. Against which fit did you measure them?"
    if named < truth:
        return "These are bad, and they are not alone."
    return (
        "Some of these are good. Against which fit did you measure them, and could the bad ones "
        "move it?"
    )


def data_10(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: a start in the wrong basin."""
    centre = rng.uniform(-5.0, 5.0)
    y = centre + np.concatenate([rng.standard_normal(14), 9.0 + 0.5 * rng.standard_normal(6)])
    return SimpleNamespace(A=np.ones((20, 1)), y=rng.permutation(y))


def judge_10(d: SimpleNamespace, answer: Any) -> str:
    """Judge: a start in the wrong basin."""
    start = float(np.squeeze(answer))
    end = irls(d.A, d.y, loss=Bisquare(), scale=1.0, x0=[start], max_iter=500, on_fail="ignore")
    if not end.converged or abs(start - np.median(d.y)) > 1e3:
        return "From there no value is in reach and every weight is zero. Start nearer."
    if end.x[0] > np.mean(np.sort(d.y)[[13, 14]]):
        return ""
    return "From there it ends at the large heap. On which side of the watershed must it start?"


def data_11(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: how much better Huber is on heavy tails."""
    A = rng.standard_normal((30, 3))
    y = rng.standard_normal((2000, 30)) * np.where(rng.random((2000, 30)) < 0.1, 10.0, 1.0)
    return SimpleNamespace(A=A, y=y)


def judge_11(d: SimpleNamespace, answer: Any) -> str:
    """Judge: how much better Huber is on heavy tails."""

    def ratio(fit: Any) -> float:
        return float(np.mean(lstsq(d.A, d.y).x ** 2) / np.mean(fit.x**2))

    huber = ratio(irls(d.A, d.y, max_iter=300, on_fail="ignore"))
    if close(answer, huber, rtol=0.02):
        return ""
    if close(answer, 1.0 / huber, rtol=0.02):
        return "How many times better is it? Which of the two mean squares is the larger?"
    if close(answer, np.sqrt(huber), rtol=0.02):
        return "That compares standard deviations. Efficiency compares variances."
    return (
        "The truth is zero, so mean squares of x are errors. Average them over all systems and "
        "unknowns, for both fits."
    )


def data_12(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: a loss of one's own."""
    return SimpleNamespace(
        u=np.linspace(-12.0, 12.0, 2401), least_efficiency=0.9, greatest_influence=1.8
    )


def judge_12(d: SimpleNamespace, answer: Any) -> str:
    """Judge: a loss of one's own."""
    weights = np.asarray(answer.weights(d.u), dtype=np.float64)
    if weights.shape != d.u.shape:
        return "weights(u) must return one weight for each u."
    if not np.isfinite(weights).all() or (weights < 0.0).any() or (weights > 1.0 + 1e-9).any():
        return "A weight is a number from 0 to 1, at u = 0 too."
    if not np.allclose(weights, weights[::-1]):
        return "Should an error to the left count differently from one to the right?"
    kept, most = efficiency(answer), gross_error_sensitivity(answer)
    if kept < d.least_efficiency:
        return f"It keeps {100 * kept:.1f} % on normal errors. Does it doubt too early?"
    if most > d.greatest_influence:
        return (
            f"One wild value moves it by {most:.2f} scales / n. Where is the pull u w(u) the "
            "largest?"
        )
    owner = _library_s(d.u, weights, answer)
    return f"That is {owner}: the library has it. Which loss is your own?" if owner else ""


def _library_s(u: Floats, weights: Floats, answer: Any) -> str:
    """Name the loss of a library that an answer is, under whatever name; else nothing.

    Where a weight lies between 0 and 1 it tells what the constant would be.
    """
    kind = type(answer)
    if kind.__module__.partition(".")[0] in ("losbench", "statsmodels"):
        return f"{kind.__module__.partition('.')[0]}'s {kind.__name__}"
    between = (u > 0.0) & (weights > 0.05) & (weights < 0.95)
    if not between.any():
        return ""
    at, w = u[between][0], weights[between][0]
    same: dict[str, Huber | Bisquare | Cauchy | Welsch] = {
        "Huber": Huber(at * w),
        "Bisquare": Bisquare(at / np.sqrt(1.0 - np.sqrt(w))),
        "Cauchy": Cauchy(at * np.sqrt(w / (1.0 - w))),
        "Welsch": Welsch(at / np.sqrt(-np.log(w))),
    }
    for name, loss in same.items():
        if np.allclose(loss.weights(u), weights, atol=1e-6):
            return f"{name}'s loss with the constant {loss.c:.3f}"
    return ""


def data_13(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: angles of frames with three bad spots of eight."""
    turn = 2.0 * np.pi * np.arange(8) / 8
    points = np.column_stack([6.0 * np.cos(turn), 6.0 * np.sin(turn), np.full(8, 260.0)])
    angles = rng.normal(0.0, 1e-4, (400, 3))
    shifts = (angles @ design_matrix(points).T).reshape(400, 8, 2) + 1e-4 * rng.standard_normal(
        (400, 8, 2)
    )
    ghost = (design_matrix(points) @ [3e-4, -2e-4, 1.5e-2]).reshape(8, 2)
    for frame in range(0, 400, 2):
        bad = rng.choice(8, 3, replace=False)
        shifts[frame, bad] += ghost[bad]
    return SimpleNamespace(points=points, shifts=shifts, hidden_truth=angles)


def judge_13(d: SimpleNamespace, answer: Any) -> str:
    """Judge: angles of frames with three bad spots of eight."""
    angles = np.asarray(answer, dtype=np.float64)
    if angles.shape != (400, 3):
        return f"400 frames have angles of shape (400, 3), in radians; these have {angles.shape}."
    rows = design_matrix(d.points)
    error = np.abs(angles - d.hidden_truth) / (
        1e-4 * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    )
    if (np.sqrt(np.mean(error**2, axis=0)) < _RIGHT).all():
        return ""
    if (np.quantile(error, 0.25, axis=0) < _RIGHT).all():
        return (
            "Half of the frames are well. In the others, how many spots of eight are bad, and who "
            "survives so many?"
        )
    return "These are not the angles yet. Are they in radians, one solve per frame?"


def data_14(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: bad spots of two-spot frames."""
    points = np.array([[5.0, 1.0, 260.0], [-5.0, 2.0, 260.0]])
    rate = rng.normal(0.0, 1e-5, 3) * [1.0, 1.0, 10.0]
    truth = np.outer(np.arange(150.0), rate)
    shifts = (truth @ design_matrix(points).T).reshape(150, 2, 2) + 1e-4 * rng.standard_normal(
        (150, 2, 2)
    )
    frames, spots = rng.choice(150, 10, replace=False), rng.integers(0, 2, 10)
    shifts[frames, spots] += 0.01 * np.where(rng.random((10, 2)) < 0.5, -1.0, 1.0)
    bad = sorted(zip(frames.tolist(), spots.tolist(), strict=True))
    return SimpleNamespace(points=points, shifts=shifts, hidden_truth=set(bad))


def judge_14(d: SimpleNamespace, answer: Any) -> str:
    """Judge: bad spots of two-spot frames."""
    named, truth = _pairs(answer, d.shifts.shape[:2]), d.hidden_truth
    if truth <= named and len(named - truth) <= 6:
        return ""
    if {frame for frame, _ in truth} <= {frame for frame, _ in named}:
        return (
            "The frames are right. Which of the two spots is it? A frame alone cannot tell; its "
            "neighbours can."
        )
    if len(named) > 30:
        return "So many? Ten spots at most are thrown far; the others are only noisy."
    return "Some bad spots are missing. How long is the window, and does it survive what it holds?"


def _rows(answer: Any, count: int) -> set[int]:
    """Row numbers from a list, set or array of them, or from a mask."""
    given = np.asarray(list(answer) if isinstance(answer, set | frozenset) else answer).ravel()
    if given.dtype == bool:
        shaped("a mask of rows", given, (count,))
        return set(np.flatnonzero(given).tolist())
    return {integer("a row number", row) for row in given.tolist()}


def _pairs(answer: Any, shape: tuple[int, int]) -> set[tuple[int, int]]:
    """Pairs (frame, spot) from any collection of them, from a mask, or from what np.nonzero makes
    of one.
    """
    if (
        isinstance(answer, tuple)
        and len(answer) == 2
        and all(isinstance(part, np.ndarray) for part in answer)
    ):
        given = np.stack(answer, axis=1)
    else:
        given = np.asarray(list(answer))
    if given.dtype == bool:
        shaped("a mask of spots", given, shape)
        given = np.argwhere(given)
    return {(integer("a frame", frame), integer("a spot", spot)) for frame, spot in given.tolist()}


def _borderline(d: SimpleNamespace) -> list[set[int]]:
    """Sets of at most two good rows that are rather far from the line of the good ones: a method
    may doubt them too.
    """
    good = np.array([row for row in range(len(d.y)) if row not in d.hidden_truth])
    fit = lstsq(d.A[good], d.y[good])
    far = good[fit.outliers(1.5)].tolist()
    return [set(some) for size in range(3) for some in combinations(far, size)]


def _line(rng: np.random.Generator, count: int, noise: float = 0.2) -> tuple[Floats, Floats]:
    """Design and observations of a straight line of random intercept and slope."""
    A = np.column_stack([np.ones(count), np.arange(float(count))])
    return A, A @ rng.uniform(-2.0, 2.0, 2) + noise * rng.standard_normal(count)
