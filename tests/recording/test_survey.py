"""What is fixed before a recording is measured, and where its spots are then expected."""

import dataclasses
import pickle

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.background import Ring
from losbench.imaging.results import SpotFlag
from losbench.recording.nodes import places_side_by_side, side_by_side
from losbench.recording.survey import Survey, survey

SENSOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
SPOTS = np.array([[30.0, 25.0], [60.0, 30.0]])


def drifting(n, speed_px=0.1, seed=1):
    truth = SPOTS + speed_px * np.arange(n)[:, None, None] * [1.0, 0.5]
    light = lb.render_spots(truth, 5e4, 2.0, (70, 100)) + 30.0
    return lb.read_recording(SENSOR.expose(light, seed), detector=SENSOR), truth


def surveyed(recording, method=None):
    return survey(recording, recording.stamps[0], SPOTS, method or lb.EIWA(), Ring())


@pytest.mark.parametrize(("n", "looked"), [(1, 1), (9, 9), (64, 64), (300, 64)])
def test_up_to_64_frames_are_looked_at_from_the_first_to_the_last(n, looked):
    found = surveyed(drifting(n)[0])
    assert len(found.frames) == looked
    assert found.frames[[0, -1]].tolist() == [0, n - 1]


def test_a_long_recording_has_a_node_at_least_every_64_frames():
    recording, _ = drifting(1)
    long = lb.read_recording(np.repeat(recording.stamps[0].read(0, 1, skip=False).frames, 5000, 0))
    assert np.diff(surveyed(long).frames).max() == 64


def test_spots_are_expected_between_where_they_were_seen():
    recording, truth = drifting(300)
    found = surveyed(recording)
    np.testing.assert_allclose(found.predicted(0, 300), truth, atol=0.1)
    np.testing.assert_array_equal(found.predicted(7, 60), found.predicted(0, 300)[7:60])


def test_where_a_spot_was_not_seen_its_neighbours_in_time_tell_or_else_the_start():
    path = np.full((3, 2, 2), np.nan)
    path[0, 0], path[2, 0] = 10.0, 14.0
    none = lb.Gain(0.0, np.inf)
    found = Survey(np.array([0, 2, 4]), path, SPOTS, lb.EIWA(13), none, none)
    np.testing.assert_allclose(found.predicted(0, 6)[:, 0, 0], [10, 11, 12, 13, 14, 14])
    np.testing.assert_array_equal(found.predicted(3, 4)[0, 1], SPOTS[1])


def test_a_survey_pickles_and_measures_the_same_elsewhere():
    recording, _ = drifting(20)
    found = surveyed(recording, lb.Weighted())
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(found.path, again.path)
    assert found.method == again.method and found.method.window == 13
    np.testing.assert_allclose(found.method.width, 2.0, rtol=0.03)


def test_squares_side_by_side_hold_the_pixels_around_each_spot():
    frame = np.arange(600, dtype=np.uint16).reshape(1, 20, 30)
    places = np.array([[10.3, 8.0], [28.0, 3.0], [np.nan, np.nan]])
    row = side_by_side(frame, places, 2)
    at = places_side_by_side(places[None], 2)[0]
    assert row.shape == (5, 15)
    np.testing.assert_allclose(at[:2], [[2.3, 2.0], [7.0, 2.0]])
    np.testing.assert_array_equal(row[:, :5], frame[0, 6:11, 8:13])
    np.testing.assert_array_equal(row[:, 5:9], frame[0, 1:6, 26:30])
    assert np.isnan(row[:, 9:]).all()


def test_noise_comes_from_the_detector_or_from_the_frames_and_is_said():
    recording, _ = drifting(40)
    stack = recording.stamps[0].read(0, 40, skip=False).frames
    given = lb.measure(recording, spots=SPOTS)
    assert given.surveys[0].noise is SENSOR and not given.surveys[0].doubts
    assert "Predicted errors rest on the detector: 2 e-/DN, 5 e- read noise." in given.notes
    own = lb.measure(lb.read_recording(stack), spots=SPOTS)
    assert own.surveys[0].noise.per_dn == pytest.approx(0.5, rel=0.2)
    assert any("rest on the noise of the frames, 0." in note for note in own.notes)
    np.testing.assert_allclose(own.sigma_xy_px, given.sigma_xy_px, rtol=0.15)
    assert not own.flags.any()


@pytest.mark.parametrize(
    ("wrong", "number"),
    [({"gain_e_per_dn": 4.0}, "its gain says 0.25"), ({"read_noise_e": 20.0}, "noise say 1")],
)
def test_a_detector_that_the_frames_contradict_is_named_with_its_numbers(wrong, number):
    recording, _ = drifting(40)
    stack = recording.stamps[0].read(0, 40, skip=False).frames
    measured = lb.measure(
        lb.read_recording(stack, detector=dataclasses.replace(SENSOR, **wrong)), spots=SPOTS
    )
    assert any("contradict the detector" in n and number in n for n in measured.notes)


