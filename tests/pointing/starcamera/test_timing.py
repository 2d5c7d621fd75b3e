"""Slerp, low-pass, clocks, and aberration against astropy's own transformation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.pointing.starcamera import (
    QuaternionConvention,
    earth_velocity_km_s,
    interpolate_attitude,
    interpolate_drift,
    remove_aberration,
    smooth_drift,
    time_tag_offset,
)
from losbench.pointing.starcamera.timing import _rate
from losbench.series import split_tracks
from losbench.units import rad_to_arcsec

LAST = QuaternionConvention(scalar="last", direction="camera_to_inertial")
FIRST = QuaternionConvention(scalar="first", direction="inertial_to_camera")


def turning(time_s):
    """A pair's first camera: pitching with the orbit, wobbling by 20 arcsec in 40 s about y and
    z.
    """
    wobble = 1e-4 * np.sin(2 * np.pi * time_s / 40.0)
    return Rotation.from_rotvec(
        2 * np.pi / 5677 * time_s[:, None] * np.array([0.0, 1.0, 0.0])
    ) * Rotation.from_rotvec(wobble[:, None] * np.array([0.3, 1.0, 0.6]))


def test_drift_between_samples_follows_the_shortest_turn():
    time = np.array([0.0, 1.0, 2.0, 30.0])
    drift = 1e-6 * np.array([[0.0, 1, 0], [1, 1, 0], [2, 1, 0], [3, 1, 0]])
    found = interpolate_drift(time, drift, [0.5, 2.0, 10.0, 30.0, 31.0])
    np.testing.assert_allclose(found[:2], 1e-6 * np.array([[0.5, 1, 0], [2, 1, 0]]), atol=1e-15)
    assert np.isnan(found).all(axis=1).tolist() == [False, False, True, False, True]
    drift[1] = np.nan
    np.testing.assert_allclose(
        interpolate_drift(time, drift, [1.0]), [[1e-6, 1e-6, 0.0]], atol=1e-15
    )


@pytest.mark.parametrize("convention", [LAST, FIRST], ids=str)
def test_attitudes_between_samples_do_not_mind_flipped_signs(convention):
    time, fine = np.arange(0, 100, 0.125), np.arange(0.05, 99, 0.1)
    scalar_first = convention.scalar == "first"
    q, truth = (
        (r if convention.to_inertial else r.inv()).as_quat(scalar_first=scalar_first)
        for r in (turning(time), turning(fine))
    )
    q[::3] *= -1
    found = interpolate_attitude(time, q, fine, convention=convention)
    miss = (
        Rotation.from_quat(found, scalar_first=scalar_first)
        * Rotation.from_quat(truth, scalar_first=scalar_first).inv()
    )
    assert rad_to_arcsec(miss.magnitude()).max() < 0.01
    q[400] = np.nan
    assert np.isfinite(interpolate_attitude(time, q, fine, convention=convention)).all()
    assert np.isnan(interpolate_attitude(time, q, fine, convention=convention, max_gap_s=0.2)).any()


def test_smoothing_averages_noise_and_keeps_a_trend():
    rng = np.random.default_rng(1)
    time = np.arange(2400) * 0.125
    drift = 1e-9 * time[:, None] + 1e-6 * rng.standard_normal((2400, 3))
    drift[100] = np.nan
    smooth = smooth_drift(time, drift, window_s=10.0)
    assert np.isnan(smooth[100]).all()
    residual = (smooth - 1e-9 * time[:, None])[200:-200]
    assert residual.std() == pytest.approx(1e-6 / 9, rel=0.15)
    np.testing.assert_allclose(smooth_drift(time, drift, window_s=0.1), drift, atol=1e-18)


def test_smoothing_takes_in_whatever_times_there_are():
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0, 50, 300))
    drift = rng.standard_normal((300, 3))
    naive = [drift[np.abs(time - t) <= 2.5].mean(axis=0) for t in time]
    np.testing.assert_allclose(smooth_drift(time, drift, window_s=5.0), naive, atol=1e-12)


@pytest.mark.parametrize("late_s", [0.05, -0.02])
def test_an_offset_between_the_clocks_is_found_and_removed(late_s):
    rng = np.random.default_rng(3)
    time = np.arange(2400) * 0.125
    tilt = Rotation.from_euler("x", [[35], [-35]], degrees=True)
    noise = 0.16 / 206265
    first = turning(time) * tilt[0] * Rotation.from_rotvec(noise * rng.standard_normal((2400, 3)))
    second = (
        turning(time + late_s)
        * tilt[1]
        * Rotation.from_rotvec(noise * rng.standard_normal((2400, 3)))
    )
    found = time_tag_offset(time, first.as_quat(), second.as_quat(), convention=LAST)
    assert found.sigma_s < 0.003
    assert abs(found.seconds - late_s) < 4 * found.sigma_s
    moved = interpolate_attitude(
        time + found.seconds, second.as_quat(), time[10:-10], convention=LAST
    )
    again = time_tag_offset(time[10:-10], first.as_quat()[10:-10], moved, convention=LAST)
    assert abs(again.seconds) < 4 * again.sigma_s


def test_tracks_begin_after_long_gaps():
    time = np.concatenate([np.arange(5.0), 86400 + np.arange(3.0)])
    assert split_tracks(time).tolist() == [0] * 5 + [1] * 3


def test_aberration_agrees_with_the_change_from_barycentric_to_geocentric_directions():
    coordinates = pytest.importorskip("astropy.coordinates")
    from astropy.time import Time

    when = Time("2022-03-25T12:00:00")
    velocity = earth_velocity_km_s("2022-03-25T12:00:00")
    stars = Rotation.random(40, rng=np.random.default_rng(5))
    natural = stars.apply([0, 0, 1])
    sky = coordinates.SkyCoord(
        *natural.T, representation_type="cartesian", frame="icrs"
    ).represent_as("unitspherical")
    sky = coordinates.SkyCoord(sky, frame="icrs")
    proper = sky.transform_to(coordinates.GCRS(obstime=when)).cartesian.xyz.value.T
    moved = Rotation.from_quat(remove_aberration(stars.as_quat(), velocity, convention=LAST)).apply(
        [0, 0, 1]
    )
    away_from_sun = (
        natural @ coordinates.get_sun(when).cartesian.xyz.to_value("AU") < 0.5
    )  # light bends near the Sun
    gap = rad_to_arcsec(np.linalg.norm(moved - proper, axis=1))
    assert gap[away_from_sun].max() < 0.02
    assert rad_to_arcsec(np.linalg.norm(moved - natural, axis=1)).max() == pytest.approx(
        20.5, abs=0.5
    )


@pytest.mark.parametrize("beta", [1e-4, 0.3])
def test_aberration_at_right_angles_is_an_arc_sine(beta):
    """Of the speed in that of light, towards the velocity; and none at rest."""
    pytest.importorskip("astropy")
    ahead = np.array([[0.0, beta * 299792.458, 0.0], [0.0, 0.0, 0.0]])
    still = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    moved, rest = remove_aberration(still, ahead, convention=LAST)
    angle = np.arcsin(beta)
    found = Rotation.from_quat(moved).apply([0, 0, 1])
    np.testing.assert_allclose(found, [0.0, np.sin(angle), np.cos(angle)], atol=1e-11)
    np.testing.assert_array_equal(rest, still[1])


def test_aberration_forth_and_back_and_in_every_convention():
    pytest.importorskip("astropy")
    stars = Rotation.random(10, rng=np.random.default_rng(6))
    there = remove_aberration(stars.as_quat(), [30.0, 0.0, 7.0], convention=LAST)
    back = remove_aberration(there, [-30.0, 0.0, -7.0], convention=LAST)
    miss = Rotation.from_quat(back) * stars.inv()
    assert rad_to_arcsec(miss.magnitude()).max() < 0.005
    other = remove_aberration(
        stars.inv().as_quat(scalar_first=True), [30.0, 0.0, 7.0], convention=FIRST
    )
    same = Rotation.from_quat(other, scalar_first=True) * Rotation.from_quat(there)
    assert same.magnitude().max() < 1e-12


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda t, q: smooth_drift(t[::-1], q, window_s=1.0),
            "sample 1 at 48 s is before the one before it",
        ),
        (
            lambda t, q: smooth_drift(np.r_[t[:5], t[4], t[5:-1]], q, window_s=1.0),
            "sample 5 at 4 s equals the one before",
        ),
        (
            lambda t, q: smooth_drift(t, q[:9], window_s=1.0),
            r"drift must have shape \(50, 4\) to match 50 times",
        ),
        (lambda t, q: smooth_drift(t, q, window_s=-1.0), "window_s must be positive, got -1"),
        (
            lambda t, q: interpolate_attitude(t, q, t + 1000.0, convention=LAST),
            "attitudes must overlap the wanted times: they run from 0 to 49 s, wanted are 1000 to "
            "1049 s",
        ),
        (
            lambda t, q: interpolate_drift(t[:2], [[0, 0, 0], [np.nan] * 3], [0.5]),
            "drift must be known at two times or more, got 1",
        ),
        (
            lambda t, q: time_tag_offset(t, q, q, convention=LAST),
            "the rate must change by more than its noise for a time offset to be seen",
        ),
        (
            lambda t, q: time_tag_offset(t[:5], q[:5], q[:5], convention=LAST),
            "at least ten rows must hold both attitudes",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    time = np.arange(50.0)
    with pytest.raises(ValueError, match=message):
        call(time, np.tile([0.0, 0.0, 0.0, 1.0], (50, 1)))


def test_the_package_s_own_names():
    assert lb.QuaternionConvention is QuaternionConvention


@pytest.mark.parametrize("smooth_s", [0.1, 1.0, 3.1])
def test_a_rate_is_that_of_a_window_about_each_time_or_of_the_nearest_step(smooth_s):
    t = np.cumsum([0.0, 1.0, 0.7, 1.2, 0.9, 1.0, 2.0, 1.0])
    turn = np.cumsum([0.0, 3.0, -1.0, 4.0, 1.0, -5.0, 9.0, 2.0]) * 1e-3
    attitude = Rotation.from_rotvec(np.outer(turn, [0.0, 1.0, 0.0]))
    expected, widths = [], []
    for when in t:
        inside = np.flatnonzero((t >= when - smooth_s / 2) & (t < when + smooth_s / 2))
        first = min(inside[0], 6)
        last = min(max(inside[-1] + 1, first + 1), 7)
        expected.append((turn[last] - turn[first]) / (t[last] - t[first]))
        widths.append(turn[last] - turn[first])
    rate, span = _rate(t, attitude, smooth_s)
    np.testing.assert_allclose(rate[:, 1], expected, rtol=1e-9)
    np.testing.assert_allclose(rate[:, 1] * span, widths, rtol=1e-9)


def noisy_heads(swing, late_s, seed, *, noise=(1e-6, 1e-6), drift=0.0, n=400):
    """Heads a second apart in their samples, about one axis: a rate that swings in 40 s, each with
    its white noise, the second read later.
    """
    rng, time = np.random.default_rng(seed), np.arange(float(n))
    heads = []
    for late, sigma in zip((0.0, late_s), noise, strict=True):
        turn = swing * 40.0 / (2 * np.pi) * np.sin(2 * np.pi * (time + late) / 40.0)
        slow = np.outer(drift * time / n if late else 0.0 * time, np.ones(3))
        errors = Rotation.from_rotvec(sigma * rng.standard_normal((n, 3)))
        heads.append(
            (Rotation.from_rotvec(np.outer(turn, [1.0, 0.0, 0.0]) + slow) * errors).as_quat()
        )
    return time, *heads


@pytest.mark.parametrize("late_s", [0.0, 3.0])
def test_the_noise_of_a_steady_pair_tells_no_offset(late_s):
    for seed in range(20):
        with pytest.raises(ValueError, match="the rate must change by more than its noise"):
            time_tag_offset(*noisy_heads(1e-7, late_s, seed), convention=LAST)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (40, 1))
    with pytest.raises(ValueError, match="the rate must change"):
        time_tag_offset(np.arange(40.0), still, still, convention=LAST)


@pytest.mark.parametrize(("ratio", "told"), [(0.7, False), (1.4, True)])
def test_a_rate_tells_from_twice_its_noise_on(ratio, told):
    """Noise in the second head alone: a mean square of 2 sigma^2 / (2 s)^2 for each axis, of which
    one swings; the power is the sum of both.
    """
    for seed in range(10):
        swing = np.sqrt(2.0 * ratio * 3.0 * 2.0 * 1e-12 / 4.0)
        heads = noisy_heads(swing, 0.0, seed, noise=(0.0, 1e-6))
        if told:
            assert time_tag_offset(*heads, convention=LAST).sigma_s < 1.0
        else:
            with pytest.raises(ValueError, match="the rate must change"):
                time_tag_offset(*heads, convention=LAST)


@pytest.mark.parametrize("noise", [(1e-6, 1e-6), (0.0, 1.4e-6), (1.4e-6, 0.0)])
@pytest.mark.parametrize(("swing", "drift"), [(4e-6, 0.0), (2e-5, 0.0), (1e-5, 1e-5)])
def test_an_offset_that_noise_draws_to_zero_keeps_the_truth_within_its_error(noise, swing, drift):
    """0.7 s, of which noise may take off a tenth; also beside a drift of ten times the noise."""
    misses = []
    for seed in range(40):
        heads = noisy_heads(swing, 0.7, seed, noise=noise, drift=drift)
        found = time_tag_offset(*heads, convention=LAST)
        misses.append((found.seconds - 0.7) / found.sigma_s)
    assert np.mean(np.abs(misses) < 2.0) > 0.85
