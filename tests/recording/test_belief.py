"""What the data say of themselves is right where the truth is known, and silent where it is too little."""

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import losbench as lb
from losbench.recording.belief import drift_slope, sampling_error, second_differences
from losbench.recording.report import write_report
from losbench.recording.second import second_opinion

CHECKS = (
    "checks.py",
    "imaging/common.py",
    "recording/stamps.py",
    "recording/readers.py",
)
HANDING_OUT = ("parts.py", "spread.py", "recording/effort.py", "recording/work.py")
CHECKING = ("__post_init__", "distinct_points", "checked_points")
SPOTS = np.array([[40.0, 30.0], [110.0, 32.0]])
SHAPE = (70, 150)
DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=SHAPE)


def recording(n=150, drift_px=1.5, shake_px=0.0, seed=1, detector=DETECTOR):
    rng = np.random.default_rng(seed)
    path = np.linspace(0.0, drift_px, n)[:, None, None] * [1.0, 0.4]
    path = path + rng.normal(0.0, shake_px, (n, 1, 2)) if shake_px else path
    light = lb.render_spots(SPOTS + path, 1e5, 2.0, SHAPE) + 40.0
    return lb.read_recording(DETECTOR.expose(light, rng), detector=detector)


def test_the_scatter_of_second_differences_is_that_of_white_noise_whatever_the_drift():
    rng = np.random.default_rng(2)
    path = np.cumsum(np.cumsum(rng.normal(0, 1e-4, (400, 300, 1)), axis=0), axis=0)
    scatter, count = second_differences(path + rng.normal(0.0, 0.02, (400, 300, 2)))
    assert (count == 398).all()
    assert abs(scatter.mean() / 0.02 - 1) < 0.005
    # the sampling error that is stated is the one of 600 such series
    assert abs((scatter / 0.02).std() / sampling_error(count)[0] - 1) < 0.1


def test_few_second_differences_tell_nothing():
    assert np.isnan(sampling_error(np.array([9]))).all()
    assert np.isfinite(sampling_error(np.array([10]))).all()
    belief = lb.measure(recording(n=6)).belief()
    assert belief.sentences()[0] == "Scatter over predicted error: too few frames to tell."
    assert np.isnan(second_differences(np.zeros((2, 1, 2)))[0]).all()


def test_an_honest_run_is_as_predicted():
    belief = lb.measure(recording(), CAMERA).belief()
    assert belief.sentences()[0].endswith(": as predicted.")
    assert np.abs(belief.ratio - 1).max() < 4 * belief.ratio_error.max()
    assert belief.flags == {} and belief.n_centroids == 300
    assert "Flags of 300 centroids: none." in belief.sentences()
    assert 0.0 < np.median(belief.p_value[1:]) < 1.0


@pytest.mark.parametrize(
    ("run", "said"),
    [
        (recording(shake_px=0.03), "scatter more than predicted"),
        (recording(detector=replace(DETECTOR, gain_e_per_dn=0.3)), "scatter less than predicted"),
    ],
)
def test_a_run_that_shakes_or_has_a_wrong_gain_is_told(run, said):
    assert said in lb.measure(run).belief().sentences()[0]


def test_two_centroids_that_see_the_same_drift_have_a_slope_of_one():
    run = recording()
    measured = lb.measure(run)
    slope = measured.belief(lb.measure(run, centroid="weighted")).slope
    assert abs(slope.value - 1) < 3 * slope.error < 0.03
    # a window that stays loses light at its edges and hardly follows
    narrow = lb.Grey(5, centre="start")
    stuck = second_opinion(run, measured, narrow, background=lb.Level(150.0), most=150)
    stuck = replace(stuck, shifts_px=0.6 * measured.shifts_px)
    assert measured.belief(stuck).slope.value == pytest.approx(0.6, abs=0.01)


