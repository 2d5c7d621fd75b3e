"""Spots that jump are found again, with a flag; where two finds may be the spot, neither is it."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.results import SpotFlag
from losbench.recording.acquire import Known, found_again, same_light

SENSOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


def jumping(n=9, sigma=8.0, spots=1, flux=2e6, seed=11):
    """Frames of spots that jump together by 40 to 100 px from frame to frame, and where they are."""
    rng = np.random.default_rng(seed)
    centre = [np.array([200.0, 160.0])]
    while len(centre) < n:
        step = rng.uniform(40.0, 100.0) * np.array(
            [np.cos(t := rng.uniform(0, 2 * np.pi)), np.sin(t)]
        )
        if ((centre[-1] + step > 70) & (centre[-1] + step < [330, 250])).all():
            centre.append(centre[-1] + step)
    apart = np.array([[0.0, 0.0], [55.0, 20.0], [-30.0, 50.0]])[:spots]
    truth = np.stack(centre)[:, None] + apart
    light = lb.render_spots(truth, flux, sigma, (320, 400)) + 30.0
    return SENSOR.expose(light, rng), truth


@pytest.mark.parametrize("detector", [SENSOR, None])
def test_nine_frames_of_a_beam_that_jumps_give_nine_rows(detector):
    frames, truth = jumping()
    measured = lb.measure(lb.read_recording(frames, detector=detector))
    assert len(measured.table) == 9
    np.testing.assert_allclose(measured.xy_px, truth, atol=0.1)
    assert np.isfinite(measured.sigma_xy_px).all()


def test_spots_that_jump_together_keep_their_numbers():
    frames, truth = jumping(sigma=2.0, spots=3, flux=2e5)
    measured = lb.measure(lb.read_recording(frames, detector=SENSOR), spots=truth[0])
    np.testing.assert_allclose(measured.xy_px, truth, atol=0.06)


def test_a_spot_that_is_off_for_a_frame_between_the_nodes_is_found_again_and_flagged():
    truth = np.broadcast_to(np.array([[60.0, 50.0], [140.0, 60.0]]), (200, 2, 2)).copy()
    truth[101] += [30.0, 20.0]
    frames = SENSOR.expose(lb.render_spots(truth, 2e5, 2.0, (100, 200)) + 30.0, 3)
    measured = lb.measure(lb.read_recording(frames, detector=SENSOR), spots=2)
    np.testing.assert_allclose(measured.xy_px, truth, atol=0.06)
    again = (measured.flags & SpotFlag.FOUND_AGAIN) > 0
    assert again[101].all() and again.sum() == 2


def test_another_star_is_not_taken_for_a_lost_one():
    """Of unlisted ones as bright, and one that comes with another brightness."""
    xy = np.array([[60.0, 50.0], [140.0, 60.0], [30.0, 80.0]])
    frames = SENSOR.expose(
        lb.render_spots(np.broadcast_to(xy, (9, 3, 2)), 2e5, 2.0, (100, 200)) + 30.0, 4
    )
    frames[5] = SENSOR.expose(lb.render_spots(xy[1:], 2e5, 2.0, (100, 200)) + 30.0, 5)
    lone = lb.measure(lb.read_recording(frames, detector=SENSOR), spots=xy[:1])
    assert np.flatnonzero(np.isnan(lone.xy_px[:, 0, 0])).tolist() == [5]
    frames[5] = SENSOR.expose(lb.render_spots([[90.0, 30.0]], 9e5, 2.0, (100, 200)) + 30.0, 5)
    lone = lb.measure(lb.read_recording(frames, detector=SENSOR), spots=xy[:1])
    assert np.flatnonzero(np.isnan(lone.xy_px[:, 0, 0])).tolist() == [5]


def test_one_shift_of_all_decides_and_two_that_fit_do_not():
    rng = np.random.default_rng(1)
    places = np.array([[30.0, 30.0], [60.0, 40.0]])
    lost = np.array([True, True])
    known = Known(places, np.full(2, 13), np.full(2, np.nan), np.zeros((0, 2)))

    def image(*shifts):
        xy = np.concatenate([places + shift for shift in shifts])
        return lb.render_spots(xy, 1e4, 2.0, (120, 200)) + rng.normal(20.0, 2.0, (120, 200))

    (one,) = found_again(image([50.0, 25.0]), places, lost, known)
    np.testing.assert_allclose(one, places + np.array([50.0, 25.0]), atol=1.5)
    assert found_again(image([50.0, 25.0], [90.0, 40.0]), places, lost, known) == []
    assert found_again(rng.normal(20.0, 2.0, (120, 200)), places, lost, known) == []


def test_light_is_alike_within_a_factor_of_two():
    told = same_light(np.array([1.9, 2.1, 0.51, 0.49, 7.0]), np.array([1.0, 1.0, 1.0, 1.0, np.nan]))
    assert told.tolist() == [True, False, True, False, True]
