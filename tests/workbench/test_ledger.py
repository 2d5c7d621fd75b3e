"""The rules that turn a print and what was found into a class, and the parts that notebooks hand
in.
"""

import csv
import io
import re
from pathlib import Path

import nbformat
import numpy as np
import pytest

import losbench as lb
from losbench.papers.liu2026.scenario import ConstantBench
from losbench.papers.lyu2015.scenario import Setting
from losbench.resources import notebook_folder
from losbench.workbench.ledger import claims as module
from losbench.workbench.ledger.rules import holm, ids
from losbench.workbench.ledger.tables import with_accepted
from losbench.workbench.ledger.tracking import calibrated_fields
from losbench.workbench.reproduction.pages import ledger_table

CLAIMS = """id,paper,where,quantity,relation,claimed,unit,note,block,notebook
a-1,p,Tab. 1,two digits,=,0.10,px,,T,03
a-2,p,Tab. 1,one digit,=,0.1,px,,T,06
a-3,p,Tab. 1,ceiling,<=,0.5,arcsec,,,03
a-4,p,Tab. 1,floor,>=,5,arcsec,,,03
a-5,p,text,statement,is,true,,,,03
a-6,p,text,rough,~,22.5,%,"commas, and <tags>",,06
a-7,p,Tab. 2,fitted,=,1.0,px,,F,03
"""


@pytest.fixture
def claims(tmp_path, monkeypatch):
    monkeypatch.setenv("LOSBENCH_BUILD", str(tmp_path / "build"))
    path = tmp_path / "claims.csv"
    path.write_text(CLAIMS, encoding="utf-8")
    return path


@pytest.fixture
def ledger(claims):
    return lb.Ledger(claims)


@pytest.mark.parametrize(
    ("claim", "ours", "sigma", "verdict"),
    [
        ("a-1", 0.104, 0.0, "agrees"),
        ("a-1", 0.106, 0.0, "differs"),
        ("a-2", 0.149, 0.0, "agrees"),
        ("a-2", 0.151, 0.0, "differs"),
        ("a-1", 0.120, 0.0051, "agrees"),
        ("a-1", 0.120, 0.0049, "differs"),
        ("a-3", 0.549, 0.0, "agrees"),
        ("a-3", -9.0, 0.0, "agrees"),
        ("a-3", 0.551, 0.0, "differs"),
        ("a-4", 4.51, 0.0, "agrees"),
        ("a-4", 4.49, 0.0, "differs"),
        ("a-5", True, 0.0, "agrees"),
        ("a-5", False, 0.0, "differs"),
        ("a-6", 22.46, 0.0, "agrees"),
    ],
)
def test_a_value_is_judged_by_three_sigma_and_the_rounding_of_the_print(
    ledger, claim, ours, sigma, verdict
):
    ledger.value(claim, lb.Value({}, ours, sigma))
    assert ledger.verdict(claim) == verdict


def test_readings_are_a_set(ledger):
    for reading, value in (("sigma", 0.439), ("peak", 0.9), ("twice", 0.7)):
        ledger.value("a-3", lb.Value({"statistic": reading}, value))
    assert (ledger.verdict("a-3"), ledger.under("a-3")) == ("depends", "1 of 3")
    row = next(row for row in ledger.rows() if row["id"] == "a-3")
    assert row["ours"] == "0.439 to 0.9"
    assert row["reason"] == "under statistic: sigma. not under statistic: peak | statistic: twice"


@pytest.mark.parametrize(
    ("value", "null", "odds", "verdict"),
    [
        (lb.Value({}, 13.8, 6.8, null=0.0, printed=(16.499, 16.501)), 0.0, 17.6, "no power"),
        (lb.Value({}, 16.5, 3.0, null=0.0, printed=(16.0, 17.0)), 0.0, 3.5e6, "agrees"),
        (lb.Value({}, 5.0, 1.0, null=5.0, printed=(4.9, 5.1)), 5.0, 1.0, "no power"),
        (lb.Value({}, 30.0, 1.0, null=0.0, printed=(4.9, 5.1)), 0.0, 1e-6, "differs"),
    ],
)
def test_odds_are_likelihoods_of_the_print_and_agreeing_needs_a_hundred(
    ledger, value, null, odds, verdict
):
    assert value.null == null
    ledger.value("a-6", value)
    assert ledger.odds("a-6") == pytest.approx(min(max(odds, 1e-6), 1e6), rel=0.02)
    assert ledger.verdict("a-6") == verdict


@pytest.mark.parametrize(
    ("p", "null", "verdict"),
    [
        (0.9, 0.0089, "agrees"),
        (0.9, 0.0091, "no power"),
        (0.05, 0.059, "no power"),
        (0.0028, None, "agrees"),
        (0.0026, None, "differs"),
    ],
)
def test_one_rule_for_statements_and_numbers(ledger, p, null, verdict):
    ledger.statement("a-5", p, null)
    assert ledger.verdict("a-5") == verdict


