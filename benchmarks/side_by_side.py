"""Time rivals in turn in one run, print their ratios beside the targets, keep a baseline."""

import argparse
import csv
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

from records import record

_IDLE = 0.2  # cores that others may keep busy while two workers are judged
# Of the time of one process, what an executor may spend on tasks that do nothing: two bare processes
# take 0.54 of it here, and 0.67 is the most that is allowed.
_OWN = 0.1
_LONG_S = 5.0  # of work that is run but once


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


def at_once(what: str, work: Callable[[Executor | None], object]) -> list[dict[str, Any]]:
    """Judge the wall time of two workers that have begun and idle against that of one process, by
    processes and by dask; where others keep the cores busy it is told beside processor time, and
    not judged. Nor is what takes one process so short a time that the executor's own cost of as
    many empty tasks is a tenth of it. Of short work it is the median of five runs, after one that
    is not counted: the first also loads what the work needs.
    """
    before = _busy_cores()
    alone_s, alone_cpu_s, _ = _typical(lambda: work(None))
    rows = []
    for who, pool, at_least in (("two processes", _processes, 1.6), ("dask", dask_workers, 1.5)):
        busy, both = max(before, _busy_cores()), []

        def pooled(pool=pool, both=both) -> None:
            with pool() as executor:
                list(executor.map(time.sleep, [1.0, 1.0]))  # until both are there
                counted = _Counted(executor)
                both_s, _, runs = _typical(lambda: work(counted))
                both += [both_s, runs, counted.tasks // runs, _empty_task(executor)]

        _, both_cpu_s = _spent(pooled)
        both_s, runs, tasks, empty_s = both
        both_cpu_s /= runs
        share = alone_s / both_s
        missed = "MISSED" if busy <= _IDLE else f"{busy:.1f} cores were busy"
        if tasks * empty_s > _OWN * alone_s:
            missed = f"too short for {tasks} tasks"
        verdict = "ok" if share >= at_least else missed
        print(
            f"{what}: one process {alone_s:.1f} s, {who} {both_s:.1f} s: {share:.2f} times as "
            f"fast; processor {alone_cpu_s:.1f} s and, with their start, {both_cpu_s:.1f} s; "
            f"{tasks} tasks, of which an empty one takes {1e3 * empty_s:.1f} ms; "
            f"cores busy before {busy:.1f}: {verdict}"
        )
        rows.append(
            {
                "what": f"{what}, {who}, an empty task {1e3 * empty_s:.1f} ms: "
                f"processor {both_cpu_s:.3g} s",
                "ours_us": 1e6 * both_s,
                "peer": f"one process: processor {alone_cpu_s:.3g} s",
                "peer_us": 1e6 * alone_s,
                "ratio": share,
                "target": f"at least {at_least:g} times faster",
                "verdict": verdict,
            }
        )
    return rows


class _Counted:
    """An executor that counts its tasks."""

    def __init__(self, executor: Executor) -> None:
        self.executor, self.tasks = executor, 0

    def submit(self, work: Callable[..., Any], *job: Any) -> Future[Any]:
        self.tasks += 1
        return self.executor.submit(work, *job)


def _empty_task(executor: Executor, count: int = 100) -> float:
    """Seconds of wall time that each of many tasks takes which do nothing."""
    begun = time.perf_counter()
    for future in [executor.submit(abs, k) for k in range(count)]:
        future.result()
    return (time.perf_counter() - begun) / count


def _processes() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(2, mp_context=get_context("spawn"))


@contextmanager
def dask_workers(*, kill_after_s: float | None = None) -> Iterator[Executor]:
    """Two workers of a local cluster, one of which may be killed."""
    from distributed import Client, LocalCluster

    local = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with LocalCluster(n_workers=2, **local) as cluster, Client(cluster) as client:
        if kill_after_s is not None:
            victim = next(iter(client.run(os.getpid).values()))
            threading.Timer(kill_after_s, os.kill, (victim, signal.SIGKILL)).start()
        yield client.get_executor()


def _busy_cores(seconds: float = 1.0) -> float:
    """How many cores others keep busy now; 0 where the system does not tell."""

    def idle() -> float:
        ticks = Path("/proc/stat").read_text().split(maxsplit=6)[4:6]  # idle, waiting for disks
        return sum(map(float, ticks)) / os.sysconf("SC_CLK_TCK")

    try:
        start, begun = idle(), time.perf_counter()
        time.sleep(seconds)
        spent = time.perf_counter() - begun
        return max(0.0, (os.cpu_count() or 1) - (idle() - start) / spent)
    except (OSError, AttributeError, ValueError):
        return 0.0


def _typical(work: Callable[[], object]) -> tuple[float, float, int]:
    """Medians of wall and processor time, and how often it ran; once, if that takes long."""
    taken = [_spent(work)]
    if taken[0][0] < _LONG_S:
        taken += [_spent(work) for _ in range(5)]
    wall, processor = (median(times) for times in zip(*(taken[1:] or taken), strict=True))
    return wall, processor, len(taken)


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
