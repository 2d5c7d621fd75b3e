"""Whatever ends a command while it writes, its folder holds the old report or the new one, whole by
its own list of sums.
"""

import errno
import hashlib
import json
import multiprocessing
import os
import resource
import shutil
import signal
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import losbench as lb
import losbench.outputs as outputs
from losbench.cli import main
from losbench.outputs import claim
from losbench.papers.ren2023.export import write_telemetry
from losbench.papers.ren2023.scenario import Pair
from losbench.resources import data_file

pytestmark = [
    pytest.mark.usefixtures("undrawn"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
]
MOVES = [(Path, "rename"), (Path, "mkdir"), (shutil, "rmtree")]
STEPS = [(outputs, "_write"), (os, "fsync"), *MOVES]
COMMANDS = ["measure", "drift"]


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """No two reports are of the same second, and so of the same sum."""
    seconds = count()
    monkeypatch.setattr("losbench.made._utc", lambda _: f"second {next(seconds)}")


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """What each command reads: three frames of one spot; ten seconds of two heads."""
    folder = tmp_path_factory.mktemp("given")
    light = lb.render_spots(np.array([[[20.0 + k, 15.0]] for k in range(3)]), 2e5, 2.0, (32, 48))
    np.save(folder / "frames.npy", lb.Detector(offset_dn=100.0).expose(light / 4.0 + 40.0, 8))
    pair = write_telemetry(folder / "pair", seed=3, setting=Pair(days=(0.0,), track_s=10.0))
    spots = ("spot", "reference", "focal")
    lines = (pair / "telemetry.toml").read_text().splitlines()
    bare = "\n".join(line for line in lines if not line.startswith(spots))
    (folder / "bare.toml").write_text(bare)
    return {
        "measure": ["measure", str(folder / "frames.npy"), "--quiet"],
        "drift": [
            *("drift", str(pair / "telemetry.csv"), "--quiet"),
            *("--columns", str(folder / "bare.toml")),
        ],
    }


@pytest.fixture
def old(given, tmp_path, request):
    """A command, the folder that holds its first report and a file of the user's, and its sum."""
    command = given[request.param]
    out = tmp_path / "run" / "out"
    assert main([*command, "--out", str(out)]) == 0
    (out / "mine.txt").write_text("mine")
    return [*command, "--out", str(out), "--force"], out, whole(out)


def whole(out):
    """The sum of a folder's report, which lists what is beside it and nothing else."""
    text = (out / "report.json").read_bytes()
    listed = json.loads(text)["files"]
    found = {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()}
    assert found.pop("mine.txt", b"mine") == b"mine"
    found.pop("report.json")
    assert {name: hashlib.sha256(data).hexdigest() for name, data in found.items()} == listed
    return hashlib.sha256(text).hexdigest()


def at_every_step(patch, act, steps=STEPS):
    """Let ``act`` be called before each step of writing, with its number and what it is done to."""
    number = count()

    def watched(whole_step):
        def step(*args, **options):
            if not options.get("ignore_errors"):
                act(next(number), args[0])
            return whole_step(*args, **options)

        return step

    for owner, name in steps:
        patch.setattr(owner, name, watched(getattr(owner, name)))


def settled(folder):
    """The sum of the report that the next run finds, which leaves only what may be resumed."""
    with claim(folder / "out", force=True):
        pass
    assert {path.name for path in folder.iterdir()} <= {"out", ".out.parts", "..out.parts.lock"}
    assert (folder / "out" / "mine.txt").read_text() == "mine"
    return whole(folder / "out")


@pytest.mark.parametrize("old", COMMANDS, indirect=True)
def test_a_command_that_is_ended_at_a_step_leaves_the_old_report_or_the_new_one(
    old, tmp_path, monkeypatch
):
    """What a process leaves that ends before a step is what lies on the disk before that step."""
    command, out, before = old
    left = []
    with monkeypatch.context() as patch:

        def keep(k, _):
            left.append(shutil.copytree(out.parent, tmp_path / f"left-{k}"))

        at_every_step(patch, keep)
        assert main(command) == 0
    after = whole(out)
    found = [settled(folder) for folder in left]
    assert len(left) > 20 and after != before
    assert set(found) == {before, after} and found == sorted(found, key=[before, after].index)


@pytest.mark.parametrize("old", ["measure"], indirect=True)
@pytest.mark.parametrize("step", [(Path, "rename"), (outputs, "_settle")], ids=["early", "late"])
def test_a_process_that_measures_and_ends_is_put_right_by_the_next(old, monkeypatch, step):
    """Between the two renames, where no folder is there at all; and with the new one in place."""
    command, out, before = old

    def end(k, _):
        if k == 1:
            os._exit(9)

    with monkeypatch.context() as patch:
        at_every_step(patch, end, [step])
        process = multiprocessing.get_context("fork").Process(target=main, args=(command,))
        process.start()
        process.join()
    assert process.exitcode == 9 and out.exists() is (step[0] is outputs)
    assert (settled(out.parent) == before) is (step[0] is Path)
    assert main(command) == 0
    assert whole(out) != before and os.listdir(out.parent) == ["out"]


@pytest.mark.parametrize(
    ("code", "steps"),
    [(errno.ENOSPC, [(os, "fsync"), *MOVES]), (errno.EACCES, [(outputs, "_write"), *MOVES])],
    ids=["full", "no right"],
)
@pytest.mark.parametrize("old", COMMANDS, indirect=True)
def test_a_command_whose_write_fails_says_where_and_leaves_a_whole_report(
    old, monkeypatch, capsys, code, steps
):
    command, out, before = old
    ends, failed = [], []
    while len(failed) == len(ends):

        def fail(k, what):
            if k == len(ends):
                failed.append(what)
                name = str(what) if isinstance(what, Path) else None
                raise OSError(code, os.strerror(code), name)

        with monkeypatch.context() as patch:
            at_every_step(patch, fail, steps)
            ends.append(main(command))
        said, found = capsys.readouterr().err, whole(out)
        if ends[-1] == 2:
            assert os.strerror(code) in said and str(out.parent) in said
            assert found == before or f"{out} holds the new ones" in said
        before = found
    assert ends[-1] == 0 and ends.count(2) > 8


@pytest.mark.parametrize("old", COMMANDS, indirect=True)
def test_a_full_disk_is_told_with_file_and_folder(old, capsys):
    """A limit on the size of files is the nearest to a full disk that a test can have."""
    command, out, before = old
    size = (out / "report.html").stat().st_size
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, limits[1]))
    try:
        assert main(command) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    said = capsys.readouterr().err
    assert f"while writing {out / 'report.html'}; {out} is as it was" in said
    assert whole(out) == before


