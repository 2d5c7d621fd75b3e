"""Vibrations, gyro errors and paths: integrals, invariants, and what they refuse."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.optics.motion.vibration import RateSeries

SHAKES = lb.random_vibration(5, 1, max_rate_rad_s=0.05)


def test_angles_are_the_integral_of_rates():
    time = np.linspace(0.0, 0.05, 2001)
    summed = cumulative_trapezoid(SHAKES.rate(time), time, axis=-2, initial=0)
    np.testing.assert_allclose(SHAKES.angle(time), summed, atol=1e-9)


def test_a_measured_series_is_integrated_exactly_between_its_samples():
    time = np.linspace(-0.01, 0.05, 13)
    series = RateSeries(time, SHAKES.rate(time))
    fine = np.linspace(-0.01, 0.05, 12001)
    summed = cumulative_trapezoid(series.rate(fine), fine, axis=-2, initial=0)
    at_zero = summed[:, np.searchsorted(fine, 0.0)][:, None]
    np.testing.assert_allclose(series.angle(fine), summed - at_zero, atol=1e-12)


def test_one_axis_moves_along_one_line():
    rates = lb.random_vibration(4, 3, max_rate_rad_s=0.05, axes="one").rate(np.linspace(0, 1, 50))
    assert (np.linalg.svd(rates, compute_uv=False)[:, 1] < 1e-12).all()


def test_a_path_is_the_product_of_its_increments_in_order(camera):
    increments = np.random.default_rng(2).normal(0, 1e-2, (3, 5, 3))
    path = lb.gyro_path(increments, interval_s=0.005, exposure_s=0.025)
    expected = np.stack([(Rotation.from_rotvec(-one[::-1])).as_matrix() for one in increments])
    for turns, end in zip(expected, path.epochs[:, 2], strict=True):
        np.testing.assert_allclose(end, np.linalg.multi_dot(turns), atol=1e-14)
    xy = np.array([[100.0, 300.0], [20.0, 40.0]])
    there = path.carry(xy, camera, start="start", end="end")
    np.testing.assert_allclose(
        path.carry(there, camera, start="end", end="start"), np.broadcast_to(xy, there.shape)
    )
    assert path.share.sum() == pytest.approx(1.0)


def test_epochs_lie_on_the_track_in_order(camera):
    path = lb.motion_path(lb.Vibration(constant_rad_s=[0.0, 0.05, 0.0]), 0.02)
    xy = [[255.5, 255.5]]
    x = [path.carry(xy, camera, end=epoch)[0, 0] for epoch in ("start", "middle", "end")]
    assert x[0] == pytest.approx(255.5) and x[1] == pytest.approx((x[0] + x[2]) / 2, abs=1e-3)
    track = path.tracks(xy, camera)[0, :, 0]
    assert (np.diff(track) < 0).all() and x[2] < track[-1] < x[1] < track[0] < x[0]


def test_mean_back_undoes_the_mean_of_a_track(camera):
    path = lb.motion_path(SHAKES, 0.025)
    xy = np.random.default_rng(5).uniform(0, 511, (5, 6, 2))
    mean = np.matmul(path.share, path.tracks(xy, camera))
    rays = np.matmul(camera.points_mm(mean), np.swapaxes(path.mean_back, 1, 2))
    np.testing.assert_allclose(camera.pixels(rays), xy, atol=1e-4)


def test_a_gyro_late_by_a_while_reads_a_later_motion():
    late = lb.Gyro(rate_hz=200.0, time_offset_s=0.001).increments(SHAKES, 0.025)
    edges = 0.001 + 0.005 * np.arange(6)
    np.testing.assert_allclose(late, np.diff(SHAKES.angle(edges), axis=-2), atol=1e-15)


def test_bias_scale_and_misalignment_add_up_to_first_order():
    still, turn = lb.Vibration(), lb.Vibration(constant_rad_s=[0.0, 0.0, 0.02])
    np.testing.assert_allclose(
        lb.Gyro(bias_deg_h=3600.0).increments(still, 0.025),
        np.full((5, 3), np.radians(0.005)),
        rtol=1e-12,
    )
    scaled = lb.Gyro(scale_factor_ppm=500.0).increments(turn, 0.025)
    np.testing.assert_allclose(scaled[:, 2], 1e-4 * 1.0005, rtol=1e-12)
    # A gyro whose axes are turned by a small angle about x sees a rate about z as one about y too.
    tilted = lb.Gyro(misalignment_arcsec=(20.0, 0.0, 0.0)).increments(turn, 0.025)
    frame = Rotation.from_rotvec([np.radians(20 / 3600), 0, 0])
    np.testing.assert_allclose(tilted[0], frame.inv().apply([0, 0, 1e-4]), atol=1e-12)


def test_the_random_walk_grows_with_the_root_of_time():
    gyro = lb.Gyro(angle_random_walk_deg_rt_h=0.1)
    still = lb.Vibration(constant_rad_s=np.zeros((4000, 3)))
    walked = gyro.increments(still, 0.025, 3).sum(axis=-2)
    assert walked.std() == pytest.approx(np.radians(0.1) * np.sqrt(0.025 / 3600), rel=0.03)
    np.testing.assert_array_equal(gyro.increments(still, 0.025, 3).sum(axis=-2), walked)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (
            lambda: lb.Vibration(constant_rad_s=[np.nan, 0, 0]),
            "constant_rad_s must be finite, got 1 NaN",
        ),
        (lambda: lb.Vibration(frequency_hz=0.0), "frequency_hz must be positive, got 0"),
        (lambda: lb.Vibration(amplitude_rad_s=np.zeros((2, 2))), "must broadcast to one shape"),
        (
            lambda: RateSeries([0.0, 1.0], np.zeros((3, 3))),
            r"rate_rad_s must have shape \(\.\.\., 2, 3\) to match 2 times",
        ),
        (lambda: RateSeries([0.0, 0.0], np.zeros((2, 3))), "each later than the one before"),
        (lambda: RateSeries([0.0, 1.0], np.full((2, 3), np.inf)), "rate_rad_s must be finite"),
        (
            lambda: RateSeries([0.0, 1.0], np.zeros((2, 3))).angle([2.0]),
            "rates are known from 0 to 1 s, not at 2 to 2 s",
        ),
        (
            lambda: lb.random_vibration(3, 1, max_rate_rad_s=1.0, axes="two"),
            "axes must be one of 'three', 'one'",
        ),
        (lambda: lb.Gyro(rate_hz=0), "rate_hz must be positive, got 0"),
        (
            lambda: lb.Gyro(bias_deg_h=[1.0, 2.0]),
            r"bias_deg_h must be a number or have shape \(\.\.\., 3\), got \(2,\)",
        ),
        (
            lambda: lb.Gyro(angle_random_walk_deg_rt_h=0.1).increments(SHAKES, 0.02),
            "seed must be given",
        ),
        (
            lambda: lb.gyro_path(np.zeros((4, 3)), interval_s=0.005, exposure_s=0.025),
            "increments must span the exposure from 0 to 0.025 s, got 0 to 0.02 s",
        ),
        (
            lambda: lb.gyro_path(
                np.zeros((9, 3)), interval_s=0.005, exposure_s=0.025, first_s=0.001
            ),
            "increments must span the exposure from 0 to 0.025 s, got 0.001 to 0.046 s",
        ),
        (
            lambda: lb.gyro_path(np.full((5, 3), np.nan), interval_s=0.005, exposure_s=0.025),
            "increments_rad must be finite, got 15 NaN or infinite of 15 values",
        ),
        (
            lambda: lb.gyro_path(np.zeros((5, 2)), interval_s=0.005, exposure_s=0.025),
            r"increments_rad must have shape \(\.\.\., k, 3\), got \(5, 2\)",
        ),
        (
            lambda: lb.motion_path(SHAKES, 0.02, mounting=np.diag([1.0, 1.0, -1.0])),
            "mounting must be a rotation",
        ),
        (lambda: lb.motion_path(SHAKES, 0.0), "exposure_s must be positive, got 0"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(act, message):
    with pytest.raises(ValueError, match=message):
        act()


def test_seed_and_rng_are_one_thing():
    """And so is the generator of that seed."""
    walk = lb.Gyro(angle_random_walk_deg_rt_h=0.1)
    for draw in (
        lambda **word: walk.increments(lb.Vibration(), 0.1, **word),
        lambda **word: lb.random_vibration(3, max_rate_rad_s=0.1, **word).rate([0.01]),
        lambda **word: lb.random_attitudes(3, **word),
        lambda **word: lb.Detector().expose(np.full((4, 4), 100.0), **word),
    ):
        first = draw(seed=5)
        np.testing.assert_array_equal(first, draw(rng=5))
        np.testing.assert_array_equal(first, draw(seed=np.random.default_rng(5)))
        assert not np.array_equal(first, draw(seed=6))
        with pytest.raises(ValueError, match="seed and rng are one thing, got both"):
            draw(seed=5, rng=6)
        with pytest.raises(ValueError, match="seed must be"):
            draw()
