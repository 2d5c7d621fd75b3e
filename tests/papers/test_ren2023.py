"""The numbers of ren2023 over sixty seeds, what wrong corrections do, and what the paper's own
numbers allow.
"""

from dataclasses import replace

import numpy as np
import pytest

import losbench as lb
from losbench.estimation.stability import split_error
from losbench.papers.provenance import assumptions
from losbench.papers.ren2023.results.analysis import budget, closure, split_table
from losbench.papers.ren2023.results.figures import campaign, evaluate, first_order, table_1
from losbench.papers.ren2023.scenario import CONVENTION, Pair
from losbench.papers.ren2023.twin import simulate
from losbench.pointing.starcamera import correct_pair, remove_aberration
from losbench.units import rad_to_arcsec

PAIR = Pair()
LAST_DAY = replace(PAIR, days=PAIR.days[-1:])


@pytest.fixture(scope="module")
def sixty():
    return campaign(PAIR, 60)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quantity", "expected", "within"),
    [
        ("change, raw", 1.10, 0.02),
        ("change, corrected", 0.00, 0.02),
        ("total, raw", 0.74, 0.01),
        ("LSFE, raw", 0.41, 0.015),
        ("NEA, raw", 0.68, 0.01),
        ("total, corrected / raw", 1.018, 0.006),
    ],
)
def test_sixty_seeds_give_the_paper_s_pair(sixty, quantity, expected, within):
    assert sixty.table().loc[quantity, "mean"] == pytest.approx(expected, abs=within)


def test_the_stated_uncertainty_is_the_scatter_from_seed_to_seed(sixty):
    for split in (sixty.before, sixty.after):
        for name in ("total", "lsfe", "nea"):
            scatter = getattr(split, name).std(ddof=1)
            assert getattr(split, f"{name}_sigma").mean() == pytest.approx(scatter, rel=0.35)


def test_every_assumption_has_its_reason():
    table = assumptions(PAIR)
    assert set(table.source) == {"stated", "assumed", "calibrated"}
    assert (table.reason.str.len() > 2).all()
    assert PAIR.angle_deg == pytest.approx(67.62, abs=0.005)


def test_wrong_corrections_change_the_angle_as_predicted():
    quiet = replace(PAIR, lsfe_arcsec=0.0, nea_arcsec=0.0, spot_noise_um=0.0)
    telemetry = simulate(quiet).telemetry
    rows = slice(-2400, None)
    drift = correct_pair(telemetry).drift[:, rows]
    heads = telemetry.quaternions[:, rows]

    def change(first, second):
        corrected = [
            lb.correct_drift(q, d, convention=CONVENTION)
            for q, d in zip(heads, (first, second), strict=True)
        ]
        angle = lb.boresight_angle(*corrected, convention=CONVENTION)
        return rad_to_arcsec(angle).mean() - 3600 * PAIR.angle_deg

    one, two = drift
    assert change(one, two) == pytest.approx(0.0, abs=2e-5)
    assert change(0 * one, 0 * two) == pytest.approx(1.1, abs=1e-4)
    assert change(-one, -two) == pytest.approx(2.2, abs=1e-4)
    assert change(two, one) == pytest.approx(2.2, abs=1e-4)
    assert change(one, 0 * two) == pytest.approx(
        0.65, abs=0.06
    )  # the base's common drift, 0.05, shows in one alone


@pytest.mark.parametrize("smooth_s", [None, 10.0])
def test_the_first_order_of_the_angle_is_the_angle(smooth_s):
    whole, short = (run(PAIR, 11, smooth_s=smooth_s) for run in (evaluate, first_order))
    np.testing.assert_allclose(short.before, whole.before, atol=1e-4)
    np.testing.assert_allclose(short.after, whole.after, atol=1e-4)


