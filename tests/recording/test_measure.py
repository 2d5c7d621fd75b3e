"""Simulated recordings give back their truth within their predicted errors; what goes wrong is
said, and goes on.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.imaging.results import SpotFlag
from losbench.logs import FrameTimes, TemperatureLog, read_temperature_log
from losbench.papers.liu2026.export import write_recording
from losbench.papers.liu2026.scenario import ThermalBench
from losbench.recording.readers import Recording
from losbench.recording.report import write_report
from losbench.recording.stamps import Stamp, UnreadableFrame
from losbench.units import rad_to_arcsec

pytestmark = pytest.mark.usefixtures("undrawn")

REFERENCE = 20
SPOTS = np.array([[40.0, 30.0], [110.0, 32.0], [75.0, 70.0], [30.0, 75.0]])
DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(100, 150))


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    small = replace(ThermalBench(), shape=(120, 640), spot_row_px=59.5)
    return write_recording(tmp_path_factory.mktemp("twin"), n_frames=160, seed=3, bench=small)


@dataclass(frozen=True)
class Loading:
    """A source of frames that does what it is told."""

    n_frames: int
    frame: Callable[[int], np.ndarray]

    def label(self, k):
        return f"frame {k}"


def twin(folder):
    return lb.read_recording(
        folder / "frames",
        times=folder / "times.csv",
        detector=lb.Detector.from_toml(folder / "camera.toml"),
    )


def in_memory(frames, times=None, detector=None):
    stamp = Stamp("frame", lb.open_frames(frames))
    return Recording(Path("memory"), len(frames), (stamp,), times=times, detector=detector)


def frames_of(spots, n=12, flux=2e5, seed=5):
    electrons = (
        lb.render_spots(np.broadcast_to(spots, (n, *np.shape(spots)[-2:])), flux, 2.0, CAMERA.shape)
        + 40.0
    )
    return DETECTOR.expose(electrons, seed)


def test_the_twin_is_measured_within_its_predicted_errors(simulated):
    recording = twin(simulated)
    truth = pd.read_csv(simulated / "truth.csv")
    positions = truth[["x1_px", "y1_px", "x2_px", "y2_px"]].to_numpy().reshape(-1, 2, 2)
    measured = lb.measure(
        recording,
        lb.Camera.from_toml(simulated / "camera.toml"),
        spots=positions[0],
        reference=REFERENCE,
    )
    angles = truth[["alpha_arcsec", "beta_arcsec", "gamma_arcsec"]].to_numpy()
    error = rad_to_arcsec(measured.attitude.angles) - (angles - angles[:REFERENCE].mean(axis=0))
    cov = rad_to_arcsec(rad_to_arcsec(measured.attitude.cov))
    chi_square = np.einsum("fi,fij,fj->f", error, np.linalg.inv(cov), error)[REFERENCE:]
    assert 0.8 < chi_square.mean() / 3 < 1.2
    pull = (measured.xy_px - positions) / measured.sigma_xy_px
    assert 0.8 < np.mean(pull**2) < 1.2
    assert 0.01 < np.median(measured.attitude.p_value) < 0.99


def test_the_table_has_times_temperatures_shifts_and_angles(simulated):
    recording = lb.read_recording(simulated / "frames", times=simulated / "times.csv")
    log = TemperatureLog(
        FrameTimes(np.array([0.0, 9000.0])), np.array([[18.0], [25.0]]), ("temperature_degC",)
    )
    table = lb.measure(
        recording, lb.Camera.from_toml(simulated / "camera.toml"), temperature=log
    ).table
    assert list(table.columns[:3]) == ["frame", "time_s", "temperature_degC"]
    assert {"dx1_px", "dy2_px", "flags1", "alpha_arcsec", "sigma_gamma_arcsec", "p_value"} <= set(
        table.columns
    )
    assert table["temperature_degC"].is_monotonic_increasing


def test_the_order_of_spots_is_from_left_to_right_unless_asked_and_stays():
    frames = frames_of(SPOTS[:3], flux=[1e5, 3e5, 2e5])
    measured = lb.measure(in_memory(frames))
    np.testing.assert_allclose(measured.reference_px, SPOTS[[0, 2, 1]], atol=0.05)
    by_light = lb.measure(in_memory(frames), spots=lb.Find(order="light"))
    np.testing.assert_allclose(by_light.reference_px, SPOTS[[1, 2, 0]], atol=0.05)


def test_without_camera_there_are_shifts_and_a_note():
    measured = lb.measure(in_memory(frames_of(SPOTS[:2])))
    assert measured.attitude is None
    assert "alpha_arcsec" not in measured.table
    assert "No camera was given: the table holds shifts in pixels, no angles." in measured.notes
    assert "No frame times were given: rows are numbered." in measured.notes


def test_a_spot_that_goes_out_is_nan_and_flagged_and_comes_back():
    frames = frames_of(SPOTS)
    frames[4:7, 20:41, 30:51] = frames_of(SPOTS[1:])[4:7, 20:41, 30:51]
    measured = lb.measure(
        in_memory(frames, detector=DETECTOR), CAMERA, spots=SPOTS, run=lb.Run(chunk=5)
    )
    lost = np.isnan(measured.xy_px[:, 0, 0])
    assert np.flatnonzero(lost).tolist() == [4, 5, 6]
    assert (measured.flags[4:7, 0] & SpotFlag.TOO_FAINT).all()
    assert np.isfinite(measured.attitude.angles).all()
    assert "Spot 1 is lost in 3 of 12 frames." in measured.notes


def test_with_two_spots_a_lost_one_costs_the_angles_of_its_frames():
    frames = frames_of(SPOTS[:2])
    frames[5] = frames_of(SPOTS[1:2])[5]
    measured = lb.measure(in_memory(frames, detector=DETECTOR), CAMERA, spots=SPOTS[:2])
    assert np.flatnonzero(np.isnan(measured.attitude.angles).any(axis=1)).tolist() == [5]
    assert any("Two spots cannot tell which of them is bad" in note for note in measured.notes)


def moving(speed_px, n=60, seed=6):
    path = np.arange(n)[:, None, None] * np.array([speed_px, 0.0])
    electrons = lb.render_spots(SPOTS[[0, 3]] + path, 2e5, 2.0, CAMERA.shape) + 40.0
    return DETECTOR.expose(electrons, seed), SPOTS[[0, 3]] + path


@pytest.mark.parametrize("speed_px", [0.0, 0.4, 1.5])
def test_moving_spots_are_followed_whatever_the_block(speed_px):
    frames, truth = moving(speed_px)
    measured = lb.measure(in_memory(frames, detector=DETECTOR), spots=2)
    order = np.argsort(measured.reference_px[:, 1])
    np.testing.assert_allclose(measured.xy_px[:, order], truth, atol=0.06)


def test_a_spot_that_is_gone_for_good_does_not_drag_the_other_along():
    frames, truth = moving(0.4, n=100)
    frames[34:, 60:] = DETECTOR.expose(np.full(frames[34:, 60:].shape, 40.0), 9)
    measured = lb.measure(in_memory(frames, detector=DETECTOR), spots=truth[0])
    np.testing.assert_allclose(measured.xy_px[:, 0], truth[:, 0], atol=0.06)
    assert np.isnan(measured.xy_px[34:, 1]).all()


def test_eight_bit_frames_give_angles_with_errors_that_hold():
    electrons = np.broadcast_to(
        lb.render_spots(SPOTS, 2e4, 2.0, CAMERA.shape) + 40.0, (40, *CAMERA.shape)
    )
    sensor = lb.Detector(gain_e_per_dn=6.0, read_noise_e=1.0, offset_dn=5.0, bits=8)
    frames = sensor.expose(electrons, 4).astype(np.uint8)
    measured = lb.measure(in_memory(frames, detector=sensor), CAMERA)
    pull = (measured.xy_px - measured.xy_px.mean(axis=0)) / measured.sigma_xy_px
    assert 0.7 < np.mean(pull**2) < 1.4
    bare = lb.measure(in_memory(frames), CAMERA)
    assert np.isfinite(bare.attitude.angles).all()
    assert any(note.startswith("No detector was given") for note in bare.notes)


def test_frames_of_another_shape_than_the_camera_are_refused():
    with pytest.raises(
        ValueError,
        match=r"camera must have the shape of the frames, \(100, 150\), got \(1080, 1920\)",
    ):
        lb.measure(in_memory(frames_of(SPOTS)), lb.Camera(260.0, 10.0, (1080, 1920)))


def test_a_saturated_spot_is_flagged():
    electrons = lb.render_spots(SPOTS[None, :2], [2e5, 3e6], 2.0, CAMERA.shape) + 40.0
    clipped = replace(DETECTOR, bits=12).expose(electrons, 1)
    measured = lb.measure(in_memory(clipped, detector=replace(DETECTOR, bits=12)), spots=SPOTS[:2])
    assert (measured.flags & SpotFlag.SATURATED).astype(bool).tolist() == [[False, True]]
    assert "1 of 2 centroids carry the flag SATURATED." in measured.notes


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float32, np.float64])
def test_full_scale_is_the_detector_s_whatever_numbers_hold_the_frames(tmp_path, dtype):
    electrons = lb.render_spots(SPOTS[None, :2], [2e5, 3.3e5], 2.0, CAMERA.shape) + 40.0
    sensor = replace(DETECTOR, bits=12, gain_e_per_dn=3.2)
    clipped = sensor.expose(np.repeat(electrons, 4, axis=0), 1)
    assert 0 < (clipped == 4095).sum(axis=(1, 2)).max() < 12
    np.save(tmp_path / "frames.npy", clipped.astype(dtype))
    read = lb.measure(lb.read_recording(tmp_path / "frames.npy", detector=sensor), spots=SPOTS[:2])
    as_read_out = lb.measure(in_memory(clipped, detector=sensor), spots=SPOTS[:2])
    assert (as_read_out.flags[:, 1] & SpotFlag.SATURATED).any()
    np.testing.assert_array_equal(
        read.flags & SpotFlag.SATURATED, as_read_out.flags & SpotFlag.SATURATED
    )


def test_calibrated_frames_whose_files_tell_the_noise_have_no_full_scale():
    frames = (
        lb.render_spots(np.repeat(SPOTS[None, :2], 2, axis=0), 4e6, 2.0, CAMERA.shape) + 5.0
    ).astype(np.float32)
    assert frames.max() > DETECTOR.full_scale_dn
    stamp = Stamp("frame", replace(lb.open_frames(frames), detector=DETECTOR))
    recording = Recording(Path("memory"), len(frames), (stamp,), detector=DETECTOR)
    measured = lb.measure(recording, spots=SPOTS[:2])
    assert not (measured.flags & SpotFlag.SATURATED).any()


def test_a_log_that_does_not_fit_is_found_before_a_frame_is_read():
    def load(k):
        raise AssertionError("a frame was read")

    frames = replace(lb.open_frames(np.zeros((3, *CAMERA.shape))), source=Loading(3, load))
    recording = Recording("memory", 3, (Stamp("frame", frames),), times=FrameTimes(np.arange(3.0)))
    log = TemperatureLog(
        FrameTimes(np.array([50.0, 60.0])), np.array([[18.0], [19.0]]), ("temperature_degC",)
    )
    with pytest.raises(ValueError, match="the temperature log must overlap the frames in time"):
        lb.measure(recording, temperature=log)


def drifting(n=40, time_s=None):
    """Frames whose shift follows the temperature at once, and the log."""
    drift = np.linspace(0.0, 1.5, n)[:, None, None] * [1.0, 0.5]
    frames = DETECTOR.expose(lb.render_spots(SPOTS + drift, 2e5, 2.0, CAMERA.shape) + 40.0, 8)
    clock = np.arange(n) * 5.0
    celsius = np.stack([18.0 + clock / 40.0, np.full(n, 20.0)], axis=-1)
    log = TemperatureLog(
        FrameTimes(clock), celsius, ("temperature_m1_degC", "temperature_plate_degC")
    )
    return in_memory(frames, FrameTimes(clock if time_s is None else time_s), DETECTOR), log


@pytest.mark.drawn
def test_a_frame_without_a_time_is_left_out_of_the_sensitivity(tmp_path):
    time_s = np.arange(40) * 5.0
    time_s[[0, 4]] = np.nan
    recording, log = drifting(time_s=time_s)
    lines = write_report(
        lb.measure(recording, CAMERA, temperature=log),
        tmp_path,
        recording=recording,
    )
    assert sum(line.startswith("Sensitivity about") for line in lines) == 3
    assert (tmp_path / "angles-over-temperature.png").stat().st_size > 1000


def test_a_report_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    recording, log = drifting(n=12)
    measured = lb.measure(recording, CAMERA, temperature=log)

    def broken(*_):
        raise ValueError("no picture")

    monkeypatch.setattr("losbench.recording.pictures.angles_figure", broken)
    with pytest.raises(ValueError, match="no picture"):
        write_report(measured, tmp_path / "out", recording=recording)
    assert not (tmp_path / "out").exists()


def test_the_report_names_its_sensor_and_no_lag_where_none_shows(tmp_path):
    recording, log = drifting()
    measured = lb.measure(recording, CAMERA, temperature=log)
    lines = write_report(measured, tmp_path, recording=recording)
    said = [line for line in lines if line.startswith("Sensitivity about")]
    assert len(said) == 3
    assert all(" to temperature_m1_degC: " in line and ", no lag, " in line for line in said)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["sensitivity_to"] == "temperature_m1_degC"
    assert [fit["lag_s"] for fit in report["sensitivity"].values()] == [0.0, 0.0, 0.0]


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
    measured = lb.measure(
        lb.read_recording(tmp_path, on_unreadable="skip", detector=DETECTOR), CAMERA
    )
    assert np.flatnonzero(np.isnan(measured.xy_px).any(axis=(1, 2))).tolist() == [0, 5]
    assert (measured.flags[5] == SpotFlag.MISSING).all()
    np.testing.assert_array_equal(measured.reference_px, measured.xy_px[1])
    assert "Shifts count from frame 1, the first that shows every spot." in measured.notes
    said = [
        note
        for note in measured.notes
        if note.startswith("2 of 12 frames are left out as unreadable: frame 0 (00.")
    ]
    assert len(said) == 1 and "frame 5 (05.tif cannot be read" in said[0]
    with pytest.raises(ValueError, match=r"spot \[1, 2, 3, 4\] is in none of 1"):
        lb.measure(
            lb.read_recording(tmp_path, on_unreadable="skip", detector=DETECTOR),
            CAMERA,
            reference=1,
        )


def test_of_many_unreadable_frames_the_first_few_are_named():
    frames = frames_of(SPOTS)

    def load(k):
        if k >= 6:
            raise UnreadableFrame(f"page {k} is torn")
        return frames[k]

    stamp = Stamp("frame", replace(lb.open_frames(frames), source=Loading(len(frames), load)))
    measured = lb.measure(
        Recording("memory", len(frames), (stamp,), detector=DETECTOR, skip_unreadable=True),
        run=lb.Run(chunk=4),
    )
    named = ", ".join(f"frame {k} (page {k} is torn)" for k in (6, 7, 8))
    assert f"6 of 12 frames are left out as unreadable: {named}, and 3 more." in measured.notes


def test_spots_that_never_show_together_give_no_reference():
    frames = frames_of(SPOTS[:2])
    frames[:6, :, :70], frames[6:, :, 70:] = (
        DETECTOR.expose(np.full(CAMERA.shape, 40.0), 9)[:, s] for s in np.s_[:70, 70:]
    )
    with pytest.raises(
        ValueError,
        match="reference must be a frame that shows every spot; all 2 at once are in none of 12",
    ):
        lb.measure(in_memory(frames, detector=DETECTOR), spots=SPOTS[:2])


def test_smoothing_lowers_the_scatter_of_a_slow_drift():
    drift = np.linspace(0.0, 1.0, 120)[:, None, None] * [1.0, 0.5]
    frames = DETECTOR.expose(lb.render_spots(SPOTS[:2] + drift, 2e4, 2.0, CAMERA.shape) + 40.0, 8)
    raw = lb.measure(in_memory(frames, detector=DETECTOR), spots=SPOTS[:2])
    smooth = lb.measure(
        in_memory(frames, detector=DETECTOR), spots=SPOTS[:2], centroid=lb.EIWA(smooth="kalman")
    )
    truth = SPOTS[:2] + drift
    assert (smooth.xy_px - truth).std() < 0.5 * (raw.xy_px - truth).std()
    assert np.mean(((smooth.xy_px - truth) / smooth.sigma_xy_px) ** 2) < 2.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"spots": [[500.0, 20.0]]},
            r"spots must lie inside the 100x150 frame, got \[\[500.0, 20.0\]\]",
        ),
        ({"spots": [1.0, 2.0, 3.0]}, r"spots must have shape \(n, 2\), got \(3,\)"),
        ({"reference": 0}, r"reference must be a whole number from 1 to 12, got 0"),
        ({"reference": 13}, r"reference must be a whole number from 1 to 12, got 13"),
        (
            {"solver": "best"},
            r"solver must be one of 'auto', 'irls', 'ls', 'lts', 'mm', got 'best'",
        ),
        (
            {"centroid": "peak"},
            r"method must be one of 'auto', 'eiwa', 'grey', 'weighted', 'likelihood', 'gaussian', 'empirical', got 'peak'",
        ),
        (
            {"centroid": lb.EIWA(201)},
            r"window of 201 x 201 pixels does not fit into frames of 100 x 150 pixels",
        ),
        ({"spots": 9}, r"9"),
        ({"spots": 0}, "n must be a whole number of at least 1, got 0"),
        ({"spots": 2.5}, "n must be a whole number, got 2.5"),
    ],
)
def test_a_bad_argument_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        lb.measure(in_memory(frames_of(SPOTS)), **options)


def test_a_dark_recording_is_refused():
    dark = DETECTOR.expose(np.full((3, 60, 80), 40.0), 3)
    with pytest.raises(ValueError, match="no spot stands out in the first frame of frame"):
        lb.measure(in_memory(dark))


@pytest.mark.drawn
def test_the_report_is_written_whole_with_its_sensitivity(simulated, tmp_path):
    recording = twin(simulated)
    log = read_temperature_log(simulated / "temperature.csv")
    measured = lb.measure(
        recording,
        lb.Camera.from_toml(simulated / "camera.toml"),
        temperature=log,
        reference=REFERENCE,
    )
    lines = write_report(measured, tmp_path, recording=recording)
    written = {
        "measurement.csv",
        "report.json",
        "report.html",
        "frame.png",
        "shifts.png",
        "angles.png",
        "leftover.png",
        "temperature.png",
        "angles-over-temperature.png",
        "sensitivity.csv",
        "compensated.png",
        "metrics.csv",
        "metrics.png",
    }
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
        assert (f"lag {fit['lag_s'] / 60:.1f} min" if fit["lag_s"] else "no lag") in line
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


def test_kepler_stars_and_what_they_share_move_as_the_mission_says(real_data):
    """Median star to 0.2 millipixel, the middle of the field by a robust solve to 0.12."""
    fits = pytest.importorskip("astropy.io.fits")
    folder = real_data("kepler-q12")
    camera = lb.Camera(focal_mm=1399.0, pixel_um=27.0, shape=(1044, 1132))
    xy = lb.measure(recording := lb.read_recording(folder), camera, reference=10).xy_px
    mission = []
    for stamp in recording.stamps:
        table = fits.getdata(folder / f"{stamp.name}.fits", 1)
        mission.append(np.stack([table["POS_CORR1"], table["POS_CORR2"]], axis=-1))
    mission = np.stack(mission, axis=1) - np.mean(mission, axis=1)
    shifts = xy - xy.mean(axis=0)
    assert np.median(np.sqrt(np.mean((shifts - mission) ** 2, axis=(0, 2)))) < 0.2e-3
    points = camera.points_mm(xy.mean(axis=0))
    angles = lb.solve_attitude(points, 0.027 * shifts, solver=lb.IRLS(max_iter=500)).angles
    rows = lb.design_matrix(points).reshape(8, 2, 3).mean(axis=0)
    error = angles @ rows.T / 0.027 - mission.mean(axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.12e-3


@pytest.mark.parametrize("method", [lb.Weighted(), lb.EIWA()], ids=["weighted", "eiwa"])
def test_what_holds_for_a_recording_does_not_depend_on_its_blocks(method):
    """Spots that grow wider halfway: one window and one width, whatever is in memory at a time."""
    frames = frames_of(SPOTS, n=24)
    wider = lb.render_spots(SPOTS, 2e5, 2.6, CAMERA.shape) + 40.0
    frames[12:] = DETECTOR.expose(np.broadcast_to(wider, (12, *CAMERA.shape)), 6)
    one, *others = (
        lb.measure(
            in_memory(frames, detector=DETECTOR),
            spots=SPOTS,
            centroid=method,
            run=lb.Run(chunk=block),
        )
        for block in (24, 4, 1)
    )
    for other in others:
        np.testing.assert_allclose(one.xy_px, other.xy_px, atol=1e-9)
        np.testing.assert_allclose(one.sigma_xy_px, other.sigma_xy_px, rtol=1e-7)
        np.testing.assert_array_equal(one.flags, other.flags)


def test_a_template_has_the_width_of_the_whole_recording():
    frames = frames_of(SPOTS, n=24)
    measured = lb.measure(
        in_memory(frames, detector=DETECTOR), spots=SPOTS, centroid=lb.Weighted(window=13)
    )
    options = {"method": "weighted", "window": 13, "noise": DETECTOR, "centre": "peak"}
    width = lb.centroid(frames, SPOTS, **options).width_px
    kept = lb.centroid(frames[20:], SPOTS, sigma=width, **options)
    np.testing.assert_allclose(measured.xy_px[20:], kept.xy, atol=1e-4)
    np.testing.assert_allclose(measured.sigma_xy_px[20:], kept.sigma_xy, rtol=1e-3)
