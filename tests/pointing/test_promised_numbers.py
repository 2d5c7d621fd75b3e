"""Numbers that the docstrings of pointing promise, from either side."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.optics.camera import project
from losbench.pointing.attitude import solve
from losbench.pointing.performance.intervals import freedom
from losbench.pointing.performance.spectrum import spectrum
from losbench.pointing.starcamera import (
    QuaternionConvention,
    check_design,
    drift_from_spots,
    interpolate_attitude,
    interpolate_drift,
    time_tag_offset,
)
from losbench.pointing.starcamera.pair import PairTelemetry
from losbench.pointing.starcamera.timing import _rate
from losbench.units import arcsec_to_rad

LAST = QuaternionConvention(scalar="last", direction="camera_to_inertial")
STEP_S = 5.0


def heads_apart(angles_deg):
    """Attitudes of two heads whose boresights stand apart by these angles."""
    still = np.tile([0.0, 0.0, 0.0, 1.0], (len(angles_deg), 1))
    return still, Rotation.from_euler("x", np.reshape(angles_deg, (-1, 1)), degrees=True).as_quat()


@pytest.mark.parametrize("off_deg", [0.49, -0.49])
def test_the_design_angle_holds_to_half_a_degree(off_deg):
    check_design(*heads_apart([70.0 + off_deg] * 5), convention=LAST, angle_deg=70.0)
    with pytest.raises(ValueError, match="must stand 70 deg apart to 0.5 deg"):
        check_design(*heads_apart([70.0 + 1.04 * off_deg] * 5), convention=LAST, angle_deg=70.0)


def test_the_scatter_of_the_design_angle_is_the_half_width_of_its_middle_half():
    """Uniform angles: half of what reaches to +-1 lies within +-1/2."""
    uniform = np.linspace(-1.0, 1.0, 401) / 3600.0
    check_design(*heads_apart(70.0 + 198.0 * uniform), convention=LAST, angle_deg=70.0)
    with pytest.raises(ValueError, match="with a scatter of 101 arcsec"):
        check_design(*heads_apart(70.0 + 202.0 * uniform), convention=LAST, angle_deg=70.0)


def test_gaps_are_bridged_up_to_ten_seconds_for_drifts_and_one_for_attitudes():
    for gap_s, bridged in ((9.9, True), (10.1, False)):
        found = interpolate_drift([0.0, gap_s], np.zeros((2, 3)), [gap_s / 2])
        assert np.isfinite(found).all() == bridged
    still = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    for gap_s, bridged in ((0.99, True), (1.01, False)):
        found = interpolate_attitude([0.0, gap_s], still, [gap_s / 2], convention=LAST)
        assert np.isfinite(found).all() == bridged


def wobbling(time_s, late_s=0.0):
    """Attitudes about x at a rate that swings by 1 mrad/s in 20 s."""
    when = time_s + late_s
    turn = 1e-3 * 20.0 / (2 * np.pi) * np.sin(2 * np.pi * when / 20.0)
    return Rotation.from_rotvec(turn[:, None] * np.array([1.0, 0.0, 0.0]))


def test_ten_rows_tell_a_time_offset_and_nine_do_not():
    time_s = np.arange(10) * 2.0
    noise = 1e-9 * np.random.default_rng(1).standard_normal((10, 3))
    first = wobbling(time_s).as_quat()
    second = (wobbling(time_s, 0.01) * Rotation.from_rotvec(noise)).as_quat()
    assert np.isfinite(time_tag_offset(time_s, first, second, convention=LAST).seconds)
    with pytest.raises(ValueError, match="at least ten rows must hold both attitudes, got 9"):
        time_tag_offset(time_s[:9], first[:9], second[:9], convention=LAST)


def test_the_sigma_of_a_time_offset_is_its_scatter():
    time_s, rng = np.arange(0.0, 100.0, 0.25), np.random.default_rng(2)
    found = []
    for _ in range(200):
        noise = Rotation.from_rotvec(1e-6 * rng.standard_normal((time_s.size, 3)))
        second = wobbling(time_s) * noise
        found.append(
            time_tag_offset(time_s, wobbling(time_s).as_quat(), second.as_quat(), convention=LAST)
        )
    seconds = np.array([each.seconds for each in found])
    assert np.mean([each.sigma_s for each in found]) == pytest.approx(seconds.std(), rel=0.2)


def test_shifts_without_their_focal_change_are_solved_with_it_from_four_rows():
    points = np.array([[30.0, 30.0, 600.0], [-30.0, -30.0, 600.0], [30.0, -30.0, 600.0]])
    turned = (-lb.design_matrix(points) @ arcsec_to_rad([1.0, -2.0, 3.0])).reshape(3, 2)
    full = drift_from_spots(points, turned + 2e-5 * points[:, :2], focal=True)
    np.testing.assert_allclose(full.delta_arcsec, [1.0, -2.0, 3.0], atol=1e-9)
    assert full.focal == pytest.approx(2e-5, rel=1e-9)
    sigma = np.array([[1.0], [2.0], [4.0]]) * 1e-4
    rng = np.random.default_rng(3)
    many = turned + sigma * rng.standard_normal((20_000, 3, 2))
    fit = drift_from_spots(points, many, focal=True, sigma=sigma)
    found = np.column_stack([fit.delta, fit.focal])
    np.testing.assert_allclose(np.cov(found.T), fit.cov[0], atol=0.03 * np.abs(fit.cov[0]).max())


# Sensitivities

TIME_S = 1e4 + STEP_S * np.arange(40.0)
WARMING = 18.0 + np.arange(40.0) / 8.0


def test_a_fitted_lag_lies_between_a_ten_thousandth_of_a_step_and_the_whole_record():
    noise = 1e-6 * np.random.default_rng(1).standard_normal((40, 12))
    for origin_s in (0.0, 1e4):
        time_s = TIME_S - 1e4 + origin_s
        lag_s = lb.fit_sensitivity(WARMING, noise, time_s=time_s, lag_s="fit").lag_s
        span_s = 39 * STEP_S
        assert lag_s.min() == pytest.approx(1e-4 * STEP_S, rel=1e-3)
        assert lag_s.max() == pytest.approx(span_s, rel=1e-3)


def test_a_confidence_is_at_most_one():
    assert np.isfinite(lb.fit_sensitivity(WARMING, 1e-6 * WARMING, confidence=0.999).k)
    with pytest.raises(ValueError, match="confidence must be a finite number from 0 to 1, got 1.2"):
        lb.fit_sensitivity(WARMING, 1e-6 * WARMING, confidence=1.2)


def test_a_lag_shorter_than_a_second_needs_times_to_predict_with():
    fit = lb.fit_sensitivity(WARMING, 1e-6 * WARMING, time_s=TIME_S, lag_s=0.5)
    with pytest.raises(ValueError, match="time_s must be given with a lag"):
        fit.predict(WARMING)
    straight = lb.fit_sensitivity(WARMING, 1e-6 * WARMING)
    np.testing.assert_allclose(straight.predict(WARMING), 1e-6 * WARMING, rtol=1e-9)


def test_as_many_samples_as_unknowns_are_one_too_few():
    angle = 1e-6 * WARMING
    for options, unknowns in (({}, 2), ({"quadratic": True}, 3)):
        assert lb.fit_sensitivity(WARMING[: unknowns + 1], angle[: unknowns + 1], **options).k > 0
        with pytest.raises(ValueError, match=f"angles must hold more than {unknowns} samples"):
            lb.fit_sensitivity(WARMING[:unknowns], angle[:unknowns], **options)
    with pytest.raises(ValueError, match="angles must hold more than 3 samples"):
        lb.fit_sensitivity(WARMING[:3], angle[:3], time_s=TIME_S[:3], lag_s="fit")


# Performance


@pytest.mark.parametrize("step_s", [1.0, 0.125])
def test_white_noise_has_as_many_degrees_of_freedom_as_samples(step_s):
    n, rng, found = 4096, np.random.default_rng(5), []
    for _ in range(60):
        noise = rng.standard_normal((n, 1))
        frequency, density, segments = spectrum(noise, [slice(0, n)], step_s, 4)
        step_Hz = frequency[1] - frequency[0]
        found.append(freedom(noise[:, 0] ** 2, density[:, 0], step_Hz, n * step_s, segments)[0])
    assert segments == 15  # eight that do not overlap, and seven between them
    assert np.mean(found) == pytest.approx(n, rel=0.01)


# Attitudes


def test_the_boresight_of_a_pair_is_z_unless_said():
    assert PairTelemetry.boresight == (0.0, 0.0, 1.0)


def test_a_rate_is_the_mean_over_the_whole_width():
    """A wobble of 20 s has no mean rate over 20 s, and keeps 2 / pi of it over 10 s."""
    time_s = np.arange(0.0, 200.0, 0.25)
    turn = 1e-4 * np.sin(2 * np.pi * time_s / 20.0)
    turned = Rotation.from_rotvec(turn[:, None] * np.array([1.0, 0.0, 0.0]))
    inner = slice(100, -100)
    rate = 1e-4 * 2 * np.pi / 20.0
    assert np.abs(_rate(time_s, turned, 20.0)[0][inner]).max() < 1e-6 * rate
    found = np.abs(_rate(time_s, turned, 10.0)[0][inner, 0]).max()
    assert found == pytest.approx(rate * 2 / np.pi, rel=1e-3)


def test_a_spot_is_bad_beyond_three_scales():
    rng = np.random.default_rng(6)
    shifts = 1e-4 * rng.standard_normal((200, 4, 2))
    shifts[::3, 1] += rng.uniform(0.0, 1e-3, (67, 1))
    track = lb.track_attitude(SQUARE, shifts, time_s=np.arange(200.0), window=5)
    size = np.sqrt(np.mean(track.residuals**2, axis=-1))
    np.testing.assert_array_equal(track.bad, size > 3.0 * track.scale[:, None])
    between = (size > 2.0 * track.scale[:, None]) & (size < 4.5 * track.scale[:, None])
    assert 0 < track.bad[between].sum() < between.sum()


SQUARE = np.array([[5.0, 5.0, 260.0], [-5.0, 5.0, 260.0], [-5.0, -5.0, 260.0], [5.0, -5.0, 260.0]])


def test_errors_that_are_the_same_in_every_frame_are_needed_for_every_spot():
    shifts = np.zeros((3, 4, 2))
    shifts[:, 3] = np.nan
    sigma = np.full((4, 2), 1e-4)
    assert lb.solve_attitude(SQUARE, shifts, sigma=sigma).ok.all()
    sigma[3] = np.nan
    with pytest.raises(ValueError, match="sigma must be positive wherever a shift is given"):
        lb.solve_attitude(SQUARE, shifts, sigma=sigma)
    each = np.broadcast_to(sigma, shifts.shape)
    assert lb.solve_attitude(SQUARE, shifts, sigma=each).ok.all()


@pytest.mark.parametrize("spots", [2, 3])
def test_two_spots_share_no_blame_and_three_do(spots):
    """With two spots per solve both weights are equal; from three on the bad one can be told."""
    shifts = 1e-5 * np.random.default_rng(4).standard_normal((1, spots, 2))
    shifts[0, 0] += 0.05
    options = {"scale": 1e-5, "loss": lb.Huber()}
    if spots == 2:
        with pytest.warns(UserWarning, match="with two spots per solve no outlier"):
            fit = lb.solve_attitude(SQUARE[:2], shifts, **options)
        assert fit.weights[0, 0, 0] == pytest.approx(fit.weights[0, 1, 0])
    else:
        fit = lb.solve_attitude(SQUARE[:3], shifts, **options)
        assert fit.weights[0, 0, 0] < 0.9 * fit.weights[0, 1:].min()


@pytest.mark.parametrize("window", [3, 4, 5, 20])
def test_a_steady_turn_is_followed_to_both_ends_of_the_record(window):
    time_s = np.cumsum(np.random.default_rng(7).uniform(0.5, 2.0, 20))
    rate = np.array([1e-5, -2e-5, 3e-5])
    angles = [4e-5, 0.0, -1e-5] + time_s[:, None] * rate
    shifts = (angles @ lb.design_matrix(SQUARE).T).reshape(20, 4, 2)
    shifts[6, 1] = np.nan
    track = lb.track_attitude(SQUARE, shifts, time_s=time_s, window=window, solver="ls")
    np.testing.assert_allclose(track.angles, angles, atol=1e-12)
    np.testing.assert_allclose(track.rates, np.broadcast_to(rate, (20, 3)), atol=1e-12)
    assert np.isnan(track.residuals[6, 1]).all() and np.isnan(track.residuals).sum() == 2
    assert (track.weights[6, 1] == 0).all() and track.converged.all()


def test_a_window_holds_at_least_two_spots_in_two_frames():
    shifts = np.zeros((3, 3, 2))
    for missing, solved in (
        ([(0, 0), (1, 0), (2, 0), (2, 1)], True),
        ([(0, 0), (1, 0), (1, 1), (2, 0), (2, 1)], False),
    ):
        given = shifts.copy()
        for frame, spot in missing:
            given[frame, spot] = np.nan
        track = lb.track_attitude(SQUARE[:3], given, window=3, solver="ls", sigma=1e-4)
        assert np.isfinite(track.angles).all() == solved == track.converged.all()
    assert lb.track_attitude(SQUARE, np.zeros((3, 4, 2)), window=3, solver="ls").converged.all()
    for window, words in ((2, "window must be a whole number"), (4, "not be longer than the 3")):
        with pytest.raises(ValueError, match=words):
            lb.track_attitude(SQUARE, np.zeros((3, 4, 2)), window=window)


def test_the_condition_of_a_layout_is_that_of_its_rows_and_two_spots_tell_a_focal_change():
    rows = lb.design_matrix(SQUARE) / 260.0
    fit = drift_from_spots(SQUARE, np.zeros((4, 2)))
    assert fit.condition == pytest.approx(np.linalg.cond(rows))
    both = np.column_stack([-rows, SQUARE[:, :2].ravel() / 260.0])
    fit = drift_from_spots(SQUARE, np.zeros((4, 2)), focal=True)
    assert fit.condition == pytest.approx(np.linalg.cond(both))
    two = np.full((4, 2), np.nan)
    two[:2] = 0.0
    assert np.isfinite(drift_from_spots(SQUARE, two, focal=True).delta).all()
    two[1] = np.nan
    assert np.isnan(drift_from_spots(SQUARE, two, focal=True).delta).all()


# The exact solve

WIDE = np.array(
    [[200.0, 0.0, 260.0], [-200.0, 0.0, 260.0], [0.0, 200.0, 260.0], [0.0, -200.0, 260.0]]
)


def displaced(angles):
    return (project(WIDE, angles) - WIDE)[..., :2]


@pytest.fixture(scope="module")
def unlikely():
    """Shifts that no rotation makes, some of which drive spots out of sight."""
    rng = np.random.default_rng(0)
    sizes = 10 ** rng.uniform(1, 5, (40, 1, 1))
    return rng.standard_normal((40, 4, 2)) * sizes


def test_an_exact_solve_of_nonsense_gives_numbers_and_says_where_it_did_not_settle(unlikely):
    shifts = np.concatenate([unlikely, displaced(np.array([[0.1, -0.2, 0.3]]))])
    with pytest.warns(RuntimeWarning, match="attitudes did not converge"):
        fit = lb.solve_attitude(WIDE, shifts, exact=True, solver="ls")
    assert np.isfinite(fit.angles).all()
    assert np.isfinite(project(WIDE, fit.angles)).all()
    np.testing.assert_allclose(fit.angles[-1], [0.1, -0.2, 0.3], atol=1e-10)
    assert fit.converged[-1] and 0 < fit.converged[:-1].sum() < 40
    for angles, shift in zip(fit.angles[fit.converged], shifts[fit.converged], strict=True):
        rows = lb.design_matrix(project(WIDE, angles))
        step = lb.lstsq(rows, (WIDE[:, :2] + shift - project(WIDE, angles)[:, :2]).ravel()).x
        assert np.abs(rows @ step).max() < 1e-8 * np.abs(rows @ angles).max()


def test_a_round_of_the_exact_solve_turns_by_at_most_half_a_radian(monkeypatch, unlikely):
    turned = []

    def watched(points, angles):
        turned.append(np.array(angles))
        return project(points, angles)

    monkeypatch.setattr(solve, "project", watched)
    shifts = np.concatenate([displaced(np.array([[0.1, 0.0, 0.0]])), unlikely])
    with pytest.warns(RuntimeWarning, match="attitudes did not converge"):
        lb.solve_attitude(WIDE, shifts, exact=True, solver="ls")
    length = np.linalg.norm(turned[1], axis=1)
    assert length[0] < 0.2
    assert length.max() == pytest.approx(0.5, abs=1e-9)
    assert np.count_nonzero(length > 0.499) > 20


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("exact", [False, True])
def test_frames_with_errors_of_their_own_are_solved_as_if_alone(frames, exact):
    rng = np.random.default_rng(3)
    shifts = displaced(1e-3 * rng.standard_normal((frames, 3))) + rng.standard_normal(
        (frames, 4, 2)
    )
    sigma = rng.uniform(0.5, 2.0, shifts.shape)
    together = lb.solve_attitude(WIDE, shifts, sigma=sigma, solver="ls", exact=exact)
    for k in range(frames):
        alone = lb.solve_attitude(WIDE, shifts[k], sigma=sigma[k], solver="ls", exact=exact)
        np.testing.assert_allclose(together.angles[k], alone.angles, rtol=1e-7)
        np.testing.assert_allclose(together.cov[k], alone.cov, rtol=1e-6)


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("lost", [0, 3])
def test_frames_with_errors_of_their_own_may_lack_a_spot(frames, lost):
    rng = np.random.default_rng(8)
    shifts = displaced(1e-3 * rng.standard_normal((frames, 3))) + rng.standard_normal(
        (frames, 4, 2)
    )
    sigma = rng.uniform(0.5, 2.0, shifts.shape)
    shifts[-1, lost] = np.nan
    kept = np.delete(np.arange(4), lost)
    together = lb.solve_attitude(WIDE, shifts, sigma=sigma, solver="ls")
    alone = lb.solve_attitude(WIDE[kept], shifts[-1, kept], sigma=sigma[-1, kept], solver="ls")
    np.testing.assert_allclose(together.angles[-1], alone.angles, rtol=1e-7)
    np.testing.assert_allclose(together.cov[-1], alone.cov, rtol=1e-7)
    np.testing.assert_allclose(together.residuals[-1, kept], alone.residuals, atol=1e-9)


@pytest.mark.parametrize("lost", [(0, 0), (0, 1)])
def test_a_spot_with_one_coordinate_is_missing(lost):
    rng = np.random.default_rng(4)
    shifts = displaced(1e-3 * rng.standard_normal((12, 3))) + rng.standard_normal((12, 4, 2))
    sigma = rng.uniform(0.5, 2.0, shifts.shape)
    part, whole = shifts.copy(), shifts.copy()
    part[5, 2, lost[1]] = whole[5, 2] = sigma[5, 2] = np.nan
    one, both = (lb.solve_attitude(WIDE, each, sigma=sigma, solver="ls") for each in (part, whole))
    np.testing.assert_array_equal(one.angles, both.angles)
    assert one.redundancy.tolist() == [5] * 5 + [3] + [5] * 6
    one, both = (lb.track_attitude(WIDE, each, window=3, solver="ls") for each in (part, whole))
    np.testing.assert_array_equal(one.angles, both.angles)
    assert np.isnan(one.residuals[5, 2]).all() and not one.weights[5, 2].any()


def test_reweighting_over_windows_has_five_hundred_steps_by_name(monkeypatch):
    asked, fit = set(), lb.IRLS.fit
    monkeypatch.setattr(
        lb.IRLS, "fit", lambda self, *a, **k: asked.add(self.max_iter) or fit(self, *a, **k)
    )
    shifts = displaced(np.zeros((5, 3))) + np.random.default_rng(5).standard_normal((5, 4, 2))
    lb.track_attitude(WIDE, shifts, window=3, method="irls")
    lb.track_attitude(WIDE, shifts, window=3, solver=lb.IRLS())
    assert asked == {500, 100}


def test_a_design_angle_is_at_most_half_a_turn():
    heads = heads_apart(np.full(5, 180.0))
    check_design(*heads, convention=LAST, angle_deg=180.0)
    with pytest.raises(ValueError, match="angle_deg must be a finite number from 0 to 180"):
        check_design(*heads, convention=LAST, angle_deg=180.5)


def test_windows_hold_nine_frames_and_rates_two_seconds_unless_said():
    shifts = np.random.default_rng(6).standard_normal((20, 4, 2))
    plain, said = (lb.track_attitude(WIDE, shifts, solver="ls", **k) for k in ({}, {"window": 9}))
    np.testing.assert_array_equal(plain.angles, said.angles)
    t = 0.5 * np.arange(60.0)
    turn = Rotation.from_rotvec(np.outer(np.cumsum(np.sin(t / 4)), [0.0, 1e-3, 0.0])).as_quat()
    wobble = Rotation.from_rotvec(1e-6 * np.random.default_rng(7).standard_normal((60, 3)))
    other = (Rotation.from_quat(turn) * wobble).as_quat()
    plain, said = (
        time_tag_offset(t, turn, other, convention=LAST, **k) for k in ({}, {"smooth_s": 2.0})
    )
    assert plain == said


# Limits of what is given

_T = np.arange(60.0)
_ROOM = np.sin(_T / 5.0)
_POINTS = np.array([[5.0, 75.0, 475.0], [-5.0, 75.0, 475.0], [5.0, -75.0, 475.0]])
_STILL = np.tile([0.0, 0.0, 0.0, 1.0], (60, 1))
_CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(1080, 1920))
PROBABILITIES = {
    "confidence": [
        lambda v: lb.pointing_metrics(_ROOM, _T, 5.0, confidence=v),
        lambda v: lb.error_percentile(_ROOM, 0.5, confidence=v),
        lambda v: lb.identify(lb.terms.Linear("room"), _ROOM, {"room": _ROOM}, _T, confidence=v),
    ],
    "probability": [
        lambda v: lb.error_percentile(_ROOM, v),
        lambda v: lb.half_cone((1.0, 2.0), v),
        lambda v: lb.PointingRequirement("R", "APE", 1.0, probability=v),
    ],
    "least_gain": [
        lambda v: lb.choose(
            {"room": lb.terms.Linear("room")}, _ROOM, {"room": _ROOM}, _T, least_gain=v
        )
    ],
}


@pytest.mark.parametrize("value", [-0.01, 1.01])
@pytest.mark.parametrize(
    ("name", "call"), [(name, call) for name, calls in PROBABILITIES.items() for call in calls]
)
def test_a_share_is_from_0_to_1(name, call, value):
    with pytest.raises(ValueError, match=f"{name} must be a finite number from 0 to 1, got"):
        call(value)


@pytest.mark.parametrize(
    ("call", "value", "message"),
    [
        (lambda v: lb.pointing_metrics(_ROOM, _T, v), -1.0, "window_s .* of at least 0,"),
        (lambda v: lb.mtf(smear=v), -1.0, "smear .* of at least 0,"),
        (lambda v: lb.noise_floor(_ROOM, rate_hz=v), -1.0, "rate_hz .* of at least 0,"),
        (
            lambda v: lb.PointingRequirement("R", "APE", 1.0, factor=v),
            -1.0,
            "factor .* of at least 0,",
        ),
        (
            lambda v: lb.design_layout(3, _CAMERA, 0.1, margin_px=v),
            -1.0,
            "margin_px .* of at least 0,",
        ),
        (
            lambda v: lb.design_layout(3, _CAMERA, 0.1, apart_px=v),
            -1.0,
            "apart_px .* of at least 0,",
        ),
        (
            lambda v: interpolate_attitude(_T, _STILL, _T, convention=LAST, max_gap_s=v),
            -1.0,
            "max_gap_s .* of at least 0,",
        ),
        (
            lambda v: check_design(_STILL, _STILL, convention=LAST, angle_deg=v),
            181.0,
            "angle_deg .* from 0 to 180,",
        ),
        (lambda v: lb.design_layout(v, _CAMERA, 0.1), 1, "n .* of at least 2,"),
        (lambda v: lb.design_layout(3, _CAMERA, 0.1, survives=v), 3, "survives .* from 0 to 2,"),
        (lambda v: lb.design_layout(3, _CAMERA, 0.1, stack=v), 0, "stack .* of at least 1,"),
        (lambda v: lb.attitude_covariance(_POINTS, 1.0, stack=v), 0, "stack .* of at least 1,"),
        (
            lambda v: lb.solve_attitude(_POINTS, np.zeros((4, 3, 2)), stack=v),
            0,
            "stack .* of at least 1,",
        ),
        (
            lambda v: lb.choose(
                {"room": lb.terms.Linear("room")}, _ROOM, {"room": _ROOM}, _T, at_most=v
            ),
            0,
            "at_most .* of at least 1,",
        ),
    ],
)
def test_a_number_has_the_limits_that_it_is_told(call, value, message):
    with pytest.raises(ValueError, match=message):
        call(value)
