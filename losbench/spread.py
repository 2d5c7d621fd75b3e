"""Work in chunks, done here or spread over threads, processes or a cluster: the one meaning of
``executor``.

An executor is None, anything with the ``submit`` or ``map`` of concurrent.futures, or what a dask
client's ``get_executor()`` returns. Results come in the order of the chunks, whoever is done first.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from hashlib import sha256
from itertools import islice
from typing import Any, TypeVar
from uuid import uuid4

import numpy as np

__all__ = ["IN_FLIGHT", "spread"]

IN_FLIGHT = 16  # tasks handed out at a time: memory stays bounded, and workers have a next one

Result = TypeVar("Result")
Job = tuple[Any, ...]
_TRIP_S, _MOST = 0.25, 64  # a task of several chunks takes no longer, and holds no more
_PATIENCE_S = 2.0  # between looks at whether a worker has died
_FIRST, _GROWTH = 4, 4  # tasks that tell how long a chunk takes, and how fast others grow from them
_PLACE = "_losbench_place"
_LARGE = 2**14  # bytes of pickled work that are packed once, not for every task
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's mallopt
_REUSED = 2**24  # bytes of the largest array whose memory is kept for the next


def spread(
    work: Callable[..., Result],
    jobs: Iterable[Job],
    *,
    executor: Any = None,
    named: Callable[..., str],
) -> Iterator[Result]:
    """Yield ``work(*job)`` for each job, in their order.

    Parameters
    ----------
    work : callable
        For processes it must pickle: a function of a module, or a `functools.partial` of one.
    jobs : iterable of tuple
        Taken as they are needed, `IN_FLIGHT` tasks ahead: of one job each or, where jobs take less
        than a quarter of a second, of several. The first four tell which.
    executor : optional
        Who works; None: this thread.
    named : callable
        ``named(*job)`` is what a failing job is called: chunk, frames, seed.

    Raises
    ------
    TypeError
        If the executor has neither ``submit`` nor ``map``.
    Exception
        What a job raised, with a note that names it; jobs that have not begun are cancelled.

    Examples
    --------
    >>> list(spread(pow, [(2, 3), (3, 2)], named=lambda base, power: f"{base} to the {power}"))
    [8, 9]
    """
    if executor is None:
        return _one_by_one(work, jobs, named)
    if hasattr(executor, "submit"):
        return _in_flight(_Elsewhere(work), jobs, executor, named)
    if hasattr(executor, "map"):
        return _mapped(_Elsewhere(work), jobs, executor, named)
    raise TypeError(f"executor must have a method map or submit, got {type(executor).__name__}")


def _one_by_one(
    work: Callable[..., Result], jobs: Iterable[Job], named: Callable[..., str]
) -> Iterator[Result]:
    _keep_memory()
    for job in jobs:
        with _naming(named, job):
            result = work(*job)
        yield result


def _in_flight(
    work: _Elsewhere, jobs: Iterable[Job], executor: Any, named: Callable[..., str]
) -> Iterator[Any]:
    """Hand out one job at a time, or of short ones as many as are worth a trip."""
    waiting, flying = iter(jobs), deque[tuple[list[Job], Any]]()
    many, ahead = 1, _FIRST
    try:
        while True:
            while len(flying) < ahead and (batch := list(islice(waiting, many))):
                with _naming(named, *batch):
                    flying.append((batch, executor.submit(work.each, batch)))
            if not flying:
                return
            if ahead < IN_FLIGHT:
                # A trip may cost as much as a short job: few travel alone to tell that they are.
                ahead = IN_FLIGHT
                if not _is_back(flying[0][1]):
                    continue
            batch, future = flying.popleft()
            with _naming(named, *batch):
                results, seconds = _outcome(future, executor)
            yield from results
            worth = int(len(batch) * _TRIP_S / max(seconds, 1e-9))
            many = max(1, min(worth, _GROWTH * len(batch), _MOST))
    finally:
        for _, future in flying:
            future.cancel()


def _outcome(future: Any, executor: Any) -> Any:
    """What comes of a task, also where a worker was killed while it sent a result: its pool waits
    for the rest of it for ever.
    """
    while isinstance(executor, ProcessPoolExecutor):
        try:
            return future.result(_PATIENCE_S)
        except TimeoutError:
            if future.done():  # or the task raised it
                break
            _end_if_broken(executor)
    return future.result()


def _end_if_broken(executor: Any) -> None:
    """End a pool of processes that has lost one: all who could send the rest let go of the pipe,
    which Python tells of under private names alone.
    """
    workers = list((getattr(executor, "_processes", None) or {}).values())
    if any(worker.exitcode not in (None, 0) for worker in workers):
        for worker in workers:
            worker.kill()
        pipe = getattr(getattr(executor, "_result_queue", None), "_writer", None)
        if pipe is not None:
            pipe.close()


def _is_back(future: Any) -> bool:
    """Whether a task ends, well or not, before jobs in it would be called long."""
    back = threading.Event()
    future.add_done_callback(lambda _: back.set())
    return back.wait(_TRIP_S)


def _mapped(
    work: _Elsewhere, jobs: Iterable[Job], executor: Any, named: Callable[..., str]
) -> Iterator[Any]:
    waiting = iter(jobs)
    while batch := list(islice(waiting, IN_FLIGHT)):
        # By one iterable, as any pool's map takes it, multiprocessing's too; which may do it all
        # before it returns.
        with _naming(named, *batch):
            results = iter(executor.map(work.placed, enumerate(batch)))
        for _ in batch:
            with _naming(named, *batch):
                result = next(results)
            yield result


@contextmanager
def _naming(named: Callable[..., str], *jobs: Job) -> Iterator[None]:
    """Name the job that failed, or all of which one did."""
    try:
        yield
    except Exception as error:
        place = vars(error).pop(_PLACE, None)
        failed = jobs if place is None else jobs[place : place + 1]
        error.add_note(f"in {', '.join(named(*job) for job in failed)}")
        raise


@dataclass(frozen=True)
class _Elsewhere:
    """Work as it is done by a worker, which is first made fit for it."""

    work: Callable[..., Any]

    def __call__(self, *job: Any) -> Any:
        _settle_in()
        return self.work(*job)

    def __reduce__(self) -> tuple[Any, ...]:
        if self._packed is None:
            return _Elsewhere, (self.work,)
        return _unpacked, (self._packed,)

    def __dask_tokenize__(self) -> str:
        """Return a name of its own: Dask would look through all that work holds, for every task."""
        return self._name

    @cached_property
    def _name(self) -> str:
        return uuid4().hex

    @cached_property
    def _packed(self) -> _Packed | None:
        """Large work, as every task takes it along; None where whoever sends it must pickle it."""
        try:
            pickled = pickle.dumps(self.work, pickle.HIGHEST_PROTOCOL)
        except Exception:  # a cluster's own pickle may know how
            return None
        # Of what is defined in a notebook this holds the name alone.
        if len(pickled) < _LARGE or b"__main__" in pickled:
            return None
        return _Packed(sha256(pickled).digest(), zlib.compress(pickled, 1))

    def each(self, jobs: list[Job]) -> tuple[list[Any], float]:
        """What comes of some jobs, and how many seconds they took."""
        begun = time.perf_counter()
        results = [self.placed(each) for each in enumerate(jobs)]
        return results, time.perf_counter() - begun

    def placed(self, numbered: tuple[int, Job]) -> Any:
        """What comes of one of several jobs; what it raises tells which of them it was."""
        place, job = numbered
        try:
            return self(*job)
        except Exception as error:
            told = _fit_to_travel(error)
            vars(told)[_PLACE] = place  # which travels with it, as its notes would not
            if told is error:
                raise
            raise told from error


def _fit_to_travel(error: Exception) -> Exception:
    """Return an error as another process can be told it: one that does not unpickle there would
    break the whole pool, and one that does not pickle would be lost.
    """
    if multiprocessing.parent_process() is None:
        return error
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


@dataclass(frozen=True)
class _Packed:
    """Work that was pickled, by its digest."""

    digest: bytes
    data: bytes = field(compare=False, repr=False)


@lru_cache(maxsize=2)
def _unpacked(packed: _Packed) -> _Elsewhere:
    """Return work as it was when a task of it came to this process before, or unpack it."""
    return _Elsewhere(pickle.loads(zlib.decompress(packed.data)))


@cache
def _keep_memory() -> None:
    """Once a process: reuse the memory of arrays that come and go.

    What a job has freed glibc hands back to the system, and maps anew for the next, page by page,
    which may take as long as the job; unless it has seen a larger array freed. This is one, of
    which no page is touched. It changes nothing where thresholds are set by the user.
    """
    np.empty(_REUSED, np.uint8)


@cache
def _settle_in() -> None:
    """Once a process: keep memory that is used again, and end when the parent ends."""
    _keep_memory()
    parent = multiprocessing.parent_process()
    # A fresh process hands every array above 128 kB back to the system and maps the next one anew,
    # page by page: up to double the processor time. Dask's workers ask for it by this variable.
    if parent is not None or os.environ.get("MALLOC_TRIM_THRESHOLD_") == "65536":
        with suppress(OSError, AttributeError, TypeError):
            libc = ctypes.CDLL(None)
            libc.mallopt(_M_TRIM_THRESHOLD, 2**28)
            libc.mallopt(_M_MMAP_THRESHOLD, 2**25)
    # Workers of a pool whose owner was killed would wait for ever, with its lock if they were
    # forked.
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


if hasattr(os, "register_at_fork"):  # a process that is forked from a settled one is another
    os.register_at_fork(after_in_child=_settle_in.cache_clear)


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
