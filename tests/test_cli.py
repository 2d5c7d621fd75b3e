"""The command line as a user types it: what it writes, what it says, and how it ends."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.cli import main
from losbench.resources import notebook_folder


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "twin"
    assert main(["simulate", "--out", str(folder), "--frames", "5", "--quiet"]) == 0
    return folder


def measure(twin, out, *more):
    files = ["--camera", str(twin / "camera.toml"), "--times", str(twin / "times.csv")]
    log = ["--temperature", str(twin / "temperature.csv")]
    return main(["measure", str(twin / "frames"), *files, *log, "--out", str(out), *more])


def test_simulate_then_measure(twin, tmp_path, capsys):
    assert measure(twin, tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "5 frames, 2 spots" in said
    assert "Two spots cannot tell which of them is bad." in said
    table = pd.read_csv(tmp_path / "out" / "measurement.csv")
    truth = pd.read_csv(twin / "truth.csv")
    for axis in ("alpha", "beta", "gamma"):
        pull = (table[f"{axis}_arcsec"] - truth[f"{axis}_arcsec"]) / table[f"sigma_{axis}_arcsec"]
        assert np.abs(pull).max() < 5
    assert json.loads((tmp_path / "out" / "report.json").read_text())["losbench"] == lb.__version__


def test_the_notebooks_are_copied_to_work_in_and_nothing_is_overwritten(tmp_path, capsys):
    assert main(["notebooks", str(tmp_path / "mine")]) == 0
    assert "jupyter lab" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "mine").iterdir()}
    assert names == {path.name for path in notebook_folder().glob("[0-9]*.ipynb")}
    assert main(["notebooks", str(tmp_path / "mine")]) == 2


@pytest.mark.usefixtures("undrawn")
def test_quiet_says_nothing(twin, tmp_path, capsys):
    assert measure(twin, tmp_path / "out", "--quiet") == 0
    assert capsys.readouterr().out == ""


@pytest.mark.usefixtures("undrawn")
def test_an_existing_folder_is_kept_unless_forced(twin, tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    assert measure(twin, tmp_path) == 2
    assert (
        "is not empty: choose another folder, or overwrite with --force" in capsys.readouterr().err
    )
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    assert measure(twin, tmp_path, "--force") == 0
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "measurement.csv").is_file()


def test_a_forced_simulation_leaves_no_frame_of_an_earlier_one(tmp_path):
    for n_frames in ("3", "2"):
        assert (
            main(["simulate", "--out", str(tmp_path), "--frames", n_frames, "--quiet", "--force"])
            == 0
        )
    assert len(list((tmp_path / "frames").iterdir())) == 2
    assert lb.read_recording(tmp_path / "frames", times=tmp_path / "times.csv").n_frames == 2


@pytest.mark.usefixtures("undrawn")
def test_a_pair_s_telemetry_is_simulated_and_corrected(tmp_path, capsys):
    assert main(["simulate", "--paper", "ren2023", "--out", str(tmp_path / "pair"), "--quiet"]) == 0
    telemetry = tmp_path / "pair" / "telemetry.csv"
    assert main(["drift", str(telemetry), "--out", str(tmp_path / "out")]) == 0
    assert "LSFE" in capsys.readouterr().out
    assert main(["drift", str(telemetry), "--out", str(tmp_path / "out")]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert (
        main(
            [
                "drift",
                str(telemetry),
                "--columns",
                str(tmp_path / "no.toml"),
                "--out",
                str(tmp_path / "2"),
            ]
        )
        == 2
    )
    assert "no.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--reference", "some"], "--reference must be 'first' or a whole number, got 'some'"),
        (
            ["--spots", "1;2"],
            "--spots must be X,Y pairs in pixels, e.g. \"690.3,539.1 1229.8,538.6\", got '1;2'",
        ),
        (["--column", "T1"], "--column must be STANDARD=OWN, e.g. temperature_degC=T1, got 'T1'"),
        (
            ["--column", "temperature_degC=T1"],
            "temperature.csv has no column 'T1' for temperature_degC",
        ),
        (["--window", "12"], "window must be odd"),
    ],
)
def test_a_wrong_argument_ends_with_2_and_one_line(twin, tmp_path, capsys, more, message):
    assert measure(twin, tmp_path / "out", *more) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert message in said[-1]
    assert said[-1].startswith("losbench measure: ")


def test_missing_files_are_named(tmp_path, capsys):
    assert main(["measure", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")]) == 2
    assert "no recording at" in capsys.readouterr().err
    for option, kind in (("--camera", "TOML"), ("--temperature", "CSV")):
        nowhere = tmp_path / "nowhere"
        assert (
            main(["measure", str(tmp_path), option, str(nowhere), "--out", str(tmp_path / "out")])
            == 2
        )
        assert capsys.readouterr().err == f"losbench measure: no {kind} file at {nowhere}\n"


def test_missing_times_are_named(twin, tmp_path, capsys):
    files = ["--times", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")]
    assert main(["measure", str(twin / "frames"), *files]) == 2
    assert capsys.readouterr().err == f"losbench measure: no CSV file at {tmp_path / 'nowhere'}\n"


def test_the_ledger_lists_the_claims_of_a_paper(capsys):
    assert main(["ledger", "--paper", "liu2026"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 70
    assert lines[0].startswith("irls-01      arithmetic  = 1.1 deg")
    assert main(["ledger", "--paper", "liu2025"]) == 2


def test_a_claim_that_does_not_exist_is_named(capsys):
    assert main(["claim", "irls-99"]) == 2
    said = capsys.readouterr().err
    assert said == "losbench claim: no claim 'irls-99'; ids run from irls-01 to drift-13\n"


def test_a_reader_that_goes_away_ends_the_command_quietly():
    losbench = subprocess.Popen(
        [sys.executable, "-m", "losbench.cli", "ledger"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    losbench.stdout.close()
    assert losbench.stderr.read() == b""
    losbench.stderr.close()
    assert losbench.wait() == 141


def test_version_and_help_come_without_the_heavy_packages():
    code = "import sys, losbench.cli as c\ntry: c.main(['--version'])\nexcept SystemExit: pass\n"
    code += (
        "assert not {'numpy', 'pandas', 'cv2', 'matplotlib'} & set(sys.modules), "
        "sorted(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == f"losbench {lb.__version__}"


@pytest.mark.parametrize(
    "error", [KeyError("x"), IndexError(3), TypeError("no"), AssertionError(), ZeroDivisionError()]
)
def test_a_defect_of_its_own_keeps_its_traceback(monkeypatch, error):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("losbench.workbench.ledger.ledger.Ledger.collect", fail)
    with pytest.raises(type(error)):
        main(["ledger"])


def test_so_does_an_error_of_value_that_no_check_raised(monkeypatch):
    broken = (np.ones(2), np.ones(3))
    monkeypatch.setattr(
        "losbench.workbench.ledger.ledger.Ledger.collect", lambda **_: np.add(*broken)
    )
    with pytest.raises(ValueError, match="operands could not be broadcast"):
        main(["ledger"])


def test_debug_shows_where_an_error_comes_from(tmp_path, capsys):
    nowhere = ["measure", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")]
    assert main(nowhere) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    with pytest.raises(FileNotFoundError, match="no recording at"):
        main([*nowhere, "--debug"])
