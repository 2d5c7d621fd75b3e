"""One table whoever measures it, however it is split, killed and resumed."""

import hashlib
import json
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest

import losbench as lb
from losbench import parts as parts_module
from losbench.cli import main
from losbench.recording.work import Job

SHAPE, N, JUMP, LOST = (64, 120), 150, 70, slice(100, 110)
DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


@pytest.fixture(scope="module")
def frames():
    """Two spots that drift, jump by 4 pixels, and of which one is lost for ten frames."""
    path = np.array([[30.0, 30.0], [90.0, 33.0]]) + np.linspace(0, 6, N)[:, None, None]
    path[JUMP:, :, 0] += 4.0
    light = np.full((N, 2), 1e5)
    light[LOST, 1] = 0.0
    electrons = [
        lb.render_spots(xy, f, 2.0, SHAPE) + 40.0 for xy, f in zip(path, light, strict=True)
    ]
    return DETECTOR.expose(np.stack(electrons), 3)


@pytest.fixture(scope="module")
def stack(frames, tmp_path_factory):
    path = tmp_path_factory.mktemp("frames") / "stack.npy"
    np.save(path, frames)
    return path


def sha(measured):
    table = measured.table.to_csv(float_format="%.17g").encode()
    return hashlib.sha256(table + repr(measured.notes).encode()).hexdigest()


def measured(stack, **run):
    recording = lb.read_recording(stack, detector=DETECTOR)
    return lb.measure(recording, spots=[[30, 30], [90, 33]], run=lb.Run(**run))


@pytest.fixture(scope="module")
def alone(stack):
    found = measured(stack)
    lost = np.isnan(found.xy_px).any(axis=(1, 2))
    assert np.flatnonzero(lost).tolist() == list(range(N))[LOST]
    assert np.abs(np.diff(found.xy_px[JUMP - 1 : JUMP + 1, 0, 0])) > 3.5
    return sha(found)


@pytest.mark.parametrize("chunk", [1, 32, 64, 400])
def test_the_table_does_not_know_its_chunks(stack, alone, chunk):
    assert sha(measured(stack, chunk=chunk)) == alone


def test_the_table_does_not_know_threads(stack, alone):
    with ThreadPoolExecutor(2) as executor:
        assert sha(measured(stack, executor=executor, chunk=32)) == alone


def test_the_table_does_not_know_processes(stack, alone, tmp_path):
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as executor:
        assert sha(measured(stack, executor=executor, chunk=32, out=tmp_path / "out")) == alone
    assert len(list((tmp_path / "out").glob("part-*.npz"))) == 5


def test_a_shape_is_made_once_and_holds_for_all_chunks(stack, tmp_path):
    recording, out = lb.read_recording(stack, detector=DETECTOR), tmp_path / "out"

    def run(method, **options):
        spots = [[30, 30], [90, 33]]
        return lb.measure(recording, spots=spots, centroid=method, run=lb.Run(**options))

    whole = run(lb.Empirical(), chunk=400)
    method = whole.surveys[0].method
    assert [shape.frames for shape in method.shape] == [64, 60]
    expected = sha(whole)
    assert sha(run("empirical", chunk=32, out=out)) == expected
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as executor:
        assert sha(run(method, executor=executor, chunk=64)) == expected
    assert sha(run(lb.Empirical(), chunk=32, out=out, resume=True)) == expected
    made = rf"shape was \(<SpotShape {method.shape[0].digest}, .*, is \(<SpotShape "
    with pytest.raises(ValueError, match=made):
        run(lb.Empirical(window=17), chunk=32, out=out, resume=True)


@pytest.mark.slow
def test_the_table_does_not_know_a_cluster_one_of_whose_workers_is_killed(stack, alone):
    distributed = pytest.importorskip(
        "distributed", reason="distributed is missing: pip install losbench[cluster]"
    )
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    )
    with cluster, distributed.Client(cluster) as client:
        victim = next(iter(client.run(os.getpid).values()))
        executor = client.get_executor()
        executor.submit(os.kill, victim, 0).result()
        os.kill(victim, signal.SIGKILL)
        assert sha(measured(stack, executor=executor, chunk=32)) == alone


