"""Series in time against loops over their samples."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from losbench.series import gaps, mark_gaps, neighbours, runs, split_tracks, window_means

TIME = np.array([0.0, 1.0, 2.0, 3.0, 4.6, 6.1, 7.2, 90.0, 91.0])


def test_a_step_of_more_than_one_and_a_half_medians_is_a_gap():
    assert gaps(TIME).tolist() == [False, False, False, True, False, False, True, False]
    assert gaps(np.array([0.0, 1.0, 2.0, 3.5])).tolist() == [False] * 3
    assert gaps(TIME, longest_s=60.0).sum() == 1
    assert gaps(TIME[:1]).size == 0


def test_tracks_neighbours_and_marks_agree_on_where_a_gap_is():
    assert split_tracks(TIME).tolist() == [0] * 7 + [1, 1]
    np.testing.assert_array_equal(neighbours(TIME), np.diff(split_tracks(TIME)) == 0)
    assert np.isnan(mark_gaps(TIME, TIME)).sum() == 2


@given(st.lists(st.booleans(), min_size=1, max_size=9))
def test_runs_hold_every_present_sample_once_and_no_gap(present):
    present = np.array(present)
    time = TIME[: len(present)]
    pieces = runs(time, present)
    held = [k for piece in pieces for k in range(len(time))[piece]]
    assert held == np.flatnonzero(present).tolist()
    for piece in pieces:
        assert present[piece].all()
        assert not gaps(time)[piece.start : piece.stop - 1].any()
    for one, other in pairwise(pieces):
        assert one.stop < other.start or gaps(time)[one.stop - 1]


@pytest.mark.parametrize("window_s", [0.5, 2.0, 5.0, 500.0])
def test_means_are_those_of_a_loop(window_s):
    values = np.random.default_rng(2).standard_normal((9, 2, 3))
    values[3, 1, 2] = np.nan
    whole = np.isfinite(values).all(axis=(1, 2))
    means = window_means(TIME, values, window_s)
    for k, t in enumerate(TIME):
        near = whole & (np.abs(TIME - t) <= window_s / 2)
        wanted = values[near].mean(axis=0) if whole[k] else np.full((2, 3), np.nan)
        np.testing.assert_allclose(means[k], wanted, atol=1e-12)


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([0.0, 2.0, 1.0], "time_s must increase, but sample 2 at 1 s is before the one before it"),
        ([0.0, 2.0, 2.0], "time_s must increase, but sample 2 at 2 s equals the one before it"),
        ([0.0, np.nan, 2.0], "time_s must be finite"),
        ([[0.0, 1.0]], "time_s must have 1 dimension"),
    ],
)
def test_times_that_do_not_increase_are_named(time, message):
    with pytest.raises(ValueError, match=message):
        split_tracks(time)
