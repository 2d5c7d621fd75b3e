"""The statements that the liu2026 notebooks rest on, each by closed form, proof or sampling
theory.
"""

from dataclasses import fields, replace

import numpy as np
import pytest

import losbench as lb
from losbench.papers.liu2026 import twin
from losbench.papers.liu2026.results import (
    angles,
    centroiding,
    geometry,
    reductions,
    twospots,
    warmup,
)
from losbench.papers.liu2026.scenario import Bench, ConstantBench, ThermalBench, next_odd
from losbench.papers.provenance import assumptions
from losbench.pointing.attitude import attitude_covariance
from losbench.units import rad_to_arcsec

MONTE_CARLO = geometry.MonteCarlo()


@pytest.fixture(scope="module")
def constant():
    setting = ConstantBench()
    return setting, centroiding.constant_run(setting)


@pytest.mark.parametrize(
    "scenario", [geometry.MonteCarlo(), Bench(), ThermalBench(), ConstantBench()]
)
def test_every_value_of_a_scenario_has_a_source_and_a_reason(scenario):
    table = assumptions(scenario)
    assert set(table.name) == {f.name for f in fields(scenario)}
    assert set(table.source) <= {"stated", "assumed", "calibrated"}
    assert table.reason.str.len().min() > 3


@pytest.mark.parametrize(
    ("noise", "expected"),
    [("gaussian", (0.691, 10.39, 65.6)), ("clipped", (0.230, 3.45, 21.8))],
)
def test_figure_1_has_the_errors_of_the_closed_form(noise, expected):
    run = geometry.figure_1(replace(MONTE_CARLO, noise=noise))
    np.testing.assert_allclose(run.sigma_arcsec[0], expected, rtol=0.03)
    sigma_mm = 0.5 * 4.5e-3 / (3.0 if noise == "clipped" else 1.0)
    closed = rad_to_arcsec(
        np.sqrt(np.diag(attitude_covariance(MONTE_CARLO.points_mm, sigma_mm, model="paper")))
    )
    np.testing.assert_allclose(run.sigma_arcsec[0], closed, rtol=0.04)
    np.testing.assert_allclose(
        run.errors_arcsec[:, 2], run.errors_arcsec[:, 0] / 50, rtol=1e-6, atol=1e-9
    )


def test_y_inherits_z_so_that_irls_07_and_08_cannot_hold():
    _, error_y, error_z = geometry.figure_1(MONTE_CARLO).errors_arcsec[:, 1].T
    rest = error_y + 75.0 / 475.0 * error_z
    assert np.abs(rest).max() <= rad_to_arcsec(0.1 * 4.5e-3 / 475.0)
    assert abs(np.corrcoef(rest, error_z)[0, 1]) < 0.05
    assert np.abs(error_y[np.abs(error_z) >= 5.0]).min() > 0.5


@pytest.mark.parametrize("scale", ["std", "mad", "std1"])
def test_two_spots_make_irls_equal_to_ls(scale):
    assert geometry.two_spot_difference(MONTE_CARLO, scale=scale).peak_arcsec.max() < 1e-9
    assert (
        geometry.two_spot_difference(MONTE_CARLO, scale=scale, model="pinhole").peak_arcsec.max()
        < 1e-3
    )


def test_residuals_of_two_spots_are_d_0_minus_d_0():
    A = lb.design_matrix(MONTE_CARLO.points_mm, model="paper")
    residuals = lb.lstsq(A, np.random.default_rng(1).standard_normal((50, 4))).residuals
    np.testing.assert_allclose(residuals[:, 0], -residuals[:, 2], rtol=1e-9)
    np.testing.assert_allclose(residuals[:, [1, 3]], 0.0, atol=1e-12)


def test_no_reading_of_the_noise_free_check_gives_2_or_0_3_percent():
    z = geometry.noise_free_readings(MONTE_CARLO).Z_percent.abs()
    assert len(z) == 24
    assert ((z < 0.02) | (z > 15.0)).all()


def test_the_perspective_explains_the_errors_of_eq_2():
    table = geometry.noise_free_readings(MONTE_CARLO).set_index(["rotation", "z", "vectors"])
    error = table.loc["exact", "projected", "as they are"]
    v = 75.0 / 475.0
    assert error.X_percent == pytest.approx(100 * v**2, rel=0.03)
    assert error.Z_percent == pytest.approx(-100 * v, rel=0.01)


def test_windows_have_the_sizes_of_the_paper():
    assert (Bench().grey_window_px, Bench().eiwa_window_px) == (19, 13)
    assert [next_odd(x) for x in (11.9, 12.0, 12.1, 13.0)] == [13, 13, 13, 15]


def test_the_grey_column_of_table_1_is_met_by_calibration(constant):
    setting, run = constant
    table = centroiding.table_1(run, setting).loc["grey"]
    assert (np.abs(table.twin - table.paper) < 3 * table.sampling_error).all()


def test_noise_shrinks_with_eiwa_and_real_motion_stays(constant):
    _, run = constant
    grey, eiwa = run.series("grey").std(axis=0), run.series("eiwa").std(axis=0)
    assert (eiwa[[1, 3]] < 0.95 * grey[[1, 3]]).all()
    assert (eiwa[[0, 2]] > 0.95 * grey[[0, 2]]).all()
    assert run.evaluations.min() > 1


