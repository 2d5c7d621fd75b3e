"""Simulated recordings give back their truth within their predicted errors; what goes wrong is said, and goes on."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.imaging.results import SpotFlag
from losbench.papers.liu2026.bench import ThermalBench
from losbench.papers.liu2026.recording import write_recording
from losbench.recording.readers import Recording
from losbench.recording.report import write_report
from losbench.recording.stamps import Stamp, UnreadableFrame
from losbench.recording.times import FrameTimes, TemperatureLog, read_temperature_log
from losbench.units import rad_to_arcsec

REFERENCE = 20
SPOTS = np.array([[40.0, 30.0], [110.0, 32.0], [75.0, 70.0], [30.0, 75.0]])
DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(100, 150))


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    small = replace(ThermalBench(), shape=(120, 640), spot_row_px=59.5)
    return write_recording(tmp_path_factory.mktemp("twin"), n_frames=160, seed=3, bench=small)


def in_memory(frames, times=None):
    stamp = Stamp("frame", frames.shape[1:], (0.0, 0.0), lambda k: frames[k])
    return Recording(Path("memory"), len(frames), (stamp,), times=times)


def frames_of(spots, n=12, flux=2e5, seed=5):
    electrons = lb.render_spots(np.broadcast_to(spots, (n, *np.shape(spots)[-2:])), flux, 2.0, CAMERA.shape) + 40.0
    return DETECTOR.expose(electrons, seed)


def test_the_twin_is_measured_within_its_predicted_errors(simulated):
    recording = lb.read_recording(simulated / "frames", times=simulated / "times.csv")
    measured = lb.measure(
        recording,
        lb.Camera.from_toml(simulated / "camera.toml"),
        detector=lb.Detector.from_toml(simulated / "camera.toml"),
        reference=REFERENCE,
    )
    truth = pd.read_csv(simulated / "truth.csv")
    angles = truth[["alpha_arcsec", "beta_arcsec", "gamma_arcsec"]].to_numpy()
    error = rad_to_arcsec(measured.attitude.angles) - (angles - angles[:REFERENCE].mean(axis=0))
    cov = rad_to_arcsec(rad_to_arcsec(measured.attitude.cov))
    chi_square = np.einsum("fi,fij,fj->f", error, np.linalg.inv(cov), error)[REFERENCE:]
    assert 0.8 < chi_square.mean() / 3 < 1.2
    positions = truth[["x1_px", "y1_px", "x2_px", "y2_px"]].to_numpy().reshape(-1, 2, 2)
    pull = (measured.xy_px - positions) / measured.sigma_xy_px
    assert 0.8 < np.mean(pull**2) < 1.2
    assert 0.01 < np.median(measured.attitude.p_value) < 0.99


def test_the_table_has_times_temperatures_shifts_and_angles(simulated):
    recording = lb.read_recording(simulated / "frames", times=simulated / "times.csv")
    log = TemperatureLog(FrameTimes(np.array([0.0, 9000.0])), np.array([[18.0], [25.0]]), ("temperature_degC",))
    table = lb.measure(recording, lb.Camera.from_toml(simulated / "camera.toml"), temperature=log).table
    assert list(table.columns[:3]) == ["frame", "time_s", "temperature_degC"]
    assert {"dx1_px", "dy2_px", "flags1", "alpha_arcsec", "sigma_gamma_arcsec", "p_value"} <= set(table.columns)
    assert table["temperature_degC"].is_monotonic_increasing


def test_the_order_of_spots_is_brightness_and_stays():
    frames = frames_of(SPOTS[:3], flux=[1e5, 3e5, 2e5])
    measured = lb.measure(in_memory(frames))
    np.testing.assert_allclose(measured.reference_px, SPOTS[[1, 2, 0]], atol=0.05)


def test_without_camera_there_are_shifts_and_a_note():
    measured = lb.measure(in_memory(frames_of(SPOTS[:2])))
    assert measured.attitude is None
    assert "alpha_arcsec" not in measured.table
    assert "No camera was given: the table holds shifts in pixels, no angles." in measured.notes
    assert "No frame times were given: rows are numbered." in measured.notes


def test_a_spot_that_goes_out_is_nan_and_flagged_and_comes_back():
    frames = frames_of(SPOTS)
    frames[4:7, 20:41, 30:51] = frames_of(SPOTS[1:])[4:7, 20:41, 30:51]
    measured = lb.measure(in_memory(frames), CAMERA, spots=SPOTS, detector=DETECTOR, block=5)
    lost = np.isnan(measured.xy_px[:, 0, 0])
    assert np.flatnonzero(lost).tolist() == [4, 5, 6]
    assert (measured.flags[4:7, 0] & SpotFlag.TOO_FAINT).all()
    assert np.isfinite(measured.attitude.angles).all()
    assert "Spot 1 is lost in 3 of 12 frames." in measured.notes


def test_with_two_spots_a_lost_one_costs_the_angles_of_its_frames():
    frames = frames_of(SPOTS[:2])
    frames[5] = frames_of(SPOTS[1:2])[5]
    measured = lb.measure(in_memory(frames), CAMERA, spots=SPOTS[:2], detector=DETECTOR)
    assert np.flatnonzero(np.isnan(measured.attitude.angles).any(axis=1)).tolist() == [5]
    assert any("Two spots cannot tell which of them is bad" in note for note in measured.notes)


def moving(speed_px, n=60, seed=6):
    path = np.arange(n)[:, None, None] * np.array([speed_px, 0.0])
    electrons = lb.render_spots(SPOTS[[0, 3]] + path, 2e5, 2.0, CAMERA.shape) + 40.0
    return DETECTOR.expose(electrons, seed), SPOTS[[0, 3]] + path


@pytest.mark.parametrize("speed_px", [0.0, 0.4, 1.5])
def test_moving_spots_are_followed_whatever_the_block(speed_px):
    frames, truth = moving(speed_px)
    measured = lb.measure(in_memory(frames), detector=DETECTOR, n_spots=2)
    order = np.argsort(measured.reference_px[:, 1])
    np.testing.assert_allclose(measured.xy_px[:, order], truth, atol=0.06)


def test_a_spot_that_is_gone_for_good_does_not_drag_the_other_along():
    frames, truth = moving(0.4, n=100)
    frames[34:, 60:] = DETECTOR.expose(np.full(frames[34:, 60:].shape, 40.0), 9)
    measured = lb.measure(in_memory(frames), detector=DETECTOR, spots=truth[0])
    np.testing.assert_allclose(measured.xy_px[:, 0], truth[:, 0], atol=0.06)
    assert np.isnan(measured.xy_px[34:, 1]).all()


def test_eight_bit_frames_give_angles_with_errors_that_hold():
    electrons = np.broadcast_to(lb.render_spots(SPOTS, 2e4, 2.0, CAMERA.shape) + 40.0, (40, *CAMERA.shape))
    sensor = lb.Detector(gain_e_per_dn=6.0, read_noise_e=1.0, offset_dn=5.0, bits=8)
    frames = sensor.expose(electrons, 4).astype(np.uint8)
    measured = lb.measure(in_memory(frames), CAMERA, detector=sensor)
    pull = (measured.xy_px - measured.xy_px.mean(axis=0)) / measured.sigma_xy_px
    assert 0.7 < np.mean(pull**2) < 1.4
    bare = lb.measure(in_memory(frames), CAMERA)
    assert np.isfinite(bare.attitude.angles).all()
    assert any(note.startswith("No detector was given") for note in bare.notes)


def test_frames_of_another_shape_than_the_camera_are_refused():
    with pytest.raises(ValueError, match=r"camera must have the shape of the frames, \(100, 150\), got \(1080, 1920\)"):
        lb.measure(in_memory(frames_of(SPOTS)), lb.Camera(260.0, 10.0, (1080, 1920)))


def test_a_saturated_spot_is_flagged():
    electrons = lb.render_spots(SPOTS[None, :2], [2e5, 3e6], 2.0, CAMERA.shape) + 40.0
    clipped = replace(DETECTOR, bits=12).expose(electrons, 1)
    measured = lb.measure(in_memory(clipped), detector=replace(DETECTOR, bits=12), spots=SPOTS[:2])
    assert (measured.flags & SpotFlag.SATURATED).astype(bool).tolist() == [[False, True]]
    assert "1 of 2 centroids carry the flag SATURATED." in measured.notes


def test_a_spot_at_the_border_has_no_centroid_and_says_so():
    frames = frames_of([[40.0, 30.0], [110.0, 32.0], [3.0, 70.0]])
    with pytest.raises(ValueError, match=r"spot \[3\] is in none of 1"):
        lb.measure(in_memory(frames), spots=[[40.0, 30.0], [110.0, 32.0], [3.0, 70.0]])


def test_unreadable_frames_leave_a_gap(tmp_path):
    for k, frame in enumerate(frames_of(SPOTS)):
        cv2.imwrite(str(tmp_path / f"{k:02d}.tif"), frame)
    for k in (0, 5):
        (tmp_path / f"{k:02d}.tif").write_bytes(b"not a TIFF")
    with pytest.raises(UnreadableFrame, match=r"00.tif cannot be read"):
        lb.read_recording(tmp_path)
    with pytest.raises(ValueError, match=r"is in none of 1"):
        lb.measure(lb.read_recording(tmp_path, on_unreadable="skip"), CAMERA, detector=DETECTOR)
    cv2.imwrite(str(tmp_path / "00.tif"), frames_of(SPOTS)[0])
    measured = lb.measure(lb.read_recording(tmp_path, on_unreadable="skip"), CAMERA, detector=DETECTOR)
    assert np.flatnonzero(np.isnan(measured.xy_px).any(axis=(1, 2))).tolist() == [5]
    assert (measured.flags[5] == SpotFlag.MISSING).all()


def test_smoothing_lowers_the_scatter_of_a_slow_drift():
    drift = np.linspace(0.0, 1.0, 120)[:, None, None] * [1.0, 0.5]
    frames = DETECTOR.expose(lb.render_spots(SPOTS[:2] + drift, 2e4, 2.0, CAMERA.shape) + 40.0, 8)
    raw = lb.measure(in_memory(frames), spots=SPOTS[:2], detector=DETECTOR)
    smooth = lb.measure(in_memory(frames), spots=SPOTS[:2], detector=DETECTOR, smooth="kalman")
    truth = SPOTS[:2] + drift
    assert (smooth.xy_px - truth).std() < 0.5 * (raw.xy_px - truth).std()
    assert np.mean(((smooth.xy_px - truth) / smooth.sigma_xy_px) ** 2) < 2.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spots": [[500.0, 20.0]]}, r"spots must lie inside the 100x150 frame, got \[\[500.0, 20.0\]\]"),
        ({"spots": [1.0, 2.0, 3.0]}, r"spots must have shape \(n, 2\), got \(3,\)"),
        ({"reference": 0}, r"reference must be a whole number from 1 to 12, got 0"),
        ({"reference": 13}, r"reference must be a whole number from 1 to 12, got 13"),
        ({"smooth": "mean"}, r"smooth must be one of 'none', 'kalman', got 'mean'"),
        ({"solver": "best"}, r"solver must be one of 'auto', 'irls', 'ls', got 'best'"),
        ({"method": "peak"}, r"method must be one of 'eiwa', 'grey', 'weighted', 'gaussian', got 'peak'"),
        ({"window": 201}, r"window of 201 x 201 pixels does not fit into frames of 100 x 150 pixels"),
        ({"n_spots": 9}, r"9"),
    ],
)
def test_a_bad_argument_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        lb.measure(in_memory(frames_of(SPOTS)), **options)


def test_a_dark_recording_is_refused():
    dark = DETECTOR.expose(np.full((3, 60, 80), 40.0), 3)
    with pytest.raises(ValueError, match="no spot stands out in the first frame of frame"):
        lb.measure(in_memory(dark))


def test_the_report_is_written_whole_with_its_sensitivity(simulated, tmp_path):
    recording = lb.read_recording(simulated / "frames", times=simulated / "times.csv")
    log = read_temperature_log(simulated / "temperature.csv")
    measured = lb.measure(
        recording,
        lb.Camera.from_toml(simulated / "camera.toml"),
        detector=lb.Detector.from_toml(simulated / "camera.toml"),
        temperature=log,
        reference=REFERENCE,
    )
    lines = write_report(measured, tmp_path, recording=recording)
    written = {"measurement.csv", "report.json", "shifts.png", "angles.png", "angles-over-temperature.png"}
    assert {path.name for path in tmp_path.iterdir()} == written
    said = [line for line in lines if "arcsec/degC" in line]
    fits = json.loads((tmp_path / "report.json").read_text())["sensitivity"]
    assert list(fits) == ["alpha", "beta", "gamma"]
    for line, fit in zip(said, fits.values(), strict=True):
        low, high = fit["interval_95_arcsec_per_degC"]
        assert low < fit["arcsec_per_degC"] < high
        for number in (fit["arcsec_per_degC"], low, high):
            assert f"{number:+.4f}" in line
        assert f"{fit['rms_arcsec']:.4f} arcsec rms" in line
        assert (f"lag {fit['lag_s'] / 60:.1f} min" if fit["lag_s"] else "no lag fitted") in line
    again = pd.read_csv(tmp_path / "measurement.csv")
    np.testing.assert_allclose(again["alpha_arcsec"], measured.table["alpha_arcsec"], rtol=1e-8)


def test_kepler_pixel_files_give_the_mission_s_own_shifts(real_data):
    folder = real_data("kepler-q12")
    fits = pytest.importorskip("astropy.io.fits")
    recording = lb.read_recording(folder)
    measured = lb.measure(recording, background="none")
    assert measured.xy_px.shape == (10, 8, 2)
    assert np.isfinite(measured.xy_px).all()
    assert recording.times.seconds[-1] == pytest.approx(9 * 1765.4, rel=1e-3)
    for star, stamp in enumerate(recording.stamps):
        with fits.open(folder / f"{stamp.name}.fits") as hdus:
            mission = np.stack([hdus[1].data["POS_CORR1"], hdus[1].data["POS_CORR2"]], axis=-1)
        error = measured.shifts_px[:, star] - (mission - mission[0])
        assert error.std() < 5e-3, stamp.name


def test_a_template_keeps_its_width_from_block_to_block():
    frames = frames_of(SPOTS, n=24)
    wider = lb.render_spots(SPOTS, 2e5, 2.6, CAMERA.shape) + 40.0
    frames[12:] = DETECTOR.expose(np.broadcast_to(wider, (12, *CAMERA.shape)), 6)
    in_blocks = lb.measure(in_memory(frames), spots=SPOTS, block=4, method="weighted", window=13, detector=DETECTOR)
    options = {"method": "weighted", "window": 13, "noise": DETECTOR, "centre": "peak"}
    width = lb.centroid(frames[:4], SPOTS, **options).width_px
    kept = lb.centroid(frames[20:], SPOTS, sigma=width, **options)
    np.testing.assert_allclose(in_blocks.sigma_xy_px[20:], kept.sigma_xy, rtol=1e-3)
    anew = lb.centroid(frames[20:], SPOTS, **options)
    assert (anew.sigma_xy / kept.sigma_xy).min() > 1.02
