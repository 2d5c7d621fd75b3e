"""Numbers of a measurement's own steps, from either side: where spots may stand, which frame is the
reference, how far they may wander, what a report counts."""

import cv2
import numpy as np
import pytest

import losbench as lb
from losbench.recording import follow
from losbench.recording.follow import measured
from losbench.recording.nodes import places_side_by_side, side_by_side
from losbench.recording.reference import Reference, shifts_from
from losbench.recording.starts import check_shape, first_places
from losbench.recording.survey import Survey, survey
from losbench.recording.track import Track

RNG = np.random.default_rng(23)


def recording_of(frames, **options):
    return lb.read_recording(np.asarray(frames), period_s=1.0, **options)


# Where spots stand


@pytest.mark.parametrize(
    ("spot", "inside"),
    [
        ((-0.5, -0.5), True),
        ((49.5, 39.5), True),
        ((-0.51, 5.0), False),
        ((5.0, -0.51), False),
        ((49.51, 5.0), False),
        ((5.0, 39.51), False),
        ((0.2, 0.2), True),
    ],
)
def test_a_spot_may_stand_as_far_as_pixels_reach(spot, inside):
    recording = recording_of(np.zeros((2, 40, 50), np.uint16))
    if inside:
        np.testing.assert_array_equal(first_places(recording, [spot])[0], [spot])
    else:
        with pytest.raises(ValueError, match="spots must lie inside the 40x50 frame"):
            first_places(recording, [spot])


def test_spots_are_given_on_the_detector_and_stand_in_the_region():
    part = recording_of(np.zeros((2, 40, 50), np.uint16), roi=(5, 6, 20, 10))
    np.testing.assert_array_equal(first_places(part, [(15.0, 12.0)])[0], [(10.0, 6.0)])
    for outside in ((4.0, 12.0), (15.0, 5.0), (25.0, 12.0), (15.0, 16.0)):
        with pytest.raises(ValueError, match="spots must lie inside the 10x20 frame"):
            first_places(part, [outside])


def test_a_camera_has_the_shape_of_the_whole_frame():
    whole = recording_of(np.zeros((2, 40, 50), np.uint16))
    part = recording_of(np.zeros((2, 40, 50), np.uint16), roi=(5, 6, 20, 10))
    camera = lb.Camera(focal_mm=50.0, pixel_um=5.0, shape=(40, 50))
    for recording in (whole, part):
        check_shape(recording, camera)
        check_shape(recording, None)
        other = lb.Camera(focal_mm=50.0, pixel_um=5.0, shape=(10, 20))
        with pytest.raises(
            ValueError, match=r"the shape of the frames, \(40, 50\), got \(10, 20\)"
        ):
            check_shape(recording, other)


# The reference


@pytest.mark.parametrize("axis", [0, 1])
def test_the_reference_is_the_first_frame_that_shows_every_spot(axis):
    xy = RNG.random((5, 3, 2))
    xy[0, 1], xy[1, 2] = np.nan, np.nan
    sigma = 0.01 + RNG.random((5, 3, 2))
    first = shifts_from(xy, sigma, "first")
    assert first.frame == 2
    np.testing.assert_array_equal(first.xy_px, xy[2])
    np.testing.assert_array_equal(first.sigma_px, sigma[2])
    assert first.notes == ["Shifts count from frame 2, the first that shows every spot."]
    assert Reference.first_whole(xy[2:], sigma[2:]).notes == []
    xy[2:, axis] = np.nan
    with pytest.raises(ValueError, match=rf"spot \[{axis + 1}\] is in none of 3"):
        Reference.first_whole(xy[2:], sigma[2:])
    with pytest.raises(ValueError, match="all 3 at once are in none of 2"):
        Reference.first_whole(xy[:2] if axis else xy[[1, 0]], sigma[:2])


def test_the_mean_of_frames_has_the_error_of_a_mean():
    xy, sigma = RNG.random((6, 2, 2)), np.full((6, 2, 2), 0.3)
    xy[0, 1] = sigma[0, 1] = np.nan
    mean = shifts_from(xy, sigma, 4)
    np.testing.assert_allclose(mean.xy_px[0], xy[:4, 0].mean(axis=0))
    np.testing.assert_allclose(mean.xy_px[1], xy[1:4, 1].mean(axis=0))
    np.testing.assert_allclose(mean.sigma_px, [[0.15] * 2, [0.3 / np.sqrt(3)] * 2])
    assert mean.frame == 0 and mean.notes == []
    with pytest.raises(ValueError, match=r"spot \[2\] is in none of 1"):
        shifts_from(xy, sigma, 1)


