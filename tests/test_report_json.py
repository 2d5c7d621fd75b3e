"""report.json keeps its schema, says its units, and is printed alone where it is asked for."""

import json
from importlib.resources import files

import jsonschema
import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.cli import main
from losbench.papers.ren2023.export import write_telemetry
from losbench.papers.ren2023.scenario import Pair

SCHEMA = json.loads(files("losbench").joinpath("report.schema.json").read_text("utf-8"))
UNITS = ("_px", "_arcsec", "_deg", "_degC", "_s", "_bytes", "_per_degC", "_mm", "_um", "_hz")
WITHOUT = {
    *("version", "frames", "spot", "frames_measured", "frames_flagged", "frames_with_a_reading"),
    *("scatter_over_predicted", "its_sampling_error", "slope_between_centroids", "its_error"),
    *("p_value_median", "p_value_below_0.05", "one_lag_p_value", "white_p_value"),
    *("samples", "samples_with_an_angle", "track", "missing", "heads", "set_aside"),
    *("windows", "dropped", "n_files"),
}


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    """A recording that is drifting with its temperature, and telemetry with spots."""
    folder = tmp_path_factory.mktemp("runs")
    camera = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(60, 150))
    drift = np.linspace(0.0, 1.5, 24)[:, None, None] * [1.0, 0.5]
    light = lb.render_spots(np.array([[40.0, 30.0], [110.0, 32.0]]) + drift, 2e5, 2.0, camera.shape)
    detector = lb.Detector(gain_e_per_dn=4.0, read_noise_e=5.0, offset_dn=100.0)
    np.save(folder / "frames.npy", detector.expose(light + 40.0, 8))
    (folder / "camera.toml").write_text(
        "focal_mm = 260.0\npixel_um = 10.0\nshape = [60, 150]\n[detector]\ngain_e_per_dn = 4.0\n"
        "read_noise_e = 5.0\noffset_dn = 100.0\n"
    )
    time_s = 5.0 * np.arange(24)
    pd.DataFrame({"time_s": time_s, "temperature_T_$1$_<b>_degC": 18.0 + time_s / 40.0}).to_csv(
        folder / "log.csv", index=False
    )
    pair = write_telemetry(folder / "pair", seed=3, setting=Pair(days=(0.0, 58.0), track_s=20.0))
    frames, log = str(folder / "frames.npy"), str(folder / "log.csv")
    camera_file = str(folder / "camera.toml")
    return {
        "measurement": [
            *("measure", frames, "--camera", camera_file, "--period-s", "5", "--temperature", log),
        ],
        "telemetry": ["drift", str(pair / "telemetry.csv")],
    }


def numbers(value, name="", path=""):
    """Every number of a report, with the name that it stands under."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if path not in (".made.settings", ".belief.flags"):
                yield from numbers(inner, key, f"{path}.{key}")
    elif isinstance(value, list):
        for inner in value:
            yield from numbers(inner, name, path)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield name, path


@pytest.mark.parametrize("kind", ["measurement", "telemetry"])
def test_a_report_keeps_its_schema_and_says_its_units(commands, kind, tmp_path, capsys):
    assert main([*commands[kind], "--out", str(tmp_path / "out"), "--json"]) == 0
    said = capsys.readouterr()
    assert said.out == (tmp_path / "out" / "report.json").read_text()
    report = json.loads(said.out, parse_constant=pytest.fail)
    jsonschema.validate(report, SCHEMA)
    assert report["kind"] == kind and report["losbench"] == lb.__version__
    bare = {p for name, p in numbers(report) if not name.endswith(UNITS) and name not in WITHOUT}
    assert bare == set()
    assert "Written to" in said.err or "LSFE" in said.err
    page = (tmp_path / "out" / "report.html").read_text()
    assert all(answer["question"] in page for answer in report["answers"])
    assert "<b>_" not in page
    assert kind == "telemetry" or "T_$1$_&lt;b&gt;" in page


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("kind", ["measurement", "telemetry"])
def test_the_schema_refuses_a_report_that_lacks_what_it_promises(commands, kind, tmp_path):
    assert main([*commands[kind], "--out", str(tmp_path / "out"), "--quiet"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    for name in SCHEMA["$defs"][kind]["required"]:
        lacking = {key: value for key, value in report.items() if key != name}
        with pytest.raises(jsonschema.ValidationError, match=name):
            jsonschema.validate(lacking, SCHEMA)


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.usefixtures("undrawn")
def test_quiet_json_prints_the_report_alone(commands, tmp_path, capsys):
    command = [*commands["telemetry"], "--out", str(tmp_path / "out"), "--json", "--quiet"]
    assert main(command) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["kind"] == "telemetry" and said.err == ""


@pytest.mark.parametrize("paper", ["liu2026", "ren2023"])
def test_a_simulation_keeps_the_schema_too(paper, tmp_path):
    out = tmp_path / "twin"
    command = ["simulate", "--paper", paper, "--frames", "2", "--seed", "5", "--out", str(out)]
    assert main([*command, "--quiet"]) == 0
    report = json.loads((out / "report.json").read_text(), parse_constant=pytest.fail)
    jsonschema.validate(report, SCHEMA)
    assert (report["kind"], report["twin"], report["seed"]) == ("simulation", paper, 5)
    assert report["made"]["command"] == " ".join(["losbench", *command, "--quiet"])
