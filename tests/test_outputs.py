"""Folders of results: whole after every end of a run, and the user's own files left alone."""

import errno
import hashlib
import json
import multiprocessing
import os
import resource
import signal
from pathlib import Path

import pytest

import losbench.outputs as module
from losbench.outputs import claim, locked

pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
OLD = {"table.csv": "old\n", "pictures/a.png": "old"}
NEW = {"table.csv": "new\n", "more.txt": "new"}


def run(out, files, **options):
    with claim(out, writes=files, force=True, **options) as results:
        for name, content in files.items():
            results.write(name, content)
        results.publish({"losbench": "test"})


class Broken:
    """A picture that cannot be drawn."""

    def encode(self):
        raise KeyError("frame 199")


def held(out):
    found = {p.relative_to(out).as_posix(): p.read_text() for p in out.rglob("*") if p.is_file()}
    report = json.loads(found.pop("report.json"))
    for name, sha256 in report["files"].items():
        assert hashlib.sha256(found[name].encode()).hexdigest() == sha256
    return found


def test_results_replace_results_and_leave_what_is_the_user_s(tmp_path):
    out = tmp_path / "out"
    run(out, OLD)
    assert held(out) == OLD
    (out / "pictures" / "mine.txt").write_text("mine")
    run(out, NEW)
    assert held(out) == NEW | {"pictures/mine.txt": "mine"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_full_folder_is_kept_unless_forced_and_a_file_of_the_user_s_even_then(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "table.csv").write_text("mine")
    message = "is not empty: choose another folder, or overwrite"
    with pytest.raises(FileExistsError, match=message), claim(out):
        pass
    with pytest.raises(FileExistsError, match="holds table.csv, which no earlier run"):
        run(out, NEW)
    assert [path.name for path in out.iterdir()] == ["table.csv"]
    with pytest.raises(FileExistsError, match="must be a folder, but is a file"):
        run(out / "table.csv", NEW)


def test_inputs_are_never_overwritten(tmp_path):
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "a.tif").write_text("frame")
    for given, out in (
        ("frames/a.tif", "frames"),
        ("frames", "frames"),
        ("frames", "."),
        ("frames", "frames/out"),
        ("frames/a.tif", "frames/../frames"),
    ):
        with pytest.raises(ValueError, match="choose another"):
            run(tmp_path / out, NEW, inputs=[tmp_path / given])
    run(tmp_path / "out", NEW, inputs=[tmp_path / "frames"])
    assert (tmp_path / "frames" / "a.tif").read_text() == "frame"


def test_a_run_that_fails_leaves_all_as_it_was(tmp_path):
    out = tmp_path / "out"
    for before in ({}, OLD):
        if before:
            run(out, before)
        with pytest.raises(KeyError, match="frame 199"):
            run(out, {"table.csv": "half", "more.txt": Broken()})
        assert (held(out) if before else out.exists()) == (before or False)
        assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


STEPS = [("_write", k) for k in range(4)] + [("_sync", 0), ("_sync", 1)]
STEPS += [("rename", 0), ("rename", 1), ("_settle", 1)]


def fails_at(monkeypatch, step, count, failure):
    """Let the call of that number of a step of writing end otherwise."""
    owner, name = (Path, "rename") if step == "rename" else (module, step)
    whole, calls = getattr(owner, name), iter(range(100))

    def patched(*args):
        if next(calls) == count:
            failure()
        return whole(*args)

    monkeypatch.setattr(owner, name, patched)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EACCES], ids=["full", "no right"])
@pytest.mark.parametrize(("step", "count"), STEPS)
def test_a_write_that_fails_leaves_the_old_results_or_the_new_ones(
    tmp_path, monkeypatch, step, count, code
):
    out = tmp_path / "out"
    run(out, OLD)

    def failure():
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as patch:
        fails_at(patch, step, count, failure)
        with pytest.raises(OSError, match=f"{os.strerror(code)}") as said:
            run(out, NEW)
    before = step in ("_write", "rename") or (step, count) == ("_sync", 0)
    if before:
        assert str(out) in str(said.value)
        assert held(out) == OLD
    run(tmp_path / "other", NEW)
    with claim(out, force=True):
        pass
    assert held(out) == (OLD if before else NEW)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "out"]


@pytest.mark.parametrize(("step", "count"), STEPS)
def test_a_process_that_ends_leaves_the_old_results_or_the_new_ones(
    tmp_path, monkeypatch, step, count
):
    out = tmp_path / "out"
    run(out, OLD)
    (out / "mine.txt").write_text("mine")
    with monkeypatch.context() as patch:
        fails_at(patch, step, count, lambda: os._exit(9))
        process = multiprocessing.get_context("fork").Process(target=run, args=(out, NEW))
        process.start()
        process.join()
    assert process.exitcode == 9
    with claim(out, force=True):
        pass
    after = step in ("_settle",) or (step, count) == ("_sync", 1)
    assert held(out) == (NEW if after else OLD) | {"mine.txt": "mine"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_full_disk_names_file_and_folder(tmp_path):
    """A limit on the size of files is the nearest to a full disk that a test can have."""
    out = tmp_path / "out"
    run(out, OLD)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(OSError, match="while writing .*out/big.bin; .*out is as it was"):
            run(out, {"table.csv": "x", "big.bin": "x" * 10_000})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert held(out) == OLD


def test_a_folder_without_the_right_to_write_is_told_before_the_work_begins(tmp_path):
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OSError, match="cannot write to .*out"):
            run(tmp_path / "out", NEW)
    finally:
        tmp_path.chmod(0o700)


def _runs(out, content, barrier):
    barrier.wait()
    try:
        run(out, {"table.csv": content, "other.csv": content})
    except BlockingIOError:
        os._exit(3)


def test_of_three_runs_at_once_one_is_whole(tmp_path):
    context = multiprocessing.get_context("fork")
    for _ in range(5):
        barrier = context.Barrier(3)
        args = [(tmp_path / "out", str(k), barrier) for k in range(3)]
        processes = [context.Process(target=_runs, args=each) for each in args]
        for process in processes:
            process.start()
        for process in processes:
            process.join()
        codes = [process.exitcode for process in processes]
        assert set(codes) <= {0, 3} and 0 in codes
        found = held(tmp_path / "out")
        assert found["table.csv"] == found["other.csv"]
        assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_lock_is_held_and_goes(tmp_path):
    with (
        locked(tmp_path / "out"),
        pytest.raises(BlockingIOError, match="another run is writing to out"),
    ):
        run(tmp_path / "out", NEW)
    run(tmp_path / "out", NEW)


@pytest.mark.skipif(os.name != "posix", reason="links as POSIX has them")
def test_results_behind_a_link_are_replaced_where_they_lie(tmp_path):
    folder, link = tmp_path / "disk" / "results", tmp_path / "out"
    link.symlink_to(folder)
    for k in range(2):
        with claim(link, force=k == 1) as results:
            results.write("table.csv", f"{k}\n")
            results.publish({})
    assert link.is_symlink() and (folder / "table.csv").read_text() == "1\n"
    assert [path.name for path in folder.parent.iterdir()] == ["results"]
    (tmp_path / "given").symlink_to(folder / "table.csv")
    with (
        pytest.raises(ValueError, match="lies in the folder to write to"),
        claim(link, inputs=[tmp_path / "given"], force=True),
    ):
        pass
