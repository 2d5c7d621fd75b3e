"""Tracking over frames: what a window of two-spot frames can tell that one frame cannot."""

import numpy as np
import pytest

import losbench as lb
from losbench.pointing.tracking import _alike

POINTS = np.array([[5.0, 2.0, 260.0], [-5.0, 1.0, 260.0]])
ROWS = lb.design_matrix(POINTS)
SIGMA_MM = 1e-4
METHODS = ["irls", "ls", "lts", "mm"]


def recording(frames, *, seed, rate=(1e-6, -2e-6, 3e-5), noise=SIGMA_MM):
    truth = np.array([1e-5, 2e-5, -1e-4]) + np.outer(np.arange(frames), rate)
    shifts = (truth @ ROWS.T).reshape(frames, 2, 2)
    return truth, shifts + noise * np.random.default_rng(seed).standard_normal(shifts.shape)


@pytest.mark.parametrize("method", METHODS)
def test_a_uniform_turn_comes_back_exactly(method):
    truth, shifts = recording(30, seed=0, noise=0.0)
    track = lb.track_attitude(POINTS, shifts, method=method, window=5, time_s=0.5 * np.arange(30))
    np.testing.assert_allclose(track.angles, truth, atol=1e-13)
    np.testing.assert_allclose(
        track.rates, np.broadcast_to([2e-6, -4e-6, 6e-5], (30, 3)), atol=1e-13
    )
    assert not track.bad.any()
    assert track.converged.all()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["irls", "lts", "mm"])
def test_the_bad_spot_of_a_two_spot_frame_is_named(method):
    truth, shifts = recording(200, seed=1)
    bad_frames = np.arange(10, 200, 17)
    bad_spots = np.arange(len(bad_frames)) % 2
    shifts[bad_frames, bad_spots] += [60 * SIGMA_MM, -40 * SIGMA_MM]
    track = lb.track_attitude(POINTS, shifts, method=method, window=9)
    expected = np.zeros((200, 2), dtype=bool)
    expected[bad_frames, bad_spots] = True
    assert track.bad[expected].all()
    assert track.bad[~expected].mean() < 0.03
    error = np.sqrt(np.mean((track.angles - truth)[bad_frames] ** 2, axis=0))
    with pytest.warns(UserWarning, match="with two spots per solve"):
        single = lb.solve_attitude(POINTS, shifts, method=method)
    alone = np.sqrt(np.mean((single.angles - truth)[bad_frames] ** 2, axis=0))
    assert (error < 0.05 * alone).all()


