"""What a report says of a measurement: counts, shares, spans and doubts, from either side."""

import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.imaging.results import SpotFlag
from losbench.recording import pictures
from losbench.recording.belief import Belief, Slope, drift_slope, sampling_error, second_differences
from losbench.recording.notes import notes_on_frames
from losbench.recording.sections import (
    Told,
    against,
    angles,
    answers,
    flags,
    scatter,
    spots,
    temperatures,
)
from losbench.recording.table import measurement_table
from losbench.recording.table import temperatures as at_frames
from losbench.recording.track import Track
from losbench.units import arcsec_to_rad

RNG = np.random.default_rng(31)
N = 100
ANGLES = np.array([3.0, -5.0, 4.0]) * np.linspace(0, 1, N)[:, None]  # arcsec


def measured(n_spots=3, *, attitude=True, lost=0, marked=0, **changes):
    xy = np.tile(np.array([[20.0, 30.0]]) + 25.0 * np.arange(n_spots)[:, None], (N, 1, 1))
    xy[:lost, 0] = np.nan
    shifts = np.linspace(0.0, 1.0, N)[:, None, None] * np.arange(1.0, 2 * n_spots + 1).reshape(
        -1, 2
    )
    raised = np.zeros((N, n_spots), int)
    raised.ravel()[:marked] = int(SpotFlag.RING)
    celsius = np.linspace(18.0, 21.5, N)
    celsius[:7] = np.nan
    fit = SimpleNamespace(
        angles=arcsec_to_rad(ANGLES),
        cov=arcsec_to_rad(1.0) ** 2 * np.tile(np.diag([0.04, 0.09, 0.25]), (N, 1, 1)),
        residuals=1e-3 * RNG.standard_normal((N, n_spots, 2)),
    )
    return SimpleNamespace(
        xy_px=xy,
        shifts_px=shifts,
        flags=raised,
        reference_px=xy[-1],
        attitude=fit if attitude else None,
        table=pd.DataFrame({"frame": np.arange(N), "temperature_box_degC": celsius}),
        notes=["a note"],
        **{"surveys": ()} | changes,
    )


def belief(scatter=1.0, error=0.1, p_value=None, slope=None, spots=3):
    return Belief(
        scatter_px=np.full((spots, 2), 0.01) * scatter,
        predicted_px=np.full((spots, 2), 0.01),
        ratio_error=np.full(spots, error),
        flags={"RING": 4},
        n_centroids=N * spots,
        p_value=p_value,
        slope=slope,
    )


def told(measurement=None, of=None, detector=True):
    recording = SimpleNamespace(detector=lb.Detector() if detector else None)
    return Told(measurement or measured(), recording, of or belief(), None)


# Answers


@pytest.mark.parametrize(
    ("lost", "word", "state", "known"),
    [(0, "Yes", "good", 300), (1, "In part", "care", 299), (100, "In part", "care", 200)],
)
def test_it_worked_as_far_as_positions_are_known(lost, word, state, known):
    answer = answers(told(measured(lost=lost)))[0]
    assert (answer.word, answer.state) == (word, state)
    assert answer.text == f"{known} of 300 positions measured: 3 spots in 100 frames."


def test_where_no_position_is_known_it_did_not_work():
    lost = measured(1, lost=N)
    assert answers(told(lost, belief(spots=1)))[0].word == "No"


@pytest.mark.parametrize(("marked", "doubted"), [(3, False), (4, True)])
def test_one_centroid_in_a_hundred_may_carry_a_flag(marked, doubted):
    """Of 300."""
    answer = answers(told(measured(marked=marked)))[1]
    assert (answer.word == "With care") == doubted
    if doubted:
        assert answer.text == "1 % of the centroids carry a flag."


@pytest.mark.parametrize(("below", "doubted"), [(30, False), (31, True)])
def test_a_tenth_of_small_p_values_and_two_of_its_errors_are_too_many(below, doubted):
    p = np.where(np.arange(104) < below, 0.049, 0.051)
    p[100:] = np.nan
    answer = answers(told(of=belief(p_value=p)))[1]
    assert ("only turns" in answer.text) == doubted


