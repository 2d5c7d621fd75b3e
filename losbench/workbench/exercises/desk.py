"""Data and checks by seed, and the copy of the solutions that students get."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from losbench.checks import integer
from losbench.workbench.exercises import basics, honesty, projects

__all__ = ["EXERCISES", "Exercises", "Judgement", "student_copy"]

Draw = Callable[[np.random.Generator], SimpleNamespace]
Judge = Callable[[SimpleNamespace, Any], str]


@dataclass(frozen=True)
class Judgement:
    """Whether an answer is right, and what to read."""

    right: bool
    text: str

    def __repr__(self) -> str:
        """Show the text alone, as a notebook does."""
        return self.text


class Exercises:
    """Data and checks of all exercises for one seed.

    Parameters
    ----------
    seed : int
        Your own; another seed has other data and other answers.

    Examples
    --------
    >>> check = Exercises(seed=7)
    >>> d = check.data(1)
    >>> check.ex01(d.y.mean())
    ex01: not yet. That is far from where most points are. Which fit listens less to a wild value?
    >>> check.ex01(...)
    ex01: not answered yet.
    """

    def __init__(self, seed: int = 1) -> None:
        self.seed = integer("seed", seed, low=0)

    def data(self, number: int) -> SimpleNamespace:
        """Return the data of an exercise; the same ones whenever they are asked for."""
        which = integer("number", number, low=1, high=len(EXERCISES))
        drawn = vars(self._drawn(which)).items()
        return SimpleNamespace(
            **{name: value for name, value in drawn if not name.startswith("hidden_")}
        )

    def __getattr__(self, name: str) -> Callable[[Any], Judgement]:
        """Find the check of an exercise: ``check.ex05(answer)``."""
        if name[:2] == "ex" and name[2:].isdigit() and int(name[2:]) in EXERCISES:
            return partial(self._judge, int(name[2:]))
        raise AttributeError(f"no exercise {name!r}; they are ex01 to ex{len(EXERCISES):02d}")

    def __dir__(self) -> list[str]:
        """List the checks too, for those who press Tab."""
        return [*super().__dir__(), *(f"ex{number:02d}" for number in EXERCISES)]

    def _drawn(self, number: int) -> SimpleNamespace:
        return EXERCISES[number][0](np.random.default_rng([self.seed, number]))

    def _judge(self, number: int, answer: Any) -> Judgement:
        name = f"ex{number:02d}"
        if answer is ...:
            return Judgement(False, f"{name}: not answered yet.")
        try:
            hint = EXERCISES[number][1](self._drawn(number), answer)
        except (TypeError, ValueError, AttributeError) as problem:
            hint = f"The answer has not the form asked for ({problem})."
        return Judgement(not hint, f"{name}: not yet. {hint}" if hint else f"{name}: right.")


def student_copy(solutions: Mapping[str, Any]) -> dict[str, Any]:
    """Strip the answers from a notebook of solutions: what stands between "# your answer" and the
    check.
    """
    cells = []
    for cell in solutions["cells"]:
        kept: list[str] = []
        hidden = False
        for line in cell["source"]:
            if line.startswith("check.ex"):
                hidden = False
            if not hidden:
                kept.append(line)
            if line.startswith("# your answer"):
                hidden = True
                kept.append("answer = ...\n")
        cells.append({**cell, "source": kept})
    return {**solutions, "cells": cells}


EXERCISES: dict[int, tuple[Draw, Judge]] = {
    1: (basics.data_01, basics.judge_01),
    2: (basics.data_02, basics.judge_02),
    3: (basics.data_03, basics.judge_03),
    4: (basics.data_04, basics.judge_04),
    5: (basics.data_05, basics.judge_05),
    6: (basics.data_06, basics.judge_06),
    7: (basics.data_07, basics.judge_07),
    8: (basics.data_08, basics.judge_08),
    9: (projects.data_09, projects.judge_09),
    10: (projects.data_10, projects.judge_10),
    11: (projects.data_11, projects.judge_11),
    12: (projects.data_12, projects.judge_12),
    13: (projects.data_13, projects.judge_13),
    14: (projects.data_14, projects.judge_14),
    15: (honesty.data_15, honesty.judge_15),
    16: (honesty.data_16, honesty.judge_16),
    17: (honesty.data_17, honesty.judge_17),
}
