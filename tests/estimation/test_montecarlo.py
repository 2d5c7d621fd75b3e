"""The same bits whoever runs the chunks, and streams that do not overlap."""

import importlib
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import losbench as lb


def throw(rng, size):
    return {"x": rng.standard_normal((size, 2)), "hit": rng.random(size) < 0.25}


class MapOnly:
    """An executor of the older kind: an emcee pool."""

    def map(self, work, *jobs):
        return list(map(work, *jobs))


class SubmitOnly:
    """An executor with the least that a cluster's client offers."""

    def submit(self, work, *job):
        future = Future()
        future.set_result(work(*job))
        return future


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_the_same_bits_for_any_number_of_threads(workers):
    alone = lb.monte_carlo(throw, 2500, seed=3, chunk=300)
    with ThreadPoolExecutor(workers) as executor:
        together = lb.monte_carlo(throw, 2500, seed=3, chunk=300, executor=executor)
    for name in ("x", "hit"):
        np.testing.assert_array_equal(alone[name], together[name])


@pytest.mark.parametrize("executor", [MapOnly(), SubmitOnly()])
def test_map_or_submit_is_enough(executor):
    alone, together = (
        lb.monte_carlo(throw, 70, seed=1, chunk=20, executor=e) for e in (None, executor)
    )
    np.testing.assert_array_equal(alone["x"], together["x"])


def test_the_same_bits_from_other_processes(tmp_path, monkeypatch):
    # Workers import the trial by name, so it has to live in a module that they find.
    (tmp_path / "dice.py").write_text(
        "def trial(rng, size):\n    return {'x': rng.integers(1, 7, size)}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    trial = importlib.import_module("dice").trial
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        together = lb.monte_carlo(trial, 40, seed=9, chunk=15, executor=executor)
    np.testing.assert_array_equal(together["x"], lb.monte_carlo(trial, 40, seed=9, chunk=15)["x"])


def test_shapes_types_and_the_last_short_chunk():
    result = lb.monte_carlo(throw, 1001, seed=0, chunk=250)
    assert result["x"].shape == (1001, 2)
    assert result["hit"].dtype == bool
    assert len(np.unique(result["x"])) == 2002


def test_more_trials_extend_the_same_experiment():
    few, many = (lb.monte_carlo(throw, n, seed=4, chunk=100)["x"] for n in (300, 500))
    np.testing.assert_array_equal(few, many[:300])


def test_chunks_are_children_of_the_seed():
    second = np.random.default_rng(np.random.SeedSequence(8).spawn(2)[1])
    np.testing.assert_array_equal(
        lb.monte_carlo(throw, 20, seed=8, chunk=10)["x"][10:], second.standard_normal((10, 2))
    )


def test_progress_is_shown_when_asked_for(capsys):
    lb.monte_carlo(throw, 30, seed=0, chunk=10)
    assert capsys.readouterr().err == ""
    lb.monte_carlo(throw, 30, seed=0, chunk=10, progress=True)
    assert "3/3" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"n": 0}, ValueError, "n must be a whole number of at least 1, got 0"),
        ({"chunk": 2.5}, ValueError, r"chunk must be a whole number, got 2\.5"),
        ({"seed": -1}, ValueError, "seed must be a whole number of at least 0, got -1"),
        ({"progress": "yes"}, ValueError, "progress must be True or False, got 'yes'"),
        ({"executor": 4}, TypeError, "executor must have a method map or submit, got int"),
        (
            {"trial": lambda rng, size: {"x": np.zeros(3)}},
            ValueError,
            r"trial must return arrays \(10, \.\.\.\) for size=10, got x with \(3,\)",
        ),
        (
            {"trial": lambda rng, size: {"xy"[size == 2]: np.zeros(size)}},
            ValueError,
            r"trial must return the same names every time, got \['x'\] and \['y'\]",
        ),
    ],
)
def test_bad_input_is_refused_by_name(change, error, message):
    with pytest.raises(error, match=message):
        lb.monte_carlo(**({"trial": throw, "n": 12, "seed": 0, "chunk": 10} | change))


def test_a_dask_client_gives_the_same_bits():
    distributed = pytest.importorskip(
        "distributed", reason="distributed is missing: pip install losbench[cluster]"
    )
    with distributed.Client(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
    ) as client:
        together = lb.monte_carlo(throw, 700, seed=3, chunk=300, executor=client.get_executor())
    alone = lb.monte_carlo(throw, 700, seed=3, chunk=300)
    for name, values in alone.items():
        np.testing.assert_array_equal(together[name], values)


@pytest.mark.parametrize(
    ("last", "told"),
    [
        (np.zeros((2, 3)), r"x with \(4,\) of float64 and \(2, 3\) of float64 in chunk 2"),
        (np.array(["1", "2"]), r"x with \(4,\) of float64 and \(2,\) of <U1 in chunk 2"),
    ],
)
def test_arrays_of_another_form_are_named_with_their_chunk(last, told):
    def trial(rng, size):
        return {"x": last if size == 2 else np.zeros(size)}

    with pytest.raises(ValueError, match=f"arrays of one form every time, got {told}"):
        lb.monte_carlo(trial, 10, seed=1, chunk=4)


def test_whole_numbers_go_with_others_and_what_is_masked_is_nan():
    def trial(rng, size):
        return {"x": np.ma.masked_equal(np.arange(size), 2) if size == 4 else np.arange(size)}

    found = lb.monte_carlo(trial, 6, seed=1, chunk=4)["x"]
    np.testing.assert_array_equal(found, [0, 1, np.nan, 3, 0, 1])
