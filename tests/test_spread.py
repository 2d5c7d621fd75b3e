"""One meaning of an executor: order, at most so many at once, the first failure ends it all."""

import multiprocessing
import os
import pickle
import platform
import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from losbench import spread as spread_module
from losbench.spread import IN_FLIGHT, spread


class Later:
    """An executor that works only when somebody waits, and sees how many do."""

    def __init__(self):
        self.waiting, self.most = [], 0

    def submit(self, work, *job):
        outer = self

        class Waiting(Future):
            def result(self, timeout=None):
                outer.waiting.remove(self)
                return work(*job)

        future = Waiting()
        self.waiting.append(future)
        self.most = max(self.most, len(self.waiting))
        return future


class Pool:
    def map(self, work, *jobs):
        return list(map(work, *jobs))


def named(x):
    return f"chunk {x}"


def odd_ones(x):
    if x == 20:
        raise ValueError("even twenty")
    return x**2


def test_results_come_in_order_and_no_more_than_so_many_are_out():
    later, taken = Later(), []

    def jobs():
        for x in range(50):
            taken.append(x)
            yield (x + 100,)

    results = spread(lambda x: x**2, jobs(), executor=later, named=named)
    assert taken == []
    assert next(results) == 10_000
    assert len(taken) == IN_FLIGHT
    assert list(results) == [(x + 100) ** 2 for x in range(1, 50)]
    assert later.most == IN_FLIGHT


@pytest.mark.parametrize("executor", [None, Later(), Pool()])
def test_a_failure_is_named_and_the_rest_cancelled(executor):
    results = spread(odd_ones, ((x,) for x in range(40)), executor=executor, named=named)
    with pytest.raises(ValueError, match="even twenty") as failed:
        list(results)
    assert failed.value.__notes__ == ["in chunk 20"]
    if isinstance(executor, Later):
        assert executor.waiting
        assert all(future.cancelled() for future in executor.waiting)


def test_short_jobs_travel_together_and_long_ones_alone():
    sizes = []

    class Counting(Later):
        def submit(self, work, *job):
            sizes.append(len(job[0]))
            return super().submit(work, *job)

    assert list(spread(abs, ((x,) for x in range(2000)), executor=Counting(), named=named)) == [
        *range(2000)
    ]
    assert sizes[:IN_FLIGHT] == [1] * IN_FLIGHT
    assert max(sizes) == 64 and sum(sizes) == 2000
    sizes.clear()
    list(spread(time.sleep, [(0.26,)] * 20, executor=Counting(), named=named))
    assert sizes == [1] * 20


class AtOnce:
    """An executor whose tasks are done as they are handed out, and their sizes."""

    def __init__(self):
        self.sizes = []

    def submit(self, work, jobs):
        self.sizes.append(len(jobs))
        future = Future()
        try:
            future.set_result(work(jobs))
        except Exception as error:
            future.set_exception(error)
        return future


def test_four_tasks_tell_how_many_short_jobs_travel_together():
    executor = AtOnce()
    jobs = ((x,) for x in range(1500))
    assert list(spread(abs, jobs, executor=executor, named=named)) == [*range(1500)]
    assert executor.sizes[:36] == [1] * 4 + [4] * 16 + [16] * 16
    assert set(executor.sizes[36:-1]) == {64} and sum(executor.sizes) == 1500


def test_long_jobs_are_all_out_before_the_first_is_back():
    """Eight of them wait for one another, and four tell of their length."""
    together = threading.Barrier(8, timeout=30)
    with ThreadPoolExecutor(8) as executor:
        places = spread(
            lambda _: together.wait(), [(x,) for x in range(8)], executor=executor, named=named
        )
        assert sorted(places) == [*range(8)]


@pytest.mark.parametrize("error", [TimeoutError, CancelledError, OSError])
def test_a_failure_of_the_very_first_job_is_named(error):
    def late(x):
        raise error("no luck")

    with pytest.raises(error, match="no luck") as failed:
        list(spread(late, [(3,), (4,)], executor=AtOnce(), named=named))
    assert failed.value.__notes__ == ["in chunk 3"]


def test_a_first_job_that_somebody_cancelled_is_named():
    class Cancelling:
        def submit(self, work, jobs):
            future = Future()
            future.cancel()
            return future

    with pytest.raises(CancelledError) as failed:
        list(spread(abs, [(3,)], executor=Cancelling(), named=named))
    assert failed.value.__notes__ == ["in chunk 3"]


class Numbers(list):
    """Tells each unpickling from the one before."""

    def __reduce__(self):
        return counted, (list(self),)


def counted(numbers):
    counted.times += 1
    return Numbers(numbers)


counted.times = 0


def place_in(numbers, k):
    return numbers[k], counted.times


