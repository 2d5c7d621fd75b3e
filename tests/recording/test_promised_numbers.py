"""Numbers that the docstrings and files of recording promise, from either side."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import losbench as lb
from losbench.logs import FrameTimes, TemperatureLog
from losbench.recording.angles import Angles
from losbench.recording.belief import _TELLS, drift_slope
from losbench.recording.readers import Recording
from losbench.recording.sensitivity import sensitivity_of
from losbench.recording.stamps import Stamp

fits = pytest.importorskip("astropy.io.fits")

SPOTS = np.array([[40.0, 30.0], [110.0, 32.0], [75.0, 70.0]])
DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
CAMERA = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(100, 150))
GAIN, READ_NOISE_E = 110.0, 330.0


def pixel_file(path, days, *, quality=None):
    """A target pixel file of 5 x 7 pixels at column 600, row 400, as Kepler's are laid out."""
    n = len(days)
    flux = lb.render_spots([[3.2, 2.1]], 2e5, 1.2, (5, 7))[None] * np.ones((n, 1, 1))
    error = np.sqrt(flux / GAIN + (READ_NOISE_E / GAIN) ** 2)
    columns = [
        fits.Column("TIME", "D", array=np.asarray(days, dtype=float)),
        fits.Column("FLUX", "35E", dim="(7, 5)", array=flux.astype(np.float32)),
        fits.Column("FLUX_ERR", "35E", dim="(7, 5)", array=error.astype(np.float32)),
        fits.Column("QUALITY", "J", array=np.zeros(n) if quality is None else quality),
    ]
    table = fits.BinTableHDU.from_columns(columns)
    table.header["1CRV5P"], table.header["2CRV5P"] = 600, 400
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)
    return flux


def test_a_day_of_a_pixel_file_has_86400_seconds(tmp_path):
    days = 131.5 + np.array([0.0, 0.25, 0.5, 1.0, 3.0])
    pixel_file(tmp_path / "star.fits", days)
    times = lb.read_recording(tmp_path / "star.fits").times
    np.testing.assert_allclose(times.seconds, [0.0, 21600.0, 43200.0, 86400.0, 259200.0], atol=1e-6)


def test_a_stamp_of_a_pixel_file_stands_in_a_margin_of_six_pixels_at_its_place(tmp_path):
    flux = pixel_file(tmp_path / "star.fits", np.arange(4.0))
    recording = lb.read_recording(tmp_path / "star.fits")
    (stamp,) = recording.stamps
    frame = stamp.read(2, 3, skip=False).frames[0]
    assert frame.shape == (5 + 12, 7 + 12)
    np.testing.assert_allclose(frame[6:-6, 6:-6], flux[2], rtol=1e-6)
    assert frame.sum() == pytest.approx(flux[2].sum(), rel=1e-6)
    found = lb.measure(recording, spots=1)
    # The stamp cuts off the foot of the star.
    np.testing.assert_allclose(found.xy_px[0, 0], [603.2, 402.1], atol=0.03)


def test_the_errors_of_a_pixel_file_tell_its_detector(tmp_path):
    pixel_file(tmp_path / "star.fits", np.arange(4.0))
    detector = lb.read_recording(tmp_path / "star.fits").detector
    assert detector.gain_e_per_dn == pytest.approx(GAIN, rel=1e-4)
    assert detector.read_noise_e == pytest.approx(READ_NOISE_E, rel=1e-3)


def test_cadences_without_a_time_are_missing_and_files_without_any_are_refused(tmp_path):
    pixel_file(tmp_path / "star.fits", [np.nan, 131.5, 132.0, np.nan, 133.5])
    times = lb.read_recording(tmp_path / "star.fits").times
    np.testing.assert_allclose(times.seconds, [np.nan, 0.0, 43200.0, np.nan, 172800.0], atol=1e-6)
    pixel_file(tmp_path / "timeless.fits", [np.nan] * 3)
    with pytest.raises(ValueError, match=r"TIME of timeless\.fits must hold at least one finite"):
        lb.read_recording(tmp_path / "timeless.fits")
    pixel_file(tmp_path / "back.fits", [3.0, np.nan, 2.0])
    with pytest.raises(ValueError, match=r"TIME of back\.fits"):
        lb.read_recording(tmp_path / "back.fits")


def test_pixel_files_of_one_recording_are_of_one_length_and_named_if_all_are(tmp_path):
    for name, days in (("a", 4), ("b", 4)):
        pixel_file(tmp_path / f"{name}.fits", np.arange(float(days)))
    recording = lb.read_recording(tmp_path)
    assert len(recording.stamps) == 2
    assert not any("the stars are" in note for note in recording.notes)
    with fits.open(tmp_path / "a.fits", mode="update") as file:
        file[0].header["OBJECT"] = "KIC 1"
    assert not any("the stars are" in note for note in lb.read_recording(tmp_path).notes)
    pixel_file(tmp_path / "c.fits", np.arange(5.0))
    with pytest.raises(ValueError, match="must have as many frames each, got .*'c': 5"):
        lb.read_recording(tmp_path)


# The report


