"""The warm-up before a camera of metal and glass, and frames of one's own camera from a TOML file."""

import cv2
import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.cli import main
from losbench.papers.liu2026 import (
    CameraBench,
    UncertainCamera,
    bench_of,
    budget,
    expose_windows,
    left_over,
    one_lag,
    own_parameters,
    sensor_places,
    warm_up,
)
from losbench.papers.liu2026.export import write_recording
from losbench.resources import data_file
from losbench.thermoelastic.model import example_camera, read_camera_model
from losbench.units import rad_to_arcsec

MODEL = data_file("three-mirror-camera.toml")


@pytest.fixture(scope="module")
def bench():
    return bench_of(read_camera_model(MODEL))


def test_the_truth_is_what_the_measuring_chain_makes_of_true_spots(bench):
    run = warm_up(bench, time_s=np.linspace(0.0, bench.duration_s, 20))
    shifts = (run.truth_px - run.truth_px[0]) * bench.camera.pixel_mm
    found = lb.solve_attitude(bench.points_mm, shifts, method="ls").angles
    np.testing.assert_allclose(run.angles_rad, found, atol=1e-12)
    assert rad_to_arcsec(run.angles_rad[-1, 0]) == pytest.approx(-1.99, abs=0.05)
    assert run.node_degC.shape == (20, 4)


def test_the_warm_up_is_exact_whatever_the_frame_times(bench):
    some = np.array([0.0, 3000.0, bench.duration_s])
    every = warm_up(bench)
    chosen = np.searchsorted(every.time_s, some)
    np.testing.assert_allclose(
        warm_up(bench, time_s=some).truth_px, every.truth_px[chosen], atol=1e-4
    )


def test_windows_hold_the_drifting_spots(bench):
    run = warm_up(bench, time_s=np.linspace(0.0, bench.duration_s, 3))
    windows = expose_windows(bench, run.truth_px, np.random.default_rng(0))
    found = lb.centroid(windows.frames[0], windows.truth_px[:, :1] - windows.origin_px[0]).xy[:, 0]
    np.testing.assert_allclose(found + windows.origin_px[0], run.truth_px[:, 0], atol=0.05)


def test_the_example_needs_no_file():
    assert CameraBench(materials="all aluminium").chain.reference_degC == 18.0


def test_a_camera_of_ones_own_writes_frames_that_measure_reads(tmp_path):
    small = tmp_path / "camera.toml"
    text = MODEL.read_text(encoding="utf-8")
    text = text.replace("shape = [1080, 1920]", "shape = [120, 640]")
    small.write_text(text.replace("spot_separation_deg = 1.1914", "spot_separation_deg = 1.0"))
    out = tmp_path / "run"
    said = main(
        ["simulate", "--camera-model", str(small), "--out", str(out), "--frames", "4", "--quiet"]
    )
    assert said == 0
    truth = pd.read_csv(out / "truth.csv")
    camera = lb.Camera.from_toml(out / "camera.toml")
    spots = truth[["x1_px", "y1_px", "x2_px", "y2_px"]].to_numpy().reshape(-1, 2, 2)
    shifts = (spots - spots[0]) * camera.pixel_mm
    angles = lb.solve_attitude(camera.points_mm(spots[0]), shifts, method="ls").angles
    np.testing.assert_allclose(
        rad_to_arcsec(angles), truth.filter(like="arcsec").to_numpy(), atol=1e-6
    )
    frame = cv2.imread(str(out / "frames" / "frame-00000.tif"), cv2.IMREAD_UNCHANGED)
    found = lb.find_spots(frame, n=2)
    near = np.abs(found[:, None] - spots[0][None]).max(axis=-1).min(axis=1)
    assert near.max() < 1.0


def test_models_that_do_not_fit_the_warm_up_are_refused(tmp_path, capsys):
    text = MODEL.read_text(encoding="utf-8")
    for old, new, said in (
        ('input = "room_degC"\nW_per_K', 'input = "table_degC"\nW_per_K',
            "inputs: key table_degC is missing; the warm-up gives only room_degC"),
        ("spot_separation_deg = 1.1914", "spot_separation_deg = 4.2",
            "optics: key spot_separation_deg puts a spot less than 26 px from the edge"),
        ('M2 = "Zerodur"', 'M2 = "glass"', "[parts]: part 'M2': material must be one of"),
    ):  # fmt: skip
        path = tmp_path / "camera.toml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        out = str(tmp_path / "run")
        assert main(["simulate", "--camera-model", str(path), "--out", out]) != 0
        message = capsys.readouterr().err.strip()
        assert said in message
        assert str(path) in message
        assert "\n" not in message
    assert main(["simulate", "--paper", "ren2023", "--camera-model", str(path), "--out", out]) != 0
    assert "--camera-model must come with --paper liu2026" in capsys.readouterr().err


def test_frames_are_written_for_any_bench(tmp_path, bench):
    folder = write_recording(tmp_path / "run", n_frames=2, bench=bench)
    assert lb.Camera.from_toml(folder / "camera.toml") == example_camera().optics.pinhole


@pytest.fixture(scope="module")
def uncertain(bench):
    return UncertainCamera(bench.chain)


@pytest.mark.slow
def test_one_temperature_with_one_lag_misses_the_truth(bench):
    fits = one_lag(bench, seeds=4)
    assert ((fits["k"] - fits["truth"]).abs() > 5 * 0.03).all()  # its scatter over seeds is 0.03
    assert fits["k"].mean() == pytest.approx(-0.58, abs=0.05)
    assert fits["holds"].sum() >= 3  # the interval is that of all lags
    assert fits["truth"][0] == pytest.approx(-0.32, abs=0.01)
    left = left_over(bench)
    assert left["four exact thermometers"] < 0.01 < left["room, one lag"]


@pytest.mark.slow
def test_the_models_own_parameters_find_it(bench, uncertain):
    fits = own_parameters(uncertain, bench, seeds=4)
    assert (fits["k"] - fits["truth"]).abs().max() < 0.012  # three sigma of 0.004
    assert fits["holds"].sum() >= 2


def test_nominal_parameters_are_the_camera(bench, uncertain):
    time = np.array([0.0, 600.0, 5400.0, 9000.0])
    room = bench.room_degC(time)
    run = bench.chain.simulate(time, {"room_degC": room})
    found = uncertain.shifts_px(np.zeros(8), time, room)
    np.testing.assert_allclose(found, (run.px - run.px[0]).reshape(-1, 4), atol=1e-4)
    assert uncertain.k_arcsec_per_degC(np.zeros(8)) == pytest.approx(
        bench.steady_arcsec_per_degC[0]
    )


@pytest.mark.slow
def test_the_budget_closes_on_all_three_axes(bench, uncertain):
    draws = 200
    table = budget(uncertain, bench, draws=draws)
    sampling = 3 / np.sqrt(2 * draws)
    np.testing.assert_allclose(table.loc["ratio"], 1.0, atol=0.05 + sampling)
    # Values of an independent prototype.
    np.testing.assert_allclose(table.loc["heat"], [0.223, 0.170, 0.052], atol=0.02)
    np.testing.assert_allclose(table.loc["centroids"], [0.112, 0.113, 10.76], rtol=0.02)


@pytest.mark.slow
def test_greedy_thermometers_beat_luck(uncertain):
    table = sensor_places(uncertain, sensors=3, runs=8)
    assert (table.loc["greedy"] < table.loc["random"]).all()
    assert table.loc["greedy", "alpha"] < 0.5 * table.loc["none", "alpha"]
