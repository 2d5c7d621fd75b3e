"""Telemetry that has no reference spots: the angle, its convention and its clocks."""

import hashlib
import json
import multiprocessing
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from losbench import outputs
from losbench.cli import main
from losbench.papers.ren2023.export import write_telemetry
from losbench.papers.ren2023.scenario import Pair
from losbench.pointing.starcamera import QuaternionConvention
from losbench.telemetry.columns import HeadColumns, TelemetryFormat
from losbench.telemetry.conventions import rate_offset
from losbench.telemetry.correct import correct_telemetry
from losbench.telemetry.read import read_telemetry

pytestmark = pytest.mark.usefixtures("undrawn")

BARE = TelemetryFormat(
    time="t",
    scalar="last",
    direction="camera_to_inertial",
    head_1=HeadColumns(quaternion=tuple(f"q1_{axis}" for axis in "xyzw")),
    head_2=HeadColumns(quaternion=tuple(f"q2_{axis}" for axis in "xyzw")),
)
NAMES = [*BARE.head_1.quaternion, *BARE.head_2.quaternion]


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """One track of five minutes at 8 Hz, without its spots."""
    folder = write_telemetry(tmp_path_factory.mktemp("pair") / "example", seed=3)
    table = pd.read_csv(folder / "telemetry.csv")[:2400]
    return table[NAMES].assign(t=np.arange(len(table)) / 8.0)


def judged(table, tmp_path, form=BARE, **options):
    table.to_csv(tmp_path / "telemetry.csv", index=False)
    (tmp_path / "telemetry.toml").write_text(form.to_toml())
    return correct_telemetry(tmp_path / "telemetry.csv", tmp_path / "out", force=True, **options)


def test_the_angle_its_split_and_what_is_missing_are_told(table, tmp_path):
    report = judged(table, tmp_path)
    truth = Pair()
    assert report.pair is None and not report.designed
    assert report.zero_deg == pytest.approx(truth.angle_deg, abs=1e-4)
    row = report.tracks.iloc[0]
    assert row["nea_unbiased_arcsec"] == pytest.approx(np.sqrt(2) * truth.nea_arcsec, rel=0.1)
    assert report.angle.columns.tolist() == ["time_s", "track", "before_arcsec"]
    text = report.summary()
    for said in ("deg, standard deviation", "No reference spots", "No design angle", "ms added"):
        assert said in text
    assert "LSFE and NEA are three sigma before correction, unbiased" in text
    assert "mean over 5 samples" in text and "lsfe_before_arcsec" in report.tracks
    plain = {"track", "start", "samples", "missing"}
    assert all(name in plain or name.endswith("_arcsec") for name in report.tracks)
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written >= {"angle.csv", "tracks.csv", "angle.png", "report.txt"}
    assert not written & {"corrected.csv", "drift.png"}


def test_a_design_angle_alone_counts_and_checks(table, tmp_path):
    designed = replace(BARE, design_angle_deg=Pair().angle_deg)
    report = judged(table, tmp_path, designed)
    assert report.designed and "No design angle" not in report.summary()
    with pytest.raises(ValueError, match="the boresights must stand 60 deg apart"):
        judged(table, tmp_path, replace(BARE, design_angle_deg=60.0))


def test_a_convention_is_proposed_with_its_evidence_and_never_taken(table, tmp_path):
    silent = replace(BARE, scalar=None, direction=None)
    with pytest.raises(
        ValueError, match="no convention is named; .* is steadiest with "
    ) as refusal:
        judged(table, tmp_path, silent)
    best, *others = str(refusal.value).split("; ")[1:5]
    assert "scalar last, camera to inertial: 67.621 deg, scatter 0.1" in best
    assert all("scatter" in other for other in others)
    assert "--convention last,camera_to_inertial" in str(refusal.value)
    confirmed = judged(table, tmp_path, silent, convention=BARE.convention)
    assert confirmed.summary() == judged(table, tmp_path).summary()


