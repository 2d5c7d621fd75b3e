"""Time rivals in turn in one run, print their ratios beside the targets, keep a baseline."""

import argparse
import csv
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from records import record

_IDLE = 0.5  # load, beyond which two processes do not have two cores to themselves


@dataclass(frozen=True)
class Row:
    """One comparison: how many times faster than a peer, or how many times slower than a limit."""

    what: str
    ours_us: float
    peer: str
    peer_us: float
    ratio: float
    target: str
    verdict: str


def in_turn(
    ours: Callable[[], object], peer: Callable[[], object], rounds: int
) -> tuple[float, float]:
    """Shortest processor times in seconds, in turn, so that what else the machine does meets
    both.
    """
    best = [float("inf"), float("inf")]
    for _ in range(rounds):
        for place, call in enumerate((ours, peer)):
            start = time.process_time()
            call()
            best[place] = min(best[place], time.process_time() - start)
    return best[0], best[1]


def faster(what: str, ours_s: float, peer: str, peer_s: float, at_least: float) -> Row:
    """Judge times per system against a peer."""
    ratio = peer_s / ours_s
    verdict = "ok" if ratio >= at_least else "MISSED"
    return Row(
        what,
        1e6 * ours_s,
        peer,
        1e6 * peer_s,
        ratio,
        f"at least {at_least:g} times faster",
        verdict,
    )


def within(what: str, ours_s: float, limit: str, limit_s: float, at_most: float) -> Row:
    """Judge a time against a physical limit."""
    ratio = ours_s / limit_s
    verdict = "ok" if ratio <= at_most else "MISSED"
    return Row(
        what,
        1e6 * ours_s,
        limit,
        1e6 * limit_s,
        ratio,
        f"at most {at_most:g} times as long",
        verdict,
    )


def at_once(
    what: str, work: Callable[[Executor | None], object], *, at_least: float
) -> dict[str, Any]:
    """Judge the wall time of two processes that have begun and idle against that of one; where
    others keep the machine busy it is told beside processor time, and not judged.
    """
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    alone_s, alone_cpu_s = _spent(lambda: work(None))

    def pooled() -> float:
        with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
            list(pool.map(time.sleep, [1.0, 1.0]))  # until both are there
            return _spent(lambda: work(pool))[0]

    both: list[float] = []
    _, both_cpu_s = _spent(lambda: both.append(pooled()))
    share = alone_s / both[0]
    verdict = "ok" if share >= at_least else f"load {busy:.1f}" if busy > _IDLE else "MISSED"
    print(
        f"{what}: one process {alone_s:.1f} s, two {both[0]:.1f} s: {share:.2f} times as fast; "
        f"processor {alone_cpu_s:.1f} s and, with their start, {both_cpu_s:.1f} s; load before "
        f"{busy:.1f}: {verdict}"
    )
    return {
        "what": f"{what}, two processes: processor {both_cpu_s:.3g} s",
        "ours_us": 1e6 * both[0],
        "peer": f"one process: processor {alone_cpu_s:.3g} s",
        "peer_us": 1e6 * alone_s,
        "ratio": share,
        "target": f"at least {at_least:g} times faster",
        "verdict": verdict,
    }


def _spent(work: Callable[[], object]) -> tuple[float, float]:
    """Wall and processor time in seconds, that of processes which have ended included."""
    wall, processor = time.perf_counter(), sum(os.times()[:4])
    work()
    return time.perf_counter() - wall, sum(os.times()[:4]) - processor


def report(
    name: str,
    rows: list[Row],
    *,
    more: Sequence[Mapping[str, Any]] = (),
    growths: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Print the table, record it for the page with what is no comparison of times, save it with
    --save, and leave with 1 if a target was missed.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--save", action="store_true", help="write the table to benchmarks/baselines"
    )
    options = parser.parse_args()
    for row in rows:
        print(
            f"{row.what:34s} {row.ours_us:9.2f} us   {row.peer:42s} {row.peer_us:9.1f} us"
            f"   ratio {row.ratio:7.2f}   {row.target}: {row.verdict}"
        )
    found = [*map(asdict, rows), *more]
    record(name, found, growths)
    if options.save:
        path = Path(__file__).parent / "baselines" / f"{name}.csv"
        path.parent.mkdir(exist_ok=True)
        with path.open("w", newline="") as file:
            table = csv.DictWriter(file, list(asdict(rows[0])), lineterminator="\n")
            table.writeheader()
            rounded = [
                asdict(row) | {k: f"{getattr(row, k):.4g}" for k in ("ours_us", "peer_us", "ratio")}
                for row in rows
            ]
            table.writerows(rounded)
    sys.exit(any(row.get("verdict") == "MISSED" for row in found))


def one_thread() -> None:
    """Start over with one thread per library, unless that is so already: ratios are of work, not of
    cores.
    """
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    if any(os.environ.get(name) != "1" for name in names):
        os.execve(
            sys.executable, [sys.executable, *sys.argv], os.environ | dict.fromkeys(names, "1")
        )
