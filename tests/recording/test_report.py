"""What the report says of a sensitivity and of pointing: no number outside its own interval."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.logs import FrameTimes, TemperatureLog
from losbench.pointing.thermal.lag import lagged
from losbench.pointing.told import finite, metric_sentences
from losbench.recording.performance import metrics_of
from losbench.recording.readers import Recording
from losbench.recording.report import write_report
from losbench.recording.sensitivity import ABOUT, sensitivity_of
from losbench.recording.stamps import Stamp
from losbench.units import arcsec_to_rad, rad_to_arcsec

SPOTS = np.array([[40.0, 30.0], [110.0, 32.0], [75.0, 70.0]])
CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(100, 150))
TIME_S = np.arange(0.0, 3600.0, 30.0)
CELSIUS = 20.0 + 3.0 * np.sin(TIME_S / 500.0)
GAINS = np.array([0.2, 0.4, -3.0])  # arcsec per degree
NAMES = ("alpha", "beta", "gamma")


@pytest.fixture(scope="module")
def warmed():
    """A measurement of 120 frames, whose angles each test replaces by known ones."""
    detector = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
    light = np.repeat(lb.render_spots(SPOTS, 4e5, 2.0, CAMERA.shape)[None], len(TIME_S), axis=0)
    stamp = Stamp("frame", lb.open_frames(detector.expose(light, 3)))
    recording = Recording(
        Path("memory"), len(TIME_S), (stamp,), times=FrameTimes(TIME_S), detector=detector
    )
    wall = CELSIUS + 0.3 * np.random.default_rng(4).standard_normal(len(TIME_S))
    log = TemperatureLog(
        FrameTimes(TIME_S),
        np.column_stack([CELSIUS, wall]),
        ("temperature_room_degC", "temperature_wall_degC"),
    )
    return lb.measure(recording, CAMERA, spots=SPOTS, temperature=log), recording


def with_angles(measured, clean_arcsec, sigma_arcsec=0.05):
    rng = np.random.default_rng(5)
    seen = clean_arcsec + sigma_arcsec * rng.standard_normal((len(TIME_S), 3))
    columns = {f"{name}_arcsec": seen[:, i] for i, name in enumerate(NAMES)}
    attitude = replace(measured.attitude, angles=arcsec_to_rad(seen))
    return replace(measured, attitude=attitude, table=measured.table.assign(**columns))


def straight():
    return GAINS * (CELSIUS - 20.0)[:, None]


def test_a_sensitivity_holds_the_truth_and_is_identify_s(warmed):
    measured = with_angles(warmed[0], straight())
    told = sensitivity_of(measured)
    numbers = told.numbers()
    model = lb.terms.Offset() + lb.terms.Lagged("T", tau_s="spectrum")
    for i, (name, truth) in enumerate(zip(NAMES, GAINS, strict=True)):
        low, high = numbers[name]["interval_95_arcsec_per_degC"]
        assert low < truth < high
        assert low < numbers[name]["arcsec_per_degC"] < high
        found = lb.identify(model, measured.attitude.angles[:, i], {"T": CELSIUS}, TIME_S)
        assert numbers[name]["arcsec_per_degC"] == pytest.approx(found.sensitivity[0], abs=1e-6)
        assert numbers[name]["one_lag_p_value"] == pytest.approx(
            found.lack_of_fit[0].f_p_value, abs=1e-6
        )
        assert numbers[name]["lag_s"] == 0.0
        assert numbers[name]["rms_arcsec"] == pytest.approx(
            float(np.std(rad_to_arcsec(measured.attitude.angles[:, i]) - straight()[:, i])),
            rel=0.05,
        )
    assert numbers["gamma"]["lag_state"] == "no lag seen"
    lines = told.sentences()
    assert all("no lag, " in line and "temperature_room_degC: " in line for line in lines)


def test_a_law_of_several_lags_is_told_and_the_best_single_one_named_beside(warmed):
    slow = lagged(CELSIUS - 20.0, TIME_S, 900.0)
    fast = lagged(CELSIUS - 20.0, TIME_S, 60.0)
    clean = np.outer(2.0 * slow - 0.8 * fast, [1.0, -1.0, 0.0])
    told = sensitivity_of(with_angles(warmed[0], clean))
    numbers = told.numbers()
    assert numbers["alpha"]["one_lag_p_value"] < 1e-3
    low, high = numbers["alpha"]["interval_95_arcsec_per_degC"]
    assert low < 1.2 < high
    one = numbers["alpha"]["one_lag_arcsec_per_degC"]
    assert not low <= one <= high
    assert f"over all lags: one alone gives {one:+.4f}" in told.sentences()[0]
    assert any(note.startswith("About X: one lag does not describe it") for note in told.notes())


def test_a_lag_as_long_as_the_record_is_said_to_be_not_identifiable(warmed):
    ramp = replace(
        warmed[0], table=warmed[0].table.assign(temperature_room_degC=18.0 + TIME_S / 400.0)
    )
    clean = np.outer(lagged(TIME_S / 400.0, TIME_S, 20_000.0), [1.0, 1.0, 1.0])
    told = sensitivity_of(with_angles(ramp, clean, 0.2))
    assert told.lag_state == ["not identifiable"] * 3
    assert all("not identifiable: one as long as" in line for line in told.sentences())
    assert any("only as far as lags within the record" in note for note in told.notes())


def test_a_sensor_that_was_left_out_is_noticed(warmed):
    wall = warmed[0].table["temperature_wall_degC"].to_numpy()
    told = sensitivity_of(with_angles(warmed[0], np.outer(wall - 20.0, [1.0, 0.0, 0.0]), 0.01))
    assert any(
        "About X: with all sensors, temperature_room_degC lagged changes" in note
        for note in told.notes()
    )


def test_frames_without_a_time_have_a_sensitivity_without_a_lag(warmed):
    still = replace(warmed[0], table=warmed[0].table.assign(time_s=np.zeros(len(TIME_S))))
    told = sensitivity_of(with_angles(still, straight()))
    assert told.lag_state == ["given"] * 3
    assert told.numbers()["beta"]["lag_interval_95_s"] == []
    assert told.numbers()["beta"]["one_lag_p_value"] is None
    np.testing.assert_allclose(told.one_lag_arcsec_per_degC, GAINS, atol=0.05)


def test_metrics_are_those_of_the_angles_and_say_their_window(warmed):
    measured = with_angles(warmed[0], straight())
    found = metrics_of(measured)
    assert found.window_s == pytest.approx(360.0)
    same = lb.pointing_metrics(measured.attitude.angles, TIME_S, 360.0)
    np.testing.assert_array_equal(found.rpe.value, same.rpe.value)
    line = metric_sentences(found, ABOUT)[2]
    assert line.startswith("Pointing about Z in windows of 360 s, arcsec (95 %): APE ")
    assert f"RPE {rad_to_arcsec(found.rpe.value[2]):.3g} (" in line
    assert metrics_of(measured, 120.0).window_s == pytest.approx(120.0)
    with pytest.raises(ValueError, match="window_s must span 2 samples or more and fit"):
        metrics_of(measured, 1e5)
    with pytest.raises(ValueError, match="window_s needs angles over time: a camera, and frames"):
        metrics_of(replace(measured, attitude=None), 120.0)
    few = measured.attitude.angles.copy()
    few[::3] = np.nan
    assert metrics_of(replace(measured, attitude=replace(measured.attitude, angles=few))) is None
    few[19:] = np.nan
    assert metrics_of(replace(measured, attitude=replace(measured.attitude, angles=few))) is None


def test_all_of_it_goes_into_table_page_and_report(warmed, tmp_path):
    measured = with_angles(warmed[0], straight())
    lines = write_report(measured, tmp_path, recording=warmed[1], window_s=300.0)
    assert sum(line.startswith("Sensitivity about") for line in lines) == 3
    assert sum("in windows of 300 s" in line for line in lines) == 3
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["sensitivity_to"] == "temperature_room_degC"
    assert report["pointing"]["window_s"] == 300.0
    axis = report["pointing"]["series"]["gamma"]
    low, high = axis["rpe_interval_95_arcsec"]
    assert low < axis["rpe_arcsec"] < high
    table = pd.read_csv(tmp_path / "measurement.csv")
    left = table["gamma_compensated_arcsec"]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(
        report["sensitivity"]["gamma"]["rms_arcsec"], rel=1e-4
    )
    of_axis = pd.read_csv(tmp_path / "sensitivity.csv").set_index("axis")
    assert of_axis.loc["gamma", "arcsec_per_degC"] == pytest.approx(
        report["sensitivity"]["gamma"]["arcsec_per_degC"], abs=1e-6
    )
    metrics = pd.read_csv(tmp_path / "metrics.csv")
    assert set(metrics["axis"]) == set(NAMES) and {"APE", "jitter"} <= set(metrics["metric"])
    page = (tmp_path / "report.html").read_text()
    for words in ("Pointing metrics", "Sensitivity to temperature_room_degC, at rest", "one lag"):
        assert words in page
    for name in ("compensated.png", "metrics.png"):
        assert (tmp_path / name).stat().st_size > 5000


def test_json_has_no_nan():
    assert finite(np.nan) is None and finite(-np.inf) is None
    assert finite(1.23456789) == 1.234568