def test_large_work_is_packed_once_and_unpacked_once_by_each_worker():
    context = multiprocessing.get_context("spawn")
    sizes = []
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        for count in (3, 100_000, 200_000):
            work = partial(place_in, Numbers(range(count)))
            elsewhere = spread_module._Elsewhere(work)
            sizes.append(len(pickle.dumps(elsewhere.each)))
            for times in range(3):  # tasks
                (found, unpacked), *_ = pool.submit(elsewhere.each, [(2,)]).result()[0]
                assert found == 2
                if count == 3:
                    few = unpacked
                    assert unpacked == times + 1
                else:
                    assert unpacked == few + (1 if count == 100_000 else 2)
    assert sizes[0] < 500 and sizes[1] < 0.7 * len(pickle.dumps(list(range(100_000))))


@pytest.mark.parametrize(("length", "packed"), [(2**14 - 200, False), (2**14 + 1, True)])
def test_small_work_travels_as_it_is(length, packed):
    elsewhere = spread_module._Elsewhere(partial(bytes.startswith, b"x" * length))
    assert (elsewhere._packed is not None) == packed
    again = pickle.loads(pickle.dumps(elsewhere))
    assert again(b"x") and not again(b"y")


def test_dask_names_tasks_without_a_look_at_what_work_holds():
    tokenize = pytest.importorskip("dask.tokenize", reason="dask is missing").tokenize

    class Closed:
        def __dask_tokenize__(self):
            raise AssertionError("looked at")

    one, other = (spread_module._Elsewhere(partial(print, Closed())) for _ in range(2))
    assert tokenize(one.each) == tokenize(one.each) != tokenize(other.each)


@pytest.mark.parametrize("name", ["__main__", "lambda"])
def test_what_only_a_cluster_can_pickle_is_left_to_it(name):
    """It takes along what is defined in a notebook, of which pickle knows the name alone."""
    work = partial(print, "__main__" * 9000) if name == "__main__" else lambda: "x" * 9**5
    assert spread_module._Elsewhere(work)._packed is None


def late(x):
    if x == 1500:
        raise UnicodeDecodeError("utf-8", b"abc", 0, 1, "no text")
    return x


def test_a_failure_among_short_jobs_is_named_across_processes():
    context = multiprocessing.get_context("spawn")
    jobs = ((x,) for x in range(4000))
    with (
        ProcessPoolExecutor(1, mp_context=context) as pool,
        pytest.raises(UnicodeDecodeError) as failed,
    ):
        list(spread(late, jobs, executor=pool, named=named))
    assert failed.value.__notes__ == ["in chunk 1500"]
    assert set(vars(failed.value)) == {"__notes__"}


def test_a_worker_that_is_killed_is_told_with_what_it_worked_on():
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, mp_context=context) as pool,
        pytest.raises(BrokenProcessPool) as failed,
    ):
        list(spread(os._exit, [(1,)], executor=pool, named=lambda x: "frames 0 to 63"))
    assert failed.value.__notes__ == ["in frames 0 to 63"]


def test_an_executor_must_be_one():
    with pytest.raises(TypeError, match="executor must have a method map or submit, got int"):
        spread(pow, [], executor=4, named=named)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's own")
