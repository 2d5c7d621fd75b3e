"""The twin of lyu2015 against closed forms, the printed means, and what its figures claim."""

from dataclasses import replace

import numpy as np
import pytest

import losbench as lb
from losbench.papers.lyu2015 import eights, results, rotation, twin
from losbench.papers.lyu2015.scenario import RATE_LAWS, TABLE_1, Setting
from losbench.papers.provenance import assumptions

SETTING = Setting()


@pytest.fixture(scope="module")
def shots():
    return twin.random_exposures(SETTING, 200)


def test_every_field_of_the_setting_says_where_it_is_from():
    table = assumptions(SETTING)
    assert set(table["source"]) == {"stated", "assumed", "calibrated"}
    assert (table["reason"].str.len() > 3).all()


def test_an_exposure_is_the_paper_s_camera_in_the_paper_s_axes():
    # The check value of a constant rate, in the paper's pixels: k covers [k, k + 1).
    motion = lb.Vibration(constant_rad_s=np.radians([[1.0, 2.0, 0.5]]))
    shot = twin.expose(SETTING, motion, np.array([0]), np.array([[160.133, 135.929]]), np.zeros(1))
    assert shot.end[0] + 0.5 == pytest.approx([163.802293, 134.853024], abs=1e-6)
    assert shot.error(shot.traditional)[0] == pytest.approx(1.77041, abs=5e-6)


def test_fields_hold_as_many_stars_as_the_sky_has(shots):
    # 5044 stars to Hp 6.0 over the sky; the trimmed field is a square of 496 px.
    counted = np.count_nonzero(lb.load_catalogue().magnitude <= SETTING.faintest_hp)
    half = 248 / 3660.97
    solid_angle = 4 * np.arcsin(half**2 / (1 + half**2))
    expected = counted * solid_angle / (4 * np.pi)
    assert len(shots.image) / 200 == pytest.approx(expected, abs=4 * np.sqrt(2 * expected / 200))


def test_the_error_of_an_image_is_its_closed_form(shots):
    path = SETTING.sensed(shots.motion, lb.Gyro(rate_hz=200.0))
    error = shots.per_image(results.quiet(shots, path))
    floor = results.floor_px(SETTING, shots.motion)[np.unique(shots.image)]
    assert np.corrcoef(error, floor)[0, 1] > 0.99
    assert error.mean() == pytest.approx(floor.mean(), rel=0.05)


def test_a_bias_costs_what_the_closed_form_says():
    still = lb.Vibration(constant_rad_s=np.zeros((1, 3)))
    shot = twin.expose(SETTING, still, np.array([0]), np.array([[255.5, 255.5]]), np.zeros(1))
    table = results.gyro_errors(SETTING, shot, (100.0,), "bias_deg_h")
    slope = 3660.97 * np.radians(1 / 3600) * 0.025 / 2
    assert slope == pytest.approx(2.22e-4, rel=1e-3)
    assert table["linear"].item() == pytest.approx(
        100 * slope * np.sqrt(2), rel=0.05
    )  # on two axes


def test_fig_6_falls_and_levels_off_and_fig_7_hardly_rises(shots):
    widths = results.sigma_sweep(SETTING, (0.1, 0.4, 1.5), 80).set_index("sigma_px")["iterative"]
    assert 3 < widths[0.1] / widths[0.4] < 9
    assert widths[1.5] == pytest.approx(widths[0.4], rel=0.05)
    bias = results.gyro_errors(SETTING, shots, (0.01, 10.0), "bias_deg_h")["linear"]
    assert 1.0 < bias[1] / bias[0] < 1.1


def test_the_example_fits_table_1_nearly_as_well_as_any_rotation():
    one = twin.example(SETTING)
    np.testing.assert_allclose(one.end + 0.5, TABLE_1["xy"], atol=1e-6)
    fitted, _ = rotation.one_rotation()
    best = np.sqrt(np.mean((fitted - TABLE_1["traditional"]) ** 2))
    ours = np.sqrt(np.mean((one.error(one.traditional) - TABLE_1["traditional"]) ** 2))
    assert 0.03 < best < ours < 1.5 * best
    # Without a threshold the stars of an image share one error.
    error = results.quiet(one, SETTING.sensed(one.motion, lb.Gyro(rate_hz=200.0)))
    assert np.ptp(error) < 0.2 * error.mean()