@pytest.mark.parametrize(
    ("chances", "ours"),
    [
        ((1.0,), "true in 100 %"),
        ((1.0, 0.996), "true in 100 %"),
        ((0.994, 0.994), "true in 99 %"),
        ((0.05, 1.0), "true in 5 to 100 %"),
    ],
)
def test_chances_are_shown_as_plain_percents(ledger, chances, ours):
    for k, p in enumerate(chances):
        ledger.statement("a-5", p, reading={"draw": str(k)})
    assert ledger.judged()["a-5"].ours == ours


def test_the_far_tails_have_odds_too(ledger):
    ledger.value("a-1", lb.Value({}, 100.0, 1.0, null=200.0))
    assert ledger.odds("a-1") == pytest.approx(1e6)
    ledger.value("a-2", lb.Value({}, 0.1, 0.0, null=7.0))
    assert ledger.odds("a-2") == pytest.approx(1e6)


def test_what_was_set_and_what_follows_is_no_evidence(ledger):
    ledger = lb.Ledger()
    ledger.set("irls-17", "ConstantBench.flux_e")
    assert ledger.verdict("irls-17") == "set"
    with pytest.raises(ValueError, match=r"flux_e was not set to irls-25, but to \('irls-17'"):
        ledger.set("irls-25", "ConstantBench.flux_e")
    with pytest.raises(ValueError, match="field must be a calibrated one"):
        ledger.set("irls-17", "ConstantBench.focal_mm")
    ledger.value("irls-62", lb.Value({}, True, made_of=("irls-44",)))
    assert (ledger.verdict("irls-62"), ledger.depends_on("irls-62")) == ("follows", ("irls-44",))


@pytest.mark.parametrize(
    ("claim", "ends", "verdict"),
    [
        ("inertial-17", (0.87, 0.50), "set"),
        ("inertial-18", (0.0100, 0.0120), "agrees"),
        ("inertial-18", (0.0100, 0.0300), "follows"),
        ("inertial-18", None, "follows"),
        ("inertial-17", None, "set"),
    ],
)
def test_a_calibrated_field_is_flipped_and_only_what_turns_is_no_evidence(claim, ends, verdict):
    setting = lb.watch(Setting())
    assert setting.frequency_hz
    reads = lb.fields_read(setting)
    ledger = lb.Ledger()
    printed = float(ledger.claims[claim].claimed)
    ledger.value(claim, lb.Value({"band": "1-60 Hz"}, printed, 0.0003, reads=reads))
    if ends:
        low, high = (lb.Value({}, end, 0.0003) for end in ends)
        ledger.ends(claim, "Setting.frequency_hz", low, high)
    assert ledger.verdict(claim) == verdict
    assert ledger.depends_on(claim) == (() if claim == "inertial-17" else ("inertial-17",))


def test_fields_are_recorded_where_they_are_used_and_not_where_they_are_copied():
    from dataclasses import replace

    bench = lb.watch(ConstantBench())
    other = replace(bench, spot_sigma_px=3.5)
    assert lb.fields_read(other) == frozenset()
    assert "flux_e" in repr(bench)
    assert lb.fields_read(bench) == frozenset()
    assert other.camera.focal_mm == 260.0
    assert lb.fields_read(bench) == {
        f"ConstantBench.{name}" for name in ("focal_mm", "pixel_um", "shape")
    }
    with pytest.raises(ValueError, match="ConstantBench is not watched"):
        lb.fields_read(ConstantBench())


def test_every_calibrated_field_names_claims():
    known = lb.Ledger().claims
    assert len(calibrated_fields()) >= 10
    for name, how in calibrated_fields().items():
        assert how.to, name
        assert set(how.to) <= set(known), name


def test_a_conflict_needs_a_slack_below_zero(ledger):
    ledger.conflict("K1", ["a-1", "a-3"], "a-1 >= a-3", -0.2, "px")
    assert list(ledger.conflicts().loc["K1"]) == ["a-1;a-3", "a-1 >= a-3", "-0.2 px"]
    for slack in (0.0, 0.1, float("nan")):
        with pytest.raises(ValueError, match="K2 is no conflict: its slack is"):
            ledger.conflict("K2", ["a-1"], "x", slack)


