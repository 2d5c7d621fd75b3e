"""Authority: closed forms of liu2026's geometry, the exact projection, and the scatter of many
draws.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import losbench as lb
from losbench.display import with_error
from losbench.optics.camera import project
from losbench.pointing.attitude import attitude_covariance
from losbench.pointing.attitude.blocks import distinct_points
from losbench.units import ARCSEC_PER_RAD

LIU_POINTS = np.array([[5.0, 75.0, -475.0], [-5.0, 75.0, -475.0]])
LIU_PIXEL_MM = 4.5e-3
RING = np.arange(6) * np.pi / 3
SPOTS = np.column_stack([0.5 + 9 * np.cos(RING), 5 * np.sin(RING) - 0.3, np.full(6, 260.0)])
ANGLES = np.array([2e-5, -3e-5, 1e-4])
SIGMA_MM = 2e-4
PER_SOLVE = ("angles", "cov", "redundancy", "p_value", "scale", "converged", "ok")
PER_FRAME = ("residuals", "weights", "leverage")

two_spots_warn = pytest.warns(
    UserWarning, match="with two spots per solve no outlier can be identified"
)


def seen_shifts(points, angles):
    return (project(points, angles) - points)[..., :2]


def noisy_frames(frames, *, seed, points=SPOTS):
    linear = (lb.design_matrix(points) @ ANGLES).reshape(-1, 2)
    return linear + SIGMA_MM * np.random.default_rng(seed).standard_normal((frames, len(points), 2))


def assert_same(one, other, names=PER_SOLVE + PER_FRAME, **tolerance):
    for name in names:
        np.testing.assert_allclose(
            getattr(one, name),
            getattr(other, name),
            **({"rtol": 1e-9, "atol": 1e-13} | tolerance),
            err_msg=name,
        )


# What is solved


@pytest.mark.parametrize("method", ["ls", "irls"])
@pytest.mark.parametrize("model", ["paper", "pinhole"])
def test_angles_that_made_the_shifts_come_back(method, model):
    shifts = (lb.design_matrix(SPOTS, model) @ ANGLES).reshape(-1, 2)
    fit = lb.solve_attitude(SPOTS, shifts, model=model, method=method)
    np.testing.assert_allclose(fit.angles, ANGLES, rtol=1e-9)
    assert fit.angles.shape == (3,)
    assert fit.cov.shape == (3, 3)
    assert fit.residuals.shape == fit.weights.shape == fit.leverage.shape == (6, 2)
    assert fit.redundancy == 9
    assert fit.converged
    assert fit.ok
    assert np.isnan(fit.p_value)
    np.testing.assert_allclose(fit.angles_arcsec, ANGLES * ARCSEC_PER_RAD, rtol=1e-9)


def test_angles_carry_the_reference_directions_into_the_observed_ones():
    fit = lb.solve_attitude(SPOTS, seen_shifts(SPOTS, ANGLES), method="ls")
    np.testing.assert_allclose(fit.angles, ANGLES, rtol=0, atol=1e-8)


@given(size=st.floats(1e-6, 0.5), seed=st.integers(0, 50))
def test_exact_finds_large_rotations(size, seed):
    direction = np.random.default_rng(seed).normal(size=3)
    angles = size * direction / np.linalg.norm(direction)
    fit = lb.solve_attitude(SPOTS, seen_shifts(SPOTS, angles), exact=True, method="ls")
    assert fit.converged
    np.testing.assert_allclose(fit.angles, angles, rtol=0, atol=1e-10)
    np.testing.assert_allclose(fit.residuals, 0.0, atol=1e-9)


def test_exact_resists_a_bad_spot_and_takes_missing_ones():
    angles = np.array([[0.1, -0.05, 0.2], [0.01, 0.02, 0.03], [0.0, 0.0, 0.0]])
    shifts = seen_shifts(SPOTS, angles)
    shifts[0, 2] += 1.0
    shifts[1, 4] = np.nan
    fit = lb.solve_attitude(SPOTS, shifts, exact=True, sigma=SIGMA_MM)
    assert fit.converged.all()
    np.testing.assert_allclose(fit.angles[1:], angles[1:], atol=1e-10)
    assert fit.weights[0, 2].max() < 0.01
    least = lb.solve_attitude(SPOTS, shifts, exact=True, method="ls")
    assert (
        np.abs(fit.angles[0] - angles[0]).max() < 0.05 * np.abs(least.angles[0] - angles[0]).max()
    )


def test_the_linear_pinhole_rows_are_what_exact_starts_from():
    shifts = noisy_frames(5, seed=1)
    linear, exact = (
        lb.solve_attitude(SPOTS, shifts, exact=e, sigma=SIGMA_MM) for e in (False, True)
    )
    np.testing.assert_allclose(exact.angles, linear.angles, rtol=0, atol=1e-7)
    assert_same(exact, linear, names=("cov", "leverage"), rtol=1e-3)


def test_spots_on_one_line_are_as_good_as_others():
    line = np.array([[x, 0.5 * x + 1.0, 260.0] for x in (-8.0, -1.0, 3.0, 9.0)])
    for model in ("paper", "pinhole"):
        shifts = (lb.design_matrix(line, model) @ ANGLES).reshape(-1, 2)
        np.testing.assert_allclose(
            lb.solve_attitude(line, shifts, model=model).angles, ANGLES, rtol=1e-9
        )


# Invariants


def test_a_batch_equals_a_loop():
    shifts = noisy_frames(12, seed=2).reshape(3, 4, 6, 2)
    shifts[1, 2, 3] = np.nan
    shifts[2, 0, 1] += 50 * SIGMA_MM
    batch = lb.solve_attitude(SPOTS, shifts, sigma=SIGMA_MM)
    assert batch.angles.shape == (3, 4, 3)
    for index in np.ndindex(3, 4):
        one = lb.solve_attitude(SPOTS, shifts[index], sigma=SIGMA_MM)
        for name in PER_SOLVE + PER_FRAME:
            np.testing.assert_allclose(
                getattr(batch, name)[index], getattr(one, name), rtol=1e-8, atol=1e-14
            )


@given(unit=st.sampled_from([1e-3, 1e3, 39.37]))
def test_any_unit_of_length_gives_the_same_angles(unit):
    shifts = noisy_frames(20, seed=3)
    shifts[:, 1] += 30 * SIGMA_MM
    here = lb.solve_attitude(SPOTS, shifts, sigma=SIGMA_MM)
    there = lb.solve_attitude(SPOTS * unit, shifts * unit, sigma=SIGMA_MM * unit)
    assert_same(here, there, names=("angles", "cov", "weights", "p_value", "leverage"), rtol=1e-8)


def test_shifts_of_another_rotation_add_its_angles_and_order_of_spots_is_free():
    shifts, more = noisy_frames(20, seed=4), np.array([5e-5, 1e-5, -2e-4])
    here = lb.solve_attitude(SPOTS, shifts)
    moved = lb.solve_attitude(SPOTS, shifts + (lb.design_matrix(SPOTS) @ more).reshape(6, 2))
    np.testing.assert_allclose(moved.angles, here.angles + more, atol=1e-12)
    order = np.random.default_rng(0).permutation(6)
    shuffled = lb.solve_attitude(SPOTS[order], shifts[:, order])
    np.testing.assert_allclose(shuffled.angles, here.angles, atol=1e-12)
    np.testing.assert_allclose(shuffled.weights, here.weights[:, order], atol=1e-6)


# Missing spots and stacks


@pytest.mark.parametrize(
    "options", [{}, {"sigma": SIGMA_MM}, {"method": "ls"}, {"scale": "std", "group": None}]
)
def test_a_missing_spot_is_a_spot_left_out(options):
    shifts = noisy_frames(8, seed=5)
    shifts[3, 0] += 40 * SIGMA_MM
    lost = shifts.copy()
    lost[:, 2, 0] = np.nan
    keep = [0, 1, 3, 4, 5]
    with_gap, without = (
        lb.solve_attitude(SPOTS, lost, **options),
        lb.solve_attitude(SPOTS[keep], shifts[:, keep], **options),
    )
    assert_same(with_gap, without, names=PER_SOLVE)
    for name in PER_FRAME:
        np.testing.assert_allclose(
            getattr(with_gap, name)[:, keep], getattr(without, name), rtol=1e-9, atol=1e-13
        )
    assert np.isnan(with_gap.residuals[:, 2]).all()
    np.testing.assert_array_equal(with_gap.weights[:, 2], 0.0)


def test_a_frame_with_too_few_spots_is_flagged_and_the_series_goes_on():
    shifts = noisy_frames(4, seed=6)
    shifts[1, 1:] = np.nan
    shifts[2] = np.nan
    shifts[3, 2:, 1] = np.nan
    fit = lb.solve_attitude(SPOTS, shifts, sigma=SIGMA_MM)
    np.testing.assert_array_equal(fit.ok, [True, False, False, True])
    np.testing.assert_array_equal(np.isnan(fit.angles).any(axis=1), ~fit.ok)
    np.testing.assert_array_equal(np.isnan(fit.p_value), ~fit.ok)
    np.testing.assert_array_equal(fit.redundancy, [9, -1, -3, 1])
    np.testing.assert_allclose(fit.angles[3], ANGLES, atol=8 * fit.std_error[3].max())


def test_stacked_frames_are_one_system_and_left_over_frames_a_shorter_one():
    shifts = noisy_frames(8, seed=7)
    shifts[4, 2] = np.nan
    stacked = lb.solve_attitude(SPOTS, shifts, stack=3, scale="std")
    assert stacked.angles.shape == (3, 3)
    assert stacked.residuals.shape == shifts.shape
    np.testing.assert_array_equal(stacked.redundancy, [33, 31, 21])
    rows, spots = lb.design_matrix(SPOTS), np.arange(12) // 2
    for block, frames in enumerate((slice(0, 3), slice(3, 6), slice(6, 8))):
        y = shifts[frames].ravel()
        seen = np.isfinite(y)
        count = y.size // 12
        direct = lb.irls(
            np.tile(rows, (count, 1))[seen],
            y[seen],
            scale="std",
            group=np.concatenate([spots + 6 * i for i in range(count)])[seen],
        )
        np.testing.assert_allclose(stacked.angles[block], direct.x, rtol=1e-9)
        np.testing.assert_allclose(stacked.cov[block], direct.cov, rtol=1e-7)
        np.testing.assert_allclose(stacked.weights[frames].ravel()[seen], direct.weights, rtol=1e-7)


def test_least_squares_takes_a_known_scale_for_its_covariance():
    shifts = 1e-3 * np.random.default_rng(4).standard_normal((5, 6, 2))
    one, two = (
        lb.solve_attitude(SPOTS, shifts, method="ls", scale=scale) for scale in (1e-3, 2e-3)
    )
    np.testing.assert_allclose(two.cov, 4.0 * one.cov)
    np.testing.assert_allclose(
        one.cov, lb.solve_attitude(SPOTS, shifts, method="ls", sigma=1e-3).cov, rtol=1e-9
    )


def test_stacked_least_squares_is_the_mean_of_its_frames():
    shifts = noisy_frames(20, seed=8).reshape(2, 10, 6, 2)
    single, stacked = (
        lb.solve_attitude(SPOTS, shifts, stack=k, method="ls", sigma=SIGMA_MM) for k in (1, 5)
    )
    np.testing.assert_allclose(
        stacked.angles, single.angles.reshape(2, 2, 5, 3).mean(axis=2), atol=1e-14
    )
    np.testing.assert_allclose(stacked.cov, single.cov[:, ::5] / 5, rtol=1e-10)
    np.testing.assert_allclose(
        stacked.cov[0, 0], attitude_covariance(SPOTS, SIGMA_MM, stack=5), rtol=1e-10
    )


def test_a_stack_longer_than_the_recording_is_one_block():
    shifts = noisy_frames(3, seed=9)
    assert_same(
        lb.solve_attitude(SPOTS, shifts, stack=3), lb.solve_attitude(SPOTS, shifts, stack=50)
    )


# Errors: predicted and seen


def test_errors_of_the_published_layout():
    # One-sigma errors about x, y, z in closed form, A and B at (+-5, 75, -475), 0.5 px of 4.5 um:
    # alpha is the mean of two y shifts (with gamma leaking in as x/z = 0 on average), gamma their
    # difference over 10 mm.
    sigma = 0.5 * LIU_PIXEL_MM
    z = sigma * np.sqrt(2) / 10
    x = sigma / np.sqrt(2) / 475
    y = np.hypot(x, 75 / 475 * z)
    covariance = attitude_covariance(LIU_POINTS, sigma, model="paper")
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [x, y, z], rtol=1e-10)
    np.testing.assert_allclose(
        np.array([x, y, z]) * ARCSEC_PER_RAD, [0.691, 10.39, 65.6], rtol=1e-3
    )


@pytest.mark.parametrize(("model", "tolerance"), [("paper", 0.03), ("pinhole", 0.03)])
def test_monte_carlo_scatter_is_the_closed_form(model, tolerance):
    sigma = 0.1 * LIU_PIXEL_MM
    shifts = sigma * np.random.default_rng(10).standard_normal((5000, 2, 2))
    fit = lb.solve_attitude(LIU_POINTS, shifts, model=model, method="ls", sigma=sigma)
    expected = np.sqrt(np.diag(attitude_covariance(LIU_POINTS, sigma, model=model)))
    np.testing.assert_allclose(lb.rms(fit.angles), expected, rtol=tolerance)
    np.testing.assert_allclose(fit.std_error[0], expected, rtol=1e-10)


def test_covariance_of_a_batch_of_layouts_equals_a_loop():
    layouts = np.stack([SPOTS, SPOTS * [0.5, 2.0, 1.0]])
    batch = attitude_covariance(layouts, SIGMA_MM)
    np.testing.assert_allclose(
        batch, [attitude_covariance(one, SIGMA_MM) for one in layouts], rtol=1e-12
    )
    rows = lb.design_matrix(SPOTS) / SIGMA_MM
    np.testing.assert_allclose(batch[0], np.linalg.inv(rows.T @ rows), rtol=1e-9)


def test_a_layout_in_one_direction_has_no_finite_covariance():
    assert np.isinf(attitude_covariance([[1.0, 2.0, 260.0], [1.0, 2.0, 260.0]], SIGMA_MM)).all()


@pytest.mark.parametrize(
    "options",
    [
        {"method": "ls"},
        {"sigma": True},
        {"sigma": True, "group": None},
        {"scale": "mad", "stack": 10},
    ],
)
def test_predicted_covariance_is_the_empirical_one(options):
    sigma = SIGMA_MM * np.array([[1.0, 2.0]]) * np.array([[1.0], [1.0], [3.0], [1.0], [1.0], [1.0]])
    known = "sigma" in options
    noise = (sigma if known else SIGMA_MM) * np.random.default_rng(11).standard_normal(
        (40_000, 6, 2)
    )
    fit = lb.solve_attitude(
        SPOTS, noise, **(options | ({"sigma": sigma} if known else {})), max_iter=1000
    )
    predicted = fit.cov.mean(axis=0)
    # reduced chi-square per axis: sampling error 0.7 % (2.2 % stacked); Huber's weights cost a few
    # per cent of accuracy
    np.testing.assert_allclose(np.diag(np.cov(fit.angles.T)) / np.diag(predicted), 1.0, atol=0.07)


def test_p_values_are_uniform_when_sigma_is_right_and_find_a_bad_spot():
    shifts = noisy_frames(4000, seed=12)
    fit = lb.solve_attitude(SPOTS, shifts, sigma=SIGMA_MM)
    counts = np.histogram(fit.p_value, bins=10, range=(0, 1))[0]
    assert ((counts - 400) ** 2 / 400).sum() < 27.9  # chi-square, 9 degrees of freedom, 0.1 %
    shifts[:, 0, 0] += 20 * SIGMA_MM
    assert (lb.solve_attitude(SPOTS, shifts, sigma=SIGMA_MM).p_value < 1e-6).all()


def test_two_spots_can_detect_what_they_cannot_identify():
    shifts = noisy_frames(200, seed=13, points=SPOTS[:2])
    shifts[:, 0, 0] += 30 * SIGMA_MM
    with two_spots_warn:
        fit = lb.solve_attitude(SPOTS[:2], shifts, sigma=SIGMA_MM)
    least = lb.solve_attitude(SPOTS[:2], shifts, sigma=SIGMA_MM, method="ls")
    assert_same(fit, least, names=("angles", "p_value", "redundancy"))
    assert (fit.std_error > least.std_error).all()
    np.testing.assert_array_equal(fit.redundancy, 1)
    assert np.median(fit.p_value) < 1e-6


def test_redundancy_numbers_add_up():
    fit = lb.solve_attitude(SPOTS, noisy_frames(6, seed=14), stack=2, sigma=SIGMA_MM)
    np.testing.assert_allclose(
        (1 - fit.leverage).reshape(3, -1).sum(axis=1), fit.redundancy, rtol=1e-12
    )
    rows = lb.design_matrix(SPOTS)
    hat = rows @ np.linalg.inv(rows.T @ rows) @ rows.T / 2
    np.testing.assert_allclose(fit.leverage[0].ravel(), np.diag(hat), rtol=1e-9)


def test_sigma_weighs_spots():
    shifts = noisy_frames(10, seed=15)
    shifts[:, 0] += 1.0
    sigma = np.where(np.arange(6)[:, None] == 0, 1e9, SIGMA_MM) * np.ones((6, 2))
    weighted = lb.solve_attitude(SPOTS, shifts, method="ls", sigma=sigma)
    without = lb.solve_attitude(SPOTS[1:], shifts[:, 1:], method="ls", sigma=SIGMA_MM)
    np.testing.assert_allclose(weighted.angles, without.angles, rtol=1e-6)
    each = np.broadcast_to(sigma, shifts.shape).copy()
    assert_same(weighted, lb.solve_attitude(SPOTS, shifts, method="ls", sigma=each))
    shifts[2, 3] = each[2, 3] = np.nan
    assert lb.solve_attitude(SPOTS, shifts, sigma=each).ok.all()
    assert_same(
        lb.solve_attitude(SPOTS, shifts, sigma=each, stack=4),
        lb.solve_attitude(SPOTS, shifts, sigma=sigma, stack=4),
    )


# Robustness: where it is real and where it is not (liu2026, section 2.1)


@pytest.mark.parametrize(("scale", "weight"), [("std", 0.951), ("mad", 0.997), ("std1", 1.0)])
def test_with_two_spots_reweighting_changes_nothing(scale, weight):
    # Rows 1 and 3 of A are equal, so residuals are (d, 0, -d, 0): rows 1 and 3 share a weight, the
    # angles do not move.
    shifts = 0.1 * LIU_PIXEL_MM * np.random.default_rng(16).standard_normal((5000, 2, 2))
    least = lb.solve_attitude(LIU_POINTS, shifts, model="paper", method="ls")
    with two_spots_warn:
        robust = lb.solve_attitude(LIU_POINTS, shifts, model="paper", scale=scale, group=None)
    assert np.abs(robust.angles_arcsec - least.angles_arcsec).max() < 1e-9
    np.testing.assert_allclose(robust.weights[:, :, 0], weight, atol=6e-4)
    np.testing.assert_allclose(robust.weights[:, :, 1], 1.0)


@pytest.mark.parametrize(
    ("bad", "share", "size", "scale", "ratio"),
    [
        ("frames", 0.05, 10, "std", 0.70),
        ("frames", 0.05, 10, "mad", 0.47),
        ("frames", 0.02, 5, "std", 0.91),
        ("frames", 0.02, 5, "mad", 0.88),
        ("elements", 0.05, 10, "std", 0.59),
        ("elements", 0.05, 10, "mad", 0.48),
        ("elements", 0.02, 5, "std", 0.88),
        ("elements", 0.02, 5, "mad", 0.88),
    ],
)
def test_stacked_frames_of_two_spots_gain_what_was_found_before(bad, share, size, scale, ratio):
    # 1000 frames in 100 blocks of 10, the paper's rows, one weight per element; a bad element is
    # off by +-size sigma.
    rng = np.random.default_rng(18)
    shifts = rng.standard_normal((20, 1000, 2, 2))
    where = rng.random((20, 1000, 1, 1) if bad == "frames" else shifts.shape) < share
    shifts += where * size * rng.choice([-1.0, 1.0], size=shifts.shape)
    least, robust = (
        lb.solve_attitude(LIU_POINTS, 1e-3 * shifts, model="paper", stack=10, **options)
        .angles.std(axis=1)
        .mean(axis=0)
        for options in ({"method": "ls"}, {"scale": scale, "group": None})
    )
    np.testing.assert_allclose(robust / least, ratio, atol=0.03)


@pytest.mark.parametrize(("spots", "least", "robust"), [(4, 18.0, 1.2), (8, 8.9, 0.6)])
def test_one_bad_spot_of_many_is_resisted_with_a_known_sigma(spots, least, robust):
    # Rows (1, 0, -v), (0, 1, u) of a unit ring, which the paper's rows are at z = 1 up to order and
    # sign of columns.
    turn = 2 * np.pi * np.arange(spots) / spots
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.ones(spots)])
    rng = np.random.default_rng(19)
    shifts = rng.standard_normal((4000, spots, 2))
    towards = rng.uniform(0, 2 * np.pi, 4000)
    gross = 100 * np.column_stack([np.cos(towards), np.sin(towards)])
    shifts[np.arange(4000), rng.integers(0, spots, 4000)] += gross
    ls = lb.solve_attitude(ring, shifts, model="paper", method="ls").angles[:, 1]
    spot = lb.solve_attitude(ring, shifts, model="paper", sigma=1.0, max_iter=1000).angles[:, 1]
    assert lb.rms(ls, about=0) == pytest.approx(least, rel=0.05)
    assert lb.rms(spot, about=0) < robust


def test_one_call_gives_one_warning_without_paths_or_numbers_of_processes():
    shifts = np.zeros((50, 2, 2))
    shifts[::2, 0] = np.nan
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        lb.solve_attitude(LIU_POINTS, shifts)
        lb.solve_attitude(LIU_POINTS, shifts, method="ls")
        lb.solve_attitude(LIU_POINTS, shifts, stack=3)
    assert len(caught) == 1
    assert "/" not in str(caught[0].message)
    assert not any(c.isdigit() for c in str(caught[0].message))


def test_a_limit_on_iterations_is_reported_once():
    shifts = noisy_frames(30, seed=17)
    with pytest.warns(RuntimeWarning, match=r"\d+ of 30 attitudes did not converge") as caught:
        fit = lb.solve_attitude(SPOTS, shifts, max_iter=1)
    assert len(caught) == 1
    assert not fit.converged.all()
    assert fit.ok.all()


# Bad input


@pytest.mark.parametrize(
    ("points", "shifts", "options", "message"),
    [
        (
            SPOTS[:4],
            np.zeros((100, 3, 2)),
            {},
            r"shifts must have shape \(\.\.\., 4, 2\) to match 4 points, got \(100, 3, 2\)",
        ),
        (
            SPOTS,
            np.full((6, 2), np.inf),
            {},
            "shifts must be finite or NaN, got 12 infinite of 12 values",
        ),
        (SPOTS, np.zeros((0, 6, 2)), {}, "shifts must hold at least one sample"),
        (
            SPOTS[:1],
            np.zeros((1, 2)),
            {},
            "points must hold at least 2 spots to fix three angles, got 1",
        ),
        (
            SPOTS[[0, 1, 0]],
            np.zeros((3, 2)),
            {},
            "points must differ, got two equal points: 0 and 2",
        ),
        (
            [[1.0, 2.0, 10.0], [0.0, 0.0, 10.0], [2.0, 4.0, 20.0]],
            np.zeros((3, 2)),
            {},
            "got 0 and 2 on one line of sight, which leaves the rotation about it undetermined",
        ),
        (SPOTS[None], np.zeros((6, 2)), {}, r"points must have shape \(n, 3\), got \(1, 6, 3\)"),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"method": "best"},
            "method must be one of 'irls', 'ls', 'lts', 'mm', got 'best'",
        ),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"model": "fisheye"},
            "model must be one of 'pinhole', 'paper', got 'fisheye'",
        ),
        (SPOTS, np.zeros((6, 2)), {"group": "frame"}, "group must be one of 'spot', got 'frame'"),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"exact": True, "model": "paper"},
            "exact must be False with model 'paper'",
        ),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"stack": 2},
            r"shifts must have shape \(\.\.\., frames, 6, 2\) to be stacked, got \(6, 2\)",
        ),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"stack": 0},
            "stack must be a whole number of at least 1, got 0",
        ),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"sigma": 0.0},
            "sigma must be positive wherever a shift is given",
        ),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"sigma": np.ones(6)},
            r"sigma must broadcast to shape \(6, 2\), got \(6,\)",
        ),
        (SPOTS, np.zeros((6, 2)), {"scale": [1.0, 2.0]}, "scale must be a number"),
        *(
            (
                SPOTS,
                np.zeros((6, 2)),
                {"method": method, "scale": 0},
                "scale must be positive, got 0",
            )
            for method in ("irls", "ls", "lts", "mm")
        ),
        (SPOTS, np.zeros((6, 2)), {"scale": True}, "scale must be a number, got True"),
        (
            SPOTS,
            np.zeros((6, 2)),
            {"method": "ls", "scale": "mad"},
            "scale must be a number, got 'mad'",
        ),
    ],
)
def test_bad_input_is_named(points, shifts, options, message):
    with pytest.raises(ValueError, match=message):
        lb.solve_attitude(points, shifts, **options)


def test_spots_that_weigh_next_to_nothing_leave_a_rotation_open():
    sigma = np.full((6, 1), 1e18)
    sigma[2] = SIGMA_MM
    shifts = noisy_frames(4, seed=23)
    message = "4 of 4 solves do not determine all three angles; errors of what they leave open are"
    for solver in (lb.LeastSquares(), lb.IRLS(), lb.LTS(), lb.MM()):
        with pytest.warns(RuntimeWarning, match=message) as told:
            fit = lb.solve_attitude(SPOTS, shifts, sigma=sigma, solver=solver)
        assert len(told) == 1
        assert np.isnan(fit.std_error).all()
    shifts[1, 2] = np.nan
    with pytest.warns(RuntimeWarning, match="3 of 4 solves do not determine"):
        fit = lb.solve_attitude(SPOTS, shifts, sigma=sigma, method="ls")
    np.testing.assert_array_equal(np.isnan(fit.std_error[:, 0]), [True, False, True, True])


# Solvers as objects


@pytest.mark.parametrize(
    ("name", "solver"),
    [("irls", lb.IRLS()), ("ls", lb.LeastSquares()), ("lts", lb.LTS()), ("mm", lb.MM())],
)
@pytest.mark.parametrize("sigma", [None, SIGMA_MM])
def test_a_name_and_its_object_are_one_choice(name, solver, sigma):
    shifts = noisy_frames(5, seed=20)
    shifts[1, 2] = np.nan
    fits = [
        lb.solve_attitude(SPOTS, shifts, sigma=sigma, **choice)
        for choice in ({"method": name}, {"solver": name}, {"solver": solver}, {"method": solver})
    ]
    for fit in fits[1:]:
        for field in PER_SOLVE + PER_FRAME:
            np.testing.assert_array_equal(getattr(fit, field), getattr(fits[0], field))


def test_options_of_an_object_are_its_own():
    shifts = noisy_frames(5, seed=21)
    named = lb.solve_attitude(SPOTS, shifts, loss="cauchy", scale="std", max_iter=500)
    given = lb.solve_attitude(
        SPOTS, shifts, solver=lb.IRLS(lb.Cauchy(), scale="std", max_iter=500), sigma=None
    )
    np.testing.assert_array_equal(named.angles, given.angles)
    known = lb.solve_attitude(SPOTS, shifts, solver=lb.IRLS(scale=3.0), sigma=SIGMA_MM)
    np.testing.assert_array_equal(known.scale, 3.0)


class Middle:
    """A solver of somebody else: each row pair's own solution, and their median."""

    def fit(self, A, y, group=None):
        return lb.irls(A, y, scale="mad", group=group, max_iter=500)


