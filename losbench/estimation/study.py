"""Monte Carlo over a grid of parameters, in the memory of a few chunks."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence, Set
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import boolean, integer
from losbench.estimation.cells import Cell, Study, cells_of
from losbench.estimation.identity import identity
from losbench.estimation.montecarlo import trials_of
from losbench.estimation.robust.failures import failures_counted
from losbench.parts import kept_parts
from losbench.spread import IN_FLIGHT, spread

__all__ = ["Study", "study"]

_RUN, _RUNS = 16, 64  # chunks that are merged before they travel, where there are so many runs


def study(
    trial: Callable[..., Mapping[str, ArrayLike]],
    grid: Mapping[str, Sequence[Any]],
    n: int,
    *,
    seed: int,
    executor: Any = None,
    chunk: int = 10_000,
    out: str | Path | None = None,
    resume: bool = False,
    progress: bool = False,
) -> Study:
    """Run ``n`` trials in every cell of a grid, and keep mean, covariance and quantiles.

    Parameters
    ----------
    trial : callable
        ``trial(rng, size, **cell)`` runs ``size`` trials at once and returns a dict of arrays
        (size, ...) of numbers. Fits of `losbench` in it that do not converge are counted; for
        others, return an array of bool named ``converged``.
    grid : mapping of str to sequence
        Parameters of the trial and their values: every combination is a cell. ``{}`` is one cell.
        No two names may be the same text, and none ``quantity``, which is a level of the table.
    n : int
        Trials in each cell.
    seed : int
        Root of the streams: chunk k of all chunks of all cells draws from child k, so that no two
        cells share their draws, and a grid ``{}`` draws as `monte_carlo` does.
    executor : optional
        As for `monte_carlo`: the result has the same bytes with any.
    chunk : int
        Trials per call, a part of the recipe.
    out : path, optional
        Folder that keeps a file for each cell that is done.
    resume : bool
        Go on with the cells of an earlier run in ``out``, of the same recipe and trial: its code,
        its defaults and all that it closes over or finds under global names, objects by what pickle
        would keep of them and by their ``__call__``. Not lists, dicts, sets, deques, iterators and
        generators of random numbers that it reaches by name, which may keep account of its calls.
        Functions of other modules, classes and modules count by name only, and what cannot be
        pickled by the name of its type.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Study
        ``.to_frame()`` is its table.

    Raises
    ------
    ValueError
        If an argument is out of range, a trial returns other than numbers, or ``out`` holds another
        study.
    FileExistsError
        If ``out`` holds anything and is not resumed.
    BlockingIOError
        If another run writes to ``out``.

    Warns
    -----
    RuntimeWarning
        Once, if fits did not converge, or trials were left out for a number that is not finite.

    Notes
    -----
    Memory does not grow with ``n``. A quantile is known to 1 / 512 of the spread (the scaled median
    absolute deviation) up to eight of them from the median, to 0.4 % of its distance beyond.

    Examples
    --------
    >>> import losbench as lb
    >>> def throw(rng, size, sigma):
    ...     return {"x": sigma * rng.standard_normal(size)}
    >>> table = lb.study(throw, {"sigma": [1.0, 3.0]}, 20_000, seed=1).to_frame()
    >>> table["std"].round(1).tolist()
    [1.0, 3.0]
    """
    axes = _axes(grid)
    cells = cells_of(axes)
    size, count = integer("chunk", chunk, low=1), integer("n", n, low=1)
    root, shown = integer("seed", seed, low=0), boolean("progress", progress)
    chunks = -(-count // size)
    sizes = [min(size, count - k * size) for k in range(chunks)]
    # Many chunks are merged where they are made, in runs that depend on nothing else.
    together = max(1, min(_RUN, chunks // _RUNS))
    recipe: dict[str, Any] = {"n": count, "seed": root, "chunk": size}
    if out is not None:
        recipe |= {
            "trial": _text(trial),
            "what it uses": identity(trial),
            "grid": repr({name: len(values) for name, values in axes.items()}),
            "values": identity(axes),
        }
    found: dict[int, Cell] = {}
    with kept_parts(out, recipe, resume=resume) as parts:
        for c in range(len(cells)):
            kept = Cell.read(parts, c)
            if kept is not None:
                found[c] = kept
        missing = [c for c in range(len(cells)) if c not in found]
        bar = _bar(chunks * len(missing), shown)
        # A group at a time: first its first chunks, whose spread all the others count in.
        for first in range(0, len(missing), IN_FLIGHT):
            group = missing[first : first + IN_FLIGHT]
            named = partial(_named, root, cells)
            work = partial(_run, trial, root, chunks)
            heads = [(c, cells[c], 0, sizes[:1], None) for c in group]
            first_parts = spread(work, heads, executor=executor, named=named)
            for c, head in zip(group, first_parts, strict=True):
                found[c] = head
                bar.update()
                if chunks == 1:
                    found[c].write(parts, c)
            rest = [(c, k) for c in group for k in range(1, chunks, together)]
            jobs = ((c, cells[c], k, sizes[k : k + together], found[c].middle) for c, k in rest)
            other_parts = spread(work, jobs, executor=executor, named=named)
            for (c, k), part in zip(rest, other_parts, strict=True):
                found[c] = found[c].merged(part)
                bar.update(min(together, chunks - k))
                if k + together >= chunks:
                    found[c].write(parts, c)
        bar.close()
    names = {cell.names for cell in found.values()}
    if len(names) > 1:
        listed = " and ".join(str(list(each)) for each in sorted(names)[:2])
        raise ValueError(f"trial must return the same names in every cell, got {listed}")
    result = Study(axes, names.pop(), tuple(found[c].summary for c in range(len(cells))))
    if result.said:
        warnings.warn(result.said, RuntimeWarning, stacklevel=2)
    return result


def _run(
    trial: Callable[..., Mapping[str, ArrayLike]],
    seed: int,
    chunks: int,
    c: int,
    cell: dict[str, Any],
    first: int,
    sizes: list[int],
    middle: tuple[Floats, Floats] | None,
) -> Cell:
    """Run chunks of one cell, one after another, and return what is kept of them."""

    def chunk(k: int, size: int) -> Cell:
        with failures_counted() as tally:
            result = trials_of(trial, seed, c * chunks + k, size, **cell)
        done = result.pop("converged", None)
        if done is not None and (done.dtype != bool or done.ndim != 1):
            raise ValueError(
                f"converged must be an array of bool ({size},), got {done.dtype} with {done.shape}"
            )
        failed = tally.failed if done is None else int(np.count_nonzero(~done))
        return Cell.of(result, failed, middle)

    return reduce(Cell.merged, (chunk(k, size) for k, size in enumerate(sizes, first)))


def _named(
    seed: int,
    cells: list[dict[str, Any]],
    c: int,
    cell: object,
    first: int,
    sizes: list[int],
    *_: object,
) -> str:
    which = f"chunk {first}" if len(sizes) == 1 else f"chunks {first} to {first + len(sizes) - 1}"
    return f"{which} of cell {c} {cells[c] or ''}, {sum(sizes)} trials of seed {seed}"


def _axes(grid: Mapping[str, Sequence[Any]]) -> dict[str, tuple[Any, ...]]:
    if not isinstance(grid, Mapping):
        raise ValueError(f"grid must be a mapping of names to values, got {type(grid).__name__}")
    names = [str(name) for name in grid]
    if len({*names, "quantity"}) <= len(names):
        raise ValueError(f"grid must hold different names, none of them 'quantity', got {names}")
    axes = {}
    for name, values in grid.items():
        # Sets have no order, or another in every process.
        wrong = isinstance(values, str | bytes | Set | Mapping) or not np.iterable(values)
        array: Any = np.asarray(values) if hasattr(values, "dtype") else None
        plain = array is not None and array.ndim == 1 and array.dtype.kind not in "mM"
        held = () if wrong else tuple(array.tolist() if plain else values)
        if not held:
            raise ValueError(f"grid must hold a sequence of values for {name}, got {values!r}")
        axes[str(name)] = held
    return axes


def _text(trial: Any) -> str:
    """What a trial is called where it is not the one of before."""
    if isinstance(trial, partial):
        return _text(trial.func)
    routine = trial if inspect.isroutine(trial) else type(trial)
    try:
        return inspect.getsource(routine)
    except (OSError, TypeError):
        return str(routine.__qualname__)


def _bar(total: int, shown: bool) -> Any:
    from tqdm.auto import tqdm

    return tqdm(total=total, unit="chunk", disable=not shown)