def test_what_is_sent_to_workers_holds_no_times_and_measures_the_same(stack):
    clock = lb.FrameTimes(np.arange(float(N)))
    recording = lb.read_recording(stack, detector=DETECTOR, times=clock)
    surveys = lb.measure(recording, spots=[[30, 30], [90, 33]]).surveys
    job = Job(recording, surveys, lb.Ring())
    sent = job.for_workers()
    assert sent.recording.times is None and job.recording.times is clock
    assert len(pickle.dumps(sent)) < len(pickle.dumps(job)) - 8 * N
    some, same = job(60, 80), pickle.loads(pickle.dumps(sent))(60, 80)
    for name in ("xy", "sigma", "flags"):
        np.testing.assert_array_equal(getattr(same, name), getattr(some, name))


def test_a_run_goes_on_with_the_parts_that_stand_whole(stack, alone, tmp_path):
    out = tmp_path / "out"
    measured(stack, out=out, chunk=32)
    parts = sorted(out.glob("part-*.npz"))
    flipped = bytearray(parts[1].read_bytes())
    flipped[200:210] = bytes(255 - b for b in flipped[200:210])
    parts[1].write_bytes(flipped)
    parts[2].write_bytes(parts[2].read_bytes()[:-30])
    parts[4].unlink()
    (out / ".losbench-draft-of-a-killed-run").write_bytes(b"half a part")
    before = {path.name: path.stat().st_mtime_ns for path in out.glob("part-*.npz")}
    assert sha(measured(stack, out=out, chunk=32, resume=True)) == alone
    after = {path.name: path.stat().st_mtime_ns for path in out.glob("part-*.npz")}
    assert [k for k, name in enumerate(sorted(after)) if after[name] != before.get(name)] == [
        1,
        2,
        4,
    ]
    assert not list(out.glob(".losbench-draft*"))


def test_parts_of_another_run_are_refused_by_what_has_changed(stack, tmp_path):
    recording = lb.read_recording(stack, detector=DETECTOR)

    def run(side, given=recording, **options):
        chosen = {"resume": True, "out": tmp_path / "out"} | options
        lb.measure(given, spots=[[30, 30], [90, 33]], centroid=lb.EIWA(side), run=lb.Run(**chosen))

    run(13)
    with pytest.raises(
        ValueError, match="holds parts of another run: window was 13, is 15; survey"
    ):
        run(15)
    with pytest.raises(ValueError, match=r"chunk was \d+, is 128$"):
        run(13, chunk=128)
    with pytest.raises(ValueError, match=r"detector was Detector\(.*, is None"):
        run(13, lb.read_recording(stack))
    with pytest.raises(ValueError, match=r"pixels was \w+, is \w+"):
        run(13, lb.read_recording(stack, detector=DETECTOR, dark=np.ones(SHAPE)))
    with pytest.raises(FileExistsError, match="out holds a run: resume it"):
        run(13, resume=False)
    os.utime(stack, (1, 1))
    with pytest.raises(ValueError, match="files was 1 of .* bytes, changed"):
        run(13)


def test_a_second_run_a_full_disk_and_a_foreign_folder_are_refused(stack, tmp_path, monkeypatch):
    out = tmp_path / "out"
    with (
        parts_module.kept_parts(out, {}),
        pytest.raises(BlockingIOError, match="another run is writing to out"),
    ):
        measured(stack, out=out, resume=True)
    real = os.replace

    def full(source, target):
        if str(target).endswith("part-000000064.npz"):
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr(parts_module.os, "replace", full)
    with pytest.raises(
        OSError, match="No space left on device .while writing .*part-000000064.npz"
    ):
        measured(stack, out=tmp_path / "full", chunk=32)
    assert len(list((tmp_path / "full").glob("part-*.npz"))) == 2
    with pytest.raises(FileExistsError, match="is not empty, and holds no run"):
        measured(stack, out=stack.parent)
    with pytest.raises(ValueError, match="resume needs out"):
        measured(stack, resume=True)