@pytest.mark.parametrize(("value", "doubted"), [(1.029, False), (1.031, True), (0.969, True)])
def test_two_centroids_disagree_beyond_three_errors(value, doubted):
    answer = answers(told(of=belief(slope=Slope(value, 0.01))))[1]
    assert ("disagree" in answer.text) == doubted


def test_no_more_than_two_doubts_are_named():
    p = np.full(100, 0.01)
    everything = told(measured(marked=40), belief(3.0, p_value=p, slope=Slope(2.0, 0.01)))
    text = answers(everything)[1].text
    assert "scatter more" in text and "carry a flag" in text and "only turns" not in text
    assert text.endswith("And 2 more, below.")
    below = against(everything)
    assert all(said in below for said in ("carry a flag", "only turns", "Two centroids disagree"))
    assert against(told()) == ""


def test_what_cannot_be_tested_comes_last():
    answer = answers(told(measured(marked=40), belief(error=np.nan)))[1]
    assert answer.text.endswith("Scatter over predicted error: too few frames to tell.")


@pytest.mark.parametrize("doubted", [False, True])
def test_a_detector_that_the_frames_contradict_is_doubted_and_would_change_the_errors(doubted):
    survey = SimpleNamespace(doubts=("a doubt",) * doubted, method=lb.EIWA(13))
    known = measured(surveys=(survey,))
    asked = answers(told(known))
    assert (asked[1].text == "The frames contradict the detector.") is doubted
    assert asked[3].word == ("2 things" if doubted else "1 thing")


def test_the_number_is_the_widest_span():
    answer = answers(told())[2]
    assert answer.word == "5 arcsec"
    assert answer.text == (
        "peak to valley about Y, the largest of three axes, where one frame is known to ± 0.3 "
        "(1 sigma); 3 about X (± 0.2), 4 about Z (± 0.5)."
    )
    shifts = answers(told(measured(attitude=False)))[2]
    assert (shifts.word, shifts.text) == ("6 px", "peak to valley of spot 3 along y.")


@pytest.mark.parametrize(
    ("n_spots", "attitude", "detector", "count", "first"),
    [
        (3, True, True, 1, "Temperatures that move"),
        (3, True, False, 2, "Temperatures that move"),
        (2, True, True, 2, "Temperatures that move"),
        (2, True, False, 3, "Temperatures that move"),
        (2, False, True, 1, "A camera"),
        (3, False, False, 2, "A camera"),
    ],
)
def test_what_would_change_the_numbers_is_counted(n_spots, attitude, detector, count, first):
    known = told(measured(n_spots, attitude=attitude), belief(spots=n_spots), detector)
    answer = answers(known)[3]
    assert answer.word == f"{count} thing{'s' * (count > 1)}"
    assert answer.text.startswith(first)


# Sections


def cells(html, row):
    """Cells of the row of a table that begins with so much."""
    for line in re.findall(r"<tr>(.*?)</tr>", html, re.DOTALL):
        found = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", line, re.DOTALL)
        if found[0] == str(row):
            return found[1:]
    raise AssertionError(html)


def test_spots_are_counted_as_seen_and_as_flagged():
    html = spots(told(measured(lost=8, marked=4)))
    assert cells(html, 1) == ["20.000", "30.000", "", "92", "2"]
    assert cells(html, 2) == ["45.000", "55.000", "", "100", "1"]
    assert "Spots, in 100 frames" in html


def test_angles_have_their_rms_span_and_error():
    html = angles(told())
    for i, name in enumerate("XYZ"):
        found = [float(cell) for cell in cells(html, name)]
        expected = [ANGLES[:, i].std(), np.ptp(ANGLES[:, i]), (0.2, 0.3, 0.5)[i]]
        np.testing.assert_allclose(found, expected, rtol=2e-3)
    assert angles(told(measured(attitude=False))) == ""


def test_temperatures_have_their_ends_and_frames():
    low, high, frames = cells(temperatures(told()), "temperature_box")
    celsius = np.linspace(18.0, 21.5, N)[7:]
    assert [float(low), float(high)] == pytest.approx([celsius[0], 21.5], rel=1e-3)
    assert frames == "93"


