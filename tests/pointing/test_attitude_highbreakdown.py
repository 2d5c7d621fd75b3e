"""solve_attitude by methods that almost half of the spots cannot mislead."""

import numpy as np
import pytest

import losbench as lb

RING = np.arange(8) * np.pi / 4
SPOTS = np.column_stack([9 * np.cos(RING), 7 * np.sin(RING), np.full(8, 260.0)])
ANGLES = np.array([2e-5, -3e-5, 1e-4])
SIGMA_MM = 2e-4
METHODS = ["lts", "mm"]


def frames(count, *, seed, bad=0):
    shifts = (lb.design_matrix(SPOTS) @ ANGLES).reshape(8, 2)
    shifts = shifts + SIGMA_MM * np.random.default_rng(seed).standard_normal((count, 8, 2))
    # Bad spots in league, along a rotation of their own.
    shifts[:, :bad] += (lb.design_matrix(SPOTS) @ [4e-4, -1e-4, 8e-3]).reshape(8, 2)[:bad]
    return shifts


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("options", [{}, {"sigma": SIGMA_MM}, {"exact": True}])
def test_three_bad_spots_of_eight_are_found_out(method, options):
    shifts = frames(100, seed=1, bad=3)
    fit = lb.solve_attitude(SPOTS, shifts, method=method, **options)
    assert not fit.weights[:, :3].any()
    assert fit.weights[:, 3:].mean() > 0.75
    assert (np.abs(fit.angles - ANGLES) < 6 * fit.std_error).mean() > 0.97
    huber = lb.solve_attitude(SPOTS, shifts, method="irls", max_iter=3000)
    assert (
        np.abs(huber.angles - ANGLES)[:, :2] > 20 * np.abs(fit.angles - ANGLES)[:, :2].mean()
    ).all()


@pytest.mark.parametrize("method", METHODS)
def test_missing_spots_and_single_frames(method):
    shifts = frames(6, seed=2, bad=2)
    shifts[2, 7] = np.nan
    shifts[4, 2:] = np.nan
    shifts[5, 1:] = np.nan
    fit = lb.solve_attitude(SPOTS, shifts, method=method)
    assert fit.ok.tolist() == [True] * 5 + [False]
    np.testing.assert_allclose(
        fit.angles[2], lb.solve_attitude(SPOTS[:7], shifts[2, :7], method=method).angles
    )
    least = lb.solve_attitude(SPOTS, shifts[4], method="ls")
    np.testing.assert_allclose(fit.angles[4], least.angles, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_two_spots_are_beyond_any_method(method):
    shifts = frames(5, seed=3)[:, :2]
    with pytest.warns(UserWarning, match="with two spots per solve no outlier can be identified"):
        fit = lb.solve_attitude(SPOTS[:2], shifts, method=method)
    least = lb.solve_attitude(SPOTS[:2], shifts, method="ls")
    np.testing.assert_allclose(fit.angles, least.angles, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_frames_stacked(method):
    shifts = frames(40, seed=4)[:, :2]
    shifts[::10, 0] += 0.01
    fit = lb.solve_attitude(SPOTS[:2], shifts, method=method, stack=10)
    assert (fit.weights[::10, 0] == 0).all()
    np.testing.assert_allclose(fit.angles, np.broadcast_to(ANGLES, (4, 3)), atol=1e-4)


def test_a_scale_by_name_belongs_to_reweighting():
    with pytest.raises(ValueError, match="scale must be a number, got 'mad'"):
        lb.solve_attitude(SPOTS, frames(2, seed=0), method="lts", scale="mad")
    known = lb.solve_attitude(SPOTS, frames(2, seed=0), method="mm", scale=SIGMA_MM)
    np.testing.assert_array_equal(known.scale, SIGMA_MM)
