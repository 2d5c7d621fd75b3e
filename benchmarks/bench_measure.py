"""A recording of full HD frames with two spots: processor time beside reading its pages alone, and
one table for every way of splitting the work.

The recordings share a few images: pages of a TIFF that point to one place, files that are links.
"""

import functools
import hashlib
import multiprocessing
import os
import resource
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import tifffile
from records import growth
from side_by_side import Row, at_once, dask_workers, in_turn, one_thread, report, within

import losbench as lb
from losbench.imaging.methods import as_background, as_method
from losbench.recording.starts import first_places
from losbench.recording.survey import survey
from losbench.recording.work import Job

SHAPE, IMAGES, FRAMES, ROUNDS, MOST_MB = (1080, 1920), 8, 32, 7, 250.0
LONG, HOURS = 4000, 100_000  # frames: 4000 are done before a second worker has found its work
SIZES = (10, 100, 1000, 10_000)
SPOTS = np.array([[690.3, 539.1], [1229.8, 538.6]])
DETECTOR = {"gain_e_per_dn": 4.0, "read_noise_e": 5.0, "offset_dn": 100.0, "bits": 12}


def images() -> np.ndarray:
    """Eight images of a slow drift, of which the last four have jumped; and one without a spot."""
    detector = lb.Detector(**DETECTOR)
    places = SPOTS + np.linspace(0, 0.5, IMAGES)[:, None, None]
    places[IMAGES // 2 :, :, 0] += 6.0
    light = lb.render_spots(places, 2e5, 2.0, SHAPE) + 40.0
    lost = lb.render_spots(places[0, :1], 2e5, 2.0, SHAPE) + 40.0
    return detector.expose(np.concatenate([light, lost[None]]), 1)


def image_of(k: int, count: int) -> int:
    """Which image frame k shows: a jump halfway, and the second spot lost for a while before."""
    lost = count // 4 <= k < count // 4 + 10
    return IMAGES if lost else k % (IMAGES // 2) + IMAGES // 2 * (k >= count // 2)


def long_tiff(path: Path, pages: np.ndarray, count: int) -> Path:
    """A BigTIFF of ``count`` pages that point to a few images."""
    with path.open("wb") as file:
        file.write(struct.pack("<2sHHHQ", b"II", 43, 8, 0, 0))
        places = []
        for page in pages:
            places.append(file.tell())
            file.write(page.tobytes())
        at, size = file.tell(), pages[0].nbytes
        length = 8 + 8 * 20 + 8
        for k in range(count):
            tags = [
                (256, 4, SHAPE[1]), (257, 4, SHAPE[0]), (258, 3, 16), (259, 3, 1),
                (262, 3, 1), (273, 16, places[image_of(k, count)]), (277, 3, 1), (279, 16, size),
            ]  # fmt: skip
            file.write(struct.pack("<Q", len(tags)))
            for tag, kind, value in tags:
                file.write(struct.pack("<HHQQ", tag, kind, 1, value))
            file.write(struct.pack("<Q", 0 if k == count - 1 else at + (k + 1) * length))
        file.seek(8)
        file.write(struct.pack("<Q", at))
    return path


def folder_of(path: Path, pages: np.ndarray, count: int, suffix: str) -> Path:
    path.mkdir()
    for k in range(count):
        name = path / f"{k:05d}{suffix}"
        if k >= len(pages):
            os.link(path / f"{k % len(pages):05d}{suffix}", name)
        elif suffix == ".png":
            cv2.imwrite(str(name), pages[k])
        else:
            tifffile.imwrite(name, pages[k], photometric="minisblack")
    return path


def reading_alone(path: Path, kind: str, room: np.ndarray) -> None:
    """Every page's bytes into one array, or for PNG its decoding."""
    if kind == "PNG folder":
        for name in sorted(path.iterdir())[:FRAMES]:
            cv2.imread(str(name), cv2.IMREAD_UNCHANGED)
        return
    files = sorted(path.iterdir())[:FRAMES] if path.is_dir() else [path] * FRAMES
    for k, name in enumerate(files):
        with name.open("rb", buffering=0) as file:
            file.seek(256 if path.is_dir() else 256 + (k % IMAGES) * room.nbytes)
            file.readinto(room)


def job_of(path: Path) -> Job:
    recording = lb.read_recording(path, detector=lb.Detector(**DETECTOR))
    under, stamp = as_background("ring"), recording.stamps[0]
    (start,) = first_places(recording, SPOTS)
    return Job(recording, (survey(recording, stamp, start, as_method("eiwa", {}), under),), under)


def costs(folder: Path, pages: np.ndarray) -> Iterator[Row]:
    """A frame measured beside its page read, for four formats."""
    room = np.empty(SHAPE, np.uint16)
    np.save(folder / "stack.npy", np.concatenate([pages[:IMAGES]] * (FRAMES // IMAGES)))
    kinds = {
        "npy": folder / "stack.npy",
        "long TIFF": folder / "long.tif",
        "TIFF folder": folder_of(folder / "tiff", pages[: IMAGES // 2], FRAMES, ".tif"),
        "TIFF folder, a spot now and then lost": folder_of(folder / "lost", pages, FRAMES, ".tif"),
        "PNG folder": folder_of(folder / "png", pages[: IMAGES // 2], FRAMES, ".png"),
    }
    for kind, path in kinds.items():
        job = job_of(path)
        last = job.recording.n_frames
        ours, alone = in_turn(
            lambda job=job, last=last: job(last - FRAMES, last),
            lambda path=path, kind=kind: reading_alone(path, kind, room),
            ROUNDS if kind != "PNG folder" else 2,
        )
        row = within(
            f"{kind}: a frame measured", ours / FRAMES, "its page read", alone / FRAMES, 1.3
        )
        # Frame by frame where a spot is lost: told, but nothing is asked of it.
        yield row if "lost" not in kind else replace(row, target="", verdict="")
    whole, job = lb.read_recording(kinds["npy"]).stamps[0], job_of(kinds["npy"])

    def as_before() -> None:
        for k in range(0, FRAMES, 8):
            seen = whole.read(k, k + 8, skip=False).frames
            lb.centroid(seen, job.surveys[0].path[0], method=job.surveys[0].method)

    ours, before = in_turn(lambda: job(0, FRAMES), as_before, ROUNDS)
    yield within("npy: a frame measured", ours / FRAMES, "of whole frames", before / FRAMES, 0.65)


def sha(measured: lb.Measurement) -> str:
    return hashlib.sha256(measured.table.to_csv(float_format="%.17g").encode()).hexdigest()


def measurement(path: Path, **run: object) -> lb.Measurement:
    recording = lb.read_recording(path, detector=lb.Detector(**DETECTOR))
    return lb.measure(recording, spots=SPOTS, run=lb.Run(**run))


def measured(path: Path, **run: object) -> str:
    return sha(measurement(path, **run))


def spent(who: str, work: Callable[[], str], alone: tuple[str, float, float] | None) -> tuple:
    """Run, print and return the table's sha256, wall and processor time, workers included."""
    wall, processor = time.perf_counter(), sum(os.times()[:4])
    found = work()
    wall, processor = time.perf_counter() - wall, sum(os.times()[:4]) - processor
    same = alone is None or found == alone[0]
    faster = "" if alone is None else f"   {alone[1] / wall:.2f} times as fast"
    print(
        f"{LONG} frames, {who:28s} {wall:6.1f} s, processor {processor:6.1f} s{faster}   "
        f"{'the same bytes' if same else 'OTHER BYTES: MISSED'}"
    )
    return found, wall, processor


def with_pool(path: Path, pool: AbstractContextManager[Executor], **run: object) -> str:
    with pool as executor:
        return measured(path, executor=executor, **run)


def killed_and_resumed(path: Path, folder: Path) -> str:
    """End a process in its midst, damage one part of what it kept, and go on."""
    out = folder / "parts"
    command = [sys.executable, __file__, "--measure", str(path), str(out)]
    process = subprocess.Popen(command)
    while len(list(out.glob("part-*.npz"))) < 8 and process.poll() is None:
        time.sleep(0.01)
    process.kill()
    process.wait()
    part = sorted(out.glob("part-*.npz"))[3]
    part.write_bytes(part.read_bytes()[:-30])
    return measured(path, out=out, resume=True)


def one_table(folder: Path) -> list[dict]:
    """The same bytes whoever measures, and what it takes."""
    path, spawn = folder / "long.tif", multiprocessing.get_context("spawn")
    ways = {
        "chunk 32": lambda: measured(path, chunk=32),
        "chunk 400": lambda: measured(path, chunk=400),
        "two processes": lambda: with_pool(path, ProcessPoolExecutor(2, mp_context=spawn)),
        "four processes": lambda: with_pool(path, ProcessPoolExecutor(4, mp_context=spawn)),
        "two threads": lambda: with_pool(path, ThreadPoolExecutor(2)),
        "dask, two workers": lambda: with_pool(path, dask_workers(), chunk=32),
        "dask, one of two killed": lambda: with_pool(
            path, dask_workers(kill_after_s=0.5), chunk=32
        ),
        "killed, damaged, resumed": lambda: killed_and_resumed(path, folder),
    }
    alone = spent("one process", lambda: measured(path), None)
    rows = []
    for who, work in ways.items():
        found, wall, _ = spent(who, work, alone)
        rows.append(
            {
                "what": f"{LONG} frames, {who}",
                "ours_us": 1e6 * wall,
                "peer": "one process, wall time",
                "peer_us": 1e6 * alone[1],
                "ratio": wall / alone[1],
                "target": "the same bytes",
                "verdict": "ok" if found == alone[0] else "MISSED",
            }
        )
    return rows


def own_peak_mb() -> float:
    """The most memory of this process, without that of the one that it was forked from."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) / 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def memory(folder: Path, pages: np.ndarray) -> dict:
    """The most memory of a process that measures 10 000 pages, 41 GB."""
    path = long_tiff(folder / "longest.tif", pages, 10_000)
    start = time.perf_counter()
    command = [sys.executable, __file__, "--measure", str(path), str(folder / "x")]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    held = float(done.stdout)
    print(f"41 GB in 10 000 pages: {time.perf_counter() - start:.1f} s, {held:.0f} MB at most")
    verdict = "ok" if held <= MOST_MB else "MISSED"
    return {
        "what": f"41 GB in 10 000 pages: {held:.0f} MB",
        "target": f"at most {MOST_MB:g} MB",
        "verdict": verdict,
    }


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder, pages = Path(name), images()
        flat = memory(folder, pages)
        job = job_of(folder / "longest.tif")
        slow = growth(
            "full HD TIFF, two spots", "frames", SIZES, lambda n: functools.partial(job, 0, n)
        )
        long_tiff(folder / "long.tif", pages, LONG)
        rows = list(costs(folder, pages))
        long_tiff(folder / "hours.tif", pages, HOURS)
        twice = [
            row
            for count, path in ((LONG, folder / "long.tif"), (HOURS, folder / "hours.tif"))
            for row in at_once(
                f"{count} frames", lambda pool, path=path: measurement(path, executor=pool)
            )
        ]
        report("measure", rows, more=[flat, *twice, *one_table(folder)], growths=[slow])


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        measured(Path(sys.argv[2]), out=sys.argv[3])
        print(own_peak_mb())
    else:
        one_thread()
        main()
