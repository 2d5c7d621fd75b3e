"""Exercises 15 to 17: a layout, an interval that lies, a verdict without power."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from losbench.arrays import Floats
from losbench.checks import integer
from losbench.estimation.breakdown import design_breakdown
from losbench.estimation.robust import lstsq
from losbench.workbench.exercises.basics import close
from losbench.workbench.explorers.lab.smallsystems import spot_rows

__all__ = ["data_15", "data_16", "data_17", "judge_15", "judge_16", "judge_17"]

_ROOM = 1.05  # how much worse than the ring's the roll's sigma may be
_TWO_SIDED = 1.96


def data_15(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: fourteen places for eight spots, a ring of them, a far corner and the middle."""
    ring = 2.0 * np.pi * (np.arange(8) + rng.uniform(-0.05, 0.05, 8)) / 8.0
    reach = 1.6 + rng.uniform(-0.05, 0.05, 8)
    corner = 3.0 * np.exp(1j * rng.uniform(0.0, 2.0 * np.pi)) + 0.1 * (rng.random(4) - 0.5)
    middle = 0.3 * np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, 2))
    good = reach * np.exp(1j * ring)
    places = rng.permutation(np.concatenate([good, corner, middle]))
    u, v = places.real.round(3), places.imag.round(3)
    return SimpleNamespace(u=u, v=v, greatest_sigma=_ROOM * _roll_sigma(good.real, good.imag))


def judge_15(d: SimpleNamespace, answer: Any) -> str:
    """Judge: eight places that survive two bad spots and see the roll."""
    chosen = sorted({integer("a place", place, low=0, high=13) for place in np.ravel(answer)})
    if len(chosen) != 8 or np.size(answer) != 8:
        return "Eight different places are asked for, by their numbers."
    rows = spot_rows(d.u[chosen], d.v[chosen])
    survived = design_breakdown(rows, group=np.repeat(np.arange(8), 2)).monotone
    sigma = _roll_sigma(d.u[chosen], d.v[chosen])
    if survived < 2:
        return (
            f"This layout survives {survived} bad. Is there a point about which it can turn while "
            "few spots do most of the moving?"
        )
    if sigma > d.greatest_sigma:
        return (
            f"Two bad spots are survived, but one sigma of the roll is {sigma:.3f}. Which spots "
            "move most in a roll?"
        )
    return ""


def data_16(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: two thousand drifts whose errors remember the one before."""
    memory, slope = round(rng.uniform(0.6, 0.85), 2), round(rng.uniform(-2.0, 2.0), 2)
    t = np.linspace(0.0, 1.0, 60)
    fresh = rng.standard_normal((60, 2000))
    errors = np.empty((60, 2000))
    errors[0] = fresh[0] / np.sqrt(1.0 - memory**2)
    for k in range(1, 60):
        errors[k] = memory * errors[k - 1] + fresh[k]
    A = np.column_stack([np.ones(60), t])
    return SimpleNamespace(A=A, y=(A @ [1.0, slope] + 0.1 * errors.T), slope=slope)


def judge_16(d: SimpleNamespace, answer: Any) -> str:
    """Judge: how often an interval holds, and by what it is too narrow."""
    held, factor = (float(part) for part in answer)
    fit = lstsq(d.A, d.y)
    pull = np.abs(fit.x[:, 1] - d.slope) / fit.std_error[:, 1]
    truth, wanted = np.mean(pull < _TWO_SIDED), np.quantile(pull, 0.95) / _TWO_SIDED
    if abs(held - 0.95) < 0.02:
        return "That is what the interval promises. In how many of the runs does it hold d.slope?"
    if not close(held, truth, rtol=0.03):
        return (
            "The first number is the share of the 2000 intervals x[1] ± 1.96 std_error[1] that "
            "hold d.slope. Is yours of the slope, and of all runs?"
        )
    if close(factor, wanted, rtol=0.03):
        return ""
    if close(factor, _TWO_SIDED * wanted, rtol=0.03):
        return "The share is right. That is the number of sigmas; by what were the 1.96 too small?"
    return "The share is right. How wide must all intervals be made for 95 of 100 to hold?"


def data_17(rng: np.random.Generator) -> SimpleNamespace:
    """Draw: a check of a bias that too few frames are asked for."""
    bias = round(rng.uniform(0.02, 0.06), 3)
    frames = int(rng.integers(4, 9))
    sigma = round(bias * np.sqrt(frames) * rng.uniform(0.3, 0.7), 3)
    return SimpleNamespace(bias=bias, tolerance=bias / 2.0, sigma=sigma, frames=frames)


def judge_17(d: SimpleNamespace, answer: Any) -> str:
    """Judge: how often a biased method passes, and the frames that a check with power needs."""
    passed, frames = (float(part) for part in answer)
    error = d.sigma / np.sqrt(d.frames)
    truth = ndtr((d.tolerance - d.bias) / error) - ndtr((-d.tolerance - d.bias) / error)
    needed = np.ceil((ndtri(0.975) * d.sigma / d.tolerance) ** 2)
    if close(passed, 1.0 - truth, rtol=0.02) and not close(passed, truth, rtol=0.02):
        return "That is how often the check would find the bias. How often does it let it pass?"
    if not close(passed, truth, rtol=0.02):
        return (
            "The mean of the frames is normal about the bias. With which standard deviation, and "
            "how much of it lies within the tolerance on either side?"
        )
    if abs(frames - needed) <= 1.0 + 0.01 * needed:
        return ""
    if frames < needed:
        return (
            "The chance is right. With so few frames, how often does a method without a bias pass?"
        )
    return "The chance is right. Fewer frames will do: what must the mean's sigma be at most?"


def _roll_sigma(u: Floats, v: Floats) -> float:
    """One sigma of the roll, for readings of one sigma 1."""
    rows = spot_rows(u, v)
    return float(np.sqrt(np.linalg.inv(rows.T @ rows)[2, 2]))
