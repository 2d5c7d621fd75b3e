"""Moments and quantiles that merge, cells that draw apart, and runs that a kill does not undo."""

import os
import re
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import stats

import losbench as lb
from losbench import parts as parts_module
from losbench.estimation import study as study_module
from losbench.estimation.streams import Summary


def throw(rng, size, sigma=1.0, shift=0.0):
    return {"x": shift + sigma * rng.standard_normal((size, 2)), "hit": rng.random(size) < 0.25}


def fit(rng, size):
    A = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0], [1.0, 9.0]])
    return {"x": lb.irls(A, rng.standard_t(1, (size, 5)), max_iter=3).x}


def summaries_equal(one, other):
    for a, b in zip(one.summaries, other.summaries, strict=True):
        for name in vars(a):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_a_study_of_one_cell_sees_the_draws_of_monte_carlo():
    drawn = lb.monte_carlo(throw, 2500, seed=3, chunk=300)
    seen = np.column_stack([drawn["x"], drawn["hit"]])
    study = lb.study(throw, {}, 2500, seed=3, chunk=300)
    assert study.names == ("x[0]", "x[1]", "hit")
    table = study.to_frame([0.1, 0.5, 0.9])
    np.testing.assert_allclose(table["mean"], seen.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(table["std"], seen.std(axis=0, ddof=1), rtol=1e-12)
    np.testing.assert_allclose(table["error"], seen.std(axis=0, ddof=1) / 50.0, rtol=1e-12)
    np.testing.assert_allclose(study.covariance(), np.cov(seen.T), rtol=1e-10, atol=1e-15)
    exact = np.quantile(seen, [0.1, 0.5, 0.9], axis=0).T
    np.testing.assert_allclose(table[["q0.1", "q0.5", "q0.9"]], exact, atol=5e-3)


@pytest.mark.parametrize("centre", [0.0, 1e5])
@pytest.mark.parametrize(
    "law", [stats.norm(scale=50.0), stats.t(5), stats.gamma(2.0), stats.uniform()]
)
def test_quantiles_are_those_of_the_numbers_to_2e_3_sigma(law, centre):
    rng = np.random.default_rng(5)
    values = centre + law.rvs((1, 400_000), random_state=rng)
    first = Summary.of(values[:, :10_000])
    rest = Summary.of(values[:, 10_000:], centre=first.centre, spread=first.spread)
    wanted = [0.0015, 0.023, 0.16, 0.5, 0.84, 0.977, 0.9985]
    found = first.merged(rest).quantiles([0.0, *wanted, 1.0])[0]
    exact = np.quantile(values[0], [0.0, *wanted, 1.0])
    np.testing.assert_array_equal(found[[0, -1]], exact[[0, -1]])
    assert np.abs(found - exact).max() < 2e-3 * law.std()


def test_quantiles_of_few_numbers_of_equal_ones_and_of_none():
    few = Summary.of(np.array([[3.0, 1.0, 2.0, 10.0]]))
    np.testing.assert_allclose(few.quantiles([0, 1 / 3, 2 / 3, 1])[0], [1, 2, 3, 10], rtol=4e-3)
    equal = Summary.of(np.full((1, 7), 4.25))
    assert equal.quantiles([0.1, 0.5]).tolist() == [[4.25, 4.25]]
    none = Summary.of(np.full((1, 3), np.nan))
    assert (none.n, none.left_out) == (0, 3)
    assert np.isnan(none.quantiles([0.5])).all()
    both = none.merged(Summary.of(np.ones((1, 2)), centre=none.centre, spread=none.spread))
    assert (both.n, both.left_out, both.mean[0], both.covariance[0, 0]) == (2, 3, 1.0, 0.0)
    assert both.quantiles([0.5]).tolist() == [[1.0]]


def test_far_numbers_merge_without_losing_digits():
    """A mean of 1e8 standard deviations, which the sum of squares would not survive."""
    values = 1e8 + np.random.default_rng(1).standard_normal((1, 6000))
    whole = Summary.of(values[:, :1000])
    for first in range(1000, 6000, 1000):
        part = values[:, first : first + 1000]
        whole = whole.merged(Summary.of(part, centre=whole.centre, spread=whole.spread))
    np.testing.assert_allclose(whole.covariance[0, 0], values.var(ddof=1), rtol=1e-9)


def test_the_same_bytes_from_threads_and_from_more_than_one_group_of_cells(tmp_path):
    grid = {"sigma": [1.0, 2.0, 5.0], "shift": range(7)}
    alone = lb.study(throw, grid, 700, seed=1, chunk=300, out=tmp_path / "a")
    with ThreadPoolExecutor(3) as executor:
        spread = lb.study(throw, grid, 700, seed=1, chunk=300, executor=executor)
    summaries_equal(alone, spread)
    assert alone.cells[8] == {"sigma": 2.0, "shift": 1}
    table = alone.to_frame()
    assert table.index.names == ["sigma", "shift", "quantity"]
    assert table.loc[(5.0, 6, "x[1]"), "mean"] == pytest.approx(6.0, abs=5 * 5 / 26)
    means = table.xs("x[0]", level="quantity")["mean"] - table.xs(
        "x[0]", level="quantity"
    ).index.get_level_values("shift")
    assert means.nunique() == 21, "cells share their draws"
    assert "... and 55 more" in alone._repr_html_()


def test_fits_that_fail_are_counted_and_said_once(recwarn):
    with pytest.warns(RuntimeWarning) as said:
        study = lb.study(fit, {}, 2000, seed=4, chunk=500)
    assert len(said) == 1
    failed = study.to_frame()["unconverged"].iloc[0]
    rngs = [np.random.default_rng(s) for s in np.random.SeedSequence(4).spawn(4)]
    A = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0], [1.0, 9.0]])
    alone = [
        lb.irls(A, rng.standard_t(1, (500, 5)), max_iter=3, on_fail="ignore").converged
        for rng in rngs
    ]
    assert failed == np.count_nonzero(~np.concatenate(alone)) > 0
    assert f"{failed} fits in 2000 trials did not converge" in str(said[0].message)
    with pytest.warns(RuntimeWarning, match="did not converge"):  # outside a study as ever
        fit(np.random.default_rng(1), 500)