def test_a_cell_differs_only_where_its_table_does(ledger):
    ledger.value("a-1", lb.Value({}, 0.2, 0.03))
    assert ledger.verdict("a-1") == "differs"
    ledger.block("T", ["a-1", "a-2"], np.array([3.1, 0.1]))
    assert ledger.blocks().p.iloc[0] == "0.0081"
    assert ledger.verdict("a-1") == "differs"
    spared = lb.Ledger.__new__(lb.Ledger)
    spared.claims, spared.entries = ledger.claims, ledger.entries[:1]
    spared.block("T", ["a-1", "a-2"], np.array([2.0, 0.1]))
    assert spared.verdict("a-1") == "agrees"


def test_covariance_counts(ledger):
    covariance = np.array([[1.0, 0.99], [0.99, 1.0]])
    ledger.block("T", ["a-1", "a-2"], np.array([1.0, -1.0]), covariance)
    ledger.block("T", ["a-1", "a-2"], np.array([1.0, 1.0]), covariance)
    assert [float(x) for x in ledger.blocks().chi2] == pytest.approx([200.0, 2 / 1.99], rel=0.01)


def test_a_fitted_cell_is_judged_by_its_block_alone(ledger):
    pull = np.ones(8)
    ledger.value("a-7", lb.Value({}, 9.0))
    ledger.block("F", ["a-7"], pull, fitted=3, reading={"c": "run"}, uses=["a-1"])
    assert (ledger.verdict("a-7"), ledger.under("a-7")) == ("agrees", "1 of 1")
    ledger.block("F", ["a-7"], 20 * pull, fitted=3, reading={"c": "frame"})
    assert (ledger.verdict("a-7"), ledger.under("a-7")) == ("depends", "1 of 2")
    assert ledger.depends_on("a-7") == ("a-1",)
    with pytest.raises(ValueError, match="8 cells cannot judge 8 parameters"):
        ledger.block("F", ["a-7"], pull, fitted=8)
    with pytest.raises(ValueError, match="no claim is of block 'X'; there are F, T"):
        ledger.block("X", ["a-7"], pull)


def test_holm_is_that_of_statsmodels():
    from statsmodels.stats.multitest import multipletests

    p = np.random.default_rng(1).uniform(0.0, 0.03, 8)
    levels = holm({str(k): float(x) for k, x in enumerate(p)}, len(p))
    rejected = multipletests(p, 0.05, method="holm")[0]
    order = np.argsort(p)
    ours = np.array([p[k] <= levels[str(k)] for k in order])
    # Step-down: after the first that stands all stand.
    np.testing.assert_array_equal(np.logical_and.accumulate(ours), rejected[order])


def test_runs_of_ids_are_short():
    order = [f"irls-{k:02d}" for k in range(1, 60)] + ["drift-01"]
    assert ids(["irls-32", "irls-33", "irls-34", "drift-01", "irls-07", "irls-08"], order) == (
        *("irls-07", "irls-08", "irls-32..34", "drift-01"),
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda x: x.value("a-9", lb.Value({}, 1.0)), "no claim 'a-9'; ids run from a-1 to a-7"),
        (lambda x: x.value("a-1", lb.Value({}, float("nan"))), "value must be a finite number"),
        (lambda x: x.value("a-1", lb.Value({}, 1.0, -1.0)), "error must be a finite number"),
        (lambda x: x.value("a-5", lb.Value({}, 1.0)), "a-5 is 'is true': its value must be True"),
        (lambda x: x.value("a-1", lb.Value({}, True)), "a-1 is '= 0.10 px': its value must be a n"),
        (lambda x: x.statement("a-1", 0.5), "a-1 is a number, no statement"),
        (lambda x: x.statement("a-5", 1.5), "p must be a finite number"),
        (lambda x: x.arithmetic("a-1", ["a-2"], 1), "holds must be True or False"),
        (lambda x: x.open("a-1", "The frames"), "question must end with"),
    ],
)
def test_a_wrong_entry_is_refused_by_name(ledger, call, message):
    with pytest.raises(ValueError, match=message):
        call(ledger)


@pytest.mark.parametrize(
    ("old", "new"),
    [("judge", "value"), ("impossible", "conflict"), ("calibrated", "set"), ("untestable", "open")],
)
def test_a_method_of_the_first_form_names_its_successor(ledger, old, new):
    with pytest.raises(AttributeError, match=rf"Ledger\.{old} is no more: use {new}\("):
        getattr(ledger, old)


