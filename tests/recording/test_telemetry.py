"""From a pair's CSV file to corrected attitudes, and every way in which such a file is wrong."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from losbench.papers.ren2023.scenario import Pair
from losbench.papers.ren2023.telemetry import write_telemetry
from losbench.recording.columns import TelemetryFormat
from losbench.recording.drift import correct_telemetry
from losbench.recording.telemetry import read_telemetry

SHORT = Pair(days=(0.0, 58.0), track_s=40.0)


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    return write_telemetry(tmp_path_factory.mktemp("pair") / "example", seed=3, setting=SHORT)


@pytest.fixture
def form(example):
    return TelemetryFormat.from_toml(example / "telemetry.toml")


def changed(example, tmp_path, change):
    """The example's CSV file after ``change`` has worked on its table."""
    table = pd.read_csv(example / "telemetry.csv")
    path = tmp_path / "telemetry.csv"
    (change(table) if callable(change) else table).to_csv(path, index=False)
    return path


def test_the_example_comes_back_with_its_drift_and_without_it_in_the_angle(example, tmp_path):
    report = correct_telemetry(example / "telemetry.csv", tmp_path / "out", smooth_s=10.0)
    truth = pd.read_csv(example / "truth.csv")
    last = (report.angle["track"] == 2).to_numpy()
    for k in (1, 2):
        for axis, allowed in zip("xyz", (0.01, 0.01, 0.1), strict=True):
            name = f"drift_{k}_{axis}_arcsec"
            assert abs((report.angle[name] - truth[name])[last].mean()) < allowed
    changes = report.tracks.set_index("track")
    raw, corrected = (changes.loc[2, f"mean_{w}"] - changes.loc[1, f"mean_{w}"] for w in ("before", "after"))
    assert raw - corrected == pytest.approx(1.1, abs=0.01)
    assert changes.loc[1, "start"] == "2022-01-26T04:00:00.000Z"
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"corrected.csv", "angle.csv", "tracks.csv", "report.txt", "angle.png", "drift.png"}
    corrected = pd.read_csv(tmp_path / "out" / "corrected.csv")
    q = corrected[["q1_x", "q1_y", "q1_z", "q1_w"]].to_numpy()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-11)
    np.testing.assert_allclose(q, report.pair.quaternions[0], atol=1e-11)
    assert report.summary() + "\n" == (tmp_path / "out" / "report.txt").read_text()


def test_a_format_survives_its_toml(form, tmp_path):
    (tmp_path / "again.toml").write_text(form.to_toml())
    assert TelemetryFormat.from_toml(tmp_path / "again.toml") == form


def test_the_mean_of_the_first_track_serves_as_reference_in_any_unit(example, form, tmp_path):
    spots = [c for c in pd.read_csv(example / "telemetry.csv", nrows=1) if c.startswith("spot")]

    def in_pixels(table):
        return table.assign(**{c: table[c] / 8e-3 + 4095.5 for c in spots})

    heads = {name: replace(getattr(form, name), reference=()) for name in ("head_1", "head_2")}
    given = read_telemetry(example / "telemetry.csv", form).pair
    pixels = replace(form, spot_unit="px", pixel_um=8.0, principal=(4095.5, 4095.5), **heads)
    found = read_telemetry(changed(example, tmp_path, in_pixels), pixels).pair
    np.testing.assert_allclose(found.points_mm, given.points_mm, atol=1e-4)
    first = given.time_s < 60
    shifted = given.shifts_mm - given.shifts_mm[:, first].mean(axis=1, keepdims=True)
    np.testing.assert_allclose(found.shifts_mm, shifted, atol=1e-9)