def test_a_trial_may_count_its_own_failures_and_leave_numbers_out():
    def trial(rng, size):
        x = rng.random(size)
        return {"x": np.where(x < 0.1, np.nan, x), "converged": x < 0.9}

    with pytest.warns(RuntimeWarning, match=r"did not converge.*; \d+ of 1000 trials are left out"):
        table = lb.study(trial, {}, 1000, seed=0).to_frame()
    assert table.index.tolist() == ["x"] or table.index.tolist() == [("x",)]
    assert table["n"].iloc[0] + table["left_out"].iloc[0] == 1000
    assert 60 < table["left_out"].iloc[0] < 140
    assert 60 < table["unconverged"].iloc[0] < 140


def test_a_killed_study_goes_on_with_the_cells_that_stand_whole(tmp_path):
    grid, out, done, kills = {"shift": range(5)}, tmp_path / "out", [], []

    def trial(rng, size, shift):
        done.append(shift)
        if shift == 3 and kills:
            raise kills.pop()
        return {"x": shift + rng.standard_normal(size)}

    whole = lb.study(trial, grid, 100, seed=2)
    kills.append(KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        lb.study(trial, grid, 100, seed=2, out=out)
    flipped = bytearray((out / "cell-000001.npz").read_bytes())
    flipped[len(flipped) // 2] ^= 1
    flipped[len(flipped) // 2 + 200] ^= 1  # if the first was in a header, which says nothing
    (out / "cell-000001.npz").write_bytes(flipped)
    cut = (out / "cell-000002.npz").read_bytes()
    (out / "cell-000002.npz").write_bytes(cut[:-30])
    done.clear()
    with pytest.raises(FileExistsError, match="holds a run"):
        lb.study(trial, grid, 100, seed=2, out=out)
    summaries_equal(lb.study(trial, grid, 100, seed=2, out=out, resume=True), whole)
    assert done == [1, 2, 3, 4]
    with pytest.raises(ValueError, match="another run: n was 100, is 200$"):
        lb.study(trial, grid, 200, seed=2, out=out, resume=True)
    with pytest.raises(
        ValueError, match=r"another run: trial was def trial.* \.\.\., is def throw"
    ):
        lb.study(throw, grid, 100, seed=2, out=out, resume=True)


def test_a_study_of_several_chunks_is_kept_whole(tmp_path):
    calls = []

    def trial(rng, size, shift):
        calls.append(size)
        return {"x": shift + rng.standard_normal(size)}

    settings = {"grid": {"shift": range(3)}, "n": 100, "seed": 2, "chunk": 30}
    whole = lb.study(trial, **settings, out=tmp_path / "out")
    assert sorted(calls) == [10] * 3 + [30] * 9
    calls.clear()
    summaries_equal(lb.study(trial, **settings, out=tmp_path / "out", resume=True), whole)
    assert not calls


def test_two_studies_do_not_write_to_one_folder(tmp_path):
    def trial(rng, size):
        with pytest.raises(BlockingIOError, match="another run is writing to out"):
            lb.study(throw, {}, 10, seed=0, out=tmp_path / "out", resume=True)
        return {"x": np.zeros(size)}

    lb.study(trial, {}, 10, seed=0, out=tmp_path / "out")


def test_a_full_disk_names_the_part_and_leaves_the_others(tmp_path, monkeypatch):
    real = os.replace

    def full(source, target):
        if str(target).endswith("cell-000002.npz"):
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr(parts_module.os, "replace", full)
    with pytest.raises(
        OSError,
        match=r"No space left on device \(while writing .*cell-000002.npz; the parts before it stay",
    ):
        lb.study(throw, {"shift": range(4)}, 10, seed=0, out=tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "cell-000000.npz",
        "cell-000001.npz",
        "run.json",
    ]


def test_many_chunks_are_merged_in_runs_whoever_works():
    """128 chunks and more: two and more to a run."""
    alone = lb.study(throw, {}, 4050, seed=2, chunk=30)
    with ThreadPoolExecutor(3) as executor:
        spread = lb.study(throw, {}, 4050, seed=2, chunk=30, executor=executor)
    summaries_equal(alone, spread)
    drawn = lb.monte_carlo(throw, 4050, seed=2, chunk=30)
    seen = np.column_stack([drawn["x"], drawn["hit"]])
    assert alone.summaries[0].n == 4050
    np.testing.assert_allclose(alone.to_frame()["mean"], seen.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(alone.covariance(), np.cov(seen.T), rtol=1e-10, atol=1e-15)

    def unlucky(rng, size):
        if rng.random() > 0.98:
            raise ValueError("no luck")
        return {"x": np.zeros(size)}

    with pytest.raises(ValueError, match="no luck") as failed:
        lb.study(unlucky, {}, 4050, seed=2, chunk=30)
    assert re.fullmatch(
        r"in chunks \d+ to \d+ of cell 0 , 60 trials of seed 2", failed.value.__notes__[0]
    )


def test_a_failing_chunk_is_named_and_cancels_the_rest():
    begun = []

    def trial(rng, size, shift):
        begun.append(shift)
        if shift == 2:
            raise ValueError("no luck")
        return {"x": np.zeros(size)}

    with ThreadPoolExecutor(1) as executor, pytest.raises(ValueError, match="no luck") as failed:
        lb.study(trial, {"shift": range(50)}, 10, seed=7, executor=executor)
    assert failed.value.__notes__ == ["in chunk 0 of cell 2 {'shift': 2}, 10 trials of seed 7"]
    assert len(begun) < 20


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid": {"sigma": 2.0}}, "grid must hold a sequence of values for sigma, got 2.0"),
        ({"grid": {"sigma": []}}, r"grid must hold a sequence of values for sigma, got \[\]"),
        ({"grid": {"sigma": {1.0, 2.0}}}, "grid must hold a sequence of values for sigma"),
        ({"grid": {"sigma": {1.0: "a"}}}, "grid must hold a sequence of values for sigma"),
        ({"grid": {"sigma": b"12"}}, "grid must hold a sequence of values for sigma, got b'12'"),
        ({"trial": lambda rng, size: {"x": np.zeros((size, 0))}}, "at least one array of numbers"),
        (
            {"trial": lambda rng, size: {"x": np.zeros((size, 1)), "x[0]": np.zeros(size)}},
            r"numbers of different names, got \['x\[0\]', 'x\[0\]'\]",
        ),
        (
            {"trial": lambda rng, size: {"x": np.zeros((size, size))}},
            r"the same names every time, got \['x\[0\]', 'x\[1\]'\] after 10 in the first",
        ),
        (
            {"trial": lambda rng, size: {"x": np.zeros(size), "converged": np.full(size, np.nan)}},
            r"converged must be an array of bool \(10,\), got float64 with \(10,\)",
        ),
        (
            {"trial": lambda rng, size: {"x": np.zeros(size), "converged": np.ones((size, 2), bool)}},
            r"converged must be an array of bool \(10,\), got bool with \(10, 2\)",
        ),
        ({"grid": [1]}, "grid must be a mapping of names to values, got list"),
        ({"grid": {1: [1], "1": [2]}}, r"grid must hold different names.*, got \['1', '1'\]"),
        ({"grid": {"quantity": [1]}}, r"none of them 'quantity', got \['quantity'\]"),
        ({"n": 0}, "n must be a whole number of at least 1, got 0"),
        ({"chunk": 0}, "chunk must be a whole number of at least 1, got 0"),
        ({"resume": True}, "resume needs out"),
        ({"trial": lambda rng, size: {}}, "trial must return at least one array of numbers"),
        ({"trial": lambda rng, size: {"x": np.full(size, "a")}}, "trial must return numbers, got x of <U1"),
        (
            {"trial": lambda rng, size: {"xy"[size == 2]: np.zeros(size)}},
            r"trial must return the same names every time, got \['x'\] and \['y'\]",
        ),
        (
            {"trial": lambda rng, size, a: {f"x{a}": np.zeros(size)}, "grid": {"a": [0, 1]}},
            r"the same names in every cell, got \['x0'\] and \['x1'\]",
        ),
    ],
)  # fmt: skip
def test_bad_input_is_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message), warnings.catch_warnings():
        lb.study(**({"trial": throw, "grid": {}, "n": 12, "seed": 0, "chunk": 10} | change))


def test_progress_is_shown_when_asked_for_and_not_else(capsys):
    lb.study(throw, {}, 30, seed=0, chunk=10)
    assert capsys.readouterr().err == ""
    lb.study(throw, {}, 30, seed=0, chunk=10, progress=True)
    assert "3/3" in capsys.readouterr().err


@pytest.mark.parametrize("chunks", [1, 2, 33, 150, 257])
def test_a_bar_counts_every_chunk_of_the_cells_that_are_not_there_yet(
    chunks, tmp_path, monkeypatch
):
    bars = []

    class Bar:
        def __init__(self, total, shown):
            self.total, self.steps, self.shown, self.closed = total, [], shown, False
            bars.append(self)

        def update(self, steps=1):
            self.steps.append(steps)

        def close(self):
            self.closed = True

    monkeypatch.setattr(study_module, "_bar", Bar)
    for grid, new in (((1.0, 2.0), 2), ((1.0, 2.0), 0)):
        lb.study(throw, {"sigma": grid}, chunks, seed=0, chunk=1, out=tmp_path, resume=True)
        bar = bars[-1]
        assert bar.total == sum(bar.steps) == new * chunks
        assert bar.closed and not bar.shown
        assert all(step > 0 for step in bar.steps)


@pytest.mark.parametrize("name", ["n", "mean", "std", "k", "seed", "trial"])
def test_a_parameter_may_have_the_name_of_a_column_or_of_an_argument(name):
    def trial(rng, size, **cell):
        return {"x": np.full(size, cell[name])}

    table = lb.study(trial, {name: [8.0, 16.0]}, 30, seed=1).to_frame()
    assert table.index.names == [name, "quantity"]
    assert table.index.get_level_values(0).tolist() == table["mean"].tolist() == [8.0, 16.0]
    assert table["n"].tolist() == [30, 30]


@pytest.mark.parametrize(
    ("values", "others"),
    [
        ([[1, 2], [3, 4]], [[1, 2], [3, 5]]),
        (np.eye(2), np.eye(2)[::-1]),
        ([np.zeros(2000), np.ones(2000)], [np.zeros(2000), np.append(np.ones(1999), 1 + 1e-12)]),
        (np.array(["2026-01-01", "2026-01-02"], "M8[ns]"), [1767225600000000000, 3]),
        ((x for x in (1.0, 2.0)), [1.0, 3.0]),
        ([None, "a"], [None, "b"]),
    ],
)
def test_values_are_handed_over_as_they_are_and_others_are_another_study(values, others, tmp_path):
    values, seen = values if isinstance(values, np.ndarray) else list(values), []

    def trial(rng, size, value):
        seen.append(value)
        return {"x": rng.standard_normal(size)}

    found = lb.study(trial, {"value": values}, 10, seed=1, out=tmp_path / "out")
    assert len(seen) == len(found.to_frame()) == 2 and found._repr_html_()
    for each, value in zip(seen, values, strict=True):
        np.testing.assert_array_equal(each, value)
    first = found.covariance(value=values[0]).to_numpy()
    np.testing.assert_array_equal(first, found.summaries[0].covariance)
    with pytest.raises(ValueError, match="another run: values was"):
        lb.study(trial, {"value": others}, 10, seed=1, out=tmp_path / "out", resume=True)


def test_an_iterator_is_an_axis_once():
    found = lb.study(throw, {"sigma": map(float, (1, 3))}, 30, seed=1)
    assert found.grid == {"sigma": (1.0, 3.0)}


def test_what_is_masked_is_left_out():
    def trial(rng, size):
        return {"x": np.ma.masked_greater(np.arange(size), 6)}

    with pytest.warns(RuntimeWarning, match="3 of 10 trials are left out"):
        found = lb.study(trial, {}, 10, seed=1)
    assert found.to_frame()["mean"].tolist() == [3.0]