def test_a_frame_that_vanishes_is_named_by_whoever_meets_it(frames, tmp_path):
    import cv2

    for k, frame in enumerate(frames[:80]):
        cv2.imwrite(str(tmp_path / f"{k:03d}.png"), frame)
    recording = lb.read_recording(tmp_path, detector=DETECTOR)
    with ThreadPoolExecutor(1) as executor:
        executor.submit = at_first(executor.submit, (tmp_path / "070.png").unlink)
        with pytest.raises(lb.UnreadableFrame, match=r"^070.png cannot be read: ") as told:
            lb.measure(recording, run=lb.Run(executor=executor, chunk=32))
    assert told.value.__notes__ == ["in frames 64 to 79"]


def at_first(call, before):
    pending = [before]

    def wrapped(*job):
        while pending:
            pending.pop()()
        return call(*job)

    return wrapped


@contextmanager
def running(*arguments, cwd):
    process = subprocess.Popen(
        [sys.executable, "-m", "losbench.cli", *arguments],
        cwd=cwd,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills a process as POSIX does")
def test_the_command_line_goes_on_after_a_kill_with_the_same_table(stack, tmp_path, capsys):
    asked = ["measure", str(stack), "--spots", "30,30 90,33", "--chunk", "32"]
    assert main([*asked, "--quiet", "--out", str(tmp_path / "whole")]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["whole"]
    with pytest.raises(SystemExit):
        main([*asked, "--out", "x", "--workers", "2", "--scheduler", "tcp://x"])
    with running(*asked, "--out", "out", cwd=tmp_path) as process:
        parts, end = tmp_path / ".out.parts", time.monotonic() + 60
        while not list(parts.glob("part-*.npz")) and process.poll() is None:
            assert time.monotonic() < end
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        process.wait()
    capsys.readouterr()
    out = str(tmp_path / "out")
    if parts.exists():  # the kill came before the end
        assert main([*asked, "--quiet", "--out", out, "--resume", "--window", "9"]) == 2
        said = capsys.readouterr().err
        assert "parts of another run: " in said and "window was 13, is 9" in said
        assert main([*asked, "--quiet", "--out", out, "--resume"]) == 0
    tables = [(tmp_path / name / "measurement.csv").read_bytes() for name in ("whole", "out")]
    assert tables[0] == tables[1]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out", "whole"]
    assert main([*asked, "--quiet", "--out", out, "--force", "--resume"]) == 2
    assert f"--resume: no run into {out} was cut off" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_line_spreads_over_processes_and_says_where_it_fails(frames, tmp_path, capfd):
    import cv2

    folder = tmp_path / "frames"
    folder.mkdir()
    for k, frame in enumerate(frames[:100]):
        cv2.imwrite(str(folder / f"{k:03d}.png"), frame)
    asked = ["measure", str(folder), "--spots", "30,30 90,33", "--chunk", "32", "--quiet"]
    for name, more in [("one", []), ("two", ["--workers", "2"])]:
        assert main([*asked, "--out", str(tmp_path / name), *more]) == 0
    one, two = ((tmp_path / name / "measurement.csv").read_bytes() for name in ("one", "two"))
    assert one == two
    capfd.readouterr()
    (folder / "050.png").write_bytes((folder / "050.png").read_bytes()[:-20])
    assert main([*asked, "--out", str(tmp_path / "bad"), "--workers", "2"]) == 2
    said = capfd.readouterr().err.strip()
    assert said.startswith("losbench measure: 050.png cannot be read: not an image, or cut short")
    assert said.count("\n") == 0


def test_the_recipe_is_kept_beside_the_parts(stack, tmp_path):
    measured(stack, out=tmp_path / "out")
    kept = json.loads((tmp_path / "out" / "run.json").read_text())
    assert (
        kept["frames"] == N and kept["source"] == "stack.npy" and kept["losbench"] == lb.__version__
    )


def test_a_part_in_the_place_of_another_is_measured_anew(stack, alone, tmp_path):
    out = tmp_path / "out"
    measured(stack, out=out, chunk=32)
    parts = sorted(out.glob("part-*.npz"))
    parts[0].write_bytes(parts[1].read_bytes())
    parts[2].unlink()
    parts[2].symlink_to("nowhere")
    assert sha(measured(stack, out=out, chunk=32, resume=True)) == alone


def test_a_run_goes_on_beside_the_frames_that_it_reads(frames, tmp_path):
    import cv2

    paths = [tmp_path / f"{k:03d}.png" for k in range(40)]
    for path, frame in zip(paths, frames, strict=False):
        cv2.imwrite(str(path), frame)
    before = sha(measured(paths, out=tmp_path / "out"))
    (tmp_path / "notes.txt").write_text("of no frame")
    assert sha(measured(paths, out=tmp_path / "out", resume=True)) == before
    assert sha(measured(str(tmp_path / "*.png"), out=tmp_path / "o")) == before
    cv2.imwrite(str(paths[35]), frames[0])
    for given, out in ((paths, "out"), (str(tmp_path / "*.png"), "o")):
        with pytest.raises(ValueError, match="files was 40 of "):
            measured(given, out=tmp_path / out, resume=True)


def test_who_stands_in_another_folder_finds_the_frames(stack, alone, tmp_path, monkeypatch):
    monkeypatch.chdir(stack.parent)
    given = (stack.name, [stack.name], "*.npy")
    recordings = [lb.read_recording(each, detector=DETECTOR) for each in given]
    monkeypatch.chdir(tmp_path)
    for recording in recordings:
        assert sha(lb.measure(recording, spots=[[30, 30], [90, 33]])) == alone


@pytest.mark.skipif(os.name != "posix", reason="links as POSIX has them")
def test_a_run_has_one_lock_by_whatever_link_it_is_reached(stack, tmp_path):
    (tmp_path / "link").symlink_to("out")
    with (
        parts_module.kept_parts(tmp_path / "out", {}),
        pytest.raises(BlockingIOError, match="another run is writing to out"),
    ):
        measured(stack, out=tmp_path / "link", resume=True)


def test_a_file_of_the_user_s_is_no_draft(stack, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".draft-letter").write_text("dear")
    with pytest.raises(FileExistsError, match="out is not empty, and holds no run"):
        measured(stack, out=tmp_path / "out")
    assert (tmp_path / "out" / ".draft-letter").read_text() == "dear"


@pytest.mark.parametrize("text", ["", "null", "3", "[" * 100_000, '{"source": "s', "\udcff"])
def test_a_damaged_recipe_is_named(stack, tmp_path, text):
    measured(stack, out=tmp_path / "out")
    (tmp_path / "out" / "run.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(ValueError, match="out/run.json is damaged: choose another folder"):
        measured(stack, out=tmp_path / "out", resume=True)


def test_parts_of_a_run_that_was_cut_off_are_not_dropped_unasked(stack, tmp_path, capsys):
    asked = ["measure", str(stack), "--spots", "30,30 90,33", "--quiet", "--out"]
    out, parts = str(tmp_path / "out"), tmp_path / ".out.parts"
    assert main([*asked, str(tmp_path / "whole")]) == 0
    measured(stack, out=parts)
    assert main([*asked, out]) == 2
    said = capsys.readouterr().err
    assert re.search(r"\d+ parts of a run into .*out .* go on with --resume, or begin anew", said)
    assert parts.is_dir()
    assert main([*asked, out, "--force"]) == 0 and not parts.exists()
    tables = [(tmp_path / name / "measurement.csv").read_bytes() for name in ("whole", "out")]
    assert tables[0] == tables[1]


def test_results_go_to_an_empty_working_directory(stack, tmp_path, monkeypatch, capsys):
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    asked = ["measure", str(stack), "--spots", "30,30 90,33", "--quiet", "--out", "."]
    assert main(asked) == 0, capsys.readouterr().err
    assert (tmp_path / "out" / "measurement.csv").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


def test_a_scheduler_that_is_none_is_named(stack, tmp_path, capsys):
    pytest.importorskip("distributed", reason="dask is missing")
    asked = ["measure", str(stack), "--out", str(tmp_path / "out"), "--scheduler", "nonsense"]
    assert main(asked) == 2
    assert "--scheduler nonsense cannot be reached: missing port" in capsys.readouterr().err