def test_two_clocks_are_brought_together(example, form, tmp_path):
    def late(table):
        seconds = np.arange(len(table)) / 8.0
        keep = seconds < 40
        return table.assign(t1=seconds, t2=seconds + 0.05)[keep]

    read = read_telemetry(changed(example, tmp_path, late), replace(form, time=("t1", "t2")))
    assert np.isnan(read.pair.quaternions[1]).any(axis=1).sum() == 1  # the first moment lies before the second clock
    assert any("interpolated to the first one's times" in note for note in read.notes)

    def apart(table):
        seconds = np.arange(len(table)) / 8.0
        return table.assign(t1=seconds, t2=seconds + 1e4)

    with pytest.raises(ValueError, match="the heads must overlap in time, but the first runs from 0 to 79.875 s"):
        read_telemetry(changed(example, tmp_path, apart), replace(form, time=("t1", "t2")))


def test_gaps_flips_and_lost_spots_are_noted_and_do_no_harm(example, form, tmp_path):
    quaternion = list(form.head_1.quaternion)

    def spoil(table):
        table.loc[50:52, quaternion[1]] = np.nan
        table.loc[100:110, quaternion] *= -1
        table.loc[200:209, "spot21_x_mm"] = np.nan
        table.loc[300, "time"] = None
        return table

    path = changed(example, tmp_path, spoil)
    (tmp_path / "telemetry.toml").write_text(form.to_toml())
    report = correct_telemetry(path, tmp_path / "out")
    clean = correct_telemetry(example / "telemetry.csv", tmp_path / "clean")
    notes = " ".join(report.notes)
    for text in (
        "1 of 640 rows have no time and are left out.",
        "Head 1: 3 rows without a quaternion.",
        "Head 1: the quaternion changes its sign 2 times, which is harmless.",
        "Head 2: 10 rows miss a spot; drifts are interpolated over up to 10 s.",
    ):
        assert text in notes
    assert report.tracks["missing"].tolist() == [3, 0]
    np.testing.assert_allclose(report.tracks["total_after"], clean.tracks["total_after"], rtol=0.03)
    other = np.setdiff1d(np.arange(639), [*range(50, 53), *range(200, 210)])
    source = np.where(other < 300, other, other + 1)
    np.testing.assert_allclose(report.angle["after_arcsec"][other], clean.angle["after_arcsec"][source], atol=1e-4)


def test_six_decimals_are_warned_of_with_their_cost(example, form, tmp_path):
    names = [*form.head_1.quaternion, *form.head_2.quaternion]
    path = changed(example, tmp_path, lambda table: table.assign(**{c: table[c].round(6) for c in names}))
    message = r"quaternions hold 6 decimals, which costs 0.51 arcsec \(3 sigma\) of the angle; 8 or more would not"
    with pytest.warns(UserWarning, match=message):
        read_telemetry(path, form)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.iloc[::-1], "column 'time' must increase, but row 2 is earlier than the row before; 639 rows do"),
        (lambda t: t.assign(time=[*t.time[:5], t.time[4], *t.time[6:]]), "row 6 repeats the time of the row before"),
        (
            lambda t: t.assign(time=[None, *t.time[1:]], q2_w=2 * t.q2_w),
            "head 2: quaternions must have unit length to 0.001, but 639 of 639 have not; row 2 has length",
        ),
        (lambda t: t.assign(time=[None, *t.time[1:5], *t.time[4:-1]]), "row 6 repeats the time of the row before"),
        (lambda t: t.assign(q1_x=np.nan), "head 1 has no row with a whole quaternion"),
        (lambda t: t.assign(spot21_x_mm=np.nan), "head 2 has no row with two spots"),
        (
            lambda t: t.assign(q1_x=t.q1_x.where(t.index < 9), q2_x=t.q2_x.where(t.index > 9)),
            "no row has the attitudes of both heads",
        ),
        (lambda t: t.assign(spot12_x_mm=t.spot11_x_mm), "head 1: spot 2 is too far from its reference for a drift"),
        (
            lambda t: t.drop(columns=["q1_x", "spot22_y_mm"]),
            "telemetry.csv has no column q1_x, spot22_y_mm; it has time",
        ),
        (lambda t: t.assign(q1_x="north"), "column 'q1_x' of telemetry.csv must hold numbers, got 'north'"),
        (lambda t: t.assign(time="noon"), "column 'time' of telemetry.csv must be ISO 8601 UTC"),
        (lambda t: t.assign(q1_x=-t.q1_x, q1_y=-t.q1_y, q1_z=-t.q1_z), "first camera scalar last, inertial to camera"),
        (lambda t: t.rename(columns={"q2_x": "q2_w", "q2_w": "q2_x"}), "the boresights must stand 67.62"),
    ],
)
def test_faulty_telemetry_is_named(example, form, tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        read_telemetry(changed(example, tmp_path, change), form)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("scalar = ", "order = ", "unknown key order; known are time, scalar"),
        ('scalar = "last"', 'scalar = "w"', "scalar must be one of 'last', 'first', got 'w'"),
        ("focal_mm = 600.0\n", "", "key focal_mm is missing"),
        ("[head_2]", "[head_3]", r"table \[head_2\] is missing"),
        (", 'q2_w']", "]", r"\[head_2\]: quaternion must name four columns, got 3"),
        ('spot_unit = "mm"', 'spot_unit = "px"', "spot_unit 'px' needs pixel_um"),
        ("'q2_w'", "'q1_w'", "every column must have one meaning, but q1_w is named twice"),
        ('time = "time"', 'time = ["a", "b", "c"]', "time must name one column, or one for each head, got 3"),
    ],
)
def test_a_faulty_description_is_named(form, tmp_path, old, new, message):
    text = form.to_toml()
    assert old in text
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=message):
        TelemetryFormat.from_toml(path)