@pytest.mark.parametrize(
    "wrong", [c for c in QuaternionConvention.every() if c != BARE.convention], ids=str
)
def test_another_convention_is_refused_and_the_right_one_named(table, tmp_path, wrong):
    with pytest.raises(ValueError, match="it is with scalar last, camera to inertial: 67.621 deg"):
        judged(table, tmp_path, convention=wrong)


def test_telemetry_that_cannot_tell_says_so(table, tmp_path):
    still = table.assign(**{name: table[name].iloc[0] for name in NAMES})
    rng = np.random.default_rng(5)
    still[NAMES] += 1e-6 * rng.standard_normal((len(still), 8))
    assert "The telemetry does not tell its convention" in judged(still, tmp_path).summary()
    with pytest.raises(ValueError, match="the telemetry does not tell which it is"):
        judged(still, tmp_path, replace(BARE, scalar=None, direction=None))


@pytest.mark.parametrize("designed", [True, False])
def test_two_clocks_a_hundred_seconds_apart_are_caught(table, tmp_path, designed):
    late = table.assign(t2=table["t"] + 100.0)
    form = replace(BARE, time=("t", "t2"), design_angle_deg=Pair().angle_deg if designed else None)
    with pytest.raises(ValueError, match="more than 20: aberration .* time tags") as refusal:
        judged(late, tmp_path, form)
    # The twin wobbles with a period of 40 s, so that -20 s fits as well as -100.
    assert "at several offsets of the second one's time tags, such as" in str(refusal.value)
    right = judged(table.assign(t2=table["t"]), tmp_path, form)
    assert "interpolated" not in right.summary()


def test_an_offset_of_the_tags_is_found_where_the_motion_does_not_repeat():
    t = np.arange(0.0, 600.0, 0.25)
    rng = np.random.default_rng(2)
    slow = np.convolve(rng.standard_normal(len(t) + 80), np.hanning(81), mode="valid")
    turned = Rotation.from_rotvec(np.cumsum(slow)[:, None] * 1e-5 * np.array([1.0, 0.5, 0.2]))
    head = turned * Rotation.from_rotvec([0.3, 0.8, -0.2])
    quaternions = np.stack([turned[:-400].as_quat(), head[400:].as_quat()])  # 100 s late
    assert "with +100.0 s added to the second" in rate_offset(quaternions, t[:-400])
    together = np.stack([turned.as_quat(), head.as_quat()])
    assert rate_offset(together, t) == ""


def test_a_head_that_answers_in_every_other_row_gets_its_split(table, tmp_path):
    sparse = table.copy()
    sparse.loc[sparse.index % 2 == 1, list(BARE.head_2.quaternion)] = np.nan
    row = judged(sparse, tmp_path).tracks.iloc[0]
    assert row["missing"] == 1200
    whole = judged(table[::2], tmp_path).tracks.iloc[0]
    for name in ("total_before_arcsec", "lsfe_unbiased_arcsec", "nea_unbiased_arcsec"):
        assert row[name] == pytest.approx(whole[name], rel=1e-9)


def test_a_file_for_each_head_and_a_third_head(table, tmp_path):
    whole = judged(table, tmp_path)
    own = [f"q_{axis}" for axis in "xyzw"]
    heads = [HeadColumns(quaternion=tuple(own))] * 3
    form = replace(BARE, head_1=heads[0], head_2=heads[1], head_3=heads[2])
    paths = []
    for k, head in enumerate((BARE.head_1, BARE.head_2, BARE.head_2)):
        paths.append(tmp_path / f"head{k + 1}.csv")
        named = dict(zip(head.quaternion, own, strict=True))
        table[["t", *head.quaternion]].rename(columns=named).to_csv(paths[-1], index=False)
    (tmp_path / "heads.toml").write_text(form.to_toml())
    assert TelemetryFormat.from_toml(tmp_path / "heads.toml").to_toml() == form.to_toml()
    for pair in ((1, 2), (1, 3)):
        report = correct_telemetry(
            paths, tmp_path / "out", columns=tmp_path / "heads.toml", heads=pair, force=True
        )
        pd.testing.assert_frame_equal(report.angle, whole.angle)
    with pytest.raises(ValueError, match="telemetry must be a file for each of 3 heads, got 1"):
        read_telemetry(paths[0], form)


