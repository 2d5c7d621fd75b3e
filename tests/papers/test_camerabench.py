"""The warm-up before a camera of metal and glass, and frames of one's own camera from a TOML file."""

import cv2
import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.cli import main
from losbench.papers.liu2026 import CameraBench, bench_of, expose_windows, warm_up
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
