"""What a chunk costs, how frames are blocked, and what the parts of a run depend on."""

import sys
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

import losbench as lb
from losbench.recording import work
from losbench.recording.effort import Effort, with_effort
from losbench.recording.survey import Survey
from losbench.recording.work import Job, _digest, _files, tracked

MEBIBYTE = 2**20


def test_efforts_add_up_what_was_read_and_keep_the_most_memory():
    one, other = Effort(10, 300), Effort(5, 700)
    assert one.and_then(other) == other.and_then(one) == Effort(15, 700)
    assert str(Effort(1_560_000_000, 2_600_000)) == "1.6 GB read, 3 MB memory"


@pytest.mark.skipif(sys.platform != "linux", reason="Linux tells what a thread has read")
def test_bytes_that_a_chunk_reads_are_counted_and_those_before_are_not(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(bytes(3 * MEBIBYTE))
    path.read_bytes()
    content, effort = with_effort(lambda name: (tmp_path / name).read_bytes(), "a")
    assert len(content) == 3 * MEBIBYTE
    assert 3 * MEBIBYTE <= effort.bytes_read < 3.1 * MEBIBYTE
    assert 10 * MEBIBYTE < effort.memory_bytes < 2**40


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux only")
def test_memory_is_that_of_the_process_in_bytes():
    import resource

    held = with_effort(lambda: None)[1].memory_bytes
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert held == pytest.approx(1024 * peak, rel=0.05)


def stamps(*shapes, itemsize=2):
    return SimpleNamespace(
        stamps=[
            SimpleNamespace(frames=SimpleNamespace(shape=shape, dtype=np.dtype(f"u{itemsize}")))
            for shape in shapes
        ]
    )


@pytest.mark.parametrize(
    ("shapes", "itemsize", "block"),
    [
        ([(10, 10)], 2, 32),
        ([(1024, 2048)], 2, 32),  # 4 MiB each
        ([(1024, 2049)], 2, 31),
        ([(1024, 2048)], 1, 32),
        ([(10, 10), (4096, 4096)], 2, 4),
        ([(8192, 8192)], 2, 1),
        ([(20_000, 20_000)], 2, 1),
    ],
)
def test_32_frames_are_measured_together_or_as_many_as_fill_128_mebibytes(shapes, itemsize, block):
    assert Job(stamps(*shapes, itemsize=itemsize), (), lb.Ring()).block == block


def small(n=70):
    light = lb.render_spots([[12.0, 11.0]], 4e4, 1.5, (24, 26)) + 50.0
    camera = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0)
    return lb.read_recording(camera.expose(np.stack([light] * n), 1), detector=camera)


@pytest.mark.parametrize(
    ("chunk", "chunks"), [(1, [32, 32, 6]), (32, [32, 32, 6]), (33, [64, 6]), (64, [64, 6])]
)
def test_chunks_are_rounded_up_to_blocks(monkeypatch, chunk, chunks):
    asked, recording = [], small()
    spread = work.spread

    def seen(call, jobs, **options):
        asked.extend(last - first for first, last in jobs)
        return spread(call, jobs, **options)

    monkeypatch.setattr(work, "spread", seen)
    start = np.array([[12.0, 11.0]])
    survey = Survey(np.array([0]), start[None], start, lb.EIWA(9, centre="peak"))
    track = tracked(Job(recording, (survey,), lb.Ring()), lb.Run(chunk=chunk))
    assert asked == chunks and track.xy.shape == (70, 1, 2)


@dataclass(frozen=True)
class Thing:
    array: np.ndarray
    number: float = 1.0
    call: object = None


@pytest.mark.parametrize(
    "other",
    [
        Thing(np.arange(6.0).reshape(3, 2)),
        Thing(np.arange(6).reshape(2, 3)),
        Thing(np.arange(1.0, 7.0).reshape(2, 3)),
        Thing(np.arange(6.0).reshape(2, 3), 2.0),
    ],
)
def test_a_digest_tells_shape_type_and_numbers(other):
    one = Thing(np.arange(6.0).reshape(2, 3))
    assert _digest(one) == _digest(replace(one))
    assert _digest(replace(one, call=len)) == _digest(replace(one, call=print))
    assert _digest(one) != _digest(other) and _digest([one]) != _digest([one, one])
    assert _digest(one) == _digest(replace(one, array=np.asfortranarray(one.array)))
    assert len(_digest(one)) == 16


def test_files_are_known_by_their_number_sizes_and_changes_and_no_others_count(tmp_path):
    import os

    import cv2

    frames = [tmp_path / f"{k}.bmp" for k in range(3)]
    for k, path in enumerate(frames):
        cv2.imwrite(str(path), np.full((20, 30), k, np.uint8))
        os.utime(path, (3 + 2 * k, 3 + 2 * k))
    size = sum(path.stat().st_size for path in frames)
    folder, listed = lb.read_recording(tmp_path), lb.read_recording(frames)
    before = _files(folder)
    assert before.startswith(f"3 of {size} bytes, changed 7000000000, together ")
    (tmp_path / "out").mkdir()
    (tmp_path / "notes.txt").write_text("of no frame")
    assert _files(listed) == _files(folder) == before
    assert _files(lb.read_recording(frames[:1])).startswith(f"1 of {size // 3} bytes, changed 3000")
    # Two frames that change places leave number, sizes and the latest change as they are.
    frames[0].rename(tmp_path / "aside")
    frames[1].rename(frames[0])
    (tmp_path / "aside").rename(frames[1])
    assert _files(folder).startswith(before[:-16]) and _files(folder) != before
    assert _files(lb.read_recording(np.zeros((2, 20, 30), np.uint8))).startswith("0 of 0 bytes")


def test_files_of_a_reader_that_names_none_are_those_of_the_source(tmp_path):
    recording = lb.read_recording(np.zeros((2, 20, 30), np.uint8))
    (tmp_path / "0").write_bytes(bytes(10))
    assert _files(replace(recording, source=tmp_path / "0")).startswith("1 of 10 bytes")
    assert _files(replace(recording, source=tmp_path)).startswith("1 of 10 bytes")
