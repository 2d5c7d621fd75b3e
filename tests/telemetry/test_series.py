"""Series from CSV files, commands on them, and attitude messages read back."""

import subprocess
import sys
from datetime import datetime

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.cli import main
from losbench.papers.liu2026 import ThermalBench, warm_up
from losbench.papers.ren2023.export import write_telemetry
from losbench.papers.ren2023.scenario import Pair
from losbench.telemetry.aem import aem_text
from losbench.telemetry.series import read_angles
from losbench.units import arcsec_to_rad, rad_to_arcsec

NAMES = {
    "frame_a": "EME2000",
    "frame_b": "SC_BODY_1",
    "object_name": "TWIN",
    "object_id": "2026-001A",
}
START = np.datetime64("2026-03-01T12:00:00")


@pytest.fixture
def series(tmp_path):
    t = np.arange(0.0, 9000.1, 30.0)
    run = warm_up(ThermalBench(), time_s=t)
    noise = 0.05 * np.random.default_rng(1).standard_normal((t.size, 2))
    angles = rad_to_arcsec(run.angles_rad[:, :2]) + noise
    path = tmp_path / "series.csv"
    pd.DataFrame(
        {"time_s": t, "a_arcsec": angles[:, 0], "b_arcsec": angles[:, 1], "room": run.room_degC}
    ).to_csv(path, index=False)
    return path


def test_identify_writes_a_model_that_compensates_as_its_table_says(series, tmp_path, capsys):
    out = tmp_path / "out"
    code = main(
        [
            "identify",
            str(series),
            "--angles",
            "a_arcsec",
            "b_arcsec",
            "--temperatures",
            "room",
            "--folds",
            "3",
            "--out",
            str(out),
        ]
    )
    assert code == 0
    assert "all lags" in capsys.readouterr().out
    names = {path.name for path in out.iterdir()}
    tables = {"sensitivity.csv", "compensated.csv", "folds.csv"}
    assert names == tables | {"model.toml", "angles.png", "report.txt", "report.json"}
    model = lb.FittedModel.from_toml(out / "model.toml")
    read = read_angles(series, ["a_arcsec", "b_arcsec"], ["room"])
    left = rad_to_arcsec(model.compensate(read.angles, read.sensors, read.time_s))
    written = pd.read_csv(out / "compensated.csv")
    np.testing.assert_allclose(written["b_compensated_arcsec"], left[:, 1], atol=1e-7)
    truth = np.sum(ThermalBench().sensitivity_arcsec_per_degC[:2], axis=1)
    found = pd.read_csv(out / "sensitivity.csv")
    assert ((found["from"] < truth) & (truth < found["until"])).all()


def test_metrics_and_budget_judge_a_series(series, tmp_path, capsys):
    budget = tmp_path / "budget.toml"
    budget.write_text(
        '[[requirement]]\nid = "R1"\nindex = "RPE"\nlimit = 1.0\nfactor = 2\n'
        '[[source]]\nname = "noise"\nkind = "noise"\nexactly = 0.3\n'
    )
    arguments = ["metrics", str(series), "--angles", "a_arcsec", "--window-s", "300"]
    assert main([*arguments, "--require", str(budget), "--out", str(tmp_path / "m")]) == 0
    assert "R1 (RPE x 2): a_arcsec met" in capsys.readouterr().out
    assert set(pd.read_csv(tmp_path / "m" / "metrics.csv")["metric"]) >= {"APE", "RPE", "jitter"}
    assert main(["budget", str(budget), "--out", str(tmp_path / "b")]) == 0
    assert "0.6" in capsys.readouterr().out
    assert len(pd.read_csv(tmp_path / "b" / "contributions.csv")) == 5


