"""A recording whose spots differ in size: each has its own window, from the survey to the report."""

import json

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.places import evenly
from losbench.imaging.results import SpotFlag
from losbench.recording.pictures import frame_figure, windows_px
from losbench.recording.report import write_report
from losbench.recording.second import second_opinion

SENSOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
SPOTS = np.array([[40.0, 40.0], [130.0, 95.0]])
SIZES = ((4e4, 1.5), (2e6, 12.0))


def recorded(truth, seed=5, shape=(200, 260), detector=SENSOR):
    light = sum(
        lb.render_spots(truth[:, [k]], flux, sigma, shape) for k, (flux, sigma) in enumerate(SIZES)
    )
    return lb.read_recording(SENSOR.expose(light + 30.0, seed), detector=detector)


def drifting(n, seed=5):
    drift = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.05, (n, 1, 2)), axis=0)
    return SPOTS + drift


@pytest.fixture(scope="module")
def measured():
    truth = drifting(150)
    recording = recorded(truth, detector=None)
    return recording, lb.measure(recording, spots=SPOTS), truth


def test_a_star_and_a_beam_have_a_window_and_a_width_each(measured):
    _, found, truth = measured
    (survey,) = found.surveys
    assert survey.method.window == (9, 73) and survey.sides.tolist() == [9, 73]
    np.testing.assert_allclose(np.mean(survey.method.width, axis=1), [1.5, 12.0], rtol=0.02)
    error = found.xy_px - truth
    np.testing.assert_allclose(
        np.sqrt(np.mean((error / found.sigma_xy_px) ** 2, axis=(0, 2))), 1.0, atol=0.12
    )
    assert (error.std(axis=(0, 2)) < 0.012).all()  # with one window for both, the beam: 0.5 px


def test_the_report_says_the_window_of_each_spot(measured, tmp_path):
    recording, found, _ = measured
    write_report(found, tmp_path, recording=recording)
    spots = json.loads((tmp_path / "report.json").read_text())["spots"]
    assert [spot["window_px"] for spot in spots] == [9, 73] == windows_px(found)
    assert len(frame_figure(found, recording).axes) == 3


def test_the_bytes_do_not_depend_on_how_the_work_is_split(measured):
    recording, found, _ = measured
    other = lb.measure(recording, spots=SPOTS, run=lb.Run(chunk=32))
    for name in ("xy_px", "sigma_xy_px", "flags"):
        assert getattr(found, name).tobytes() == getattr(other, name).tobytes()


def test_a_second_opinion_looks_through_the_same_windows(measured):
    recording, found, truth = measured
    other = second_opinion(recording, found, "eiwa", most=40)
    seen = np.isfinite(other.xy_px).all(axis=(1, 2))
    assert seen.sum() == 40
    assert (np.abs(other.xy_px[seen] - truth[seen]).max(axis=(0, 2)) < [0.05, 0.08]).all()


@pytest.mark.parametrize("method", ["eiwa", "weighted"])
def test_spots_of_two_sizes_that_jump_together_are_found_again(method):
    """In one frame that the survey leaves out."""
    n = 90
    out = int(np.setdiff1d(np.arange(n), evenly(n, 64))[20])
    truth = np.repeat(SPOTS[None], n, axis=0)
    truth[out] += [60.0, 35.0]
    found = lb.measure(recorded(truth), spots=SPOTS, centroid=method)
    np.testing.assert_allclose(found.xy_px, truth, atol=0.1)
    again = found.flags & SpotFlag.FOUND_AGAIN > 0
    assert again[out].all() and again.sum() == 2
