"""Authority: closed forms, scipy's Rotation and finite differences of the exact projection."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.optics.camera import project, rotate

CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(1080, 1920))
LIU_POINTS = np.array([[5.0, 75.0, -475.0], [-5.0, 75.0, -475.0]])
GOOD = "focal_mm = 260\npixel_um = 10\nshape = [2, 3]\n"
WIDE_POINTS = np.array([[30.0, -20.0, 100.0], [-45.0, 10.0, 100.0], [5.0, 60.0, 80.0]])


def test_the_published_field_of_view():
    # liu2026, section 3.1: 4.23 x 2.38 degrees
    np.testing.assert_allclose(CAMERA.fov_deg, (4.23, 2.38), atol=0.005)
    assert CAMERA.arcsec_per_px == pytest.approx(
        np.degrees(np.arctan(10e-3 / 260)) * 3600, rel=1e-8
    )


def test_an_off_centre_principal_point_divides_the_field_unevenly():
    camera = dataclasses.replace(CAMERA, principal_px=(-0.5, 539.5))
    assert camera.fov_deg[0] == pytest.approx(np.degrees(np.arctan(19.2 / 260)))
    assert camera.fov_deg[1] == pytest.approx(CAMERA.fov_deg[1])


def test_the_middle_pixel_of_an_odd_detector_looks_along_the_axis():
    camera = lb.Camera(100.0, 5.0, (101, 201))
    np.testing.assert_array_equal(camera.points_mm([100, 50]), [0, 0, 100])


@given(x=st.floats(-100, 2000), y=st.floats(-100, 1200), distance=st.floats(1e-3, 1e6))
def test_a_pixel_survives_the_way_out_and_back_at_any_distance(x, y, distance):
    ray = CAMERA.points_mm([[x, y]])
    np.testing.assert_allclose(CAMERA.pixels(ray * distance), [[x, y]], rtol=1e-12, atol=1e-9)


def test_a_point_behind_the_camera_has_no_pixel():
    assert np.isnan(CAMERA.pixels([0.0, 0.0, -1.0])).all()


def test_a_missing_spot_stays_missing():
    np.testing.assert_array_equal(
        np.isnan(CAMERA.points_mm([[np.nan, 2.0], [1.0, 2.0]]))[:, 0], [True, False]
    )


def test_a_camera_survives_its_file(tmp_path):
    camera = lb.Camera(260.0, 10, [1080, 1920], principal_px=np.array([1.5, 2]))
    (tmp_path / "camera.toml").write_text(camera.to_toml())
    assert lb.Camera.from_toml(tmp_path / "camera.toml") == camera


def test_a_camera_file_needs_no_principal_point(tmp_path):
    (tmp_path / "camera.toml").write_text("focal_mm = 260\npixel_um = 10.0\nshape = [1080, 1920]\n")
    assert lb.Camera.from_toml(tmp_path / "camera.toml") == CAMERA


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("focal_mm = 260", "key pixel_um, shape is missing"),
        (
            GOOD + "focus = 1",
            "unknown key focus; known are focal_mm, pixel_um, shape, principal_px",
        ),
        (GOOD.replace("260", "'260'"), "focal_mm must be a number, got '260'"),
        (GOOD.replace("260", "'260 mm'"), "focal_mm must be a number, got '260 mm'"),
        (GOOD.replace("10", "-10"), "pixel_um must be positive, got -10"),
        (GOOD.replace("[2, 3]", "1080"), "shape must be two numbers, got 1080"),
        (GOOD.replace("[2, 3]", "[2.5, 3]"), "shape must be a whole number, got 2.5"),
        (GOOD.replace("[2, 3]", "[2, 0]"), "shape must be a whole number of at least 1, got 0"),
        (GOOD + "principal_px = [nan, 1]", "principal_px must be a finite number, got nan"),
        ("focal_mm 260", "Expected '=' after a key"),
    ],
)
def test_a_bad_camera_file_is_named_with_its_fault(tmp_path, text, message):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"mine\.toml: ") as caught:
        lb.Camera.from_toml(path)
    assert message in str(caught.value)


def test_rows_are_the_derivative_of_the_exact_projection():
    step = 1e-6
    columns = [
        (project(WIDE_POINTS, step * axis) - project(WIDE_POINTS, -step * axis))[:, :2].ravel()
        / (2 * step)
        for axis in np.eye(3)
    ]
    np.testing.assert_allclose(
        lb.design_matrix(WIDE_POINTS), np.column_stack(columns), rtol=1e-8, atol=1e-8
    )


def test_paper_rows_are_rotation_with_z_overwritten():
    # liu2026, eq. (1)-(2): R = I + [angles x], so that the displacement is a cross product.
    angles = np.array([1e-4, -2e-4, 3e-4])
    expected = np.cross(angles, LIU_POINTS)[:, :2].ravel()
    np.testing.assert_allclose(lb.design_matrix(LIU_POINTS, "paper") @ angles, expected, rtol=1e-13)


def test_both_models_agree_on_the_axis_except_for_terms_of_second_order():
    near = np.array([[1e-3, 0.0, 1.0], [0.0, 1e-3, 1.0]])
    np.testing.assert_allclose(lb.design_matrix(near), lb.design_matrix(near, "paper"), atol=1.1e-6)


def test_signs_a_turn_about_y_moves_spots_along_plus_x_and_about_x_along_minus_y():
    axis = [[0.0, 0.0, 260.0]]
    assert project(axis, [0, 1e-3, 0])[0, 0] > 0
    assert project(axis, [1e-3, 0, 0])[0, 1] < 0
    # about z: +x is carried towards +y, which is down the rows
    assert project([[1.0, 0.0, 260.0]], [0, 0, 1e-3])[0, 1] > 0


def test_rotation_follows_scipy_and_projection_keeps_the_direction():
    angles = np.random.default_rng(1).normal(size=(2, 4, 3)) * 0.3
    turned = rotate(WIDE_POINTS, angles)
    assert turned.shape == (2, 4, 3, 3)
    np.testing.assert_allclose(
        turned[1, 2], Rotation.from_rotvec(angles[1, 2]).apply(WIDE_POINTS), rtol=1e-12
    )
    seen = project(WIDE_POINTS, angles)
    np.testing.assert_allclose(np.cross(seen, turned), 0, atol=1e-10)
    np.testing.assert_array_equal(seen[..., 2], np.broadcast_to(WIDE_POINTS[:, 2], (2, 4, 3)))


def test_a_point_turned_behind_the_camera_is_not_seen():
    seen = project([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]], [0.0, np.radians(60), 0.0])
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[1, :2]).all()


@given(scale=st.sampled_from([1e-3, 1e3, 25.4]))
def test_any_unit_of_length_serves(scale):
    np.testing.assert_allclose(
        lb.design_matrix(WIDE_POINTS * scale), scale * lb.design_matrix(WIDE_POINTS), rtol=1e-14
    )


def test_a_batch_of_layouts_equals_a_loop():
    layouts = WIDE_POINTS * np.array([1.0, 0.5, 2.0])[:, None, None] + np.arange(3)
    np.testing.assert_array_equal(
        lb.design_matrix(layouts), [lb.design_matrix(one) for one in layouts]
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: lb.design_matrix([[1.0, 2.0]]),
            r"points must have shape \(\.\.\., n, 3\), got \(1, 2\)",
        ),
        (lambda: lb.design_matrix([[1.0, 2.0, 0.0]]), "points must have z other than zero"),
        (
            lambda: lb.design_matrix([[1.0, np.nan, 1.0]]),
            "points must be finite, got 1 NaN or infinite of 3 values",
        ),
        (
            lambda: lb.design_matrix(LIU_POINTS, "exact"),
            "model must be one of 'pinhole', 'paper', got 'exact'",
        ),
        (
            lambda: project(LIU_POINTS, [1.0, 2.0]),
            r"angles must have shape \(\.\.\., 3\), got \(2,\)",
        ),
        (
            lambda: CAMERA.points_mm([1.0, 2.0, 3.0]),
            r"xy_px must have shape \(\.\.\., 2\), got \(3,\)",
        ),
        (lambda: CAMERA.pixels([1.0, 2.0]), r"points_mm must have shape \(\.\.\., 3\), got \(2,\)"),
        (lambda: lb.Camera(0.0, 10.0, (2, 2)), "focal_mm must be positive, got 0"),
        (lambda: lb.Camera(1.0, 10.0, (2, 2, 2)), r"shape must be two numbers, got \(2, 2, 2\)"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
