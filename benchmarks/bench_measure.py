"""A recording of full HD frames with two spots: processor time beside reading its pages alone, and
one table for every way of splitting the work.

The recordings share a few images: pages of a TIFF that point to one place, files that are links.
"""

import hashlib
import os
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import tifffile
from side_by_side import in_turn, one_thread, report, within

SHAPE, IMAGES, FRAMES, ROUNDS = (1080, 1920), 8, 32, 7
SPOTS = np.array([[690.3, 539.1], [1229.8, 538.6]])
DETECTOR = {"gain_e_per_dn": 4.0, "read_noise_e": 5.0, "offset_dn": 100.0, "bits": 12}


def images() -> np.ndarray:
    import losbench as lb

    detector = lb.Detector(**DETECTOR)
    drift = np.linspace(0, 0.5, IMAGES)[:, None, None]
    light = lb.render_spots(SPOTS + drift, 2e5, 2.0, SHAPE) + 40.0
    return detector.expose(light, 1)


def long_tiff(path: Path, pages: np.ndarray, count: int) -> Path:
    """A BigTIFF of ``count`` pages, of which every eighth shows the same image."""
    import struct

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
                (262, 3, 1), (273, 16, places[k % len(places)]), (277, 3, 1), (279, 16, size),
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


def job_of(path: Path):
    import losbench as lb
    from losbench.imaging.methods import as_background, as_method
    from losbench.recording.starts import first_places
    from losbench.recording.survey import survey
    from losbench.recording.work import Job

    recording = lb.read_recording(path, detector=lb.Detector(**DETECTOR))
    under, stamp = as_background("ring"), recording.stamps[0]
    (start,) = first_places(recording, SPOTS)
    return Job(recording, (survey(recording, stamp, start, as_method("eiwa", {}), under),), under)


def costs(folder: Path) -> list:
    pages, room = images(), np.empty(SHAPE, np.uint16)
    np.save(folder / "stack.npy", np.concatenate([pages] * (FRAMES // IMAGES)))
    kinds = {
        "npy": folder / "stack.npy",
        "long TIFF": long_tiff(folder / "long.tif", pages, 4000),
        "TIFF folder": folder_of(folder / "tiff", pages, FRAMES, ".tif"),
        "PNG folder": folder_of(folder / "png", pages, FRAMES, ".png"),
    }
    rows = []
    for kind, path in kinds.items():
        job = job_of(path)
        last = job.recording.n_frames
        ours, alone = in_turn(
            lambda job=job, last=last: job(last - FRAMES, last),
            lambda path=path, kind=kind: reading_alone(path, kind, room),
            ROUNDS if kind != "PNG folder" else 2,
        )
        rows.append(
            within(f"{kind}: a frame measured", ours / FRAMES, "its page read", alone / FRAMES, 1.3)
        )
    return rows


def sha(measured) -> str:
    return hashlib.sha256(measured.table.to_csv(float_format="%.17g").encode()).hexdigest()


if __name__ == "__main__":
    one_thread()
    with tempfile.TemporaryDirectory() as name:
        report("measure", costs(Path(name)))
    sys.exit()