def test_sampling_errors_are_those_of_normal_numbers():
    series = np.random.default_rng(2).standard_normal((20_000, 1))
    found = centroiding.sampled(series, 100, seed=3)
    mean, error = found["rms"]
    assert mean[0] == pytest.approx(1.0, abs=0.02)
    assert error[0] == pytest.approx(1 / np.sqrt(2 * 99), rel=0.15)
    assert found["pv"][0][0] == pytest.approx(
        5.015, rel=0.02
    )  # expected range of 100 normal numbers


def test_the_twin_obeys_the_bound_that_table_2_breaks(constant):
    setting, run = constant
    measured = centroiding.table_1(run, setting).loc["eiwa"].twin
    found = angles.table_2(run, setting).loc["LS"].twin
    for statistic in ("rms", "pv"):
        y = max(measured[statistic, "A y"], measured[statistic, "B y"])
        y *= setting.camera.arcsec_per_px
        assert found[statistic, "alpha"] <= y + 9.6 / 260 * found[statistic, "gamma"]
        printed = angles.TABLE_2["IRLS"][statistic]
        # 2 with equal weights on both y rows; any weights leave a little more room.
        assert printed[0] > 1.8 * twospots.alpha_bound(statistic, printed[2], setting=setting).total


def test_ls_and_irls_agree_frame_by_frame_on_the_twin(constant):
    setting, run = constant
    ls, robust = (
        angles.frame_angles(run, setting, method=method).std(axis=0) for method in ("LS", "IRLS")
    )
    np.testing.assert_allclose(robust, ls, rtol=1e-4)


@pytest.mark.parametrize(
    ("what", "share", "size", "scale", "expected"),
    [
        ("frames", 0.05, 10.0, "std", 0.70),
        ("frames", 0.02, 5.0, "std", 0.91),
        ("frames", 0.05, 10.0, "mad", 0.47),
        ("elements", 0.05, 10.0, "std", 0.59),
        ("elements", 0.02, 5.0, "mad", 0.88),
    ],
)
def test_stacking_makes_robustness_real(what, share, size, scale, expected):
    ratio = angles.contaminated_ratios(
        Bench(), share=share, size=size, what=what, scale=scale, seed=11
    )
    np.testing.assert_allclose(ratio, expected, atol=0.04)


def test_the_warm_up_is_exact_whatever_the_frame_times():
    setting = ThermalBench()
    every, few = (
        twin.warm_up(setting),
        twin.warm_up(setting, time_s=np.array([0.0, 3000.0, setting.duration_s])),
    )
    rows = np.searchsorted(every.time_s, few.time_s)
    np.testing.assert_allclose(few.node_degC, every.node_degC[rows], rtol=1e-12)
    assert few.node_degC[-1] == pytest.approx(25.0, abs=0.3)


def test_irls_keeps_the_sensitivity_that_outliers_take_from_ls():
    setting = ThermalBench(frame_period_s=30.0)
    drift = warmup.figure_5(setting)
    clean = warmup.sensitivities(drift, setting)
    spoiled = warmup.sensitivities(drift, setting, bad_share=0.05, bad_arcsec=20.0, seed=1)
    moved = (spoiled - clean).abs()
    assert clean.loc["alpha", "irls"] == pytest.approx(clean.loc["alpha", "truth"], rel=0.03)
    assert (moved.loc[["alpha", "beta"], "irls"] < 0.1 * moved.loc[["alpha", "beta"], "ls"]).all()


@pytest.mark.parametrize("noise", list(geometry.NOISE_FORMS))
def test_every_form_of_noise_has_the_sigma_that_it_states(noise):
    draws = geometry.unit_noise(np.random.default_rng(4), (200_000,), noise)
    assert draws.std() == pytest.approx(geometry.NOISE_FORMS[noise], rel=0.01)
    if noise != "gaussian":
        assert np.abs(draws).max() <= 1.0
    with pytest.raises(ValueError, match="noise must be one of"):
        geometry.unit_noise(np.random.default_rng(4), (3,), "pink")


def test_a_filter_of_gain_one_changes_nothing_and_a_low_one_smooths():
    series = np.random.default_rng(5).standard_normal((4000, 2))
    np.testing.assert_allclose(reductions.smoothed(series, 1.0), series, atol=1e-15)
    for gain in (0.8, 0.3):
        expected = np.sqrt(gain / (2.0 - gain))
        assert reductions.smoothed(series, gain).std() == pytest.approx(expected, rel=0.05)


def test_pv_over_rms_knows_noise_from_a_sinusoid(constant):
    setting, run = constant
    rows = reductions.shape_values(run, setting).set_index("claim")
    assert (np.abs(rows.value - 5.0) < 1.0).all()
    t = np.arange(100.0)
    sinusoid = np.sin(2 * np.pi * 0.0373 * t)
    assert np.ptp(sinusoid) / sinusoid.std() == pytest.approx(rows.null.iloc[0], rel=0.02)


def test_the_contest_of_sensitivities_is_decided_by_seeds():
    setting = ThermalBench(frame_period_s=120.0)
    drift = warmup.figure_5(setting)
    won = warmup.sensitivity_contest(drift, setting, bad_share=0.05, bad_arcsec=20.0, seeds=12)
    assert won.shape == (12,)
    assert won.dtype == bool
    again = warmup.sensitivity_contest(drift, setting, bad_share=0.05, bad_arcsec=20.0, seeds=12)
    np.testing.assert_array_equal(won, again)
