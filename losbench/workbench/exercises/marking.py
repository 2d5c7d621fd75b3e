"""Marking by hidden seeds: each notebook is run again with data that its author has not seen.

An answer that is a method is right for any seed, one that is a number for its own alone. The code
that runs is a stranger's: each notebook has a process of its own, with a limit of time and memory,
in an empty folder. That guards against accidents, not against malice.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from losbench.workbench.exercises.desk import EXERCISES, Exercises, Judgement

__all__ = ["Mark", "mark_folder", "mark_notebook"]


@dataclass(frozen=True)
class Mark:
    """How a notebook did: of each exercise the share of seeds for which it was right.

    ``problem`` tells why nothing could be marked, or which cell failed first.
    """

    notebook: str
    shares: dict[int, float] = field(default_factory=dict)
    problem: str = ""

    @property
    def right(self) -> float:
        """Exercises right, of as many as there are; NaN where nothing could be marked."""
        return sum(self.shares.values()) if self.shares else float("nan")

    def row(self) -> dict[str, str]:
        """Return the row of the table of marks; empty where nothing could be marked."""
        numbers = {f"ex{k:02d}": f"{self.shares[k]:.2f}" if self.shares else "" for k in EXERCISES}
        right = f"{self.right:.2f}" if self.shares else ""
        return {
            "notebook": self.notebook,
            "right": right,
            "of": str(len(EXERCISES)),
            **numbers,
            "problem": self.problem,
        }


def mark_folder(
    folder: str | Path, seeds: Sequence[int], *, seconds: float = 120.0, memory_mb: int = 4096
) -> Iterator[Mark]:
    """Mark every notebook in a folder and the folders within it, by name.

    Parameters
    ----------
    folder : path
        What was handed in.
    seeds : sequence of int
        Hidden from the students; three or more.
    seconds, memory_mb : float, int
        Limits for one notebook with all seeds. Where the system cannot limit memory, as on Windows,
        it is not limited.

    Raises
    ------
    ValueError
        If there is no notebook.
    """
    root = Path(folder)
    found = [p for p in sorted(root.rglob("*.ipynb")) if ".ipynb_checkpoints" not in p.parts]
    if not found:
        raise ValueError(f"{root} must hold notebooks (*.ipynb), but there is none")
    for path in found:
        name = path.relative_to(root).as_posix()
        yield mark_notebook(path, seeds, name=name, seconds=seconds, memory_mb=memory_mb)


def mark_notebook(
    path: Path, seeds: Sequence[int], *, name: str, seconds: float, memory_mb: int
) -> Mark:
    """Mark one notebook in a process of its own, which ends with all that it has started."""
    asked = json.dumps({"path": str(path.resolve()), "seeds": list(seeds), "memory_mb": memory_mb})
    with (
        tempfile.TemporaryDirectory(prefix="losbench-mark-", ignore_cleanup_errors=True) as spare,
        subprocess.Popen(
            [sys.executable, "-m", "losbench.workbench.exercises.marking"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=spare,
            env=_environment(spare),
            start_new_session=True,
        ) as process,
    ):
        try:
            said, _ = process.communicate(asked, timeout=seconds)
        except subprocess.TimeoutExpired:
            return Mark(name, problem=f"not done after {seconds:g} s")
        finally:
            _end(process)
    try:
        found = json.loads(said.splitlines()[-1])
    except (IndexError, json.JSONDecodeError):
        return Mark(name, problem=f"its process ended with {process.returncode}: memory?")
    shares = {int(number): float(share) for number, share in found["shares"].items()}
    return Mark(name, shares, found["problem"])


def _environment(folder: str) -> dict[str, str]:
    places = dict.fromkeys(("HOME", "USERPROFILE", "IPYTHONDIR", "MPLCONFIGDIR"), folder)
    kept = ("PATH", "PYTHONPATH", "SYSTEMROOT", "LANG", "LOSBENCH_DATA")
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    return {
        **{name: os.environ[name] for name in kept if name in os.environ},
        **places,
        **threads,
        "MPLBACKEND": "Agg",
        "LOSBENCH_BUILD": os.path.join(folder, "build"),
    }


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and what it has started."""
    if os.name == "posix":
        import signal

        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


class _Marked(Exercises):
    """Exercises of a hidden seed, whatever seed the notebook names; what they judge is kept.

    A check says nothing, so that no loop can ask until it is right; the last answer counts.
    """

    hidden = 0
    right: dict[int, bool]
    made = False

    def __init__(self, seed: int = 1) -> None:
        super().__init__(_Marked.hidden)
        _Marked.made = True

    def _judge(self, number: int, answer: Any) -> Judgement:
        _Marked.right[number] = super()._judge(number, answer).right
        return Judgement(False, f"ex{number:02d}: marked.")


def _main() -> None:
    """Mark what standard input asks for; in a process of its own."""
    asked = json.loads(sys.stdin.read())
    answer = os.fdopen(os.dup(1), "w")
    # What the notebook prints goes nowhere: the answer has the pipe for itself.
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    _limit(asked["memory_mb"])
    import nbformat

    cells = nbformat.read(asked["path"], as_version=4).cells
    sources = [cell.source for cell in cells if cell.cell_type == "code"]
    shares, problem = _run(sources, asked["seeds"])
    answer.write("\n" + json.dumps({"shares": shares, "problem": problem}) + "\n")
    answer.flush()
    os._exit(0)


def _run(sources: Sequence[str], seeds: Sequence[int]) -> tuple[dict[int, float], str]:
    from IPython.core.interactiveshell import InteractiveShell

    import losbench.workbench.exercises as room

    room.Exercises = room.desk.Exercises = _Marked  # type: ignore[misc]
    counts, problem = dict.fromkeys(EXERCISES, 0), ""
    for seed in seeds:
        _Marked.hidden, _Marked.right, _Marked.made = seed, {}, False
        shell = InteractiveShell()
        shell.history_manager.enabled = False
        for number, source in enumerate(sources, start=1):
            done = shell.run_cell(source, store_history=False)
            error = done.error_before_exec or done.error_in_exec
            if error and not problem:
                problem = f"code cell {number}: {type(error).__name__}: {error}"
        if not _Marked.made:
            return {}, problem or "no cell makes Exercises"
        for number in counts:
            counts[number] += _Marked.right.get(number, False)
    return {number: count / len(seeds) for number, count in counts.items()}, problem


def _limit(memory_mb: int) -> None:
    with suppress(ImportError, ValueError, OSError):
        import resource

        most = memory_mb * 2**20
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


if __name__ == "__main__":
    _main()
