"""Could the verdicts have been otherwise? A method that does nothing is planted where each claim is
examined, and what was set is turned to its other end.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.papers import liu2026, lyu2015, ren2023
from losbench.papers.liu2026.results import layout
from losbench.workbench.ledger.claims import accepted_verdicts

# Agreeing claims that no method could fail: no centroid, loss, aid or correction enters them.
WITHOUT_NULL = {"irls-05", "irls-06", "irls-10", "irls-11", "inertial-19"}


@pytest.fixture(scope="module")
def rest():
    setting = liu2026.ConstantBench()
    return setting, liu2026.constant_run(setting)


def judge_eiwa(run, setting):
    """Notebook 06 in short: cells of the table and the text, both statements."""
    ledger = lb.Ledger()
    found = liu2026.reductions(run, setting)
    for column, block in (
        ("eiwa", "liu2026 Tab. 1, EIWA"),
        ("eiwa in the text", "liu2026 section 3.2, EIWA"),
    ):
        rows = found.values(column)
        ledger.values(rows, {"spots": "moving"})
        pull, covariance = found.pull(column)
        ledger.block(block, rows.claim, pull, covariance)
    (lower, lower_null), (less, less_null) = found.chances().values()
    ledger.statement("irls-46", lower, lower_null)
    ledger.statement("irls-55", less, less_null)
    return ledger


def test_an_eiwa_that_does_nothing_agrees_nowhere(rest):
    setting, run = rest
    rng = np.random.default_rng(1)
    # Its own noise, of a thousandth of the grey one's scatter, so that errors are not zero.
    idle = replace(run, eiwa_px=run.grey_px + 1e-5 * rng.standard_normal(run.grey_px.shape))
    verdicts = judge_eiwa(idle, setting).verdicts()
    found = {id_: verdict for id_, verdict in verdicts.items() if verdict != "pending"}
    assert len(found) == 18
    assert "agrees" not in found.values()


def test_the_two_statements_have_the_odds_of_the_null(rest):
    setting, run = rest
    ledger = judge_eiwa(run, setting)
    assert 12.0 < ledger.odds("irls-46") < 80.0
    assert 0.3 < ledger.odds("irls-55") < 1.6
    assert 10.0 < ledger.odds("irls-25") < 30.0
    assert ledger.verdict("irls-25") == "no power"
    assert ledger.verdict("irls-23") == "differs"


def test_an_irls_that_is_least_squares_fits_no_layout(monkeypatch):
    real = layout.two_spot_angles
    monkeypatch.setattr(
        layout, "two_spot_angles", lambda *a, scale=None, **k: real(*a, scale=None, **k)
    )
    # Without a loss all blocks have ratios of one; the prints' rounding is all the scatter left.
    fit = liu2026.LayoutModel(blocks=60).at(np.array([7.18, 1.96, 153.5]))
    pull, covariance = fit.misfit
    ledger = lb.Ledger()
    claims = ["irls-32", "irls-38", "irls-41"]
    ledger.block("liu2026 Tab. 2", claims, pull, covariance, fitted=3)
    ledger.statement("irls-44", 0.0, 0.0)
    assert {ledger.verdict(claim) for claim in [*claims, "irls-44"]} == {"differs"}


def test_an_aid_that_does_nothing_agrees_nowhere():
    setting = lyu2015.Setting()
    rows = []
    for sigma in (0.1, 0.2, 0.4, 1.5):
        some = lyu2015.random_exposures(replace(setting, sigma_px=sigma), 40)
        rows.append({"sigma_px": sigma, "iterative": some.error(some.traditional).mean()})
    plain = rows[2]["iterative"]
    idle = np.full(3, plain)  # whatever the bias of a gyro that is not used
    ledger = lb.Ledger()
    ledger.value("inertial-18", lb.Value({}, plain, 0.02, null=plain))
    for claim, holds, nothing in (
        ("inertial-20", lyu2015.improves(pd.DataFrame(rows)), 0.0),
        ("inertial-21", True, 1.0),
        ("inertial-22", lyu2015.stays(idle), 0.0),
        ("inertial-27", lyu2015.worsens(idle), 0.0),
    ):
        ledger.statement(claim, float(holds), nothing)
    assert [ledger.verdict(f"inertial-{k}") for k in (18, 20, 21, 22, 27)] == [
        *("differs", "differs", "no power", "differs", "differs"),
    ]


def test_a_correction_that_does_nothing_agrees_nowhere():
    seeds = ren2023.campaign(ren2023.Pair(), 4)
    raw = seeds.table()["mean"]["change, raw"]
    ledger = lb.Ledger()
    ledger.value("drift-02", lb.Value({}, raw, 0.05, null=raw))
    assert ledger.verdict("drift-02") == "differs"


def test_the_band_of_frequencies_turns_the_plain_mean_and_not_the_aided_one():
    setting = lb.watch(lyu2015.Setting())
    ledger = lb.Ledger()

    def means(one):
        shots = lyu2015.random_exposures(one, 150)
        path = one.sensed(shots.motion, one.biased_gyro(150, 1))
        errors = (
            shots.per_image(shots.error(shots.traditional)),
            shots.per_image(lyu2015.quiet(shots, path)),
        )
        return [(e.mean(), e.std() / np.sqrt(len(e))) for e in errors]

    here = means(setting)
    assert "Setting.frequency_hz" in lb.fields_read(setting)
    about = {"reads": lb.fields_read(setting)}
    ends = [
        means(replace(setting, frequency_hz=band))
        for band in ledger.allowed("Setting.frequency_hz")
    ]
    for k, claim in enumerate(("inertial-17", "inertial-18")):
        null = {"null": here[0][0]} if k else {}
        ledger.value(claim, lb.Value({}, *here[k], **null, **about))
        ledger.ends(claim, "Setting.frequency_hz", *(lb.Value({}, *end[k]) for end in ends))
    assert ledger.verdict("inertial-17") == "set"
    assert ledger.verdict("inertial-18") == "agrees"
    assert ledger.odds("inertial-18") > 100
    reasons = {row["id"]: row["reason"] for row in ledger.rows(examined=True)}
    assert "turns with Setting.frequency_hz" in reasons["inertial-17"]
    assert "stands at both ends of Setting.frequency_hz" in reasons["inertial-18"]


def test_claims_that_agree_without_a_null_do_not_hang_on_a_method():
    accepted = accepted_verdicts()
    assert {accepted[claim] for claim in WITHOUT_NULL} == {"agrees"}
    # Fig. 1 is the same by LS and by IRLS.
    assert liu2026.two_spot_difference(liu2026.MonteCarlo()).peak_arcsec.max() < 1e-9


def test_doubt_comes_from_the_null_and_not_from_the_print(rest):
    setting, run = rest
    rows = liu2026.reductions(run, setting).values()
    low, high = liu2026.printed_reductions()
    assert (rows.low == low).all()
    assert (rows.high == high).all()
    assert (rows.null == 0.0).all()
    assert ((high - low) > 0).all()