def test_no_command_writes_over_its_input_or_over_what_is_not_its_own(series, tmp_path, capsys):
    angles = ["--angles", "a_arcsec"]
    commands = {
        "metrics.csv": ["metrics", str(series), *angles, "--window-s", "300"],
        "model.toml": ["identify", str(series), *angles, "--temperatures", "room"],
        "budget.csv": ["budget", str(tmp_path / "budget.toml")],
    }
    (tmp_path / "budget.toml").write_text("")
    for name, command in commands.items():
        assert main([*command, "--out", str(tmp_path), "--force"]) == 2
        assert "lies in the folder to write to" in capsys.readouterr().err
        (tmp_path / "own").mkdir(exist_ok=True)
        (tmp_path / "own" / name).write_text("mine")
        assert main([*command, "--out", str(tmp_path / "own"), "--force"]) == 2
        assert "which no earlier run of losbench lists" in capsys.readouterr().err
        assert (tmp_path / "own" / name).read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["metrics", "FILE", "--angles", "c_arcsec", "--window-s", "60"], "has no column c_arcsec"),
        (["metrics", "FILE", "--angles", "room", "--window-s", "60"], "the unit of column 'room'"),
        (["metrics", "FILE", "--angles", "a_arcsec", "--window-s", "1e7"], "window_s must span"),
        (
            [
                "identify",
                "FILE",
                "--angles",
                "a_arcsec",
                "--temperatures",
                "room",
                "--lag",
                "slow",
                "--out",
                "OUT",
            ],
            'tau_s must be a number, "fit" or "spectrum"',
        ),
        (
            ["identify", "FILE", "--angles", "a_arcsec", "--folds", "many", "--out", "OUT"],
            "--folds must be a whole number or year",
        ),
        (["budget", "none.toml"], "no TOML file at none.toml"),
    ],
)
def test_wrong_use_of_a_command_is_said_in_a_line(series, tmp_path, capsys, arguments, message):
    places = {"FILE": str(series), "OUT": str(tmp_path / "out")}
    assert main([places.get(word, word) for word in arguments]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1


ROW_S = 30.0


def written(tmp_path, **changes):
    """A CSV file of 120 rows, its columns changed."""
    t = ROW_S * np.arange(120)
    room = 20.0 + np.sin(t / 700.0)
    noise = 0.05 * np.random.default_rng(3).standard_normal(t.size)
    frame = pd.DataFrame({"time_s": t, "a_arcsec": 2.0 * room + noise, "room": room})
    frame = frame.assign(flat=3.0, same=2.0 * room + 1.0)
    for name, change in changes.items():
        frame[name] = change(frame)
    path = tmp_path / "series.csv"
    frame.to_csv(path, index=False)
    return path


def missing(first, last):
    return lambda f: f["a_arcsec"].where((f.index < first) | (f.index >= last))


IDENTIFY = ["identify", "FILE", "--angles", "a_arcsec", "--out", "OUT"]
METRICS = ["metrics", "FILE", "--angles", "a_arcsec"]


@pytest.mark.parametrize(
    ("command", "changes", "message"),
    [
        (
            [*IDENTIFY, "--temperatures", "room"],
            {"time_s": lambda f: f["time_s"][::-1].to_numpy()},
            "column 'time_s' must increase, but data row 2",
        ),
        (
            [*IDENTIFY, "--temperatures", "room"],
            {"time_s": lambda f: f["time_s"].where(f.index != 5, 4 * ROW_S)},
            "column 'time_s' must increase, but data row 6",
        ),
        (
            [*IDENTIFY, "--temperatures", "flat"],
            {},
            "sensor flat must vary to give a sensitivity, got 3 throughout",
        ),
        (
            [*IDENTIFY, "--temperatures", "room"],
            {"a_arcsec": missing(0, 118)},
            "angles must hold more than 3 samples with every sensor, to fit as many unknowns, got 2",
        ),
        (
            [*IDENTIFY, "--temperatures", "room", "--folds", "6"],
            {"a_arcsec": missing(20, 45)},
            "folds must each hold samples, got none in block 2",
        ),
        ([*IDENTIFY, "--steps", "9e9"], {}, "Steps must lie within the record, after 0 s"),
        ([*IDENTIFY, "--steps", "0"], {}, "Steps must lie within the record, after 0 s"),
        ([*IDENTIFY, "--trend", "9"], {}, "degree must be a whole number from 1 to 5, got 9"),
        (
            [*IDENTIFY, "--temperatures", "room", "--lag", "none", "--linear", "room"],
            {},
            "model must hold each term once, got room twice",
        ),
        ([*METRICS, "--window-s", "1e6"], {}, "fit into the record, which has 120 of 30 s"),
        ([*METRICS, "--window-s", "10"], {}, "window_s must span 2 samples or more"),
        (
            [*METRICS, "--window-s", "300", "--separation-s", "1e6"],
            {},
            "separation_s must span 1 samples or more and fit",
        ),
        (
            [*METRICS, "--window-s", "300"],
            {"a_arcsec": lambda f: f["a_arcsec"].where(f.index % 9 > 0)},
            "window_s must fit into a stretch without gaps, the longest of which is 240 s",
        ),
        (
            [*METRICS, "--window-s", "300"],
            {"time_s": lambda f: f["time_s"][::-1].to_numpy()},
            "column 'time_s' must increase",
        ),
    ],
)
def test_a_bad_series_is_named_in_a_line(tmp_path, capsys, command, changes, message):
    places = {"FILE": str(written(tmp_path, **changes)), "OUT": str(tmp_path / "out")}
    assert main([places.get(word, word) for word in command]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_sensors_that_read_the_same_and_steps_within_one_fold_are_told_in_the_report(tmp_path):
    path, out = str(written(tmp_path)), tmp_path / "out"
    common = ["identify", path, "--angles", "a_arcsec", "--quiet"]
    assert main([*common, "--temperatures", "room", "same", "--out", str(out)]) == 0
    text = (out / "report.txt").read_text()
    assert "room lagged, same lagged cannot be told apart by these samples" in text
    assert pd.read_csv(out / "sensitivity.csv")["arcsec_per_degC"].isna().all()
    steps = ["--steps", str(65 * ROW_S), str(70 * ROW_S), "--folds", "4"]
    assert main([*common, *steps, "--out", str(tmp_path / "steps")]) == 0
    text = (tmp_path / "steps" / "report.txt").read_text()
    assert "Not predictable: block 3" in text and "DataFrame" not in text


def test_times_that_go_back_are_named_by_row(tmp_path):
    path = tmp_path / "series.csv"
    path.write_text("time_s,a_deg\n0,1\n5,1\n5,2\n7,3\n")
    with pytest.raises(ValueError, match="column 'time_s' must increase, but data row 3"):
        read_angles(path, ["a_deg"])


def test_dates_and_units_are_read(tmp_path):
    path = tmp_path / "series.csv"
    path.write_text("time,a_mas,b_deg\n2026-03-01T12:00:00Z,1000,1\n2026-03-01T12:00:05Z,,2\n")
    read = read_angles(path, ["a_mas", "b_deg"])
    assert read.angles[0, 0] == pytest.approx(float(arcsec_to_rad(1.0)))
    assert read.angles[1, 1] == pytest.approx(np.radians(2.0))
    assert np.isnan(read.angles[1, 0])
    assert read.time_s.tolist() == [0.0, 5.0]
    assert read.start == np.datetime64("2026-03-01T12:00:00")


def attitudes():
    t = 0.5 * np.arange(60)
    t[40:] += 100.0
    turned = Rotation.from_rotvec(np.outer(t, [0.001, -0.002, 0.003]))
    return t, turned * Rotation.random(rng=np.random.default_rng(1))


def read_message(text):
    """Epochs, numbers (n, 7) and key words of a message."""
    keys = [line for line in text.splitlines() if " = " in line]
    data = [line.split() for line in text.splitlines() if line[:1].isdigit()]
    return [row[0] for row in data], np.array([row[1:] for row in data], dtype=float), keys


def test_an_attitude_message_comes_back_to_the_last_digits_with_rates_and_segments():
    t, turned = attitudes()
    q = turned.as_quat()
    q[7] = np.nan
    created = datetime(2026, 3, 2, 8, 0, 0)
    text, segments = aem_text(t, q, start=START, created=created, **NAMES)
    assert segments == 3
    epochs, numbers, keys = read_message(text)
    kept = np.isfinite(q).all(axis=1)
    np.testing.assert_allclose(numbers[:, :4], q[kept], atol=1e-12)
    rate = turned[0].inv().apply([0.001, -0.002, 0.003])
    np.testing.assert_allclose(numbers[0, 4:], np.degrees(rate), rtol=1e-9)
    assert np.datetime64(epochs[1]) - START == np.timedelta64(500, "ms")
    assert keys.count("REF_FRAME_A = EME2000") == 3
    assert "CREATION_DATE = 2026-03-02T08:00:00" in keys


def test_brahe_reads_every_component_of_a_message_back(tmp_path):
    ccsds = pytest.importorskip("brahe.ccsds", reason="brahe is in the extra messages")
    t, turned = attitudes()
    q = turned.as_quat()
    q[7] = np.nan
    path = tmp_path / "attitude.aem"
    path.write_text(aem_text(t, q, start=START, **NAMES)[0])
    segments = ccsds.AEM.from_file(str(path)).segments
    frames = {(s.ref_frame_a, s.ref_frame_b, s.time_system, s.angvel_frame) for s in segments}
    assert len(segments) == 3
    assert frames == {("EME2000", "SC_BODY_1", "UTC", "SC_BODY_1")}
    states = [state for segment in segments for state in segment.states]
    read = np.array([[s.quaternion.data[k] for k in (1, 2, 3, 0)] for s in states])
    rates = np.array([state.angular_velocity for state in states])
    np.testing.assert_allclose(read, q[np.isfinite(q).all(axis=1)], rtol=0, atol=1e-12)
    # The axis of the turn stands in frame A; in frame B it is where the first attitude puts it.
    first = turned[0].inv().apply([0.001, -0.002, 0.003])
    np.testing.assert_allclose(rates, np.tile(first, (59, 1)), rtol=0, atol=1e-12)
    assert str(states[1].epoch).startswith("2026-03-01 12:00:00.500 UTC")


@pytest.mark.parametrize("missing", sorted(NAMES))
def test_a_message_without_its_frames_or_object_is_refused(missing):
    t, turned = attitudes()
    with pytest.raises(ValueError, match=f"{missing} must be named in an attitude message"):
        aem_text(t, turned.as_quat(), start=START, **(NAMES | {missing: " "}))


def test_attitudes_that_never_stand_together_have_no_rates():
    t, turned = attitudes()
    q = turned.as_quat()
    q[::2] = np.nan
    with pytest.raises(ValueError, match="must hold two neighbouring samples"):
        aem_text(t, q, start=START, **NAMES)


def test_drift_writes_messages_whose_attitudes_are_those_of_its_table(tmp_path):
    folder = write_telemetry(
        tmp_path / "pair", seed=3, setting=Pair(days=(0.0, 58.0), track_s=20.0)
    )
    out = tmp_path / "out"
    names = ["--aem", "EME2000", "ST_1", "ST_2", "TWIN", "2022-001A"]
    assert main(["drift", str(folder / "telemetry.csv"), "--out", str(out), "--quiet", *names]) == 0
    table = pd.read_csv(out / "corrected.csv")
    _, numbers, keys = read_message((out / "corrected-2.aem").read_text())
    columns = [f"q2_{axis}" for axis in "xyzw"]
    written = table[columns].dropna().to_numpy()
    same = np.abs(np.sum(written[: len(numbers)] * numbers[:, :4], axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-11)
    assert "REF_FRAME_B = ST_2" in keys


def test_the_commands_are_there_for_a_new_user():
    done = subprocess.run(
        [sys.executable, "-m", "losbench.cli", "--help"], capture_output=True, text=True, check=True
    )
    for command in ("identify", "metrics", "budget"):
        assert command in done.stdout
