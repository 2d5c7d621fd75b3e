"""From a pair's CSV file to corrected attitudes, and every way in which such a file is wrong."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from losbench.papers.ren2023.export import write_telemetry
from losbench.papers.ren2023.scenario import CONVENTION, Pair
from losbench.papers.ren2023.twin import body_attitude, simulate
from losbench.pointing.performance import pointing_metrics
from losbench.pointing.starcamera import earth_velocity_km_s, remove_aberration
from losbench.pointing.thermal.lag import lagged
from losbench.telemetry.columns import TelemetryFormat
from losbench.telemetry.correct import correct_telemetry
from losbench.telemetry.read import read_telemetry
from losbench.units import arcsec_to_rad, rad_to_arcsec

pytestmark = pytest.mark.usefixtures("undrawn")

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


@pytest.mark.drawn
def test_the_example_comes_back_with_its_drift_and_without_it_in_the_angle(example, tmp_path):
    report = correct_telemetry(example / "telemetry.csv", tmp_path / "out", smooth_s=10.0)
    truth = pd.read_csv(example / "truth.csv")
    last = (report.angle["track"] == 2).to_numpy()
    for k in (1, 2):
        for axis, allowed in zip("xyz", (0.01, 0.01, 0.1), strict=True):
            name = f"drift_{k}_{axis}_arcsec"
            assert abs((report.angle[name] - truth[name])[last].mean()) < allowed
    changes = report.tracks.set_index("track")
    raw, corrected = (
        changes.loc[2, f"mean_{w}_arcsec"] - changes.loc[1, f"mean_{w}_arcsec"]
        for w in ("before", "after")
    )
    assert raw - corrected == pytest.approx(1.1, abs=0.01)
    assert changes.loc[1, "start"] == "2022-01-26T04:00:00.000Z"
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {
        "corrected.csv",
        "angle.csv",
        "tracks.csv",
        "report.txt",
        "report.json",
        "report.html",
        "leftover.png",
        "angle.png",
        "drift.png",
        "metrics.csv",
        "metrics.png",
    }
    corrected = pd.read_csv(tmp_path / "out" / "corrected.csv")
    q = corrected[["q1_x", "q1_y", "q1_z", "q1_w"]].to_numpy()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-11)
    np.testing.assert_allclose(q, report.pair.quaternions[0], atol=1e-11)
    assert report.summary() + "\n" == (tmp_path / "out" / "report.txt").read_text()


def test_the_metrics_are_those_of_the_angle_over_the_window_that_splits_it(example, tmp_path):
    report = correct_telemetry(example / "telemetry.csv", tmp_path / "out", window=9)
    found, angle = report.metrics, report.angle
    step_s = float(np.median(np.diff(angle["time_s"])))
    assert found.window_s == pytest.approx(9 * step_s)
    same = pointing_metrics(
        arcsec_to_rad(angle[["before_arcsec", "after_arcsec"]].to_numpy()),
        angle["time_s"].to_numpy(),
        9 * step_s,
        observations=angle["track"].to_numpy(),
    )
    np.testing.assert_array_equal(found.jitter.value, same.jitter.value)
    assert (rad_to_arcsec(found.pre.value) > 0).all()  # between the two tracks
    told = json.loads((tmp_path / "out" / "report.json").read_text())["pairs"][0]
    after = told["pointing"]["series"]["after"]
    low, high = after["rpe_interval_95_arcsec"]
    assert low < after["rpe_arcsec"] < high
    assert told["sensitivity"] is None
    written = pd.read_csv(tmp_path / "out" / "metrics.csv")
    assert set(written["axis"]) == {"before", "after"}
    summary = report.summary()
    assert "Pointing of the angle corrected in windows of" in summary
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Pointing metrics" in page and "Sensitivity to" not in page
    short = changed(example, tmp_path, lambda t: t.iloc[:60])
    small = correct_telemetry(
        short, tmp_path / "short", window=7, columns=example / "telemetry.toml"
    )
    assert small.metrics is None


def test_the_angle_s_sensitivity_is_to_the_first_temperature_that_stands_beside(
    example, form, tmp_path
):
    angle = correct_telemetry(example / "telemetry.csv", tmp_path / "plain").angle
    rng = np.random.default_rng(2)
    slow = 20.0 + np.linspace(0.0, 8.0, len(angle))
    turn = 0.5 * lagged(slow - 20.0, angle["time_s"].to_numpy(), 4.0)  # arcsec, of the second head

    def warmed(table):
        q = table[[f"q2_{axis}" for axis in "xyzw"]].to_numpy()
        axis = np.cross(*boresights(table))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        turned = Rotation.from_rotvec(arcsec_to_rad(turn)[:, None] * axis) * Rotation.from_quat(q)
        columns = dict(zip([f"q2_{axis}" for axis in "xyzw"], turned.as_quat().T, strict=True))
        return table.assign(tube_degC=slow, **columns, wall_degC=rng.uniform(18, 22, len(table)))

    path = changed(example, tmp_path, warmed)
    described = replace(form, temperatures=("tube_degC", "wall_degC"))
    path.with_suffix(".toml").write_text(described.to_toml())
    report = correct_telemetry(path, tmp_path / "out")
    told = json.loads((tmp_path / "out" / "report.json").read_text())["pairs"][0]
    assert told["sensitivity_to"] == "tube_degC"
    # Between the tracks the tube warms by 4 degC and the pair drifts by 1.1 arcsec, which is the
    # temperature's doing as far as the angle uncorrected can tell.
    for name, truths in (("before", (0.5, 0.5 + 1.1 / 4.0)), ("after", (0.5,))):
        low, high = told["sensitivity"][name]["interval_95_arcsec_per_degC"]
        for held in (told["sensitivity"][name]["arcsec_per_degC"], *truths):
            assert low < held < high
    assert "Sensitivity of the angle uncorrected to tube_degC: " in report.summary()
    table = pd.read_csv(tmp_path / "out" / "angle.csv")
    left = table["before_arcsec"] - table["before_compensated_arcsec"]
    np.testing.assert_allclose(left, rad_to_arcsec(report.sensitivity.predicted[:, 0]), atol=1e-6)
    for name in ("sensitivity.csv", "compensated.png", "metrics.png"):
        assert (tmp_path / "out" / name).stat().st_size > 50
    assert "Sensitivity to tube_degC, at rest" in (tmp_path / "out" / "report.html").read_text()
    path.with_suffix(".toml").write_text(replace(form, temperatures=("T9",)).to_toml())
    with pytest.raises(ValueError, match=r"telemetry\.csv has no column T9; it has"):
        correct_telemetry(path, tmp_path / "again")


def boresights(table):
    return [
        Rotation.from_quat(table[[f"q{k}_{axis}" for axis in "xyzw"]].to_numpy()).apply([0, 0, 1])
        for k in (1, 2)
    ]


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
    assert (
        np.isnan(read.pair.quaternions[1]).any(axis=1).sum() == 1
    )  # the first moment lies before the second clock
    assert any("interpolated to the first one's times" in note for note in read.notes)

    def apart(table):
        seconds = np.arange(len(table)) / 8.0
        return table.assign(t1=seconds, t2=seconds + 1e4)

    with pytest.raises(
        ValueError, match="the heads must overlap in time, but the first runs from 0 to 79.875 s"
    ):
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
        "Head 2: 10 rows miss a spot.",
        "Head 2: 10 of 639 rows give no drift of their own: 10 are interpolated over up to 10 s "
        "(max_gap_s), 0 stay "
        "missing.",
    ):
        assert text in notes
    assert report.tracks["missing"].tolist() == [3, 0]
    np.testing.assert_allclose(
        report.tracks["total_after_arcsec"], clean.tracks["total_after_arcsec"], rtol=0.03
    )
    other = np.setdiff1d(np.arange(639), [*range(50, 53), *range(200, 210)])
    source = np.where(other < 300, other, other + 1)
    np.testing.assert_allclose(
        report.angle["after_arcsec"][other], clean.angle["after_arcsec"][source], atol=1e-4
    )


def test_six_decimals_are_warned_of_with_their_cost(example, form, tmp_path):
    names = [*form.head_1.quaternion, *form.head_2.quaternion]
    path = changed(
        example, tmp_path, lambda table: table.assign(**{c: table[c].round(6) for c in names})
    )
    message = (
        r"quaternions hold 6 decimals, which costs 0.51 arcsec \(3 sigma\) of the angle; 8 or more "
        r"would not"
    )
    with pytest.warns(UserWarning, match=message):
        read_telemetry(path, form)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda t: t.iloc[::-1],
            "column 'time' must increase, but row 2 is earlier than the row before; 639 rows do",
        ),
        (
            lambda t: t.assign(time=[*t.time[:5], t.time[4], *t.time[6:]]),
            "row 6 repeats the time of the row before",
        ),
        (
            lambda t: t.assign(time=[None, *t.time[1:]], q2_w=2 * t.q2_w),
            "head 2: quaternions must have unit length to 0.001, but 639 of 639 have not; row 2 "
            "has length",
        ),
        (
            lambda t: t.assign(time=[None, *t.time[1:5], *t.time[4:-1]]),
            "row 6 repeats the time of the row before",
        ),
        (lambda t: t.assign(q1_x=np.nan), "head 1 has no row with a whole quaternion"),
        (lambda t: t.assign(spot21_x_mm=np.nan), "head 2 has no row with two spots"),
        (
            lambda t: t.assign(q1_x=t.q1_x.where(t.index < 9), q2_x=t.q2_x.where(t.index > 9)),
            "no row has the attitudes of both heads",
        ),
        (
            lambda t: t.assign(spot12_x_mm=t.spot11_x_mm),
            "head 1: spot 2 is too far from its reference for a drift",
        ),
        (
            lambda t: t.drop(columns=["q1_x", "spot22_y_mm"]),
            "telemetry.csv has no column q1_x, spot22_y_mm; it has time",
        ),
        (
            lambda t: t.assign(q1_x="north"),
            "column 'q1_x' of telemetry.csv must hold numbers, got 'north'",
        ),
        (lambda t: t.assign(time="noon"), "column 'time' of telemetry.csv must be ISO 8601 UTC"),
        (
            lambda t: t.assign(q1_x=-t.q1_x, q1_y=-t.q1_y, q1_z=-t.q1_z),
            "first camera scalar last, inertial to camera",
        ),
        (
            lambda t: t.rename(columns={"q2_x": "q2_w", "q2_w": "q2_x"}),
            "the boresights must stand 67.62",
        ),
    ],
)
def test_faulty_telemetry_is_named(example, form, tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        read_telemetry(changed(example, tmp_path, change), form)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("scalar = ", "order = ", "unknown key order; known are time, time_fraction, scalar"),
        ('scalar = "last"', 'scalar = "w"', "scalar must be one of 'last', 'first', got 'w'"),
        ("focal_mm = 600.0\n", "", "key focal_mm is missing"),
        ("[head_2]", "[head_3]", r"table \[head_2\] is missing"),
        (", 'q2_w']", "]", r"\[head_2\]: quaternion must name four columns, got 3"),
        ('spot_unit = "mm"', 'spot_unit = "px"', "spot_unit 'px' needs pixel_um"),
        ("'q2_w'", "'q1_w'", "every column must have one meaning, but q1_w is named twice"),
        (
            "boresight = [0.0, 0.0, 1.0]",
            "boresight = [0, 0, 0]",
            "boresight must be a direction of three numbers",
        ),
        (
            'time = "time"',
            'time = ["a", "b", "c"]',
            "time must name one column, or one for each head, got 3",
        ),
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
    path = changed(
        example, tmp_path, lambda table: table.assign(time=1.3e9 + 0.125 * np.arange(len(table)))
    )
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
    assert (
        "1 of 1 tracks have fewer than 20 angles, or too few runs of 5 without a gap: no split."
        in notes
    )
    assert (
        "Head 2: the spots stand so near to each other that z is lost; is spot_unit right?" in notes
    )


def test_a_missing_description_is_named(example, tmp_path):
    path = changed(example, tmp_path, lambda table: table[:10])
    with pytest.raises(
        FileNotFoundError, match=r"no description of the columns at .*telemetry.toml: write one, or"
    ):
        correct_telemetry(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_missing_telemetry_is_named_before_its_description(tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"no telemetry at .*nowhere.csv: expected a CSV file"
    ):
        correct_telemetry(tmp_path / "nowhere.csv", tmp_path / "out")


def corrected(example, form, tmp_path, change, **options):
    """The report of the example after ``change`` has worked on its table."""
    (tmp_path / "telemetry.toml").write_text(form.to_toml())
    return correct_telemetry(changed(example, tmp_path, change), tmp_path / "out", **options)


def spots_of(table, head=""):
    return [c for c in table if c.startswith(f"spot{head}")]


@pytest.mark.parametrize("referenced", [True, False])
def test_single_bad_spots_are_left_out_and_named(example, form, tmp_path, referenced):
    if not referenced:
        form = replace(
            form, **{h: replace(getattr(form, h), reference=()) for h in ("head_1", "head_2")}
        )

    def spoil(table):
        table.loc[3, "spot11_x_mm"], table.loc[40, "spot11_x_mm"] = -9999.0, 0.0
        return table

    def blank(table):
        table.loc[[3, 40], ["spot11_x_mm", "spot11_y_mm"]] = np.nan
        return table

    found = corrected(example, form, tmp_path, spoil)
    note = (
        "Head 1: in 2 of 640 rows spot 1 lies more than 3 mm from its reference, farther than any "
        "drift"
    )
    assert f"{note}, and is left out there; the first is row 4." in found.notes
    expected = corrected(example, form, tmp_path, blank, force=True)
    pd.testing.assert_frame_equal(found.angle, expected.angle)
    assert note not in " ".join(expected.notes)


def test_the_spots_scatter_is_told_and_noted_where_it_is_not_what_was_said(example, form, tmp_path):
    def ratios(report):
        lines = [line for line in report.notes if "the spots scatter about a pure turn by" in line]
        return [float(line.split("by ")[1].split()[0]) for line in lines], [
            ", far from 1" in line for line in lines
        ]

    values, far = ratios(corrected(example, form, tmp_path, lambda t: t))
    assert values == pytest.approx([1.0, 1.0], abs=0.12) and far == [
        False,
        False,
    ]  # 640 degrees of freedom, 4 sigma

    def bad(table):
        table.loc[7, "spot21_y_mm"] += 0.05
        return table

    values, far = ratios(corrected(example, form, tmp_path, bad, force=True))
    assert values[1] > 5 and far == [False, True]
    low = corrected(
        example, replace(form, spot_sigma_um=10 * form.spot_sigma_um), tmp_path, None, force=True
    )
    assert ratios(low)[1] == [True, True]
    without = corrected(example, replace(form, spot_sigma_um=None), tmp_path, None, force=True)
    assert ratios(without) == ([], [])


def test_a_track_of_scattered_gaps_has_a_mean_and_no_split(example, form, tmp_path):
    def scatter(table):
        table.loc[(table.index < 320) & (table.index % 3 == 0), "q1_x"] = np.nan
        return table

    report = corrected(example, form, tmp_path, scatter)
    assert (
        "1 of 2 tracks have fewer than 20 angles, or too few runs of 5 without a gap: no split."
        in report.notes
    )
    first, second = (report.tracks.iloc[k] for k in range(2))
    clean = correct_telemetry(example / "telemetry.csv", tmp_path / "clean").tracks
    assert np.isnan(
        first[["total_before_arcsec", "lsfe_unbiased_arcsec", "nea_after_arcsec"]].astype(float)
    ).all()
    assert first["mean_after_arcsec"] == pytest.approx(clean.loc[0, "mean_after_arcsec"], abs=0.05)
    assert second["lsfe_unbiased_arcsec"] == clean.loc[1, "lsfe_unbiased_arcsec"]
    lines = report.summary().splitlines()
    assert "(213 angles); no split" in lines[0] and "nan" not in report.summary()


def side_by_side(every):
    """Columns of each head with a clock of its own, the second one's every so many rows and
    shorter.
    """

    def change(table):
        seconds = np.arange(320) / 8.0
        table = table[:320].drop(columns="time")
        second = [c for c in table if c.startswith(("q2", "spot2"))]
        own = table[second].iloc[::every].assign(t2=seconds[::every]).reset_index(drop=True)
        return pd.concat([table.drop(columns=second).assign(t1=seconds), own], axis=1)

    return change


def test_a_slower_second_clock_in_a_shorter_column_loses_nothing(example, form, tmp_path):
    form = replace(form, time=("t1", "t2"))
    whole = corrected(example, form, tmp_path, side_by_side(1))
    half = corrected(example, form, tmp_path, side_by_side(2), force=True)
    assert len(half.angle) == 320
    assert half.tracks["missing"].tolist() == [
        1
    ]  # the last moment lies after the second clock's last
    np.testing.assert_allclose(
        half.angle["after_arcsec"][:319:2], whole.angle["after_arcsec"][:319:2], atol=1e-6
    )
    assert "no t2" not in half.summary()
    slow = corrected(example, form, tmp_path, side_by_side(16), force=True)
    assert "300 of 320 lie outside its own or in a gap of more than 1 s." in slow.summary()
    assert "1 of 1 tracks have fewer than 20 angles" in slow.summary()


@pytest.mark.parametrize("wrong", ["sign", "heads"])
def test_a_correction_that_doubles_the_drift_is_noted(example, form, tmp_path, wrong):
    def spoil(table):
        names = spots_of(table)
        if wrong == "sign":
            return table.assign(**{c: -table[c] for c in names})
        one, two = spots_of(table, 1), spots_of(table, 2)
        return table.rename(columns=dict(zip(one + two, two + one, strict=True)))

    unreferenced = {h: replace(getattr(form, h), reference=()) for h in ("head_1", "head_2")}
    principal = form.principal
    clean = corrected(example, replace(form, **unreferenced), tmp_path, None)
    report = corrected(
        example, replace(form, principal=principal, **unreferenced), tmp_path, spoil, force=True
    )
    text = (
        "check the sign of the spots, whether the heads' spots are swapped, focal_mm and spot_unit."
    )
    assert text not in clean.summary()
    assert text in report.summary()


def test_results_keep_utc_where_the_input_had_it(example, form, tmp_path):
    report = corrected(example, form, tmp_path, None)
    given = pd.to_datetime(pd.read_csv(example / "telemetry.csv")["time"], utc=True)
    for name in ("corrected", "angle"):
        written = pd.read_csv(tmp_path / "out" / f"{name}.csv")
        assert (pd.to_datetime(written["time"], utc=True) == given).all()
        np.testing.assert_allclose(written["time_s"], report.angle["time_s"], rtol=0, atol=1e-6)
    corrected(example, form, tmp_path, lambda t: t.assign(time=np.arange(len(t)) / 8.0), force=True)
    assert "time" not in pd.read_csv(tmp_path / "out" / "angle.csv")


@pytest.mark.parametrize(("lost", "track"), [("spot1", 2), ("q1", 1)])
def test_a_track_without_a_value_is_said_to_be_missing(example, form, tmp_path, lost, track):
    def spoil(table):
        rows = table.index >= 320 if track == 2 else table.index < 320
        table.loc[rows, [c for c in table if c.startswith(lost)]] = np.nan
        return table

    report = corrected(example, form, tmp_path, spoil)
    text = report.summary()
    assert "nan" not in text and "missing arcsec" not in text
    assert "corrected missing (0 angles); " in text.splitlines()[track - 1]
    if lost == "spot1":
        assert "arcsec, corrected missing" in text.splitlines()[2]
        assert (
            "320 of 640 rows give no drift of their own: 0 are interpolated over up to 10 s "
            "(max_gap_s), 320" in text
        )
    else:
        assert "angle changed by" not in text
        assert "(track 2; white noise assumed)" in text


def test_spots_slower_than_ten_seconds_serve_if_the_gap_is_allowed(example, form, tmp_path):
    def sparse(table):
        table.loc[table.index % 160 != 0, spots_of(table)] = np.nan
        return table

    short = corrected(example, form, tmp_path, sparse)
    assert short.tracks["missing"].tolist() == [318, 318]
    assert "corrected +" in short.summary() and "(2 angles)" in short.summary()
    bridged = corrected(example, form, tmp_path, sparse, force=True, max_gap_s=30.0)
    assert bridged.tracks["missing"].tolist() == [159, 159]
    assert "317 are interpolated" not in bridged.summary()
    assert (
        "636 of 640 rows give no drift of their own: 318 are interpolated over up to 30 s"
        in bridged.summary()
    )


@pytest.mark.parametrize(
    ("unit_s", "message"),
    [
        (
            1e-3,
            r"telemetry.csv: times must be in seconds, but most samples .* the median step is 125 "
            r"s",
        ),
        (
            86400.0,
            r"telemetry.csv: times must be in seconds, but the median step is 1.45e-06 s; are they "
            r"days\?",
        ),
    ],
)
def test_times_that_are_no_seconds_are_refused(example, form, tmp_path, unit_s, message):
    with pytest.raises(ValueError, match=message):
        corrected(
            example, form, tmp_path, lambda t: t.assign(time=np.arange(len(t)) * 0.125 / unit_s)
        )
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


def test_slow_samples_pass_with_a_longer_track_gap(example, form, tmp_path):
    report = corrected(
        example,
        form,
        tmp_path,
        lambda t: t.assign(time=125.0 * np.arange(len(t))),
        track_gap_s=200.0,
        max_gap_s=200.0,
    )
    assert len(report.tracks) == 1


def test_aberration_left_in_the_attitudes_is_named_as_a_cause(tmp_path):
    setting = Pair(days=(58.0,), track_s=300.0)
    folder = write_telemetry(tmp_path / "pair", seed=3, setting=setting)
    seen = simulate(setting, 3, aberration=True).telemetry.quaternions
    names = [f"q{k}_{axis}" for k in (1, 2) for axis in "xyzw"]

    def summary(quaternions):
        table = pd.read_csv(folder / "telemetry.csv")
        table[names] = np.concatenate(quaternions, axis=1)
        table.to_csv(folder / "telemetry.csv", index=False)
        return correct_telemetry(folder / "telemetry.csv", tmp_path / "out", force=True).summary()

    assert "Stellar aberration" in summary(seen)
    times = (
        pd.to_datetime(pd.read_csv(folder / "telemetry.csv")["time"], utc=True)
        .dt.tz_localize(None)
        .to_numpy()
    )
    velocity = earth_velocity_km_s(times) + 7.6 * body_attitude(setting, setting.time_s).apply(
        [1.0, 0.0, 0.0]
    )
    cured = [remove_aberration(q, velocity, convention=CONVENTION) for q in seen]
    assert "Stellar aberration" not in summary(cured)


@pytest.mark.parametrize(
    ("tag_s", "text"), [(0.25, "put the tags right first"), (8.0, "wrong time tags of one head")]
)
def test_wrong_time_tags_of_one_head_are_noted(example, form, tmp_path, tag_s, text):
    def late(table):
        seconds = np.arange(320) / 8.0
        return table[:320].assign(t1=seconds, t2=seconds + tag_s)

    two = replace(form, time=("t1", "t2"))
    assert text in corrected(example, two, tmp_path, late).summary()
    right = corrected(example, form, tmp_path, None, force=True).summary()
    assert text not in right


def test_the_boresight_may_lie_along_another_axis(example, form, tmp_path):
    """Axes renamed x -> y -> z -> x in attitude, installation and boresight leave the angle as it
    was.
    """
    turn = Rotation.from_matrix([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

    def renamed(table):
        for k in (1, 2):
            names = [f"q{k}_{axis}" for axis in "xyzw"]
            table[names] = (Rotation.from_quat(table[names].to_numpy()) * turn).as_quat()
        return table

    into = tuple(map(tuple, turn.inv().as_matrix().tolist()))
    heads = {h: replace(getattr(form, h), installation=into) for h in ("head_1", "head_2")}
    along = replace(form, boresight=tuple(turn.inv().apply([0.0, 0.0, 1.0]).tolist()), **heads)
    expected = corrected(example, form, tmp_path, None)
    found = corrected(example, along, tmp_path, renamed, force=True)
    np.testing.assert_allclose(
        found.angle["after_arcsec"], expected.angle["after_arcsec"], atol=1e-5
    )
    normal = tuple(turn.inv().apply([1.0, 0.0, 0.0]).tolist())  # which both heads share
    with pytest.raises(ValueError, match="the boresights must stand 67.62"):
        read_telemetry(tmp_path / "telemetry.csv", replace(along, boresight=normal))