def test_a_solver_of_ones_own_will_do():
    shifts = noisy_frames(5, seed=22)
    own = lb.solve_attitude(SPOTS, shifts, solver=Middle())
    np.testing.assert_array_equal(own.angles, lb.solve_attitude(SPOTS, shifts).angles)
    track = lb.track_attitude(SPOTS, shifts, solver=Middle(), window=3)
    np.testing.assert_array_equal(
        track.angles, lb.track_attitude(SPOTS, shifts, solver=lb.IRLS(), window=3).angles
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"solver": "best"}, "solver must be one of 'irls', 'ls', 'lts', 'mm', got 'best'"),
        ({"solver": lb.MM}, "or an object with fit.*got <class"),
        ({"method": 3}, "method must be one of 'irls', .*, or an object with fit.*got 3"),
        ({"solver": lb.MM(), "method": "mm"}, "solver and method are one thing"),
        (
            {"solver": lb.MM(), "scale": 2.0},
            r"scale belongs to the solver, MM\(scale=...\), got both",
        ),
        ({"method": "ls", "loss": "huber"}, "loss is no option of the solver 'ls'"),
        ({"solver": lb.IRLS(scale=[1.0, 2.0])}, "scale must be a number"),
        ({"loss": "hubert"}, "loss must be one of"),
    ],
)
def test_a_bad_solver_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        lb.solve_attitude(SPOTS, np.zeros((6, 2)), **options)


