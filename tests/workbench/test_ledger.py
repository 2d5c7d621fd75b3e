"""The rules that turn a print and a value into a verdict, and the parts that notebooks hand in."""

import csv
import io

import pytest

import losbench as lb
from losbench.workbench.ledger import claims as module

CLAIMS = """id,paper,where,quantity,relation,claimed,unit,note
a-1,p,Tab. 1,two digits,=,0.10,px,
a-2,p,Tab. 1,one digit,=,0.1,px,
a-3,p,Tab. 1,ceiling,<=,0.5,arcsec,
a-4,p,Tab. 1,floor,>=,5,arcsec,
a-5,p,text,statement,is,true,,
a-6,p,text,rough,~,22.5,%,"commas, and <tags>"
"""


@pytest.fixture
def claims(tmp_path, monkeypatch):
    monkeypatch.setenv("LOSBENCH_BUILD", str(tmp_path / "build"))
    path = tmp_path / "claims.csv"
    path.write_text(CLAIMS, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("claim", "ours", "sigma", "verdict"),
    [
        ("a-1", 0.104, 0.0, "reproduced"),
        ("a-1", 0.106, 0.0, "differs"),
        ("a-2", 0.149, 0.0, "reproduced"),
        ("a-2", 0.151, 0.0, "differs"),
        ("a-1", 0.120, 0.0051, "reproduced"),
        ("a-1", 0.120, 0.0049, "differs"),
        ("a-3", 0.549, 0.0, "reproduced"),
        ("a-3", -9.0, 0.0, "reproduced"),
        ("a-3", 0.551, 0.0, "differs"),
        ("a-4", 4.51, 0.0, "reproduced"),
        ("a-4", 4.49, 0.0, "differs"),
        ("a-5", True, 0.0, "reproduced"),
        ("a-5", False, 0.0, "differs"),
        ("a-6", 22.46, 0.0, "reproduced"),
    ],
)
def test_a_value_is_judged_by_three_sigma_and_the_rounding_of_the_print(
    claims, claim, ours, sigma, verdict
):
    assert lb.Ledger(claims).judge(claim, ours, uncertainty=sigma).verdict == verdict


@pytest.mark.parametrize(
    ("claim", "bound", "impossible"),
    [
        ("a-1", {"at_most": 0.094}, True),
        ("a-1", {"at_most": 0.096}, False),
        ("a-1", {"at_least": 0.106}, True),
        ("a-3", {"at_least": 0.79}, True),
        ("a-3", {"at_most": 0.1}, False),
        ("a-4", {"at_most": 4.4}, True),
        ("a-4", {"at_least": 0.0, "at_most": 6.0}, False),
        ("a-5", {"contradiction": True}, True),
        ("a-5", {"contradiction": False}, False),
    ],
)
def test_impossible_needs_a_bound_that_leaves_no_room(claims, claim, bound, impossible):
    ledger = lb.Ledger(claims)
    if impossible:
        assert ledger.impossible(claim, proof="geometry", **bound).verdict == "impossible"
    else:
        with pytest.raises(ValueError, match=f"{claim} is not impossible"):
            ledger.impossible(claim, proof="geometry", **bound)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda ledger: ledger.judge("a-9", 1.0), "no claim 'a-9'; ids run from a-1 to a-6"),
        (lambda ledger: ledger.judge("a-1", float("nan")), "ours must be a finite number, got nan"),
        (
            lambda ledger: ledger.judge("a-1", 1.0, uncertainty=-1.0),
            "uncertainty must be a finite number",
        ),
        (lambda ledger: ledger.judge("a-5", 1.0), "ours must be True or False, got 1.0"),
        (
            lambda ledger: ledger.impossible("a-1", proof="none"),
            "a-1 is a number: give at_least or at_most",
        ),
        (
            lambda ledger: ledger.impossible("a-5", proof="none", at_most=1),
            "a-5 is no number: give contradiction",
        ),
    ],
)
def test_a_wrong_entry_is_refused_by_name(claims, call, message):
    with pytest.raises(ValueError, match=message):
        call(lb.Ledger(claims))


def test_a_second_verdict_must_be_the_first(claims):
    ledger = lb.Ledger(claims)
    ledger.judge("a-1", 0.1)
    assert ledger.judge("a-1", 0.101).ours == "0.101"
    with pytest.raises(ValueError, match="a-1 is judged twice: reproduced, then differs"):
        ledger.judge("a-1", 0.2)


def test_parts_join_into_one_table_that_does_not_see_rounding_noise(claims):
    texts = []
    for noise in (0.0, 1e-13):
        first, second = lb.Ledger(claims), lb.Ledger(claims)
        first.judge("a-1", 0.1 + noise, uncertainty=0.01, reading="sigma", evidence="5000 trials")
        second.untestable("a-6", reason="not printed")
        second.calibrated("a-2", 0.1, reading="sets the jitter")
        assert list(first.save("03").index) == ["a-1"]
        second.save("06")
        joined = lb.Ledger.collect(claims=claims)
        texts.append(joined.to_csv())
    assert texts[0] == texts[1]
    rows = list(csv.DictReader(io.StringIO(texts[0])))
    assert tuple(rows[0]) == module.COLUMNS
    assert [row["verdict"] for row in rows] == [
        *("reproduced", "calibrated"),
        *["pending"] * 3,
        "untestable",
    ]
    assert rows[0]["ours"] == "0.1"
    assert rows[0]["evidence"] == "Notebook 03. 5000 trials"
    page = joined.to_html(["03-first"])
    assert "commas, and &lt;tags&gt;" in page
    assert page.count('<a href="html/03-first.html">') == 1
    assert '<td class="ours">0.1 ± 0.01</td>' in page


def test_notebooks_that_disagree_are_named(claims):
    for notebook, value in (("03", 0.1), ("04", 0.2)):
        ledger = lb.Ledger(claims)
        ledger.judge("a-1", value)
        ledger.save(notebook)
    with pytest.raises(ValueError, match="a-1 is judged twice: reproduced, then differs"):
        lb.Ledger.collect(claims=claims)


def test_the_accepted_verdict_stands_in_for_a_notebook_that_has_not_run(tmp_path):
    joined = lb.Ledger.collect(tmp_path / "nothing", fall_back=True)
    assert joined.verdicts() == module.accepted_verdicts()


def test_the_shipped_claims_are_complete():
    claims = lb.Ledger().claims.values()
    assert len(claims) == 96
    for claim in claims:
        assert claim.relation in {"=", "~", "<=", ">=", "is"}
        assert (
            claim.claimed == "true"
            if claim.relation == "is"
            else claim.interval[0] < claim.interval[1]
        )
    assert set(module.accepted_verdicts()) == {claim.id for claim in claims}
    assert set(module.accepted_verdicts().values()) <= set(module.VERDICTS)


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