def _ends(command, barrier):
    barrier.wait()
    os._exit(main(command))


@pytest.mark.parametrize("old", ["measure"], indirect=True)
def test_of_three_commands_at_once_one_writes_a_whole_report(old):
    command, out, before = old
    context = multiprocessing.get_context("fork")
    barrier = context.Barrier(3)
    runs = [
        context.Process(target=_ends, args=([*command, "--chunk", str(k)], barrier))
        for k in (1, 2, 3)
    ]
    for run in runs:
        run.start()
    for run in runs:
        run.join()
    ended = [run.exitcode for run in runs]
    assert 0 in ended and set(ended) <= {0, 2}
    after = whole(out)
    chunk = json.loads((out / "report.json").read_text())["made"]["settings"]["chunk"]
    assert after != before and ended[chunk - 1] == 0
    assert os.listdir(out.parent) == ["out"]


@pytest.mark.parametrize("name", [*COMMANDS, "simulate"])
def test_what_a_command_reads_is_never_what_it_writes(given, name, tmp_path, capsys):
    model = tmp_path / "in" / "camera.toml"
    command = given.get(
        name, ["simulate", "--quiet", "--frames", "2", "--camera-model", str(model)]
    )
    source = Path(command[1]).parent if name in given else data_file("three-mirror-camera.toml")
    if name in given:
        shutil.copytree(source, tmp_path / "in")
        command = [word.replace(str(source), str(tmp_path / "in")) for word in command]
    else:
        model.parent.mkdir()
        shutil.copy(source, model)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    for out in (tmp_path / "in", tmp_path):
        assert main([*command, "--out", str(out), "--force"]) == 2
        assert "lies in the folder to write to" in capsys.readouterr().err
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