def test_least_squares_over_a_window_has_the_predicted_errors():
    truth, shifts = recording(3000, seed=2)
    track = lb.track_attitude(POINTS, shifts, method="ls", sigma=SIGMA_MM, window=7)
    error = (track.angles - truth)[::7]
    predicted = np.diagonal(track.cov[1500])[:3]
    np.testing.assert_allclose(np.mean(error**2, axis=0) / predicted, 1.0, atol=0.2)
    # In the middle of its window a line knows its place as well as a mean does.
    single = lb.solve_attitude(POINTS, shifts[1500], method="ls", sigma=SIGMA_MM)
    np.testing.assert_allclose(track.cov[1500, :3, :3], single.cov / 7, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_missing_spots_are_done_without_as_long_as_can_be(method):
    truth, shifts = recording(40, seed=3)
    shifts[5, 0] = np.nan
    shifts[12] = np.nan
    shifts[20:30] = np.nan
    track = lb.track_attitude(POINTS, shifts, method=method, window=5)
    assert (track.weights[5, 0] == 0).all()
    assert np.isnan(track.residuals[12]).all()
    np.testing.assert_allclose(track.angles[[5, 12]], truth[[5, 12]], atol=5e-5)
    assert np.isnan(track.angles[22:28]).all()
    assert np.isfinite(track.angles[:20]).all()
    assert not track.bad[20:30].any()
    assert not track.converged[22:28].any()


def test_a_long_series_goes_through_in_parts():
    _, shifts = recording(5000, seed=4)
    whole = lb.track_attitude(POINTS, shifts, method="irls", window=5)
    part = lb.track_attitude(POINTS, shifts[4050:4150], method="irls", window=5)
    np.testing.assert_allclose(whole.angles[4060:4140], part.angles[10:-10], rtol=1e-6, atol=1e-12)


BAD = [
    (
        {"shifts": np.zeros((9, 3, 2))},
        r"shifts must have shape \(F, 2, 2\) to match 2 points, got \(9, 3, 2\)",
    ),
    ({"shifts": np.zeros((9, 2))}, r"shifts must have 3 dimensions, got shape \(9, 2\)"),
    ({"window": 2}, "window must be a whole number of at least 3, got 2"),
    ({"window": 10}, "window must not be longer than the 9 frames, got 10"),
    ({"time_s": np.zeros(9)}, "time_s must increase, but sample 1 at 0 s equals the one before it"),
    ({"time_s": np.zeros(8)}, r"time_s must have shape \(9,\) to match 9 frames, got \(8,\)"),
    ({"method": "best"}, "method must be one of 'irls', 'ls', 'lts', 'mm', got 'best'"),
    ({"sigma": 0.0}, "sigma must be positive, got 0"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_input_is_refused_by_name(change, message):
    arguments = {"shifts": np.zeros((9, 2, 2))} | change
    with pytest.raises(ValueError, match=message):
        lb.track_attitude(POINTS, **arguments)


def test_a_spot_is_bad_beyond_three_scales_of_its_window():
    shifts = recording(400, seed=6)[1]
    track = lb.track_attitude(POINTS, shifts, solver="ls", window=5)
    size = np.sqrt(np.mean(track.residuals**2, axis=-1)) / track.scale[:, None]
    assert np.max(size) < 3.0
    shifts[::20, 1, 0] += 8.0 * SIGMA_MM
    track = lb.track_attitude(POINTS, shifts, solver="lts", window=5)
    size = np.sqrt(np.mean(track.residuals**2, axis=-1)) / track.scale[:, None]
    np.testing.assert_array_equal(track.bad, size > 3.0)
    assert ((size > 2.0) & (size < 3.0)).any() and ((size > 3.0) & (size < 4.5)).any()


def test_a_window_needs_two_spots_in_two_frames():
    """Windows of three frames of three spots."""
    seen = {
        (3, 3, 3): 9,
        (2, 0, 2): 4,
        (3, 0, 2): 5,
        (2, 1, 1): None,
        (3, 1, 1): None,
        (1, 1, 1): None,
        (2, 2, 0): 4,
    }
    present = np.array([[k < spots for spots in row for k in range(3)] for row in seen])
    found = {spots: members.tolist() for spots, members in _alike(present, 3, 3)}
    assert found == {
        count: [k for k, spots in enumerate(seen.values()) if spots == count] for count in (4, 5, 9)
    }


@pytest.mark.parametrize("window", [4, 5])
def test_windows_lie_about_their_frames_and_within_the_record(window):
    """Least squares of one window by hand, whatever the frame's place in it."""
    _, shifts = recording(8, seed=7)
    t = np.cumsum([0.0, 1.0, 0.5, 2.0, 1.0, 0.7, 1.0, 1.3])
    track = lb.track_attitude(POINTS, shifts, solver="ls", window=window, time_s=t)
    for frame in range(8):
        first = min(max(frame - window // 2, 0), 8 - window)
        inside = slice(first, first + window)
        design = np.concatenate([np.hstack([ROWS, ROWS * (s - t[frame])]) for s in t[inside]])
        x = lb.lstsq(design, shifts[inside].ravel()).x
        np.testing.assert_allclose(track.angles[frame], x[:3], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(track.rates[frame], x[3:], rtol=1e-6, atol=1e-12)
        left = (design @ x - shifts[inside].ravel()).reshape(window, 2, 2)[frame - first]
        np.testing.assert_allclose(track.residuals[frame], left, atol=1e-12)