def test_least_squares_reaches_the_bound_and_the_joint_fit_beats_it():
    row = results.accuracy(SETTING, (4e3,), images=120).iloc[0]
    assert row["least squares"] == pytest.approx(1.0, abs=0.05)
    assert row["least squares"] < row["least squares, plain"] < row["iterative, every pixel"]
    assert row["joint"] < 0.6


def test_a_spline_gains_below_50_hz_and_loses_near_nyquist():
    table = results.one_frequency(SETTING, (10.0, 45.0, 75.0)).set_index("frequency_hz")
    assert (table["spline"] < table["linear"]).tolist() == [True, True, False]
    np.testing.assert_allclose(table.loc[10.0, "linear"], table.loc[10.0, "floor"], rtol=0.02)


def test_another_vibration_gives_other_numbers(shots):
    slow = twin.random_exposures(replace(SETTING, frequency_hz=(0.01, 0.02)), 100)
    assert slow.error(slow.traditional).mean() > 1.5 * shots.error(shots.traditional).mean()
    aided = results.quiet(slow, SETTING.sensed(slow.motion, lb.Gyro(rate_hz=200.0)))
    assert aided.mean() < 2e-4


def test_the_limit_per_axis_is_exceeded_by_the_norm_and_four_laws_keep_it():
    shakes = SETTING.vibrations(2000, 1)
    top = np.degrees(SETTING.fastest(shakes))
    assert np.mean(top > 3.0) == pytest.approx(0.37, abs=0.04)
    assert 4.0 < top.max() < 3.0 * np.sqrt(3.0)
    for law in RATE_LAWS:
        other = replace(SETTING, rate_limit=law)
        kept = np.degrees(other.fastest(other.vibrations(500, 1)))
        assert len(kept) == 500
        assert kept.max() <= 3.0 + 1e-9
    with pytest.raises(ValueError, match="rate_limit must be"):
        replace(SETTING, rate_limit="none").vibrations(3, 1)


def test_clean_stars_share_one_rotation_and_a_threshold_parts_them():
    clean = rotation.rotation_misfits(SETTING, images=12)
    assert clean.max() < 0.02
    cut = rotation.rotation_misfits(SETTING, threshold=0.05, images=12)
    assert np.median(cut) > 2 * np.median(clean)


def test_no_clean_set_of_eight_scatters_as_printed_and_a_threshold_makes_it(shots):
    path = SETTING.sensed(shots.motion, SETTING.biased_gyro(200, 1))
    clean = eights.aided_eights(shots, path)
    assert len(clean) == np.sum(np.bincount(shots.image) >= 8) > 30
    first = np.flatnonzero(np.bincount(shots.image) >= 8)[0]
    whole = results.quiet(shots, path)[shots.image == first][:8]
    np.testing.assert_allclose(clean[0], whole, atol=1e-9)
    # The floor's closed form at its worst, both axes turning round at the full rate, and the pixels.
    worst = SETTING.camera.focal_px * 0.005**2 / 0.3 * 2 * np.sqrt(2) * np.radians(3.0)
    assert clean.max() < worst + 0.01 < TABLE_1["aided"].max()
    assert eights.as_printed(clean) == 0.0
    assert 0.02 < eights.as_printed(eights.aided_eights(shots, path, threshold=0.05)) < 0.4
    assert eights.as_printed(eights.aided_eights(shots, path, threshold=0.05, flux_e=1e3)) > 0.3
    told = TABLE_1["aided"]
    sets = np.array([told, np.minimum(told, 0.08), np.where(told > 0.08, told, 0.0)])
    assert eights.as_printed(sets) == pytest.approx(1 / 3)
