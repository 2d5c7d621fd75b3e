"""What a trial is: its code and the settings that it uses, the same in every process."""

import enum
import itertools
import os
import re
import subprocess
import sys
from functools import lru_cache, partial, wraps
from pathlib import Path
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pandas as pd
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


class Level(enum.Enum):
    LOW, HIGH = 0.0, 1.0


class Wide(float):
    pass


def callable_object(shift):
    """An object whose class differs by its code alone."""

    def low(self, rng, size):
        return {"x": rng.random(size)}

    def high(self, rng, size):
        return {"x": rng.random(size) + 1}

    return type("Called", (), {"__call__": high if shift else low, "__module__": __name__})()


def wrapped(function):
    @wraps(function)
    def call(*args):
        return call.__wrapped__(*args)

    return call


def calling(function):
    def trial(rng, size):
        return {"x": function(rng, size)["x"]}

    return trial


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
        callable_object,
        lambda shift: calling(callable_object(shift)),
        lambda shift: calling(Model(shift)),
        lambda shift: calling(lru_cache(closing(shift))),
        lambda shift: lru_cache(closing(shift)),
        lambda shift: wrapped(closing(shift)),
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


@pytest.mark.parametrize(
    "made",
    [
        Model,
        Level,
        Wide,
        slice,
        lambda shift: SimpleNamespace(shift=shift),
        lambda shift: pd.DataFrame({"shift": [shift]}),
        lambda shift: pd.Series([shift], index=["shift"]),
        lambda shift: range(int(shift)),
        lambda shift: re.compile(str(shift)),
        lambda shift: MappingProxyType({"shift": shift}),
        lambda shift: np.ma.masked_array([1.0, 2.0], mask=[shift, 0.0]),
        lambda shift: np.array([shift, None]),
        lambda shift: (len, max)[int(shift)],
    ],
)
def test_objects_that_a_trial_closes_over_count_by_what_they_hold(made):
    assert identity(closing(made(0.0))) == identity(closing(made(0.0)))
    assert identity(closing(made(0.0))) != identity(closing(made(1.0)))


def test_containers_have_an_end_and_equal_parts_may_be_one():
    assert identity([[1], 2]) != identity([[1, 2]]) != identity([[1, 2], []])
    assert identity("a", "b") != identity("a\0b") and identity(()) != identity([])
    one = np.zeros(3)
    assert identity([one, one]) == identity([one, one.copy()])


def test_an_object_may_be_in_a_set_that_it_holds():
    one, other = Model(set()), Model(set())
    one.shift.add(one)
    assert identity(one) == identity(one) != identity(other)


def test_a_mask_that_is_used_stays_the_same():
    masked = np.ma.masked_array([1.0, 2.0], mask=[True, False])
    before = identity(masked)
    masked.filled()
    assert identity(masked) == before


def test_functions_that_call_each_other_are_looked_at_once():
    """30 of them, which have more paths than could be walked."""
    names = [f"f{k}" for k in range(30)]
    home = {"__name__": "ring", "SHIFT": 1.0}
    for name in names:
        exec(f"def {name}():\n    return SHIFT, {', '.join(names)}", home)
    before = identity(home["f0"])
    assert identity(home["f0"]) == before
    home["SHIFT"] = 2.0
    assert identity(home["f0"]) != before


def test_iterators_generators_and_methods_of_accounts_may_go_on():
    calls, counter, rng = [], itertools.count(), np.random.default_rng(1)
    append = calls.append

    def trial():
        append(next(counter))
        return rng.random()

    before = identity(trial)
    trial()
    assert calls == [0] and identity(trial) == before


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
        calling(Model(1.0)),
        closing(pd.DataFrame({"a": [1.0], "b": ["c"]})),
        closing(Level.HIGH),
        closing(SimpleNamespace(names={"a", "b"}, log=sys.stderr, key=object())),
    ]
