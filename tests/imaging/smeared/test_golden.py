"""Numbers that follow from lyu2015's own model alone, to their digits; its pixel k covers [k, k +
1).
"""

import numpy as np
import pytest

import losbench as lb

HALF_TURN = np.diag([-1.0, -1.0, 1.0])  # eq. (1) turns the image by 180 degrees
COSINE = lb.Vibration(amplitude_rad_s=np.radians([0.0, 3.0, 0.0]), frequency_hz=20.0)
MIDDLE = np.array([[255.5, 255.5]])


def length(shift):
    return np.linalg.norm(shift, axis=-1)


def test_focal_length(camera):
    assert camera.focal_mm / camera.pixel_mm == pytest.approx(3660.9706, abs=1e-4)
    assert camera.fov_deg == pytest.approx((8.0, 8.0), abs=1e-12)


def test_constant_rate(camera, expose, sense):
    turn = lb.Vibration(constant_rad_s=np.radians([1.0, 2.0, 0.5]))
    shot = expose(turn, np.array([[160.633, 136.429]]) - 0.5, mounting=HALF_TURN)
    assert shot.end[0] + 0.5 == pytest.approx([163.802293, 134.853024], abs=1e-6)
    assert length(shot.centre() - shot.end)[0] == pytest.approx(1.77041, abs=5e-6)
    path = sense(turn, mounting=HALF_TURN)
    for method in ("iterative", "least_squares"):
        found = lb.aided_centroid(
            shot.windows, origin=shot.origin, path=path, camera=camera, sigma=0.45, method=method
        )
        assert length(found.xy - shot.end)[0] < 2e-4


def test_cosine(camera, expose, sense):
    shot = expose(COSINE, MIDDLE, mounting=HALF_TURN)
    np.testing.assert_allclose(shot.end, MIDDLE, atol=1e-9)
    assert length(shot.centre() - shot.end)[0] == pytest.approx(0.97238, abs=5e-6)
    error = {}
    for kind in ("linear", "spline"):
        path = sense(COSINE, mounting=HALF_TURN, interpolation=kind)
        found = lb.aided_centroid(
            shot.windows, origin=shot.origin, path=path, camera=camera, sigma=0.45
        )
        error[kind] = length(found.xy - shot.end)[0]
    assert 0.0320 <= error["linear"] <= 0.0321
    assert error["spline"] < 0.001


def test_s_curve_of_the_grey_centre_at_rest():
    u = np.linspace(0.0, 1.0, 401)
    image = lb.render_spots(
        np.stack([8 + u, np.full_like(u, 8)], axis=-1)[:, None], 1.0, 0.45, (17, 17)
    )
    error = image.sum(axis=1) @ np.arange(17) / image.sum(axis=(1, 2)) - 8 - u
    assert np.abs(error).max() == pytest.approx(0.00585, abs=5e-6)


def test_the_sampling_floor_is_what_the_closed_form_says_and_falls_with_the_square_of_the_interval(
    camera, expose, sense
):
    shakes = lb.random_vibration(300, 11, max_rate_rad_s=np.radians(3.0), frequency_hz=(1.0, 50.0))
    shot = expose(shakes, np.full((300, 1, 2), 255.5), sigma=0.6)
    floor = {}
    for rate_hz in (200.0, 400.0):
        found = lb.aided_centroid(
            shot.windows,
            origin=shot.origin,
            path=sense(shakes, rate_hz=rate_hz),
            camera=camera,
            sigma=0.6,
        )
        floor[rate_hz] = found.xy - shot.end
    assert 3.5 < length(floor[200.0]).mean() / length(floor[400.0]).mean() < 4.5

    # Interpolating a curve linearly misses h^2 / 12 of its mean second derivative: f h^2 / (12 T)
    # [w(T) - w(0)].
    change = np.diff(shakes.rate([0.0, 0.025]), axis=-2)[:, 0]
    predicted = 3660.97 * 0.005**2 / (12 * 0.025) * np.stack([change[:, 1], -change[:, 0]], axis=-1)
    assert length(floor[200.0][:, 0] - predicted).mean() < 0.15 * length(predicted).mean()


def test_a_narrow_spot_is_worse_off(camera, expose, sense):
    shakes = lb.random_vibration(100, 5, max_rate_rad_s=np.radians(3.0))
    xy = np.random.default_rng(6).uniform(20, 490, (100, 4, 2))
    error = {}
    for sigma in (0.1, 0.6):
        shot = expose(shakes, xy, sigma=sigma, nodes=8)
        with (
            pytest.warns(RuntimeWarning, match="did not converge") if sigma < 0.2 else np.errstate()
        ):
            found = lb.aided_centroid(
                shot.windows,
                origin=shot.origin,
                path=sense(shakes, nodes=12),
                camera=camera,
                sigma=sigma,
                background=0.0,
            )
        error[sigma] = length(found.xy - shot.end).mean()
    assert 3 < error[0.1] / error[0.6] < 9


def test_a_thousand_images(camera, expose, sense):
    shakes = lb.random_vibration(1000, 2015, max_rate_rad_s=np.radians(3.0))
    shot = expose(shakes, np.random.default_rng(3).uniform(20, 490, (1000, 4, 2)))
    arguments = {"origin": shot.origin, "camera": camera, "sigma": 0.45, "background": 0.0}
    aided = lb.aided_centroid(shot.windows, path=sense(shakes), **arguments)
    assert aided.converged.all()
    assert length(shot.centre() - shot.end).mean() == pytest.approx(0.69, abs=0.05)
    assert length(aided.xy - shot.end).mean() == pytest.approx(0.011, abs=0.0006)


def test_a_spline_beats_straight_lines_for_slow_vibrations(camera, expose, sense):
    shakes = lb.random_vibration(200, 8, max_rate_rad_s=np.radians(3.0), frequency_hz=(1.0, 50.0))
    shot = expose(shakes, np.random.default_rng(4).uniform(20, 490, (200, 4, 2)))
    arguments = {"origin": shot.origin, "camera": camera, "sigma": 0.45, "background": 0.0}
    spline = lb.aided_centroid(
        shot.windows, path=sense(shakes, interpolation="spline"), **arguments
    )
    assert length(spline.xy - shot.end).mean() < 0.003
    wide = lb.aided_centroid(
        shot.windows, path=sense(shakes, interpolation="spline", margin=3), **arguments
    )
    assert length(wide.xy - shot.end).mean() < 0.5 * length(spline.xy - shot.end).mean()
