"""Authority: batoid's rays, first-order optics, Seidel sums, and what a rigid body must do."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from losbench.optics.design import anastigmat, design_three_mirror, seidel_sums
from losbench.optics.jacobian import apart, jacobian_table, los_angles, los_jacobian
from losbench.optics.rays import Rays
from losbench.optics.threemirror import ThreeMirror

ARCSEC = np.radians(1 / 3600)
CAMERA = ThreeMirror(
    radius_mm=(542.46, 171.93, 251.7),
    conic=(-1.6168, 0.0, 0.1954),
    vertex_z_mm=(0.0, 148.6, 0.0, 176.91),
    beam_mm=40.0,
    bias_deg=6.0,
    pixel_um=10.0,
    shape=(1080, 1920),
)
ON_AXIS = dataclasses.replace(CAMERA, bias_deg=0.0, beam_mm=2.0, spot_separation_deg=1e-4)


def test_rays_fall_where_batoid_lets_them_fall():
    told = json.loads(Path(__file__).with_name("batoid_rays.json").read_text())
    camera = dataclasses.replace(CAMERA)
    camera.__dict__["pivot_mm"] = np.array(told["pivot_mm"])  # batoid's were rounded
    rays = Rays(np.array([told["origin_mm"]]), np.array([told["direction"]]))
    points, _ = camera.trace(rays, told["poses"])
    np.testing.assert_allclose(points[3][:, 0, :, :2], told["detector_xy_mm"], rtol=0, atol=1e-11)


def test_the_chief_ray_meets_the_mirrors_where_it_was_designed_to():
    pivots = [
        [0, 35.13841, 1.13733],
        [0, 0, 148.6],
        [0, -34.83180, 2.42407],
        [0, -27.10342, 176.91],
    ]
    np.testing.assert_allclose(CAMERA.pivot_mm, pivots, atol=1e-5)
    px = CAMERA.observe(rays=CAMERA.launch([[0.02, -0.01]], rings=0))[0]
    np.testing.assert_allclose((px[0] - [959.5, 539.5]) * -0.01, [-5.18046, 2.60418], atol=1e-5)


def test_the_design_is_the_camera_of_the_paper():
    camera = design_three_mirror(260.0)
    assert camera.plate_scale_mm.mean() == pytest.approx(260.0, abs=1e-3)
    np.testing.assert_allclose(camera.radius_mm, CAMERA.radius_mm, rtol=1e-4)
    np.testing.assert_allclose(camera.vertex_z_mm, CAMERA.vertex_z_mm, rtol=2e-4)
    np.testing.assert_allclose(camera.conic, CAMERA.conic, atol=4e-4)
    assert camera.pinhole.fov_deg == pytest.approx(
        (4.24, 2.38), abs=0.05
    )  # 4.23 x 2.38, section 3.1


def test_a_longer_camera_is_the_same_camera_in_another_unit():
    short, long = (
        design_three_mirror(260.0),
        design_three_mirror(520.0, beam_mm=80.0, pixel_um=20.0),
    )
    np.testing.assert_allclose(long.radius_mm, 2 * np.array(short.radius_mm), rtol=1e-5)


def test_the_field_is_sharp_and_undistorted():
    tangents = CAMERA.field_tangents()
    points, _ = CAMERA.trace(CAMERA.launch(tangents))
    off = points[3] - points[3].mean(axis=-2, keepdims=True)
    radius_um = 1e3 * np.sqrt(np.mean(np.sum(off[..., :2] ** 2, axis=-1), axis=-1))
    assert radius_um.max() < 3.0
    assert radius_um.mean() < 1.5
    left = CAMERA.observe(rays=CAMERA.launch(tangents))[0] - CAMERA.pinhole.pixels(
        CAMERA.directions(tangents)
    )
    assert np.abs(left).max() < 0.1
    assert CAMERA.distortion_px < 0.05
    assert CAMERA.pinhole.focal_mm == pytest.approx(257.872, abs=0.01)
    # A camera of 260 mm about the detector's middle is far off: the field is not symmetric.
    assert CAMERA.pinhole.principal_px == pytest.approx((959.5, -2170.8), abs=0.1)


def test_the_conics_cancel_three_seidel_sums_and_the_powers_the_fourth():
    curvature, conic = anastigmat(0.57610, 0.68585)
    sums = seidel_sums(curvature, conic, 0.57610)
    np.testing.assert_allclose(sums[:4], 0.0, atol=1e-14)
    assert np.abs(seidel_sums(curvature, conic + np.array([0.01, 0, 0]), 0.57610)[0]) > 1e-4


def test_the_fifth_seidel_sum_is_the_cubic_of_traced_distortion():
    tangents = np.linspace(0.01, 0.15, 15)
    beams = ON_AXIS.launch(np.stack([tangents, 0 * tangents], axis=-1), rings=0)
    x = -ON_AXIS.trace(beams)[0][3][:, 0, 0]
    focal, cubic = np.linalg.lstsq(
        np.stack([tangents, tangents**3, tangents**5], axis=-1), x, rcond=None
    )[0][:2]
    curvature, conic = anastigmat(0.57610, 0.68585)
    assert cubic / focal == pytest.approx(-seidel_sums(curvature, conic, 0.57610)[4] / 2, rel=0.1)


def test_no_mirrors_have_impossible_distances():
    with pytest.raises(ValueError, match="no three mirrors have spacing 0.05"):
        anastigmat(0.05, 0.2)


def test_first_order_optics_on_the_axis():
    """A mirror's tilt moves the image by 2 f y_i, its shift by 2 f y_i / R_i, with y the marginal heights."""
    heights, focal = np.array([1.0, 0.45213, 0.68580]), 257.942
    jacobian = los_jacobian(ON_AXIS).reshape(6, 4, 8)[1]
    tilt, shift = jacobian[:3, 3] * ARCSEC, jacobian[:3, 1] * 1e-3
    np.testing.assert_allclose(np.abs(tilt), 2 * focal * heights * 100 * ARCSEC, rtol=2e-4)
    # One micrometre of shift, in pixels of 10 um.
    np.testing.assert_allclose(
        np.abs(shift), 2 * focal * heights / np.array(CAMERA.radius_mm) / 10, rtol=2e-4
    )


