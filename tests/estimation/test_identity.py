"""What a trial is: its code and the settings that it uses, the same in every process."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import losbench as lb
from losbench.estimation.identity import identity

SHIFT = 1.0


def helper(x):
    return x + SHIFT


class Model:
    def __init__(self, shift):
        self.shift = shift

    def trial(self, rng, size):
        return {"x": rng.random(size) + self.shift}

    __call__ = trial


def closing(shift):
    def trial(rng, size):
        return {"x": rng.random(size) + shift}

    return trial


def defaulting(given):
    def trial(rng, size, shift=given):
        return {"x": rng.random(size) + shift}

    return trial


def partly(rng, size, shift):
    return {"x": rng.random(size) + np.mean(shift)}


def by_helper(rng, size):
    return {"x": [helper(x) for x in rng.random(size)]}


@pytest.mark.parametrize(
    "made",
    [
        closing,
        defaulting,
        Model,
        lambda shift: Model(shift).trial,
        lambda shift: partial(partly, shift=shift),
        lambda shift: partial(partly, shift=np.append(np.zeros(1999), shift)),
        lambda shift: partial(partly, shift=lb.Camera(1.0 + shift, 10.0, (10, 10)).focal_mm),
        lambda shift: (lambda rng, size: {"x": rng.random(size) + 1}, lambda rng, size: {"x": rng.random(size) + 2})[int(shift)],
    ],
)  # fmt: skip
def test_a_study_goes_on_with_no_cell_of_a_trial_that_holds_other_numbers(made, tmp_path):
    whole = lb.study(made(0.0), {}, 10, seed=1, out=tmp_path / "out")
    again = lb.study(made(0.0), {}, 10, seed=1, out=tmp_path / "out", resume=True)
    assert again.to_frame().equals(whole.to_frame())
    with pytest.raises(ValueError, match="another run: what it uses was"):
        lb.study(made(1.0), {}, 10, seed=1, out=tmp_path / "out", resume=True)


def test_a_number_under_a_global_name_counts_through_functions_of_the_module(monkeypatch):
    before = identity(by_helper)
    assert identity(by_helper) == before
    monkeypatch.setitem(globals(), "SHIFT", 2.0)
    assert identity(by_helper) != before


def test_what_keeps_account_or_cannot_be_pickled_does_not_stop_a_study_from_going_on():
    calls, log = [], {}

    def trial(rng, size):
        calls.append(size)
        log[size] = sys.stderr
        return later(size)

    before = identity(trial)
    calls.append(3)

    def later(size):
        return {"x": np.zeros(size)}

    ring = [1]
    ring.append(ring)
    assert identity(trial) != before  # a function that it had not before
    assert identity(ring) == identity(ring) != identity([1, [1]])
    assert identity({"a", "b"}) == identity({"b", "a"})
    assert identity(np.add) != identity(np.subtract) and identity(len) == identity(len)
    assert identity(sys.stderr) == identity(sys.stderr)


def test_one_trial_is_the_same_in_another_process():
    code = "from test_identity import *; print(identity(*samples()))"
    runs = [
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
            cwd=Path(__file__).parent,
        ).stdout
        for seed in ("1", "2")
    ]
    assert runs[0] == runs[1]


def samples():
    return [
        by_helper,
        Model(1.0),
        closing({"a"}),
        {"a", "b"},
        lb.IRLS(),
        np.mean,
        np.random.PCG64(1),
    ]