def test_attitudes_are_shown_in_arcseconds_with_what_is_wrong_in_words():
    shifts = noisy_frames(4, seed=21)
    shifts[2, 1:] = np.nan
    fit = lb.solve_attitude(SPOTS, shifts, sigma=SIGMA_MM)
    fit = replace(fit, converged=np.array([True, False, False, True]))
    rows = [row.split("</td>") for row in fit._repr_html_().split("<tr>")[2:]]
    cells = [[cell.rsplit(">", 1)[-1] for cell in row[:6]] for row in rows]
    assert [row[0] for row in cells] == ["0", "1", "2", "3"]
    assert [row[5] for row in cells] == ["", "not converged", "too few spots", ""]
    assert [bool(row[4]) for row in cells] == [True, True, False, True]
    assert cells[0][1] == with_error(fit.angles_arcsec[0, 0], fit.std_error_arcsec[0, 0])
    assert "AttitudeFit: 4 solves, 2 converged; arcseconds" in fit._repr_html_()
    frame = fit.to_frame()
    np.testing.assert_array_equal(frame["gamma_arcsec"], ARCSEC_PER_RAD * fit.angles[:, 2])
    np.testing.assert_array_equal(frame["sigma_beta_arcsec"], fit.std_error_arcsec[:, 1])
    assert frame["ok"].tolist() == [True, True, False, True]


