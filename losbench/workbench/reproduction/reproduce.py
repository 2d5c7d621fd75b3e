"""Run the notebooks and gather every figure, table and verdict.

A notebook works in a folder of its own, which is moved into the build folder only when all its
cells have run: what lies there is whole, whatever interrupted the run. A notebook whose inputs have
not changed is not run again.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import distributions
from pathlib import Path

from tqdm import tqdm

from losbench.checks import integer
from losbench.outputs import locked
from losbench.resources import build_folder, data_file, notebook_folder, write_whole
from losbench.workbench.ledger.claims import COLUMNS, accept, accepted_verdicts, as_csv
from losbench.workbench.ledger.ledger import Ledger
from losbench.workbench.reproduction.running import Run, end_with_parent, reads_others, run_notebook
from losbench.workbench.reproduction.site import build_site, can_build

__all__ = ["Reproduction", "reproduce"]


@dataclass(frozen=True)
class Reproduction:
    """What a reproduction did; ``changed`` lists the verdicts that are not the accepted ones.

    ``site`` is the first page of the site, where one was built, ``problem`` why it was not.
    """

    runs: list[Run]
    changed: list[str]
    out: Path
    counts: dict[str, int] = field(default_factory=dict)
    site: Path | None = None
    problem: str = ""

    @property
    def ok(self) -> bool:
        """Whether every notebook ran, the site was built and every verdict is the accepted one."""
        return not (self.changed or self.problem or any(run.error for run in self.runs))

    def summary(self) -> str:
        """Return time and memory per notebook, what failed, and the verdicts, as text."""
        width = max((len(run.notebook) for run in self.runs), default=0)
        lines = [
            f"{run.notebook:<{width}}  {run.seconds:6.1f} s  {run.memory_mb:5.0f} MB  "
            f"{'FAILED' if run.error else 'unchanged' * run.reused}"
            for run in self.runs
        ]
        lines += [f"\n{run.error}" for run in self.runs if run.error]
        if self.changed:
            lines += [
                "",
                "Verdicts that differ from the accepted ones (--accept takes them):",
                *self.changed,
            ]
        lines += [f"\n{self.problem}"] * bool(self.problem)
        verdicts = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items())
        last = [
            "",
            f"Claims: {verdicts}.",
            f"Written to {self.out}"
            + (f"; open {self.site}" if self.site else "; losbench site makes pages of it."),
        ]
        return "\n".join([*(line.rstrip() for line in lines), *last])


def reproduce(
    select: Sequence[str] = (),
    *,
    workers: int = 2,
    out: str | Path | None = None,
    force: bool = False,
    accept_verdicts: bool = False,
    quiet: bool = False,
    notebooks: str | Path | None = None,
    site: bool = True,
) -> Reproduction:
    """Run the notebooks in a process pool and gather figures, tables and the ledger.

    Of all notebooks a site is built too, if the extra ``docs`` is installed.

    Parameters
    ----------
    select : sequence of str
        Numbers or beginnings of notebook names, e.g. "03" or "3"; by default all.
    workers : int
        Notebooks that run at a time.
    out : path, optional
        Where the output goes, by default the build folder.
    force : bool
        Run also what has not changed since the last run.
    accept_verdicts : bool
        Make the verdicts found the accepted ones, instead of comparing them.
    quiet : bool
        No progress bar.
    notebooks : path, optional
        The folder of the notebooks, by default the one that losbench ships.
    site : bool
        Build the site too.

    Returns
    -------
    Reproduction
        ``ok``, and ``summary()`` for the terminal.

    Raises
    ------
    ValueError
        If nothing matches ``select``.
    OSError
        If nothing can be written to ``out``, or another run writes there.
    """
    integer("workers", workers, low=1)
    source = Path(notebooks or notebook_folder())
    target = Path(out or build_folder()).resolve()
    every = sorted(source.glob("[0-9]*.ipynb"))
    begins = tuple(text.zfill(2) if text.isdigit() else text for text in select)  # 3 means 03
    chosen = [path for path in every if not begins or path.name.startswith(begins)]
    if not chosen:
        raise ValueError(f"no notebook begins with {', '.join(select) or 'a number'} in {source}")
    with locked(target):
        target.mkdir(parents=True, exist_ok=True)
        _recover(target)
        _forget(target, keep={path.stem for path in every})
        runs = _run_all(chosen, target, workers=workers, force=force, quiet=quiet)
        changed, counts = _settle(
            target, complete=not select, accept_verdicts=accept_verdicts, runs=runs
        )
        first, problem = _site(source, target) if site and not select else (None, "")
    return Reproduction(runs, changed, target, counts, first, problem)


def _site(source: Path, target: Path) -> tuple[Path | None, str]:
    if not can_build():
        return None, ""
    try:
        return build_site(out=target, notebooks=source), ""
    except ValueError as problem:
        return None, str(problem)


def _run_all(
    chosen: list[Path], target: Path, *, workers: int, force: bool, quiet: bool
) -> list[Run]:
    common = _common_inputs()
    inputs = {path: hashlib.sha256(common + path.read_bytes()).hexdigest() for path in chosen}
    old = {path: None if force else _reusable(path.stem, inputs[path], target) for path in chosen}
    due = [path for path in chosen if old[path] is None]
    first = [path for path in due if not reads_others(path.stem)]
    last = [path for path in due if reads_others(path.stem)]
    runs = {path.stem: run for path, run in old.items() if run is not None}
    with (
        _stoppable(),
        tempfile.TemporaryDirectory(
            prefix=".running-", dir=target, ignore_cleanup_errors=True
        ) as stage,
        tqdm(total=len(due), unit="notebook", disable=quiet or not due) as bar,
    ):
        for batch in (first, last):
            for run in _run_batch(batch, Path(stage), target, min(workers, len(batch))):
                _install(
                    run,
                    inputs[next(p for p in batch if p.stem == run.notebook)],
                    Path(stage),
                    target,
                )
                runs[run.notebook] = run
                bar.set_postfix_str(run.notebook)
                bar.update()
    return [runs[name] for name in sorted(runs)]


def _run_batch(batch: list[Path], stage: Path, target: Path, workers: int) -> Iterator[Run]:
    if not batch:
        return
    # A fresh interpreter per worker: nothing of this process, neither threads nor settings, reaches
    # a notebook.
    with ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=end_with_parent
    ) as pool:
        try:
            tasks = [pool.submit(run_notebook, path, stage / path.stem, target) for path in batch]
            for task in as_completed(tasks):
                yield task.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise


@contextmanager
def _stoppable() -> Iterator[None]:
    """Let a request to terminate unwind as Ctrl-C does, so that workers and half-made files go
    too.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _install(run: Run, inputs: str, stage: Path, target: Path) -> None:
    """Put what a notebook made in place of what it made before; a failed one leaves nothing that
    looks like its own.
    """
    _discard(run.notebook, target)
    if run.error:
        return
    for product in run.products:
        (target / product).parent.mkdir(parents=True, exist_ok=True)
        (stage / run.notebook / product).replace(target / product)
    write_whole(
        _record(run.notebook, target),
        json.dumps({"inputs": inputs, **asdict(run)}, indent=1) + "\n",
    )