def test_bending_a_mirror_moves_the_focus_as_its_power_does():
    heights, focal = np.array([1.0, 0.45213, 0.68580]), 257.942
    focus = los_jacobian(ON_AXIS).reshape(6, 4, 8)[4, :3, 7]
    np.testing.assert_allclose(np.abs(focus), 2e3 * (focal * heights) ** 2, rtol=1e-3)
    off_axis = los_jacobian(CAMERA).reshape(6, 4, 8)[4, :3, 7]
    np.testing.assert_allclose(off_axis, focus, rtol=0.06)


def test_the_map_off_axis():
    """Values of an independent prototype, mean of both spots: per micrometre and per arcsecond."""
    jacobian = los_jacobian(CAMERA).reshape(6, 4, 8)
    spot = (jacobian[:2] + jacobian[2:4]) / 2
    np.testing.assert_allclose(spot[1, :, 1] * 1e-3, [-0.09370, 0.13297, -0.13926, 0.1], atol=2e-5)
    np.testing.assert_allclose(spot[1, :, 3] * ARCSEC, [0.25257, -0.11083, 0.16961, 0], atol=2e-5)
    np.testing.assert_allclose(
        spot[1, :, 2] * 1e-3, [-0.02231, 0.01296, 0.01379, -0.00445], atol=2e-5
    )
    np.testing.assert_allclose(spot[0, :, 4] * ARCSEC, [-0.24708, 0.11023, -0.16706, 0], atol=2e-5)
    np.testing.assert_allclose(
        jacobian[4:, :, 2].mean(axis=0) * 1e-3, [0.888, -1.037, 1.149, -1.0], atol=1e-3
    )
    table = jacobian_table(CAMERA)
    np.testing.assert_allclose(
        table["scale_ppm"].to_numpy()[2::6], [-8.233, 4.783, 5.090, -1.641], atol=0.004
    )
    # One pixel is 7.933 arcsec, and turning the focal plane turns the image the other way.
    np.testing.assert_allclose(table["gamma_arcsec"].to_numpy()[23], -1.0, atol=1e-2)


@pytest.mark.parametrize(("column", "size"), [(0, 10e-3), (3, 10 * ARCSEC)])
def test_the_map_is_straight(column, size):
    jacobian, rest = los_jacobian(CAMERA), CAMERA.observe()[0]
    rows = [8 * optic + column + axis for optic in range(4) for axis in range(3)]
    motions = np.eye(32)[rows]

    def off(size):
        px = CAMERA.observe(*apart(motions * size))[0]
        return np.abs((px - rest).reshape(-1, 4) - motions @ jacobian[:4].T * size).max()

    assert off(size) < 3e-5
    assert off(10 * size) == pytest.approx(100 * off(size), rel=0.05)  # the second order


def test_a_rigid_camera_hardly_notices_where_it_stands_but_sees_its_turn():
    rest = CAMERA.observe()[0]
    for axis in range(3):
        motion = np.zeros((4, 6))
        motion[:, axis] = 1.0  # the beam stays
        assert np.abs(CAMERA.observe(motion)[0] - rest).max() < 0.008
    turn = np.array([ARCSEC, 0, 0])
    motion = np.concatenate([np.cross(turn, CAMERA.pivot_mm), np.tile(turn, (4, 1))], axis=1)
    shift = CAMERA.observe(motion)[0] - rest
    np.testing.assert_allclose(shift[:, 1], 0.1264, atol=1e-4)
    # The stars turn the other way about a camera that turns.
    np.testing.assert_allclose(los_angles(CAMERA) @ shift.ravel(), -turn, atol=2e-3 * ARCSEC)


def test_growth_of_all_things_changes_no_picture():
    growth, light = 1e-3, CAMERA.laser
    motion = np.zeros((4, 6))
    motion[:, :3] = growth * CAMERA.pivot_mm
    grown = CAMERA.observe(
        motion,
        np.full(4, growth),
        rays=Rays(light.origin_mm * (1 + growth), light.direction),
    )
    np.testing.assert_allclose(grown[0], CAMERA.observe()[0], atol=1e-12)
    np.testing.assert_allclose(grown[1], CAMERA.observe()[1], atol=1e-8)


def test_batches_are_loops():
    motions = np.random.default_rng(0).normal(scale=1e-5, size=(2, 3, 4, 6))
    px, focus = CAMERA.observe(motions)
    assert px.shape == (2, 3, 2, 2)
    assert focus.shape == (2, 3, 2)
    np.testing.assert_allclose(px[1, 2], CAMERA.observe(motions[1, 2])[0], atol=1e-11)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"radius_mm": (1.0, 2.0)}, r"radius_mm must have shape \(3,\)"),
        ({"radius_mm": (1.0, 0.0, 2.0)}, "radius_mm must not be zero"),
        ({"beam_mm": -1.0}, "beam_mm must be positive"),
        ({"bias_deg": 60.0}, "bias_deg must be a finite number from -45 to 45"),
        ({"radius_mm": (542.46, 171.93, 20.0)}, "let no ray through the stop"),
        ({"shape": (1080,)}, r"shape must have shape \(2,\)"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(change, said):
    with pytest.raises(ValueError, match=said):
        dataclasses.replace(CAMERA, **change)
