"""Arguments that say who works, and what is kept of it on the way."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from losbench.recording.run import Run

__all__ = ["add_workers", "run_of"]


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add them to a parser."""
    group = parser.add_argument_group("who works")
    who = group.add_mutually_exclusive_group()
    who.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes to use (%(default)s)"
    )
    who.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a dask cluster whose workers see the files, e.g. tcp://10.0.0.1:8786",
    )
    group.add_argument(
        "--chunk",
        type=int,
        default=64,
        metavar="FRAMES",
        help="handed out at a time; changes no number (%(default)s)",
    )
    group.add_argument(
        "--resume", action="store_true", help="go on with what a run that was cut off has done"
    )


@contextmanager
def run_of(options: argparse.Namespace) -> Iterator[Run]:
    """Run as the arguments say, with parts beside the folder of results until those stand."""
    from losbench.checks import integer
    from losbench.recording.run import Run

    workers = integer("--workers", options.workers, low=1)
    out = Path(os.path.realpath(options.out))
    parts = out.with_name(f".{out.name}.parts")
    if options.resume and not parts.is_dir():
        raise ValueError(f"--resume: no run into {options.out} was cut off")
    if not options.resume:
        kept = len(list(parts.glob("part-*.npz")))
        if kept and not options.force:
            raise FileExistsError(
                f"{kept} parts of a run into {options.out} that was cut off are kept: go on with "
                "--resume, or begin anew with --force"
            )
        shutil.rmtree(parts, ignore_errors=True)
    with _executor(workers, options.scheduler) as executor:
        try:
            yield Run(
                executor=executor,
                chunk=options.chunk,
                out=parts,
                resume=options.resume,
                progress=not options.quiet,
            )
        except BaseException as error:
            kept = len(list(parts.glob("part-*.npz")))
            if kept:
                error.add_note(f"{kept} parts are kept: --resume goes on with them")
            raise
    shutil.rmtree(parts, ignore_errors=True)


@contextmanager
def _executor(workers: int, scheduler: str | None) -> Iterator[Any]:
    if scheduler is not None:
        try:
            from distributed import Client
        except ImportError:
            raise ImportError("--scheduler needs dask: pip install 'losbench[cluster]'") from None
        try:
            client = Client(scheduler)
        except (OSError, ValueError) as error:
            raise ValueError(f"--scheduler {scheduler} cannot be reached: {error}") from None
        with client:
            yield client.get_executor()
    elif workers > 1:
        # Not forked: threads of OpenCV and BLAS would come along half, and the lock on the results.
        # What interrupts this process at the terminal would reach them too: they end with it.
        pool = ProcessPoolExecutor(
            workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=signal.signal,
            initargs=(signal.SIGINT, signal.SIG_IGN),
        )
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)
    else:
        yield None
