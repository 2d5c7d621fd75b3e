"""Two commits side by side: their benches in turns in one run, so that a busy moment meets both.

Prints for every row of every bench how many times slower the new commit is (median of the rounds),
and beside it how far the old one strays from its own median. Each commit runs its own benches, with
this environment's packages.
"""

from __future__ import annotations

import argparse
import csv
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from collections import defaultdict
from io import BytesIO
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ALLOWED = 1.05
Key = tuple[str, str]


def unpacked(commit: str, folder: Path) -> Path:
    """Write the files of a commit into the folder."""
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=False)
    if archive.returncode:
        sys.exit(f"compare: {commit!r} is no commit here: {archive.stderr.decode().strip()}")
    with tarfile.open(fileobj=BytesIO(archive.stdout)) as files:
        files.extractall(folder, filter="data")
    for stale in (folder / "benchmarks" / "baselines").glob("*.csv"):
        stale.unlink()
    return folder


def measured(tree: Path, bench: str) -> dict[Key, float]:
    """Run one bench of a tree; return by row how slow it is beside its peer or limit."""
    script = tree / "benchmarks" / f"bench_{bench}.py"
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    command = [sys.executable, str(script), "--save"]
    subprocess.run(command, cwd=tree, env=environment, stdout=subprocess.DEVNULL, check=False)
    table = tree / "benchmarks" / "baselines" / f"{bench}.csv"
    if not table.is_file():
        return {}
    with table.open(encoding="utf-8", newline="") as file:
        return {
            (row["what"], row.get("peer", "")): slowness(float(row["ratio"]), row["target"])
            for row in csv.DictReader(file)
        }


def slowness(ratio: float, target: str) -> float:
    """Turn a ratio into one that grows as the library gets slower.

    >>> slowness(50.0, "at least 20 times faster"), slowness(3.0, "at most 5 times as long")
    (0.02, 3.0)
    """
    return ratio if target.startswith(("at most", "<=")) else 1.0 / ratio


def judged(old: list[float], new: list[float]) -> tuple[float, float, bool]:
    """Return how many times slower the new is, how far the old strays, and if that is allowed.

    >>> judged([1.0, 1.1, 1.0], [1.2, 1.2, 1.2])
    (1.2, 0.1, False)
    """
    middle = statistics.median(old)
    slower = statistics.median(new) / middle
    spread = max(abs(value / middle - 1.0) for value in old)
    return round(slower, 3), round(spread, 3), slower <= ALLOWED + spread


def main() -> None:
    """Run the rounds, print the table, and leave with 1 where the new commit is slower."""
    names = sorted(path.stem[6:] for path in Path(__file__).parent.glob("bench_*.py"))
    names.remove("explorers")  # its browser makes it a measurement of its own
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old", help="commit to compare with")
    parser.add_argument("new", nargs="?", default="HEAD", help="commit to judge (HEAD)")
    parser.add_argument("--rounds", type=int, default=5, help="turns of both (5)")
    parser.add_argument("--benches", nargs="+", default=names, choices=names, metavar="NAME")
    options = parser.parse_args()
    rounds: dict[tuple[str, Key], tuple[list[float], list[float]]] = defaultdict(lambda: ([], []))
    with tempfile.TemporaryDirectory() as folder:
        trees = [
            unpacked(commit, Path(folder, name))
            for commit, name in ((options.old, "old"), (options.new, "new"))
        ]
        for turn in range(options.rounds):
            for bench in options.benches:
                for place, tree in enumerate(trees):
                    for key, value in measured(tree, bench).items():
                        rounds[bench, key][place].append(value)
            print(f"round {turn + 1} of {options.rounds} done", flush=True)
    missed = False
    for (bench, key), (old, new) in sorted(rounds.items()):
        name = f"{bench}: {' | '.join(filter(None, key))}"
        if not (old and new):
            print(f"{name:70.70s}  only in the {'old' if old else 'new'} commit")
            continue
        slower, spread, allowed = judged(old, new)
        verdict = "ok" if allowed else "SLOWER"
        print(f"{name:70.70s}  new / old {slower:6.3f}   old strays {spread:6.3f}   {verdict}")
        missed |= not allowed
    sys.exit(missed)


if __name__ == "__main__":
    main()