def test_smoothing_the_drift_takes_away_the_noise_that_the_correction_adds():
    plain, smooth = evaluate(LAST_DAY, 3), evaluate(LAST_DAY, 3, smooth_s=10.0)
    raw = split_error(plain.before[0]).total
    assert split_error(plain.after[0]).total > 1.01 * raw
    assert split_error(smooth.after[0]).total == pytest.approx(float(raw), rel=0.005)


def test_the_chain_closes_from_pixels_to_the_angle():
    short = replace(LAST_DAY, track_s=60.0)
    simulated = simulate(short, 5, pixels=True)
    pair = correct_pair(simulated.telemetry, sigma_mm=short.spot_noise_um * 1e-3)
    truth = simulated.drift_rad
    error = rad_to_arcsec(pair.drift - truth)
    assert 3 * error[..., :2].std() == pytest.approx(0.1, rel=0.07)
    assert np.abs(error[..., :2].mean(axis=1)).max() < 0.012
    assert np.abs(rad_to_arcsec(pair.after_rad) - 3600 * PAIR.angle_deg).mean() < 0.5


def test_aberration_is_several_arcsec_in_a_track_until_it_is_removed():
    pytest.importorskip("astropy")
    quiet = replace(LAST_DAY, lsfe_arcsec=0.0, nea_arcsec=0.0)
    plain, moved = simulate(quiet, 1).telemetry, simulate(quiet, 1, aberration=True).telemetry

    def angle(heads):
        return rad_to_arcsec(lb.boresight_angle(*heads, convention=CONVENTION))

    assert np.ptp(angle(moved.quaternions)) > 3.0
    assert np.ptp(angle(plain.quaternions)) < 0.01
    back = remove_aberration(plain.quaternions, [0.0, 0.0, 0.0], convention=CONVENTION)
    np.testing.assert_allclose(back, plain.quaternions, atol=1e-15)


def test_only_a_window_of_five_closes_the_printed_numbers():
    table = closure(0.74 / np.sqrt(2.0), 0.48, 0.30)
    five = table[(table.window == 5)]
    assert five.loc["epoch difference", "difference"] == pytest.approx(0.0, abs=0.001)
    assert five.loc["residual", "LSFE predicted"] == pytest.approx(0.208, abs=0.001)
    assert (table.drop(five.index[0])["difference"].abs() > 0.02).all()
    assert (table[(table.window != 5)]["difference"].abs() > 0.02).all()


def test_the_unbiased_split_recovers_the_truth_and_the_paper_s_does_not():
    table = split_table(PAIR, windows=(5,), correlations_s=(5.0, 15.0), tracks=100)
    assert (table["LSFE paper"] > 1.3).all()
    assert ((table["LSFE unbiased"] - 1).abs() < 0.05).all()
    assert ((table["NEA unbiased"] - 1).abs() < 0.01).all()
    assert (table["within 1"] > 0.6).all() and (table["within 2"] > 0.83).all()


def test_table_1_has_one_camera_at_root_two_of_the_pair():
    run = evaluate(LAST_DAY, 2)
    table = table_1(run.before[0], run.after[0])
    np.testing.assert_allclose(
        table.loc["one camera, before"] * np.sqrt(2),
        table.loc["pair, before"].to_numpy(),
        rtol=1e-12,
    )
    assert table.loc["pair, before", "total"] == pytest.approx(3 * lb.rms(run.before[0]), rel=1e-12)


def test_the_error_budget_has_the_sizes_that_theory_gives():
    pytest.importorskip("astropy")
    table = budget(PAIR).set_index("what", append=True)["arcsec"]
    assert table.loc["quaternions with 6 decimals"].item() == pytest.approx(
        3 * 2 * 2**0.5 * 1e-6 / 12**0.5 * 206265, rel=0.05
    )
    assert table.loc[
        "time tags 1 ms apart", "at most, pitch about the common normal"
    ] == pytest.approx(0.228, abs=0.001)
    assert table.loc["focal length +10 ppm, spots on one side"].item() == pytest.approx(
        0.108, abs=0.001
    )
    assert table.loc["angle by 2 acos(w)"].item() == pytest.approx(0.0043, abs=0.0002)
