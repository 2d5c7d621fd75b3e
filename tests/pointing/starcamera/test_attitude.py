"""Exact values of ren2023, invariants of the correction, and every wrong convention noticed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.pointing.starcamera import QuaternionConvention, check_design, observability
from losbench.units import arcsec_to_rad, rad_to_arcsec

LAST = QuaternionConvention(scalar="last", direction="camera_to_inertial")
HEADS = Rotation.from_euler("x", [[35.0], [-35.0]], degrees=True)
D1, D2 = arcsec_to_rad([0.45, 0.3, 1.2]), arcsec_to_rad([-0.65, -0.2, -0.9])


def stored(rotation, convention):
    """Camera-to-inertial rotations as quaternions of a convention."""
    return (rotation if convention.to_inertial else rotation.inv()).as_quat(
        scalar_first=convention.scalar == "first"
    )


def pitch(first_deg, last_deg):
    return Rotation.from_rotvec(
        np.radians(np.linspace(first_deg, last_deg, 100))[:, None] * np.array([0.0, 1.0, 0.0])
    )


def change_arcsec(first, second, convention=LAST):
    return float(
        rad_to_arcsec(lb.boresight_angle(first, second, convention=convention) - np.radians(70.0))
    )


@pytest.mark.parametrize("convention", QuaternionConvention.every(), ids=str)
def test_the_exact_values_of_the_pair_in_every_convention(convention):
    a, b = (
        stored(HEADS[0] * Rotation.from_rotvec(D1), convention),
        stored(HEADS[1] * Rotation.from_rotvec(D2), convention),
    )
    assert change_arcsec(a, b, convention) == pytest.approx(1.1, abs=1e-5)
    right = [lb.correct_drift(q, d, convention=convention) for q, d in ((a, D1), (b, D2))]
    assert abs(change_arcsec(*right, convention)) < 1e-6
    wrong = [lb.correct_drift(q, -d, convention=convention) for q, d in ((a, D1), (b, D2))]
    assert change_arcsec(*wrong, convention) == pytest.approx(2.2, abs=1e-5)


def test_at_rest_the_angle_is_seventy_degrees():
    assert lb.boresight_angle(*HEADS.as_quat(), convention=LAST) == pytest.approx(
        np.radians(70.0), abs=1e-15
    )


def test_swapped_heads_change_the_angle_as_predicted():
    a, b = (
        (HEADS[0] * Rotation.from_rotvec(D1)).as_quat(),
        (HEADS[1] * Rotation.from_rotvec(D2)).as_quat(),
    )
    swapped = lb.correct_drift(a, D2, convention=LAST), lb.correct_drift(b, D1, convention=LAST)
    gradient = observability(a, b, convention=LAST).angle
    predicted = 1.1 - rad_to_arcsec(gradient @ np.concatenate([D2, D1]))
    assert change_arcsec(*swapped) == pytest.approx(predicted, abs=1e-5)
    assert predicted == pytest.approx(2.2, abs=1e-3)


def test_the_wrong_side_makes_the_angle_wander_while_the_pair_turns():
    turn = pitch(0, 20)
    a, b = ((turn * HEADS[k] * Rotation.from_rotvec(d)).as_quat() for k, d in enumerate((D1, D2)))
    right = [lb.correct_drift(q, d, convention=LAST) for q, d in ((a, D1), (b, D2))]
    wrong = [
        (Rotation.from_rotvec(-d) * Rotation.from_quat(q)).as_quat() for q, d in ((a, D1), (b, D2))
    ]
    steady, wandering = (
        np.ptp(rad_to_arcsec(lb.boresight_angle(*q, convention=LAST))) for q in (right, wrong)
    )
    assert steady < 1e-6
    assert wandering > 0.3


def test_the_angle_sees_one_of_six_components_and_the_relative_rotation_three():
    rng = np.random.default_rng(1)
    turn = Rotation.random(20, rng=rng)
    a, b = (turn * HEADS[0]).as_quat(), (turn * HEADS[1]).as_quat()
    seen = observability(a, b, convention=LAST)
    assert np.linalg.matrix_rank(seen.angle) == 1
    assert (np.linalg.matrix_rank(seen.relative) == 3).all()
    step = 1e-5
    for k, direction in enumerate(np.eye(6)):
        moved = [
            lb.correct_drift(q, -step * d, convention=LAST)
            for q, d in ((a, direction[:3]), (b, direction[3:]))
        ]
        slope = (lb.boresight_angle(*moved, convention=LAST) - np.radians(70.0)) / step
        np.testing.assert_allclose(slope, seen.angle[:, k], atol=1e-5)
        before, after = (
            Rotation.from_quat(p).inv() * Rotation.from_quat(q) for p, q in ((a, b), moved)
        )
        np.testing.assert_allclose(
            (after * before.inv()).as_rotvec() / step, seen.relative[..., k], atol=1e-5
        )


def test_an_installation_matrix_takes_the_monitor_s_axes_to_the_camera_s():
    installed = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    q = HEADS[0].as_quat()
    direct = lb.correct_drift(q, installed @ D1, convention=LAST)
    np.testing.assert_allclose(
        lb.correct_drift(q, D1, convention=LAST, installation=installed), direct, atol=1e-16
    )


def test_drift_sized_angles_survive_where_an_arc_cosine_returns_nothing():
    tiny = 1e-9
    turned = Rotation.from_rotvec([tiny, 0.0, 0.0]).as_quat()
    assert lb.boresight_angle([0, 0, 0, 1], turned, convention=LAST) == pytest.approx(
        tiny, rel=1e-12
    )
    assert 2 * np.arccos(turned[3]) == 0.0


def test_a_missing_row_stays_missing_and_signs_may_flip():
    q = np.tile(HEADS[0].as_quat(), (4, 1))
    q[1] = np.nan
    q[2] *= -1
    drift = np.tile(D1, (4, 1))
    drift[3, 0] = np.nan
    found = lb.correct_drift(q, drift, convention=LAST)
    assert np.isnan(found).any(axis=1).tolist() == [False, True, False, True]
    np.testing.assert_allclose(found[2], -found[0])
    angle = lb.boresight_angle(q, np.tile(HEADS[1].as_quat(), (4, 1)), convention=LAST)
    assert np.isnan(angle).tolist() == [False, True, False, False]
    assert angle[2] == angle[0]


@given(st.integers(0, 2**32 - 1))
def test_the_angle_ignores_a_common_turn_and_the_order_of_the_heads(seed):
    turn, a, b = Rotation.random(3, rng=np.random.default_rng(seed))
    angle = lb.boresight_angle(a.as_quat(), b.as_quat(), convention=LAST)
    assert lb.boresight_angle(
        (turn * a).as_quat(), (turn * b).as_quat(), convention=LAST
    ) == pytest.approx(float(angle), abs=1e-14)
    assert lb.boresight_angle(b.as_quat(), a.as_quat(), convention=LAST) == angle


def test_correcting_by_a_drift_and_back_changes_nothing():
    q = Rotation.random(100, rng=np.random.default_rng(2)).as_quat()
    drift = 1e-3 * np.random.default_rng(3).standard_normal((100, 3))
    there = lb.correct_drift(q, drift, convention=LAST)
    np.testing.assert_allclose(lb.correct_drift(there, -drift, convention=LAST), q, atol=1e-15)
    grid = lb.correct_drift(q.reshape(20, 5, 4), drift.reshape(20, 5, 3), convention=LAST)
    np.testing.assert_array_equal(grid.reshape(100, 4), there)


@pytest.mark.parametrize("true", QuaternionConvention.every(), ids=str)
@pytest.mark.parametrize("believed", QuaternionConvention.every(), ids=str)
def test_a_wrong_convention_is_caught_by_the_design_angle(true, believed):
    turn = pitch(30, 50) * Rotation.from_rotvec([0.3, 0.2, 0.7])
    a, b = (stored(turn * head, true) for head in HEADS)
    if true == believed:
        check_design(a, b, convention=believed, angle_deg=70.0)
        return
    with pytest.raises(ValueError, match="the boresights must stand 70 deg apart") as caught:
        check_design(a, b, convention=believed, angle_deg=70.0)
    assert f"first camera {true}; second camera {true}" in str(caught.value)


def test_the_design_angle_is_that_of_the_boresights_named():
    a, b = (stored(pitch(30, 50) * head, LAST) for head in HEADS)
    check_design(
        a, b, convention=LAST, angle_deg=70.0, boresight=[0.0, 1.0, 0.0]
    )  # the heads differ by a turn about x
    check_design(a, b, convention=LAST, angle_deg=0.0, boresight=[1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="must stand 70 deg apart"):
        check_design(a, b, convention=LAST, angle_deg=70.0, boresight=[1.0, 0.0, 0.0])


def test_heads_of_different_conventions_are_told_apart():
    turn = pitch(30, 50) * Rotation.from_rotvec([0.3, 0.2, 0.7])
    other = QuaternionConvention(scalar="first", direction="inertial_to_camera")
    a, b = stored(turn * HEADS[0], LAST), stored(turn * HEADS[1], other)
    with pytest.raises(
        ValueError, match=f"what would fit: first camera {LAST}; second camera {other}$"
    ):
        check_design(a, b, convention=LAST, angle_deg=70.0)
    with pytest.raises(ValueError, match="no other convention fits either$"):
        check_design(a, b, convention=LAST, angle_deg=12.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: lb.boresight_angle(
                [[0, 0, 0, 1.0], [0, 0, 0, 2.0]], np.tile([0, 0, 0, 1.0], (2, 1)), convention=LAST
            ),
            "first must have unit length to 0.001, but 1 of 2 have not; the first, number 1, has "
            "length 2",
        ),
        (
            lambda: lb.boresight_angle(
                [0, 0, 0, 1.0], np.tile([0, 0, 0, 1.0], (2, 1)), convention=LAST
            ),
            r"second must have shape \(4,\) to match first, got \(2, 4\)",
        ),
        (
            lambda: lb.correct_drift(
                np.tile([0, 0, 0, 1.0], (2, 1)), np.zeros((3, 3)), convention=LAST
            ),
            r"drift must broadcast to \(2, 3\) to match quaternions, got \(3, 3\)",
        ),
        (
            lambda: lb.correct_drift([0, 0, 0, 1.0], np.zeros(3), convention="xyzw"),
            "convention must be a QuaternionConvention, got 'xyzw'",
        ),
        (
            lambda: lb.correct_drift(
                [0, 0, 0, 1.0], np.zeros(3), convention=LAST, installation=2 * np.eye(3)
            ),
            r"installation must be a rotation matrix: orthonormal rows, determinant \+1",
        ),
        (
            lambda: lb.correct_drift([0, 0, 1.0], np.zeros(3), convention=LAST),
            r"quaternions must have shape \(..., 4\)",
        ),
        (
            lambda: QuaternionConvention(scalar="w", direction="camera_to_inertial"),
            "scalar must be one of 'last', 'first', got 'w'",
        ),
        (
            lambda: QuaternionConvention(scalar="last", direction="body"),
            "direction must be one of 'camera_to_inertial', 'inertial_to_camera', got 'body'",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
