"""Two heads that turn against each other, with spots that show it: the angle of the stars comes
out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.pointing.starcamera import PairTelemetry, correct_pair, smooth_drift

TIME_S = np.arange(80.0)
POINTS_MM = np.array([[5, 4, 50], [-6, 5, 50], [-4, -5, 50], [6, -3, 50]]) * np.array(
    [[[1.0]], [[1.2]]]
)
MOUNTED = Rotation.from_euler("zyx", [[10, 20, 30], [-50, 5, 80]], degrees=True)
TURNED = 1e-5 * np.stack(
    [np.sin(np.outer(TIME_S, rate)) for rate in ([0.1, 0.2, 0.05], [0.15, 0.1, 0.02])]
)  # in monitor axes
STARS = Rotation.from_rotvec([[[0.1, 0.2, 0.3]], [[0.9, -0.4, 0.3]]])


def heads(angle=TURNED):
    """Attitudes as heads report them that have turned by so much, (2, n, 4), scalar last."""
    return np.stack(
        [
            (star * Rotation.from_rotvec(mount.apply(turn))).as_quat()
            for star, mount, turn in zip(STARS, MOUNTED, angle, strict=True)
        ]
    )


TELEMETRY = PairTelemetry(
    time_s=TIME_S,
    quaternions=heads(),
    points_mm=POINTS_MM,
    shifts_mm=np.stack(
        [(lb.project(p, -turn) - p)[..., :2] for p, turn in zip(POINTS_MM, TURNED, strict=True)]
    ),
    convention=lb.QuaternionConvention(scalar="last", direction="camera_to_inertial"),
    installation=MOUNTED.as_matrix(),
)


def without_spots(first, last):
    shifts = TELEMETRY.shifts_mm.copy()
    shifts[0, first : last + 1] = np.nan
    return replace(TELEMETRY, shifts_mm=shifts)


@pytest.mark.parametrize("boresight", [None, (1.0, 0.0, 0.0)])
def test_what_turned_comes_out_of_the_angle(boresight):
    pair = correct_pair(replace(TELEMETRY, boresight=boresight) if boresight else TELEMETRY)
    along = boresight or (0.0, 0.0, 1.0)
    one, two = (star.apply(along)[0] for star in STARS)
    angle = np.arccos(one @ two)
    np.testing.assert_allclose(pair.drift, TURNED, atol=1e-9)
    np.testing.assert_allclose(pair.after_rad, angle, atol=2e-9)
    assert np.abs(pair.before_rad - angle).max() > 5e-6
    np.testing.assert_allclose(
        np.abs(np.vecdot(pair.quaternions, heads(0 * TURNED))), 1.0, atol=1e-12
    )
    np.testing.assert_array_equal(pair.drift[1], pair.fits[1].delta)


def test_known_errors_of_spots_scale_the_covariance():
    one, three = (correct_pair(TELEMETRY, sigma_mm=s).fits[1].cov for s in (1e-3, 3e-3))
    np.testing.assert_allclose(three, 9 * one)


def test_ten_seconds_without_spots_are_bridged_and_no_more():
    nine = correct_pair(without_spots(21, 29))  # seen at 20 s and 30 s
    np.testing.assert_allclose(nine.drift[0, 25], (TURNED[0, 20] + TURNED[0, 30]) / 2, atol=1e-9)
    assert np.isfinite(nine.after_rad).all()
    ten = correct_pair(without_spots(21, 30))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(ten.after_rad)), np.arange(21, 31))
    assert np.isfinite(ten.drift[1]).all()
    assert np.isfinite(correct_pair(without_spots(21, 30), max_gap_s=11.0).after_rad).all()


def test_a_smoothed_drift_is_that_of_the_smoother():
    plain, smooth = (correct_pair(TELEMETRY, smooth_s=s) for s in (None, 20.0))
    for k in range(2):
        expected = smooth_drift(TIME_S, plain.drift[k], window_s=20.0)
        np.testing.assert_array_equal(smooth.drift[k], expected)
    np.testing.assert_array_equal(smooth.fits[0].delta, plain.fits[0].delta)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("quaternions", heads()[:, 1:], r"quaternions must have shape \(2, 80, 4\) to match 80"),
        ("quaternions", heads()[..., 1:], r"quaternions must have shape \(2, 80, 4\)"),
        ("points_mm", POINTS_MM[..., :2], r"points_mm must have shape \(2, 4, 3\)"),
        ("shifts_mm", np.zeros((2, 80, 3, 2)), r"shifts_mm must have shape \(2, 80, 4, 2\)"),
        ("shifts_mm", np.zeros((2, 79, 4, 2)), r"to match 80 times and 4 spots"),
        ("installation", np.eye(3), r"installation must have shape \(2, 3, 3\)"),
    ],
)
def test_what_does_not_match_is_refused_by_name(field, value, message):
    with pytest.raises(ValueError, match=message):
        replace(TELEMETRY, **{field: value})