def test_scatter_and_flags_are_those_of_the_belief():
    of = Belief(
        scatter_px=np.array([[0.02, 0.03]]),
        predicted_px=np.array([[0.01, 0.02]]),
        ratio_error=np.array([0.25]),
        flags={"RING": 4, "EDGE": 2},
        n_centroids=100,
    )
    known = told(measured(1), of)
    found = [[float(v) for v in cells(scatter(known), name)] for name in ("x1", "y1")]
    np.testing.assert_allclose(found, [[20.0, 10.0, 2.0, 0.25], [30.0, 20.0, 1.5, 0.25]])
    assert cells(flags(known), "RING")[0] == "4" and "Of 100 centroids" in flags(known)


# Belief


@pytest.mark.parametrize(("strays", "verdict"), [(0.99, "as predicted"), (1.01, "scatter")])
@pytest.mark.parametrize("sign", [1, -1])
def test_one_recording_in_a_hundred_is_called_at_fault_by_chance(strays, verdict, sign):
    """Of six coordinates the farthest lies beyond this as often, by Bonferroni's rule."""
    from scipy.stats import norm

    far = norm.isf(0.01 / 2 / 6) * 0.1 * strays
    of = belief(error=0.1)
    of.scatter_px[1, 0] *= np.exp(sign * far)
    assert verdict in of.sentences()[0]
    assert ("more" if sign > 0 else "less") in of.sentences()[0] or verdict == "as predicted"


def test_ten_second_differences_have_an_error_and_nine_have_none():
    """For white noise the relative error of a scatter is the root of 35 / 36 over their number."""
    error = sampling_error(np.array([0, 9, 10, 360]))
    np.testing.assert_allclose(error, [np.nan, np.nan, np.sqrt(35 / 360), np.sqrt(35 / 36 / 360)])
    rng = np.random.default_rng(8)
    scatter, count = second_differences(rng.standard_normal((302, 4000, 2)))
    assert (count == 300).all()
    assert scatter.std() / scatter.mean() == pytest.approx(sampling_error(count)[0], rel=0.05)


def test_the_slope_of_two_centroids_is_least_squares_about_each_mean():
    rng = np.random.default_rng(9)
    other = np.cumsum(rng.standard_normal((200, 2, 2)), axis=0) + 5.0
    one = 0.9 * other + 3.0 + 0.05 * rng.standard_normal(other.shape)
    one[4, 0, 0] = np.nan
    found = drift_slope(one, other, np.full(other.shape, 0.02))
    seen = np.isfinite(one)
    both = [
        np.concatenate(
            [
                (s[:, i, j] - s[seen[:, i, j], i, j].mean())[seen[:, i, j]]
                for i in (0, 1)
                for j in (0, 1)
            ]
        )
        for s in (one, other)
    ]
    slope = both[0] @ both[1] / (both[1] @ both[1])
    left = ((both[0] - slope * both[1]) ** 2).sum() / (len(both[0]) - 1)
    lowered = len(both[0]) * 0.02**2 / (both[1] @ both[1])
    assert found.value == pytest.approx(slope, rel=1e-12)
    assert found.error == pytest.approx(np.hypot(np.sqrt(left / (both[1] @ both[1])), lowered))


@pytest.mark.parametrize(("share", "told"), [(0.049, True), (0.051, False)])
def test_a_slope_is_known_to_a_twentieth(share, told):
    drift = np.linspace(-1.0, 1.0, 50)[:, None, None] * np.ones((1, 1, 2))
    size = np.sqrt(share * (drift**2).sum() / drift.size)
    found = drift_slope(drift, drift, np.full(drift.shape, size))
    assert np.isfinite(found.value) == told


# Notes and the table