# Tracks


@pytest.mark.parametrize(("off", "near"), [(1.4, True), (1.5, False), (-1.6, False)])
def test_a_spot_is_near_its_place_below_the_reach(off, near):
    places = np.zeros((3, 2, 2))
    xy = places.copy()
    xy[1, 0, 1] = off
    track = Track(xy, xy, np.zeros((3, 2), int))
    assert track.near(places, 1.5).tolist() == [True, near, True]
    xy[1, 0, 1] = np.nan
    assert track.near(places, 1.5).tolist() == [True, False, True]


def test_only_frames_that_lack_a_spot_are_measured_again(monkeypatch):
    """Two lost within a block, and a spot that wanders out of reach, comes back and goes on."""
    path = np.zeros((24, 2, 2)) + np.array([[20.0, 20.0], [60.0, 20.0]])
    path[10:15, 1, 1] += np.array([2.0, 4.0, 5.0, 4.0, 2.0])
    light = np.full((24, 2), 1e5)
    light[[3, 20], 1] = 0.0
    detector = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
    pairs = zip(path, light, strict=True)
    clean = [lb.render_spots(xy, flux, 1.5, (40, 80)) + 40.0 for xy, flux in pairs]
    recording = recording_of(detector.expose(np.stack(clean), 1), detector=detector)
    under, start = lb.Ring(15), path[0]
    held = Survey(np.array([0, 23]), path[[0, 23]], start, lb.EIWA(9, centre="peak"), detector)
    calls = []
    monkeypatch.setattr(
        follow, "centroid", lambda *a, **k: calls.append(len(a[0])) or lb.centroid(*a, **k)
    )
    track = measured(recording, recording.stamps[0], held, under, 0, 24)
    off = np.abs(track.xy - path).max(axis=(1, 2))
    assert np.flatnonzero(~(off < 0.1)).tolist() == [3, 20]
    assert calls[0] == 24 and 7 <= len(calls) - 1 <= 9  # 2 lost, 5 away, and the way back


# The survey


def test_spots_are_expected_on_straight_lines_between_where_they_were_seen():
    path = np.array(
        [[[0.0, 0.0], [5.0, 5.0]], [[np.nan, np.nan], [7.0, 9.0]], [[20.0, 10.0], [8.0, 3.0]]]
    )
    seen = Survey(np.array([0, 4, 10]), path, np.array([[1.0, 1.0], [2.0, 2.0]]), lb.EIWA(9))
    expected = seen.predicted(2, 7)
    assert expected.shape == (5, 2, 2)
    at = np.arange(2, 7)
    np.testing.assert_allclose(expected[:, 0], np.stack([2.0 * at, 1.0 * at], axis=-1))
    np.testing.assert_allclose(expected[:, 1, 0], np.interp(at, [0, 4, 10], [5, 7, 8]))
    lost = Survey(np.array([0, 4]), np.full((2, 2, 2), np.nan), seen.start, lb.EIWA(9))
    np.testing.assert_array_equal(lost.predicted(0, 3), np.broadcast_to(seen.start, (3, 2, 2)))


def test_squares_side_by_side_show_what_stood_around_each_spot():
    frame = RNG.integers(0, 900, (1, 30, 40)).astype(np.uint16)
    places = np.array([[10.3, 12.6], [1.0, 28.0], [np.nan, np.nan]])
    cut, at = side_by_side(frame, places, 4), places_side_by_side(places[None], 4)
    assert cut.shape == (9, 27)
    np.testing.assert_array_equal(cut[:, :9], frame[0, 9:18, 6:15])
    second = cut[:, 9:18]
    np.testing.assert_array_equal(second[:6, 3:], frame[0, 24:30, 0:6])
    assert np.isnan(second[6:]).all() and np.isnan(second[:, :3]).all()
    assert np.isnan(cut[:, 18:]).all()
    np.testing.assert_allclose(at[0, 0], [4.3, 3.6])
    np.testing.assert_allclose(at[0, 1], [9 + 4.0, 4.0])
    assert np.isnan(at[0, 2]).all()