def test_grace_fo_is_judged_and_other_conventions_are_refused(real_data, tmp_path, capsys):
    folder = real_data("grace-fo")
    form = tmp_path / "heads12.toml"
    form.write_text(
        'time = "t"\n[head_1]\nquaternion = ["a0", "a1", "a2", "a3"]\n'
        '[head_2]\nquaternion = ["b0", "b1", "b2", "b3"]\n'
    )
    command = ["drift", str(folder / "heads12.csv"), "--columns", str(form), "--out"]
    assert main([*command, str(tmp_path / "no")]) == 2
    assert "steadiest with scalar first, camera to inertial: 80.969 deg" in capsys.readouterr().err
    for convention in QuaternionConvention.every():
        named = f"--convention={convention.scalar},{convention.direction}"
        right = named == "--convention=first,camera_to_inertial"
        code = main([*command, str(tmp_path / named), named])
        out, err = capsys.readouterr()
        assert code == (0 if right else 2)
        if right:
            assert "angle 80.969157 deg, standard deviation 3.96 arcsec (33 angles)" in out
        else:
            assert "it is with scalar first, camera to inertial: 80.969 deg" in err


def test_every_pair_of_three_heads_is_judged_in_one_run(table, tmp_path):
    turn = Rotation.from_euler("y", 30.0, degrees=True)
    third = (Rotation.from_quat(table[list(BARE.head_2.quaternion)]) * turn).as_quat()
    names = [f"q3_{axis}" for axis in "xyzw"]
    form = replace(BARE, head_3=HeadColumns(quaternion=tuple(names)))
    report = judged(table.assign(**dict(zip(names, third.T, strict=True))), tmp_path, form)
    pairs = (report, *report.others)
    assert [each.heads for each in pairs] == [(1, 2), (1, 3), (2, 3)]
    assert pairs[2].zero_deg == pytest.approx(30.0, abs=1e-6)
    for each in pairs:
        alone = judged(
            table.assign(**dict(zip(names, third.T, strict=True))), tmp_path, form, heads=each.heads
        )
        pd.testing.assert_frame_equal(each.tracks, alone.tracks)
        assert alone.others == ()
    text = judged(table.assign(**dict(zip(names, third.T, strict=True))), tmp_path, form).summary()
    assert [line for line in text.splitlines() if line.startswith("Heads")] == [
        "Heads 1 and 2:",
        "Heads 1 and 3:",
        "Heads 2 and 3:",
    ]
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written >= {
        *(f"{pair}-angle.{kind}" for pair in ("1-2", "1-3", "2-3") for kind in ("csv", "png")),
        *("tracks.csv", "report.txt", "report.html", "report.json"),
    }
    tracks = pd.read_csv(tmp_path / "out" / "tracks.csv")
    assert tracks["heads"].tolist() == ["1-2", "1-3", "2-3"]
    with pytest.raises(ValueError, match="heads must be among the 2 described, got 3"):
        judged(table, tmp_path, heads=(1, 3))


def test_the_page_answers_what_is_asked_after_a_run(table, tmp_path):
    judged(table, tmp_path)
    page = (tmp_path / "out" / "report.html").read_text()
    for said in ("Did it work?", "67.62", "camera to inertial", "telemetry.csv", "A design angle"):
        assert said in page
    assert "<b>Angle between the heads</b>" in page
    assert "By the convention named the angle scatters by" in page
    assert "the mean is known to ± " in page


