"""Exact values of ren2023, the sign that ties it to liu2026, and the focal term."""

import numpy as np
import pytest

import losbench as lb
from losbench.optics.camera import project
from losbench.pointing.starcamera import drift_from_spots
from losbench.units import arcsec_to_rad, rad_to_arcsec

EDGE = 600.0 * np.tan(np.radians(3.0))
POINTS = np.array([[EDGE, EDGE, 600.0], [-EDGE, -EDGE, 600.0]])
DELTA = arcsec_to_rad([0.7, -1.1, 2.0])


def seen(points, delta):
    """Shifts of the spots when the camera has turned by delta: the directions turn by minus that,
    in its axes.
    """
    return (project(points, -np.asarray(delta)) - points)[..., :2]


def test_the_exact_values_of_the_paper_s_layout():
    assert pytest.approx(31.444667569825, abs=1e-9) == EDGE
    shifts_um = 1e3 * seen(POINTS, DELTA)
    expected = [[3.51905734595, 1.74568638011], [2.90926536786, 2.35547933705]]
    np.testing.assert_allclose(shifts_um, expected, atol=1e-9)
    found = drift_from_spots(POINTS, 1e-3 * shifts_um)
    np.testing.assert_allclose(
        found.delta_arcsec, [0.699994629706, -1.100003452224, 2.000000872694], atol=1e-9
    )


def test_a_camera_turns_against_what_it_sees():
    shifts = seen(POINTS, DELTA)
    both = lb.solve_attitude(POINTS, shifts, method="ls")
    np.testing.assert_array_equal(drift_from_spots(POINTS, shifts).delta, -both.angles)
    a, b = np.moveaxis(POINTS[:, :2] / 600.0, 1, 0)
    dx, dy, dz = DELTA
    first_order = 600.0 * np.stack(
        [a * b * dx - (1 + a**2) * dy + b * dz, (1 + b**2) * dx - a * b * dy - a * dz], -1
    )
    np.testing.assert_allclose(shifts, first_order, atol=1e-7)


def test_covariance_is_that_of_the_noise():
    rng = np.random.default_rng(4)
    noisy = seen(POINTS, DELTA) + 0.137e-3 * rng.standard_normal((20_000, 2, 2))
    fit = drift_from_spots(POINTS, noisy, sigma=0.137e-3)
    np.testing.assert_allclose(
        np.cov(fit.delta.T), fit.cov[0], atol=0.03 * np.abs(fit.cov[0]).max()
    )
    assert 3 * fit.std_error_arcsec[0, :2] == pytest.approx([0.1, 0.1], abs=0.001)
    assert fit.condition == pytest.approx(1 / np.tan(np.radians(3)) / np.sqrt(2), rel=0.01)


def test_a_focal_change_looks_like_a_drift_unless_it_is_solved_for_or_the_spots_straddle_the_axis():
    one_sided = np.array([[EDGE, EDGE, 600.0], [EDGE, -EDGE, 600.0]])
    for points, apparent in ((POINTS, 0.0), (one_sided, 0.108)):
        shifts = seen(points, DELTA) + 1e-5 * points[:, :2]
        plain, full = drift_from_spots(points, shifts), drift_from_spots(points, shifts, focal=True)
        error = np.abs(plain.delta_arcsec - rad_to_arcsec(DELTA))
        assert error[1] == pytest.approx(apparent, abs=0.001)
        assert full.focal == pytest.approx(1e-5, abs=2e-9)
        np.testing.assert_allclose(full.delta, DELTA, atol=3e-11)
        assert full.cov.shape == (4, 4)


def test_batches_agree_with_single_frames_and_missing_spots_stay_missing():
    points = np.array([[30.0, 30.0, 600.0], [-30.0, -30.0, 600.0], [30.0, -30.0, 600.0]])
    shifts = seen(points, DELTA * np.arange(4)[:, None, None].swapaxes(1, 2)[..., 0])
    shifts[1, 2] = np.nan
    shifts[2, 1:] = np.nan
    for focal in (False, True):
        batch = drift_from_spots(points, shifts, sigma=1e-4, focal=focal)
        for k in (0, 1, 3):
            alone = drift_from_spots(points, shifts[k], sigma=1e-4, focal=focal)
            np.testing.assert_allclose(alone.delta, batch.delta[k], atol=1e-15)
            np.testing.assert_allclose(alone.cov, batch.cov[k], rtol=1e-6, atol=1e-24)
        assert np.isnan(batch.delta[2]).all()
        assert np.isnan(batch.residuals[1, 2]).all() and np.isfinite(batch.residuals[1, :2]).all()


def test_bad_input_is_named():
    with pytest.raises(
        ValueError, match=r"shifts must have shape \(..., 2, 2\) to match 2 points, got \(5, 3, 2\)"
    ):
        drift_from_spots(POINTS, np.zeros((5, 3, 2)), focal=True)
    with pytest.raises(ValueError, match="points must differ, got two equal points: 0 and 1"):
        drift_from_spots(POINTS[[0, 0]], np.zeros((2, 2)))
    with pytest.raises(ValueError, match="focal must be True or False, got 1"):
        drift_from_spots(POINTS, np.zeros((2, 2)), focal=1)
    with pytest.raises(ValueError, match="sigma must be positive, got -1"):
        drift_from_spots(POINTS, np.zeros((2, 2)), sigma=-1.0, focal=True)


@pytest.mark.parametrize("focal", [False, True])
def test_errors_of_a_drift_are_told_for_its_three_angles(focal):
    corners = np.array([[30.0, 30.0, 600.0], [-30.0, -30.0, 600.0], [30.0, -30.0, 600.0]])
    shifts = seen(corners, DELTA) + 1e-4 * np.random.default_rng(9).standard_normal((5, 3, 2))
    fit = drift_from_spots(corners, shifts, sigma=1e-4, focal=focal)
    assert fit.cov.shape == (5, 3 + focal, 3 + focal)
    assert fit.std_error_arcsec.shape == fit.delta_arcsec.shape == (5, 3)
    variance = np.diagonal(fit.cov, axis1=1, axis2=2)[:, :3]
    np.testing.assert_allclose(arcsec_to_rad(fit.std_error_arcsec) ** 2, variance, rtol=1e-9)
    rows = -lb.design_matrix(corners)
    if focal:
        rows = np.column_stack([rows, corners[:, :2].ravel()])
    assert fit.condition == pytest.approx(np.linalg.cond(rows), rel=1e-9)
    np.testing.assert_allclose(
        fit.cov[0], 1e-8 * np.linalg.inv(rows.T @ rows), rtol=1e-6, atol=1e-24
    )
    assert (fit.focal is None) != focal