@pytest.mark.parametrize(
    ("n", "nodes"), [(1, 1), (40, 40), (64, 64), (4033, 64), (4034, 65), (4097, 65), (4098, 66)]
)
def test_64_frames_are_looked_at_or_every_64th(n, nodes):
    one = lb.render_spots([[12.0, 11.0]], 4e4, 1.5, (24, 26)).round().astype(np.uint16)
    recording = recording_of(np.broadcast_to(one, (n, 24, 26)))
    stamp = recording.stamps[0]
    seen = survey(recording, stamp, np.array([[12.0, 11.0]]), lb.EIWA(9), lb.Ring())
    assert len(seen.frames) == nodes
    assert seen.frames[0] == 0 and seen.frames[-1] == n - 1
    np.testing.assert_allclose(seen.path, np.tile([12.0, 11.0], (nodes, 1, 1)), atol=0.01)


# Following


def test_frames_that_cannot_be_read_show_nothing(tmp_path):
    frames, xy = spots_that_jump(0.0)
    for k, frame in enumerate(frames):
        assert cv2.imwrite(str(tmp_path / f"a-{k}.png"), frame)
    (tmp_path / "a-2.png").write_bytes(b"no image")
    recording = lb.read_recording(tmp_path, period_s=1.0, on_unreadable="skip")
    ahead = Survey(np.array([0]), xy[:1], xy[0], lb.EIWA(13, centre="peak"))
    whole = measured(recording, recording.stamps[0], ahead, lb.Ring(), 0, 6)
    alone = measured(recording, recording.stamps[0], ahead, lb.Ring(), 2, 3)
    for track, k in ((whole, 2), (alone, 0)):
        assert np.isnan(track.xy[k]).all() and np.isnan(track.sigma[k]).all()
        assert (track.flags[k] == lb.SpotFlag.MISSING).all()
        assert list(track.skipped) == [2]
        assert track.skipped[2].startswith("a-2.png cannot be read")
    assert alone.xy.shape == alone.sigma.shape == (1, 2, 2)
    assert np.isfinite(np.delete(whole.xy, 2, axis=0)).all()


def spots_that_jump(by, at=3, n=6):
    xy = np.tile([[30.0, 25.0], [60.0, 40.0]], (n, 1, 1))
    xy[at:] += by
    light = lb.render_spots(xy, 4e4, 2.0, (70, 90)) + 100.0
    return lb.Detector().expose(light, 3), xy


@pytest.mark.parametrize("by", [0.5, 2.0, 6.0])
def test_spots_that_wander_within_a_block_are_followed_frame_by_frame(by):
    """The survey knows the first frame only; a spot is found a quarter of the window away."""
    frames, xy = spots_that_jump(by)
    recording = recording_of(frames)
    ahead = Survey(np.array([0]), xy[:1], xy[0], lb.EIWA(13, centre="peak"))
    track = measured(recording, recording.stamps[0], ahead, lb.Ring(), 0, 6)
    if by < 3.0:
        np.testing.assert_allclose(track.xy, xy, atol=0.1)
    assert track.xy.shape == (6, 2, 2)
    steps = np.stack(
        [
            measured(recording, recording.stamps[0], ahead, lb.Ring(), k, k + 1).xy[0]
            for k in range(3)
        ]
    )
    np.testing.assert_allclose(track.xy[:3], steps, atol=1e-9)


def test_a_drift_is_followed_further_than_one_window_reaches():
    xy = np.array([30.0, 25.0]) + np.arange(12)[:, None, None] * np.array([2.0, 1.0])
    frames = lb.Detector().expose(lb.render_spots(xy, 4e4, 2.0, (70, 90)) + 100.0, 3)
    recording = recording_of(frames)
    ahead = Survey(np.array([0]), xy[:1], xy[0], lb.EIWA(13, centre="peak"))
    track = measured(recording, recording.stamps[0], ahead, lb.Ring(), 0, 12)
    np.testing.assert_allclose(track.xy, xy, atol=0.1)


# Belief


def test_the_share_of_small_p_values_is_that_below_a_twentieth():
    p = np.array([0.01, 0.02, 0.049, 0.05, 0.3, 0.9, np.nan, 0.5, 0.6, 0.7])
    told = lb.Belief(
        ratio_error=np.full(3, 0.1),
        scatter_px=np.ones((3, 2)),
        predicted_px=np.ones((3, 2)),
        p_value=p,
        flags={},
        n_centroids=30,
    ).to_dict()
    known = p[np.isfinite(p)]
    assert told["p_value_median"] == pytest.approx(np.median(known))
    assert told["p_value_below_0.05"] == pytest.approx(3 / 9, abs=1e-4)