def test_a_full_folder_is_left_alone_unless_forced(example, tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(FileExistsError, match="is not empty"):
        correct_telemetry(example / "telemetry.csv", tmp_path)
    correct_telemetry(example / "telemetry.csv", tmp_path, force=True)
    assert (tmp_path / "mine.txt").read_text() == "keep"
    with pytest.raises(FileExistsError, match="is not empty"):
        write_telemetry(tmp_path, setting=SHORT)


def test_times_in_seconds_come_back_as_they_were(example, form, tmp_path):
    path = changed(example, tmp_path, lambda table: table.assign(time=1.3e9 + 0.125 * np.arange(len(table))))
    (tmp_path / "telemetry.toml").write_text(form.to_toml())
    report = correct_telemetry(path, tmp_path / "out")
    for name in ("corrected", "angle"):
        written = pd.read_csv(tmp_path / "out" / f"{name}.csv")["time_s"]
        np.testing.assert_array_equal(written, 1.3e9 + 0.125 * np.arange(640))
    assert report.tracks["start"].tolist() == ["1300000000 s"]


def test_two_clocks_of_different_kinds_are_refused(example, form, tmp_path):
    path = changed(example, tmp_path, lambda table: table.assign(t2=np.arange(len(table)) / 8.0))
    with pytest.raises(ValueError, match="columns time and t2 must both hold seconds, or both UTC"):
        read_telemetry(path, replace(form, time=("time", "t2")))


def test_what_a_file_cannot_tell_is_noted(example, form, tmp_path):
    path = changed(example, tmp_path, lambda table: table[:10])
    (tmp_path / "telemetry.toml").write_text(replace(form, spot_unit="um").to_toml())
    notes = " ".join(correct_telemetry(path, tmp_path / "out").notes)
    assert "1 of 1 tracks have fewer than 20 angles: no split." in notes
    assert "Head 2: the spots stand so near to each other that z is lost; is spot_unit right?" in notes


def test_a_missing_description_is_named(example, tmp_path):
    path = changed(example, tmp_path, lambda table: table[:10])
    with pytest.raises(FileNotFoundError, match=r"no description of the columns at .*telemetry.toml: write one, or"):
        correct_telemetry(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_missing_telemetry_is_named_before_its_description(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no telemetry at .*nowhere.csv: expected a CSV file"):
        correct_telemetry(tmp_path / "nowhere.csv", tmp_path / "out")
