"""Telemetry of a million rows without spots, read and judged, beside the minute and the memory that
it may take.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from records import record
from scipy.spatial.transform import Rotation
from side_by_side import one_thread

from losbench.telemetry.correct import correct_telemetry

ROWS = 1_000_000
MOST_S, MOST_MB = 60.0, 1000.0
FORM = """time = "t"
scalar = "first"
direction = "camera_to_inertial"
[head_1]
quaternion = ["a0", "a1", "a2", "a3"]
[head_2]
quaternion = ["b0", "b1", "b2", "b3"]
"""


def write(folder: Path) -> Path:
    """Two heads that turn once an orbit, with an arcsecond of noise, as text of 12 decimals."""
    path, rng = folder / "heads.csv", np.random.default_rng(1)
    (folder / "heads.toml").write_text(FORM)
    with path.open("w") as file:
        file.write("t,a0,a1,a2,a3,b0,b1,b2,b3\n")
        for first in range(0, ROWS, 50_000):
            t = 0.5 * np.arange(first, first + 50_000)
            orbit = 2e-3 * np.pi * np.stack([0.0 * t, t / 5.6, 3.0 * np.sin(t / 300.0)], axis=1)
            body = Rotation.from_rotvec(0.1 * orbit) * Rotation.from_rotvec(
                np.outer(t / 900.0, [0.0, 1.0, 0.0])
            )
            noise = (Rotation.from_rotvec(5e-6 * rng.standard_normal((len(t), 3))) for _ in "ab")
            mounted = (Rotation.identity(), Rotation.from_euler("x", 81.0, degrees=True))
            heads = [
                (body * mount * error).as_quat(scalar_first=True)
                for mount, error in zip(mounted, noise, strict=True)
            ]
            np.savetxt(file, np.column_stack([t, *heads]), fmt="%.12g", delimiter=",")
    return path


def rows_of(took: float, held: float) -> list[dict]:
    """What is recorded of processor time in seconds and memory in MB."""
    return [
        {
            "what": f"{ROWS} rows",
            "ours_us": 1e6 * took,
            "peer": "a minute",
            "peer_us": 1e6 * MOST_S,
            "ratio": took / MOST_S,
            "target": "at most once",
            "verdict": "ok" if took <= MOST_S else "MISSED",
        },
        {
            "what": f"{ROWS} rows: {held:.0f} MB",
            "target": f"at most {MOST_MB:g} MB",
            "verdict": "ok" if held <= MOST_MB else "MISSED",
        },
    ]


def main() -> None:
    one_thread()
    with tempfile.TemporaryDirectory() as name:
        path = write(Path(name))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        start = time.process_time()
        report = correct_telemetry(path, Path(name, "out"))
        took = time.process_time() - start
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(report.summary().splitlines()[0])
    ok = took <= MOST_S and held <= MOST_MB
    print(
        f"{ROWS} rows: {took:.1f} s of processor time, at most {MOST_S:g}; {held:.0f} MB (writing "
        f"them {before:.0f}), at most {MOST_MB:g}: {'ok' if ok else 'MISSED'}"
    )
    record("telemetry", rows_of(took, held))
    sys.exit(not ok)


if __name__ == "__main__":
    main()