def drifting(n, span_degC):
    """Spots that drift with a temperature that rises by so much over n frames."""
    clock, noise = np.arange(float(n)), np.random.default_rng(1)
    celsius = np.linspace(18.0, 18.0 + span_degC, n)
    spots = SPOTS + 0.4 * (celsius - 18.0)[:, None, None]
    light = lb.render_spots(spots, 2e5, 2.0, CAMERA.shape) + 40.0
    stamp = Stamp("frame", lb.open_frames(DETECTOR.expose(light, noise)))
    recording = Recording(Path("memory"), n, (stamp,), times=FrameTimes(clock), detector=DETECTOR)
    log = TemperatureLog(FrameTimes(clock), celsius[:, None], ("temperature_degC",))
    return recording, log


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("n", "span_degC", "told"),
    [(9, 5.0, False), (10, 5.0, True), (12, 0.49, False), (12, 0.51, True)],
)
def test_a_sensitivity_takes_ten_frames_and_half_a_degree(tmp_path, n, span_degC, told):
    recording, log = drifting(n, span_degC)
    measured = lb.measure(recording, CAMERA, temperature=log)
    lines = lb.write_report(measured, tmp_path, recording=recording)
    assert sum(line.startswith("Sensitivity about") for line in lines) == (3 if told else 0)
    assert (tmp_path / "angles-over-temperature.png").is_file() == told


def test_the_error_of_a_mean_reference_is_that_of_a_mean():
    recording, _ = drifting(16, 0.0)
    found = lb.measure(recording, CAMERA, reference=16)
    own = np.sqrt(found.sigma_shifts_px**2 - found.sigma_xy_px**2)
    expected = np.sqrt(np.sum(found.sigma_xy_px**2, axis=0)) / 16
    np.testing.assert_allclose(own, np.broadcast_to(expected, own.shape), rtol=1e-6)
    np.testing.assert_allclose(found.reference_px, found.xy_px.mean(axis=0), atol=1e-12)


# How far to believe it


@pytest.mark.parametrize("size_px", [1e-3, 0.1, 10.0])
def test_a_slope_is_that_of_least_squares_about_each_coordinate_s_mean(size_px):
    """Whatever the drift, where frames are missing too; noise of the other is in its error."""
    rng = np.random.default_rng(2)
    two = size_px * rng.standard_normal((60, 3, 2)).cumsum(axis=0) + [5.0, -3.0]
    one = 0.9 * two + 0.02 * size_px * rng.standard_normal(two.shape) + 7.0
    one[3:9, 1], two[20, 0, 1] = np.nan, np.nan
    known = np.isfinite(one) & np.isfinite(two)
    x, y = (
        np.concatenate([s[known[:, i, j], i, j] for i in range(3) for j in range(2)])
        for s in (
            np.where(known, s, np.nan) - np.nanmean(np.where(known, s, np.nan), axis=0)
            for s in (two, one)
        )
    )
    sigma = 0.01 * size_px
    found = drift_slope(one, two, np.full(two.shape, sigma))
    slope = x @ y / (x @ x)
    assert found.value == pytest.approx(slope, rel=1e-9)
    left = np.sum((y - slope * x) ** 2) / (known.sum() - 1) / (x @ x)
    assert found.error == pytest.approx(np.hypot(np.sqrt(left), known.sum() * sigma**2 / (x @ x)))


@pytest.mark.parametrize(("times", "told"), [(0.98, True), (1.02, False)])
def test_a_slope_is_told_where_its_error_is_small_enough(times, told):
    drift = np.repeat(np.linspace(-1.0, 1.0, 50)[:, None, None], 2, axis=2)
    sigma = np.sqrt(times * _TELLS * np.sum(drift**2) / drift.size)
    found = drift_slope(drift, drift, np.full(drift.shape, sigma))
    assert np.isfinite(found.value) == told
    if told:
        assert found.error == pytest.approx(times * _TELLS)


def test_a_lag_that_may_be_shorter_than_a_fifth_of_a_step_is_none(tmp_path):
    recording, log = drifting(12, 5.0)
    told = sensitivity_of(lb.measure(recording, CAMERA, temperature=log))
    assert told.shortest_lag_s == pytest.approx(0.2)
    found = SimpleNamespace(
        tau_s=np.ones((3, 1)),
        tau_interval_s=np.array([[[0.19, 5.0]], [[0.21, 5.0]], [[0.0, 5.0]]]),
        fitted=SimpleNamespace(tau_s=np.full((3, 1), 0.9)),
    )
    assert replace(told, found=found).lag_s.tolist() == [0.0, 0.9, 0.0]


@pytest.mark.parametrize(("spots", "robust"), [(2, False), (3, False), (4, True)])
def test_four_spots_tell_outliers_and_three_do_not(spots, robust):
    for angles in (Angles(), Angles("auto")):
        assert angles.chosen(spots) == (lb.IRLS() if robust else lb.LeastSquares())
        said = angles.sentence(spots)
        assert f"{spots} spots, redundancy {2 * spots - 3}." in said
        assert ("cannot tell which" in said) == (spots == 2)
