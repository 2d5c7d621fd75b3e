"""Monte Carlo in chunks that do not care who runs them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.checks import boolean, integer, unmasked
from losbench.spread import spread

__all__ = ["Trial", "monte_carlo", "trials_of"]

Trial = Callable[[np.random.Generator, int], Mapping[str, ArrayLike]]


def monte_carlo(
    trial: Trial,
    n: int,
    *,
    seed: int,
    executor: Any = None,
    chunk: int = 1000,
    progress: bool = False,
) -> dict[str, NDArray[Any]]:
    """Run ``n`` trials, in chunks that each have their own random stream.

    Parameters
    ----------
    trial : callable
        ``trial(rng, size)`` runs ``size`` trials at once and returns a dict of arrays (size, ...).
        What is masked becomes NaN.
    n : int
        Number of trials.
    seed : int
        Root of the streams: chunk k draws from child k of ``SeedSequence(seed)``.
    executor : optional
        Anything with the ``submit`` or ``map`` of concurrent.futures: a pool of threads or
        processes, or what a dask client's ``get_executor()`` returns. The result has the same bits
        with any of them, and with none.
    chunk : int
        Trials per call. It is part of the recipe: another chunk size draws other numbers.
    progress : bool
        Show a progress bar.

    Returns
    -------
    dict of (n, ...) arrays

    Raises
    ------
    ValueError
        If a count is not a positive whole number, or a trial returns arrays of the wrong length, or
        other names or shapes than the first chunk.
    TypeError
        If the executor has neither ``map`` nor ``submit``.

    Examples
    --------
    >>> def throw(rng, size):
    ...     return {"x": rng.standard_normal(size)}
    >>> bool(abs(monte_carlo(throw, 4000, seed=1)["x"].mean()) < 0.05)
    True
    """
    count, size = integer("n", n, low=1), integer("chunk", chunk, low=1)
    root = integer("seed", seed, low=0)
    jobs = ((k, min(size, count - k * size)) for k in range(-(-count // size)))
    results: Iterator[dict[str, NDArray[Any]]] = spread(
        partial(trials_of, trial, root), jobs, executor=executor, named=partial(_named, root)
    )
    if boolean("progress", progress):
        from tqdm.auto import tqdm

        results = tqdm(results, total=-(-count // size), unit="chunk")
    return _join(list(results))


def trials_of(
    trial: Callable[..., Mapping[str, ArrayLike]],
    seed: int,
    k: int,
    size: int,
    /,  # any name may be a parameter's
    **parameters: Any,
) -> dict[str, NDArray[Any]]:
    """Run the ``size`` trials of chunk ``k``, and check what they return."""
    # What spawn() would give as its child k, without the children before it.
    stream = np.random.SeedSequence(seed, spawn_key=(k,))
    found = trial(np.random.default_rng(stream), size, **parameters)
    if not isinstance(found, Mapping):
        raise ValueError(
            f"trial must return a dict of arrays ({size}, ...), got {type(found).__name__}"
        )
    result = {name: unmasked(values) for name, values in found.items()}
    for name, values in result.items():
        if values.shape[:1] != (size,):
            raise ValueError(
                f"trial must return arrays ({size}, ...) for size={size}, got {name} with "
                f"{values.shape}"
            )
    return result


def _named(seed: int, k: int, size: int) -> str:
    return f"chunk {k}, {size} trials of seed {seed}"


def _join(parts: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    first = parts[0]
    for k, part in enumerate(parts):
        if set(part) != set(first):
            raise ValueError(
                f"trial must return the same names every time, got {list(first)} and {list(part)} "
                f"in chunk {k}"
            )
        for name, values in part.items():
            if _form(values) != _form(first[name]):
                raise ValueError(
                    f"trial must return arrays of one form every time, got {name} with "
                    f"{first[name].shape} of {first[name].dtype} and {values.shape} of "
                    f"{values.dtype} in chunk {k}"
                )
    return {name: np.concatenate([part[name] for part in parts]) for name in first}


def _form(values: NDArray[Any]) -> tuple[str, tuple[int, ...]]:
    """What NumPy cannot put together, or, as numbers with text, should not."""
    kind = values.dtype.kind
    return "number" if kind in "buifc" else kind, values.shape[1:]