def test_a_second_opinion_leaves_frames_out_and_agrees_with_the_first():
    run = recording()
    measured = lb.measure(run)
    other = second_opinion(run, measured, lb.EIWA(), most=40)
    seen = np.isfinite(other.xy_px[:, 0, 0])
    assert seen.sum() == 40 and seen[0] and seen[-1]
    np.testing.assert_allclose(other.xy_px[seen], measured.xy_px[seen], atol=0.01)


def test_without_a_drift_the_slope_is_not_known():
    run = recording(drift_px=0.0)
    measured = lb.measure(run)
    belief = measured.belief(lb.measure(run, centroid="weighted"))
    assert np.isnan(belief.slope.value)
    assert belief.sentences()[-1].endswith("the drift is too small to tell.")


def test_noise_of_the_second_series_is_in_the_slope_s_error():
    rng = np.random.default_rng(5)
    drift = np.linspace(0.0, 0.5, 400)[:, None, None] * np.ones((1, 2, 2))
    noise = 0.02
    pulls = []
    for _ in range(100):
        one, two = (drift + rng.normal(0.0, noise, drift.shape) for _ in range(2))
        slope = drift_slope(one, two, np.full(drift.shape, noise))
        pulls.append((slope.value - 1) / slope.error)
    assert np.mean(np.abs(pulls) < 2) > 0.9
    assert np.abs(np.mean(pulls)) < 1.0


def test_another_number_of_frames_is_no_second_opinion():
    with pytest.raises(ValueError, match=r"other must be of the same frames and spots, \(150, 2\)"):
        lb.measure(recording()).belief(lb.measure(recording(n=20)))


@pytest.mark.usefixtures("undrawn")
def test_belief_is_in_the_report_and_shows_itself(tmp_path):
    run = recording(n=40)
    measured = lb.measure(run, CAMERA)
    belief = measured.belief()
    lines = write_report(measured, tmp_path, recording=run)
    assert all(sentence in lines for sentence in belief.sentences())
    written = json.loads((tmp_path / "report.json").read_text())["belief"]
    np.testing.assert_allclose(written["scatter_over_predicted"], belief.ratio, atol=1e-4)
    assert written["flags"] == {} and written["slope_between_centroids"] is None
    assert belief.to_frame().index.tolist() == ["x1", "y1", "x2", "y2"]
    for shown in (belief, measured):
        assert len(shown._repr_html_().splitlines()) <= 13
    assert "±" in measured._repr_html_()
    assert measured.to_frame() is measured.table


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"centroid": lb.Weighted(2.0, window=13), "background": lb.Ring(15)},
        {"centroid": lb.EIWA(13, hot_pixel_gate=True), "run": lb.Run(chunk=64)},
    ],
    ids=str,
)
def test_a_call_enters_no_file_more_than_twice(options):
    """Runs of calls in one file. Apart: readers, checks of fields, what hands out chunks, what one
    linear solve does, and the survey, which goes the same way frame by frame.
    """
    run, root = recording(n=20, drift_px=0.0), Path(lb.__file__).parent
    lb.measure(run, CAMERA, **options)
    stays, surveying = [], []

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event not in ("call", "return") or not path.is_relative_to(root):
            return
        name = str(path.relative_to(root))
        if (name, frame.f_code.co_name) == ("recording/survey.py", "survey"):
            surveying[:] = ["on"] if event == "call" else []
        if event == "return" or surveying:
            return
        checks = name in {*CHECKS, *HANDING_OUT} or frame.f_code.co_name in CHECKING
        if checks or name.startswith(("recording/frames", "estimation", "pointing/attitude")):
            return
        if not stays or stays[-1] != name:
            stays.append(name)
            if stays[-4:-2] == stays[-2:]:  # an iteration that looks and steps is one stay in both
                del stays[-2:]

    sys.setprofile(note)
    try:
        lb.measure(run, CAMERA, **options)
    finally:
        sys.setprofile(None)
    often = {name: count for name, count in Counter(stays).items() if count > 2}
    assert not often, "\n".join(stays)
    assert len(set(stays)) > 12