@pytest.mark.parametrize("skipped", [0, 1, 3, 4, 9])
def test_three_unreadable_frames_are_named_and_the_rest_counted(skipped):
    xy = np.full((20, 2, 2), 5.0)
    xy[:4, 1, 0] = np.nan
    raised = np.zeros((20, 2), int)
    raised[:5, 0] = int(SpotFlag.RING | SpotFlag.EDGE)
    track = Track(xy, xy, raised, dict.fromkeys(range(skipped), "damaged"))
    known = SimpleNamespace(noise=lb.Detector(), doubts=("a doubt",), black=0.0, reason="")
    notes = notes_on_frames(track, [known, known])
    if skipped:
        named = ", ".join(f"frame {k} (damaged)" for k in range(min(skipped, 3)))
        more = f", and {skipped - 3} more" if skipped > 3 else ""
        said = f"{skipped} of 20 frames are left out as unreadable: {named}{more}."
        assert notes.pop(0) == said
    assert notes[:2] == [
        "Spot 2 is lost in 4 of 20 frames.",
        "5 of 40 centroids carry the flag RING.",
    ]
    assert notes[2].startswith("Predicted errors rest on the detector: 1 e-/DN")
    assert notes[3:] == ["a doubt"]


def test_stamps_that_differ_are_gathered():
    xy = np.full((3, 2, 2), 5.0)
    surveys = [
        SimpleNamespace(noise=lb.Detector(), doubts=doubts, black=0.0, reason=f"{how}: because")
        for how, doubts in (("eiwa", ()), ("weighted", ("one", "two")), ("eiwa", ("three",)))
    ]
    notes = notes_on_frames(Track(xy, xy, np.zeros((3, 2), int), {}), surveys)
    assert notes[0] == "Centroids by eiwa (stamps 1, 3); weighted (stamp 2)."
    assert notes[2:] == [
        "one",
        "two",
        "That is stamp 2; the frames of 2 of 3 stamps contradict the detector, each by numbers of "
        "its own.",
    ]


def test_the_table_holds_each_number_under_its_name():
    frames = np.zeros((4, 20, 30), np.uint16)
    recording = lb.read_recording(frames, period_s=2.0, start="2026-03-01T12:00:00.0005Z")
    xy, sigma, shifts = RNG.random((3, 4, 2, 2))
    raised = RNG.integers(0, 9, (4, 2))
    angle, cov = RNG.random((4, 3)), RNG.random((4, 3, 3)) + np.eye(3)
    attitude = SimpleNamespace(angles=angle, cov=cov, p_value=RNG.random(4))
    table = measurement_table(
        recording, {"temperature_degC": np.arange(4.0)}, xy, sigma, raised, shifts, attitude
    )
    np.testing.assert_array_equal(table["time_s"], 2.0 * np.arange(4))
    assert table["time"][1] == "2026-03-01T12:00:02.001Z"
    for n in range(2):
        for i, axis in enumerate("xy"):
            np.testing.assert_array_equal(table[f"{axis}{n + 1}_px"], xy[:, n, i])
            np.testing.assert_array_equal(table[f"sigma_{axis}{n + 1}_px"], sigma[:, n, i])
            np.testing.assert_array_equal(table[f"d{axis}{n + 1}_px"], shifts[:, n, i])
        np.testing.assert_array_equal(table[f"flags{n + 1}"], raised[:, n])
    for i, name in enumerate(("alpha", "beta", "gamma")):
        np.testing.assert_allclose(table[f"{name}_arcsec"], np.degrees(angle[:, i]) * 3600)
        np.testing.assert_allclose(
            table[f"sigma_{name}_arcsec"], np.degrees(np.sqrt(cov[:, i, i])) * 3600
        )


@pytest.mark.parametrize(("until", "without"), [(6.0, 0), (5.9, 1), (2.0, 2)])
def test_frames_outside_the_log_are_counted(tmp_path, until, without):
    recording = lb.read_recording(np.zeros((4, 20, 30), np.uint16), period_s=2.0)
    step = np.linspace(0.0, until, 7)
    lines = "".join(f"{t},{20 + t}\n" for t in step)
    (tmp_path / "log.csv").write_text("time_s,temperature_degC\n" + lines)
    log = lb.read_temperature_log(tmp_path / "log.csv")
    columns, notes = at_frames(recording, log)
    np.testing.assert_allclose(
        columns["temperature_degC"], [20 + t if t <= until else np.nan for t in (0, 2, 4, 6)]
    )
    said = [note for note in notes if "lie outside the temperature log" in note]
    assert len(said) == (without > 0)
    if said:
        assert said[0].startswith(f"{without} of 4 frames")


# Pictures