def test_parts_join_into_one_table_that_does_not_see_rounding_noise(claims):
    texts = []
    for noise in (0.0, 1e-13):
        first, second = lb.Ledger(claims), lb.Ledger(claims)
        first.value("a-1", lb.Value({"p": "sigma"}, 0.1 + noise, 0.01, null=0.3, uses=("a-2",)))
        first.ends("a-1", "Setting.frequency_hz", lb.Value({}, 0.1), lb.Value({}, 0.2))
        first.statement("a-5", 0.5, reading={"who": "us"})
        first.arithmetic("a-4", ["a-3"], holds=False, note="5 is not 6")
        second.open("a-6", "Where were the spots?")
        second.block("T", ["a-1", "a-2"], np.array([0.1, 0.2]), reading={"r": "x"})
        second.conflict("K1", ["a-1", "a-2"], "one <= other", -1.0)
        assert list(first.save("03").index) == ["a-1", "a-4", "a-5"]
        second.save("06")
        joined = lb.Ledger.collect(claims=claims)
        texts.append(module.as_csv(module.COLUMNS, joined.rows()))
    assert texts[0] == texts[1]
    rows = list(csv.DictReader(io.StringIO(texts[0])))
    assert tuple(rows[0]) == module.COLUMNS
    assert [row["verdict"] for row in rows] == [
        *("agrees", "pending", "pending", "arithmetic", "agrees", "open", "pending"),
    ]
    assert rows[0]["ours"] == "0.100 ± 0.010"
    assert rows[0]["depends_on"] == "a-2"
    assert rows[0]["conflicts"] == rows[1]["conflicts"] == "K1"
    assert rows[3]["reason"] == "the paper's own prints: false; 5 is not 6"
    assert joined.questions() == {"Where were the spots?": ("a-6",)}
    page = ledger_table(rows, {("03", ""): "notebooks/03-first.html"})
    assert "commas, and &lt;tags&gt;" in page
    assert page.count('<a href="notebooks/03-first.html">') == 5
    assert '<td class="ours" data-value="0.100">0.100 ± 0.010</td>' in page


def test_a_claim_belongs_to_one_notebook(ledger):
    ledger.value("a-6", lb.Value({}, 22.5))
    with pytest.raises(ValueError, match="a-6 must be examined by notebook 06, got 03"):
        ledger.save("03")


def test_the_accepted_verdict_stands_in_for_a_notebook_that_has_not_run(tmp_path):
    rows = with_accepted(list(lb.Ledger.collect(tmp_path / "nothing").rows()))
    assert {row["id"]: row["verdict"] for row in rows} == module.accepted_verdicts()


def test_the_shipped_claims_are_complete():
    claims = lb.Ledger().claims.values()
    assert len(claims) == 114
    for claim in claims:
        assert claim.relation in {"=", "~", "<=", ">=", "is"}
        assert (
            claim.claimed == "true"
            if claim.relation == "is"
            else claim.interval[0] < claim.interval[1]
        )
        assert len(claim.notebook) == 2
    assert set(module.accepted_verdicts()) == {claim.id for claim in claims}
    assert set(module.accepted_verdicts().values()) <= set(module.CLASSES)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("claimed", "printed", "claims.csv has no column claimed; it has id, paper"),
        (",1.1,", ",1e999,", "line 2: irls-01 must claim a number"),
        (",1.1,", ",-inf,", "line 2: irls-01 must claim a number"),
        (",=,1.1,", ",is,1.1,", "true or false by 'is', got 'is' '1.1'"),
        ("irls-02", "irls-01", "line 3: the id must be given, and once"),
        ("irls-02,", ",", "line 3: the id must be given, and once"),
    ],
)
def test_a_faulty_table_of_claims_is_named(tmp_path, old, new, message):
    path = tmp_path / "claims.csv"
    text = module.data_file("claims.csv").read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        module.read_claims(path)


def test_the_claims_of_a_paper_s_figure_stand_below_it_and_are_no_wider(ledger):
    assert max(map(len, ledger.figure("liu2026", "Fig. 1").splitlines())) <= 80
    drawn = set()
    for path in notebook_folder().glob("[0-9]*.ipynb"):
        for cell in nbformat.read(path, 4).cells:
            if found := re.search(r"figures\.save\(fig, \"(\w+)-fig-(\d)\"", cell.source):
                shown, _, said = cell.source[found.end() :].partition("plt.show()\n")
                assert "print" not in shown
                assert f'.figure("{found[1]}", "Fig. {found[2]}"))' in said
                drawn.add(found[0])
    assert len(drawn) == 15


def test_readme_and_data_count_the_claims_as_they_are():
    root = Path(__file__).resolve().parents[2]
    accepted = module.accepted_verdicts()
    text = (root / "README.md").read_text(encoding="utf-8")
    assert f"> {len(accepted)} claims: {module.counted(accepted.values())}.\n" in text
    claims = lb.Ledger().claims.values()
    data = (root / "data" / "README.md").read_text(encoding="utf-8")
    assert f"the {len(accepted)} printed numbers" in data
    for prefix, paper in (("irls", "liu2026"), ("inertial", "lyu2015"), ("drift", "ren2023")):
        count = sum(claim.paper == paper for claim in claims)
        assert f"{count} claims, ids `{prefix}-*`" in data