@pytest.mark.parametrize(
    ("pooled", "variable", "expected"),
    [
        (False, "", []),
        (False, "65536", [(-1, 2**28), (-3, 2**25)]),
        (True, "", [(-1, 2**28), (-3, 2**25)]),
    ],
)
def test_the_allocator_is_set_in_workers_alone(monkeypatch, pooled, variable, expected):
    calls = []
    monkeypatch.setattr(
        spread_module.ctypes,
        "CDLL",
        lambda name: type("libc", (), {"mallopt": staticmethod(lambda *set_: calls.append(set_))}),
    )
    monkeypatch.setattr(
        spread_module.multiprocessing, "parent_process", lambda: object() if pooled else None
    )
    monkeypatch.setattr(spread_module.threading, "Thread", MagicMock())
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", variable)
    spread_module._settle_in.__wrapped__()
    assert calls == expected


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc's own")
@pytest.mark.parametrize("threads", [False, True])
def test_memory_of_arrays_that_come_and_go_is_mapped_once(threads):
    """Eight arrays of a megabyte to a job are 2048 pages, of which each is a fault if it is new."""
    code = """
        import resource
        from concurrent.futures import ThreadPoolExecutor
        from contextlib import nullcontext

        import numpy as np

        from losbench.spread import spread

        def job(k):
            return len([np.ones(2**17) for _ in range(8)])

        def faults():
            return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

        with ThreadPoolExecutor(1) if THREADS else nullcontext() as executor:
            list(spread(job, [(k,) for k in range(5)], executor=executor, named=str))
            before = faults()
            list(spread(job, [(k,) for k in range(50)], executor=executor, named=str))
            print(faults() - before)
    """.replace("THREADS", str(threads))
    environment = {name: value for name, value in os.environ.items() if "MALLOC" not in name}
    command = [sys.executable, "-c", textwrap.dedent(code)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert int(done.stdout) < 2 * 2048


@pytest.mark.skipif(os.name != "posix", reason="kills a process as POSIX does")
@pytest.mark.parametrize("before", [False, True])
def test_workers_end_when_the_parent_is_killed(before, tmp_path):
    """Also those of a process whose own threads have worked before it forked."""
    (tmp_path / "owner.py").write_text(
        textwrap.dedent(
            """
            import os, pathlib, sys, time
            from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
            from losbench.spread import spread

            def work(k):
                pathlib.Path("worker").write_text(str(os.getpid()))
                time.sleep(60)

            if __name__ == "__main__":
                if sys.argv[1:] == ["before"]:
                    with ThreadPoolExecutor(1) as pool:
                        list(spread(abs, [(0,)], executor=pool, named=str))
                with ProcessPoolExecutor(1) as pool:
                    list(spread(work, [(0,)], executor=pool, named=str))
            """
        )
    )
    command = [sys.executable, "-W", "ignore", "owner.py", *["before"] * before]
    owner = subprocess.Popen(command, cwd=tmp_path)
    end = time.monotonic() + 30
    while not (tmp_path / "worker").exists() or not (tmp_path / "worker").read_text():
        assert time.monotonic() < end
        time.sleep(0.05)
    worker = int((tmp_path / "worker").read_text())
    owner.send_signal(signal.SIGKILL)
    owner.wait()
    while True:
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            break
        status = Path(f"/proc/{worker}/stat")
        if status.exists() and status.read_text().split()[2] == "Z":  # nobody is there to bury it
            break
        assert time.monotonic() < end, "the worker outlives its owner"
        time.sleep(0.05)


class TwoWords(Exception):
    def __init__(self, one, other):
        super().__init__(f"{one} {other}")


class Held(Exception):
    def __init__(self):
        super().__init__("held")
        self.by = lambda: None


def told_badly(x):
    if x == 20:
        raise TwoWords("even", "twenty")
    if x == 40:
        raise Held
    return x


@pytest.mark.parametrize(("first", "told"), [(0, "TwoWords: even twenty"), (30, "Held: held")])
def test_an_error_that_no_other_process_can_be_told_is_told_by_its_name(first, told):
    jobs = [(x,) for x in range(first, 60)]
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        with pytest.raises(RuntimeError, match=f"^{told}") as failed:
            list(spread(told_badly, jobs, executor=executor, named=named))
        assert failed.value.__notes__ == [f"in chunk {20 if first == 0 else 40}"]
        assert list(spread(told_badly, [(3,)], executor=executor, named=named)) == [3]
    with ThreadPoolExecutor(1) as executor, pytest.raises(TwoWords if first == 0 else Held):
        list(spread(told_badly, jobs, executor=executor, named=named))


def test_a_pool_of_multiprocessing_maps_too():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert list(spread(pow, [(2, 3), (3, 2)], executor=pool, named=named)) == [8, 9]
        with pytest.raises(ValueError, match="even twenty") as failed:
            list(spread(odd_ones, ((x,) for x in range(40)), executor=pool, named=named))
        assert failed.value.__notes__ == ["in chunk 20"]


@pytest.mark.skipif(os.name != "posix", reason="kills a process as POSIX does")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_worker_that_is_killed_while_it_sends_ends_the_run(method, tmp_path):
    (tmp_path / "owner.py").write_text(
        textwrap.dedent(
            """
            import multiprocessing, os, signal, struct, sys, time
            from concurrent.futures import ProcessPoolExecutor
            from losbench.spread import spread

            def work(k):
                if k == 5:
                    frame = sys._getframe()
                    while "result_queue" not in frame.f_locals:
                        frame = frame.f_back
                    # The head of a result, whose rest never comes.
                    os.write(frame.f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 99))
                    os.kill(os.getpid(), signal.SIGKILL)
                time.sleep(0.3)
                return k

            if __name__ == "__main__":
                context = multiprocessing.get_context(sys.argv[1])
                pool = ProcessPoolExecutor(2, mp_context=context)
                jobs = ((k,) for k in range(40))
                for done in spread(work, jobs, executor=pool, named=str):
                    print(done)
            """
        )
    )
    owner = subprocess.run(
        [sys.executable, "-W", "ignore", "owner.py", method],
        cwd=tmp_path, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert owner.returncode == 1 and owner.stdout.split()[:4] == ["0", "1", "2", "3"]
    assert "BrokenProcessPool" in owner.stderr  # the fourth is lost too, if it was not done
    assert owner.stderr.split()[-1] in ("4", "5")


def out_of_time(x):
    raise TimeoutError("late")


def test_what_a_job_itself_raises_for_time_is_told(monkeypatch):
    monkeypatch.setattr(spread_module, "_PATIENCE_S", 0.05)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        with pytest.raises(TimeoutError, match="late"):
            list(spread(out_of_time, [(1,)], executor=executor, named=named))
        assert list(spread(abs, [(-3,)], executor=executor, named=named)) == [3]