@pytest.mark.parametrize("xy", [(40.2, 30.4), (3.0, 55.0), (78.0, 2.0)])
def test_a_spot_is_shown_with_twelve_pixels_around_it(xy):
    image = np.arange(60 * 80).reshape(60, 80)
    origin = np.array([100.0, 200.0])
    near, corner = pictures._near(image, origin, np.array(xy) + origin, None)
    x, y = np.rint(xy).astype(int)
    left, top = max(x - 12, 0), max(y - 12, 0)
    np.testing.assert_array_equal(near, image[top : min(y + 13, 60), left : min(x + 13, 80)])
    np.testing.assert_array_equal(corner, origin + np.array([left, top]))


def test_lines_of_pictures_are_the_numbers_of_the_table():
    known = measured()
    for i, axis in enumerate(pictures.shifts_figure(known).axes):
        for n, line in enumerate(axis.lines):
            np.testing.assert_array_equal(line.get_ydata(), known.shifts_px[:, n, i])
    for i, axis in enumerate(pictures.leftover_figure(known).axes):
        for n, line in enumerate(axis.lines):
            np.testing.assert_allclose(line.get_ydata(), 1e3 * known.attitude.residuals[:, n, i])
    for name, values in zip(("alpha", "beta", "gamma"), ANGLES.T, strict=True):
        known.table[f"{name}_arcsec"], known.table[f"sigma_{name}_arcsec"] = values, 0.25
    for i, axis in enumerate(pictures.angles_figure(known).axes):
        np.testing.assert_array_equal(axis.lines[0].get_ydata(), ANGLES[:, i])
        band = axis.collections[0].get_paths()[0].vertices[:, 1]
        assert [band.min(), band.max()] == pytest.approx(
            [ANGLES[:, i].min() - 0.25, ANGLES[:, i].max() + 0.25]
        )
    (axis,) = pictures.temperature_figure(known).axes
    np.testing.assert_array_equal(
        axis.lines[0].get_ydata(), known.table["temperature_box_degC"].to_numpy()
    )
    assert axis.get_xlabel() == "frame"


@pytest.mark.parametrize(("n", "image"), [(3000, False), (3001, True)])
def test_lines_of_more_than_three_thousand_points_are_images(n, image):
    known = SimpleNamespace(
        shifts_px=np.zeros((n, 1, 2)), table=pd.DataFrame({"frame": np.arange(n)})
    )
    lines = [line for axis in pictures.shifts_figure(known).axes for line in axis.lines]
    assert all(bool(line.get_rasterized()) == image for line in lines)


def test_no_two_spots_look_the_same():
    known = SimpleNamespace(
        shifts_px=np.zeros((5, 20, 2)), table=pd.DataFrame({"frame": np.arange(5)})
    )
    lines = pictures.shifts_figure(known).axes[0].lines
    assert len({(a.get_color(), a.get_marker(), a.get_linestyle()) for a in lines}) == 20


@pytest.mark.parametrize("n_spots", [1, 2, 6, 8])
def test_spots_are_shown_near_to(n_spots):
    frames = RNG.integers(90, 110, (3, 60, 300)).astype(np.uint16)
    recording = lb.read_recording(frames, period_s=1.0)
    xy = np.tile(np.array([20.0, 30.0]) + np.outer(np.arange(n_spots), [33.0, 0.0]), (3, 1, 1))
    xy[0, -1] = np.nan
    figure = pictures.frame_figure(SimpleNamespace(xy_px=xy, surveys=()), recording)
    whole, *near = figure.axes
    assert len(near) == n_spots
    assert whole.get_title().startswith("frame 1:")
    assert len(whole.patches) == n_spots
    np.testing.assert_array_equal([patch.center for patch in whole.patches], xy[1])
    np.testing.assert_array_equal(whole.images[0].get_array(), frames[1])
    assert whole.images[0].get_extent() == [-0.5, 299.5, 59.5, -0.5]
    for axis, place in zip(near, xy[1], strict=False):
        left, right, bottom, top = axis.images[0].get_extent()
        assert [left, right] == [place[0] - 12.5, place[0] + 12.5][:2] or left == 7.5
        assert [top, bottom] == [place[1] - 12.5, place[1] + 12.5]
        np.testing.assert_array_equal(axis.lines[0].get_xydata(), [place])