def _reusable(notebook: str, inputs: str, target: Path) -> Run | None:
    """Return the earlier run if its inputs were the same and all that it made is still there."""
    if reads_others(notebook):
        return None
    with suppress(FileNotFoundError, json.JSONDecodeError, KeyError):
        record = json.loads(_record(notebook, target).read_text(encoding="utf-8"))
        if record["inputs"] == inputs and all(
            (target / product).is_file() for product in record["products"]
        ):
            return Run(
                notebook,
                record["seconds"],
                memory_mb=record["memory_mb"],
                reused=True,
                products=tuple(record["products"]),
            )
    return None


def _discard(notebook: str, target: Path) -> None:
    record = _record(notebook, target)
    with suppress(FileNotFoundError, json.JSONDecodeError):
        for product in json.loads(record.read_text(encoding="utf-8"))["products"]:
            (target / product).unlink(missing_ok=True)
    record.unlink(missing_ok=True)


def _recover(target: Path) -> None:
    """Put right what a killed run left: the site that it had set aside back, drafts away."""
    for draft in target.glob(".site-*"):
        if (draft / "old").is_dir() and not (target / "site").exists():
            (draft / "old").rename(target / "site")
        shutil.rmtree(draft, ignore_errors=True)
    for draft in target.glob(".running-*"):
        shutil.rmtree(draft, ignore_errors=True)


def _forget(target: Path, keep: set[str]) -> None:
    """Remove what notebooks that no longer exist have left."""
    for record in (target / "runs").glob("*.json"):
        if record.stem not in keep:
            _discard(record.stem, target)


def _record(notebook: str, target: Path) -> Path:
    return target / "runs" / f"{notebook}.json"


def _common_inputs() -> bytes:
    """Digest what every notebook depends on: the library, its data, the installed packages, the
    commit it states.
    """
    from losbench.figures import commit

    package = Path(__file__).resolve().parent.parent
    files = [*package.rglob("*.py"), *data_file("claims.csv").parent.iterdir()]
    digest = hashlib.sha256(commit().encode())
    for path in sorted(files):
        if path.is_file() and path.name != "verdicts.csv":
            digest.update(path.name.encode() + path.read_bytes())
    digest.update(repr(sorted((d.name, d.version) for d in distributions())).encode())
    return digest.digest()


def _settle(
    target: Path,
    *,
    complete: bool,
    accept_verdicts: bool,
    runs: Iterable[Run],
) -> tuple[list[str], dict[str, int]]:
    """Write the ledger; return the verdicts that are not the accepted ones, and how many there are
    of each.
    """
    rows = list(Ledger.collect(target / "ledger").rows())
    write_whole(target / "ledger.csv", as_csv(COLUMNS, rows))
    found = {row["id"]: row["verdict"] for row in rows}
    examined = {id_ for id_, verdict in found.items() if verdict != "pending"}
    counts = {
        verdict: list(found.values()).count(verdict) for verdict in sorted(set(found.values()))
    }
    if accept_verdicts and not any(run.error for run in runs):
        kept = (
            found if complete else {**accepted_verdicts(), **{id_: found[id_] for id_ in examined}}
        )
        accept({id_: kept[id_] for id_ in found if id_ in kept})
        return [], counts
    changed = [
        f"  {id_}: accepted {verdict}, found {found.get(id_, 'no such claim')}"
        for id_, verdict in accepted_verdicts().items()
        if found.get(id_) != verdict and (complete or id_ in examined)
    ]
    return changed, counts