@pytest.mark.parametrize(("apart", "two"), [(1.2e-9, True), (0.8e-9, False)])
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_two_directions_are_two_from_a_billionth_on(apart, two, unit):
    points = unit * np.array([[5.0, 2.0, 400.0], [5.0, 2.0, 400.0], [-5.0, 1.0, 400.0]])
    points[1, 0] += apart * points[1, 2]
    points[1] *= 3.0  # the same direction from three times as far
    if two:
        np.testing.assert_array_equal(distinct_points(points), points)
        return
    with pytest.raises(ValueError, match="points must lie in different directions, got 0 and 1"):
        distinct_points(points)


@pytest.mark.parametrize(("apart", "finite"), [(1e-8, True), (1e-12, False)])
def test_a_layout_tells_a_rotation_down_to_a_billionth_of_the_best_known(apart, finite):
    """Two spots off the axis: their roll is known by how far they are apart alone."""
    points = np.array([[5.0, 2.0, 400.0], [5.0, 2.0, 400.0]])
    points[1, 0] += apart * 400.0
    found = attitude_covariance(points, 1e-3)
    if not finite:
        assert np.isinf(found).all()
        return
    assert np.isfinite(found).all() and (np.diagonal(found) > 0).all()
    # About their own direction both turn in place, but for what lies between them.
    along = points[0] / np.linalg.norm(points[0])
    assert np.sqrt(along @ found @ along) == pytest.approx(
        1e-3 * np.sqrt(2.0) / (apart * 400.0), rel=0.01
    )