GRACE = """header:
  dimensions:
    num_records: 40
  global_attributes:
    summary: "a word with an open quote
    conventions: CF-1.6
{}# End of YAML header
"""
IN_TURN = """time = 1
time_fraction = [2, 1e-6]
scalar = "last"
direction = "camera_to_inertial"
[head_1]
quaternion = [4, 5, 6, 7]
rows = [3, 1]
[head_2]
quaternion = [4, 5, 6, 7]
rows = [3, 2]
"""


@pytest.mark.parametrize("described", [None, 0, 300])
def test_rows_in_turn_without_a_header_are_told_by_their_number(table, tmp_path, described):
    """As level-1A star-camera files of GRACE-FO are laid out."""
    whole = judged(table[:400], tmp_path)
    text = "" if described is None else GRACE.format("    more: 1\n" * described)
    for _, row in table[:400].iterrows():
        seconds, fraction = divmod(row["t"], 1.0)
        for head, columns in ((1, NAMES[:4]), (2, NAMES[4:])):
            numbers = " ".join(f"{row[name]:.16g}" for name in columns)
            text += f"{seconds:.0f} {1e6 * fraction:.0f} {head} {numbers}\n"
    (tmp_path / "sca.txt").write_text(text)
    (tmp_path / "sca.toml").write_text(IN_TURN)
    options = {} if described is not None else {"delimiter": "space"}
    report = correct_telemetry(tmp_path / "sca.txt", tmp_path / "turn", **options)
    np.testing.assert_allclose(
        report.angle["before_arcsec"], whole.angle["before_arcsec"], rtol=0, atol=1e-6
    )
    assert len(report.angle) == 400
    (tmp_path / "sca.toml").write_text(IN_TURN.replace("rows = [3, 2]", "rows = [3, 4]"))
    with pytest.raises(
        ValueError, match="column '3' never holds 4, which tells the rows of head 2"
    ):
        correct_telemetry(tmp_path / "sca.txt", tmp_path / "none", **options)
    (tmp_path / "sca.toml").write_text(IN_TURN.replace("rows = [3, 2]", "rows = [3, 1]"))
    with pytest.raises(ValueError, match="all heads must have rows of their own, or none"):
        correct_telemetry(tmp_path / "sca.txt", tmp_path / "none", **options)


STEPS = ["_write", "_sync", "_settle", "rename"]


@pytest.mark.parametrize("kept", [0, 3, 6])
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_drift_that_is_ended_leaves_the_old_report_or_the_new_one(
    table, tmp_path, monkeypatch, step, kept
):
    judged(table[:200], tmp_path)
    before = json.loads((tmp_path / "out" / "report.json").read_text())["files"]
    owner = Path if step == "rename" else outputs
    whole, calls = getattr(owner, step), iter(range(100))

    def ends(*args):
        if next(calls) == kept:
            os._exit(9)
        return whole(*args)

    with monkeypatch.context() as patch:
        patch.setattr(owner, step, ends)
        process = multiprocessing.get_context("fork").Process(
            target=judged, args=(table[:200], tmp_path), kwargs={"window": 7}
        )
        process.start()
        process.join()
    with outputs.claim(tmp_path / "out", force=True):
        pass
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    for name, sha256 in report["files"].items():
        content = (tmp_path / "out" / name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == sha256
    if process.exitcode == 9 and step == "_write":
        assert report["files"] == before
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_telemetry_is_never_written_over(table, tmp_path):
    table.to_csv(tmp_path / "telemetry.csv", index=False)
    (tmp_path / "telemetry.toml").write_text(BARE.to_toml())
    given = (tmp_path / "telemetry.csv").read_bytes()
    for out in (tmp_path, tmp_path / "telemetry.csv"):
        with pytest.raises((ValueError, FileExistsError), match="choose another|must be a folder"):
            correct_telemetry(tmp_path / "telemetry.csv", out, force=True)
    assert (tmp_path / "telemetry.csv").read_bytes() == given