def test_two_frames_of_round_spots_tell_their_noise_by_what_a_gaussian_leaves():
    recording, _ = drifting(2)
    stack = recording.stamps[0].read(0, 2, skip=False).frames
    measured = lb.measure(lb.read_recording(stack), spots=SPOTS)
    assert not measured.flags.any()
    assert measured.surveys[0].noise.per_dn == pytest.approx(0.5, rel=0.3)
    assert any("rest on the noise of the frames, 0." in note for note in measured.notes)
    given = lb.measure(recording, spots=SPOTS)
    np.testing.assert_allclose(measured.sigma_xy_px, given.sigma_xy_px, rtol=0.2)
    wrong = dataclasses.replace(SENSOR, gain_e_per_dn=8.0)
    assert not lb.measure(lb.read_recording(stack, detector=wrong), spots=SPOTS).surveys[0].doubts


def test_two_frames_give_lower_bounds_that_are_flagged_in_table_and_notes():
    """Of spots with wings."""
    row, column = np.mgrid[:70, :100]
    light = sum(3e3 * (1.0 + ((column - x) ** 2 + (row - y) ** 2) / 9.0) ** -2.5 for x, y in SPOTS)
    stack = SENSOR.expose(np.stack([light + 30.0] * 2), 1)
    measured = lb.measure(lb.read_recording(stack), spots=SPOTS)
    flags = measured.table[["flags1", "flags2"]].to_numpy()
    assert (flags & SpotFlag.LOWER_BOUND > 0).all()
    assert any("lower bounds, and flagged LOWER_BOUND" in note for note in measured.notes)
    assert "4 of 4 centroids carry the flag LOWER_BOUND." in measured.notes


def test_what_is_not_said_is_chosen_by_what_the_spots_look_like_and_told():
    recording, truth = drifting(60)
    found = surveyed(recording, lb.AutoCentroid())
    assert isinstance(found.method, lb.Weighted)
    np.testing.assert_allclose(found.method.width, 2.0, rtol=0.03)
    measured = lb.measure(recording, spots=SPOTS)
    assert measured.notes[0] == f"Centroids by {found.reason}."
    assert measured.notes[0].startswith("Centroids by weighted: a Gaussian leaves ")
    pulls = (measured.xy_px - truth) / measured.sigma_xy_px
    assert np.sqrt(np.mean(pulls**2)) == pytest.approx(1.0, abs=0.15)
    told = lb.measure(recording, spots=SPOTS, centroid=lb.EIWA())
    assert not any("Centroids by" in note for note in told.notes)


def test_a_ring_that_drifts_is_measured_by_its_own_shape():
    """Every frame starts on the brightest pixel, which lies anywhere on the ring."""
    rng = np.random.default_rng(3)
    fine = (np.arange(5 * 61) + 0.5) / 5 - 0.5
    truth = 27 + np.linspace(0, 5, 100)[:, None] * [1.0, 0.4] + rng.normal(0.0, 0.05, (100, 2))
    r = np.hypot(fine - truth[:, :1, None], fine[:, None] - truth[:, 1:, None])
    ring = 5e3 * np.exp(-0.5 * ((r - 5.0) / 0.8) ** 2)
    light = ring.reshape(100, 61, 5, 61, 5).mean(axis=(2, 4)) + 100.0
    recording = lb.read_recording(SENSOR.expose(light, rng), detector=SENSOR)
    measured = lb.measure(recording, spots=[[27, 27]], centroid="empirical")
    error = measured.xy_px[:, 0] - truth
    pulls = (error - error.mean(axis=0)) / measured.sigma_xy_px[:, 0]
    assert pulls.std() == pytest.approx(1.0, abs=0.15) and np.abs(pulls).max() < 5.0
    assert not measured.flags.any()


def test_a_shape_is_made_of_the_frames_that_are_looked_at_and_states_its_scatter():
    recording, truth = drifting(200)
    measured = lb.measure(recording, spots=SPOTS, centroid="empirical")
    method = measured.surveys[0].method
    assert isinstance(method, lb.Empirical) and [s.frames for s in method.shape] == [64, 64]
    error = measured.xy_px - truth
    pulls = (error - error.mean(axis=0)) / measured.sigma_xy_px
    assert pulls.std() == pytest.approx(1.0, abs=0.1)
    assert not measured.flags.any()
    few = lb.read_recording(recording.stamps[0].read(0, 9, skip=False).frames[:, :, :45])
    with pytest.raises(ValueError, match="needs 10 windows of one size .* got 9"):
        lb.measure(few, spots=SPOTS[:1], centroid="empirical")


@pytest.mark.parametrize(("level", "clipped"), [(2.0, True), (40.0, False)])
def test_black_that_is_clipped_is_told(level, clipped):
    rng = np.random.default_rng(3)
    light = lb.render_spots(SPOTS, 5e4, 2.0, (70, 100)) + level
    frames = np.rint(rng.normal(light, 4.0, (20, *light.shape))).clip(0, 65535).astype(np.uint16)
    notes = lb.measure(lb.read_recording(frames), spots=SPOTS).notes
    assert any("black is clipped" in note for note in notes) == clipped
