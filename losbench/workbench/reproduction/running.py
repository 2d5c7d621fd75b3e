"""Run one notebook in a kernel of its own, the same way every time."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import shutil
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# The imports of Jupyter take seconds, and the process that starts the workers does without: they
# stand where needed.

__all__ = ["Run", "end_with_parent", "reads_others", "run_notebook"]

_QUIET_MACHINE = {
    "PYTHONHASHSEED": "0",
    "SOURCE_DATE_EPOCH": "0",
    **{
        f"{library}_NUM_THREADS": "1"
        for library in ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR")
    },
}


@dataclass(frozen=True)
class Run:
    """One notebook of a reproduction; ``error`` names the cell and is empty where all went well.

    ``memory_mb`` is the most that its kernel held, where the system tells it, else zero.
    """

    notebook: str
    seconds: float
    memory_mb: float = 0.0
    reused: bool = False
    error: str = ""
    products: tuple[str, ...] = ()


def end_with_parent() -> None:
    """Watch the process that started this worker: a worker whose parent was killed must not
    linger.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def reads_others(notebook: str) -> bool:
    """Whether a notebook reads what the others have written: it runs last, and in the build folder
    itself.
    """
    return notebook >= "90"


def run_notebook(path: Path, folder: Path, target: Path) -> Run:
    """Execute a notebook; it and whatever it saves go to ``folder``."""
    import nbformat

    started = time.perf_counter()
    for part in ("work", "notebooks"):
        (folder / part).mkdir(parents=True)
    build = target if reads_others(path.stem) else folder
    memory_mb = 0.0
    try:
        notebook = nbformat.read(path, as_version=4)
        error, memory_mb = _execute(notebook, path.name, cwd=folder / "work", build=build)
        if not error:
            nbformat.write(notebook, folder / "notebooks" / path.name)
    except Exception as problem:
        error = f"{path.name}: {type(problem).__name__}: {problem}"
    shutil.rmtree(folder / "work")
    products = tuple(sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()))
    return Run(path.stem, time.perf_counter() - started, memory_mb, error=error, products=products)


def _peak_mb(process: Any) -> float:
    """Return the most memory that a process has held, which Linux tells; elsewhere zero."""
    with suppress(OSError, AttributeError):
        status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
        return int(status.partition("VmHWM:")[2].split()[0]) / 1024
    return 0.0


def _execute(notebook: Any, name: str, *, cwd: Path, build: Path) -> tuple[str, float]:
    """Run all cells in a fresh kernel; return what went wrong, the cell named, and its memory."""
    from jupyter_client.manager import AsyncKernelManager
    from nbclient import NotebookClient
    from nbclient.exceptions import CellControlSignal, CellExecutionError, DeadKernelError

    current: dict[str, Any] = {"id": "none", "index": -1, "mb": 0.0}
    # Sockets in a temporary folder, where the system has such: no race for ports, nothing left
    # behind, and a path short enough for a socket.
    with tempfile.TemporaryDirectory(prefix="losbench-") as sockets:
        place = {"transport": "ipc", "ip": f"{sockets}/s"} if os.name == "posix" else {}
        manager = AsyncKernelManager(connection_file=f"{sockets}/kernel.json", **place)
        client = NotebookClient(
            notebook,
            km=manager,
            timeout=600,
            record_timing=False,
            store_widget_state=False,
            shutdown_kernel="immediate",
            resources={"metadata": {"path": str(cwd)}},
            on_cell_start=lambda cell, cell_index: current.update(id=cell.id, index=cell_index),
            on_cell_executed=lambda **_: current.update(mb=_peak_mb(manager.provisioner)),
        )
        environment = {
            **os.environ,
            **_QUIET_MACHINE,
            "LOSBENCH_BUILD": str(build),
            "IPYTHONDIR": sockets,
        }
        try:
            asyncio.run(client.async_execute(env=environment, cleanup_kc=True))
        except (CellControlSignal, DeadKernelError) as problem:
            where = f"{name}, cell {current['id']!r} (number {current['index'] + 1})"
            raised = isinstance(problem, CellExecutionError)
            said = f"{problem.ename}: {problem.evalue}" if raised else problem
            return f"{where}: {said}", current["mb"]
    return "", current["mb"]
