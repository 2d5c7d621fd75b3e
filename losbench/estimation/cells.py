"""Cells of a study: what is kept of each, in memory and on disk, and the table of all."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.display import html_table, with_error
from losbench.estimation.streams import Summary
from losbench.parts import Parts

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Cell", "Study", "cells_of"]

QUANTILES = (0.00135, 0.15865, 0.5, 0.84135, 0.99865)  # of a Gaussian, one and three sigma
_WHOLE = ("n", "left_out", "unconverged")


@dataclass(frozen=True)
class Study:
    """What a study found, cell by cell of its grid.

    Attributes
    ----------
    grid : dict of str to tuple
        Parameters and their values; cells are in order of their product, the last parameter
        changing fastest.
    names : tuple of str
        The p numbers of a trial: ``x``, or ``x[0]`` and ``x[0,1]`` where a trial returns arrays.
    summaries : tuple of Summary
        One a cell: ``n``, ``mean`` (p,), ``covariance`` (p, p), ``quantiles(...)`` (p, q).

    Examples
    --------
    >>> import losbench as lb
    >>> def throw(rng, size, faces):
    ...     return {"points": rng.integers(1, faces, size, endpoint=True)}
    >>> dice = lb.study(throw, {"faces": [6, 20]}, 5000, seed=1)
    >>> dice.cells
    [{'faces': 6}, {'faces': 20}]
    >>> dice.to_frame([0.5])["mean"].round().tolist(), dice.covariance(faces=6).shape
    ([3.0, 11.0], (1, 1))
    """

    grid: dict[str, tuple[Any, ...]]
    names: tuple[str, ...]
    summaries: tuple[Summary, ...]

    @property
    def cells(self) -> list[dict[str, Any]]:
        """The parameters of each cell."""
        return cells_of(self.grid)

    def to_frame(self, quantiles: Sequence[float] = QUANTILES) -> pd.DataFrame:
        """Return one row for each cell and number: trials, failures, mean with its one-sigma error,
        standard deviation, and quantiles.
        """
        import pandas as pd

        places, rows = [], []
        for cell, summary in zip(self.cells, self.summaries, strict=True):
            sigma = np.sqrt(np.diagonal(summary.covariance))
            found = summary.quantiles(list(quantiles))
            for k, name in enumerate(self.names):
                places.append([*map(_shown, cell.values()), name])
                rows.append(
                    {
                        "n": summary.n,
                        "left_out": summary.left_out,
                        "unconverged": summary.unconverged,
                        "mean": summary.mean[k] if summary.n else np.nan,
                        "error": sigma[k] / np.sqrt(max(summary.n, 1)),
                        "std": sigma[k],
                        **{f"q{q:g}": x for q, x in zip(quantiles, found[k], strict=True)},
                    }
                )
        # Not as columns first: a parameter may have the name of one, as n.
        axes = zip([*self.grid, "quantity"], zip(*places, strict=True), strict=True)
        return pd.DataFrame(rows).set_index([pd.Series(each, name=name) for name, each in axes])

    def covariance(self, **cell: Any) -> pd.DataFrame:
        """Return the covariance (p, p) of one cell's numbers."""
        import pandas as pd

        asked = [(name, _shown(value)) for name, value in cell.items()]
        shown = ({name: _shown(value) for name, value in each.items()} for each in self.cells)
        chosen = [k for k, each in enumerate(shown) if all(ask in each.items() for ask in asked)]
        if len(chosen) != 1:
            raise ValueError(f"cell must name one cell of {list(self.grid)}, got {len(chosen)}")
        return pd.DataFrame(self.summaries[chosen[0]].covariance, self.names, self.names)

    def _repr_html_(self) -> str:
        table = self.to_frame([0.5])
        heads = [*self.grid, "quantity", "mean", "std", "n"]
        rows = (
            [*(key if isinstance(key, tuple) else (key,)), with_error(mean, error), f"{std:.6g}", n]
            for key, mean, error, std, n in zip(
                table.index, *(table[c] for c in ("mean", "error", "std", "n")), strict=True
            )
        )
        title = f"Study of {len(self.summaries)} cells"
        return html_table(title, heads, rows, count=len(table), note=self.said or "")

    @property
    def said(self) -> str | None:
        """What the reader of the table must know: fits that failed, trials left out."""
        failed, left, n = (
            sum(getattr(each, name) for each in self.summaries)
            for name in ("unconverged", "left_out", "n")
        )
        said = []
        if failed:
            said.append(
                f"{failed} fits in {n + left} trials did not converge, and count all the same"
            )
        if left:
            said.append(f"{left} of {n + left} trials are left out for numbers that are not finite")
        return f"study: {'; '.join(said)}; see .to_frame()" if said else None


@dataclass(frozen=True)
class Cell:
    """What is kept of one cell, or of a chunk of it: the names of its numbers and their summary."""

    names: tuple[str, ...]
    summary: Summary

    @classmethod
    def of(
        cls,
        result: Mapping[str, NDArray[Any]],
        unconverged: int,
        middle: tuple[Floats, Floats] | None,
    ) -> Cell:
        """Summarise arrays (size, ...) by name."""
        names, rows = [], []
        for name, values in result.items():
            if values.dtype.kind not in "buif":
                raise ValueError(f"trial must return numbers, got {name} of {values.dtype}")
            names += [_label(str(name), place) for place in np.ndindex(*values.shape[1:])]
            rows.append(values.reshape(len(values), -1).T)
        if not names:
            raise ValueError("trial must return at least one array of numbers, got none")
        if len(set(names)) < len(names):
            raise ValueError(f"trial must return numbers of different names, got {names}")
        if middle is not None and len(middle[0]) != len(names):
            raise ValueError(
                f"trial must return the same names every time, got {names} after "
                f"{len(middle[0])} in the first chunk"
            )
        together = np.empty((len(names), len(values)))  # row by row, whatever order came
        np.concatenate(rows, out=together)
        centre, unit = middle or (None, None)
        return cls(tuple(names), Summary.of(together, unconverged, centre=centre, spread=unit))

    @classmethod
    def read(cls, parts: Parts, number: int) -> Cell | None:
        """Return a cell that was kept, or None."""
        held: dict[str, Any] | None = parts.read(_file(number))
        if held is None or held.keys() != {"names", *(field.name for field in fields(Summary))}:
            return None
        names = tuple(held.pop("names").tolist())
        return cls(names, Summary(**held | {name: int(held[name]) for name in _WHOLE}))

    def write(self, parts: Parts, number: int) -> None:
        """Keep a cell."""
        arrays: dict[str, Any] = {f.name: getattr(self.summary, f.name) for f in fields(Summary)}
        parts.write(_file(number), {"names": np.array(self.names), **arrays})

    @property
    def middle(self) -> tuple[Floats, Floats]:
        """Where its histogram counts from, and its unit."""
        return self.summary.centre, self.summary.spread

    def merged(self, other: Cell) -> Cell:
        """Return both together."""
        if other.names != self.names:
            raise ValueError(
                "trial must return the same names every time, got "
                f"{list(self.names)} and {list(other.names)}"
            )
        return Cell(self.names, self.summary.merged(other.summary))


def cells_of(axes: Mapping[str, tuple[Any, ...]]) -> list[dict[str, Any]]:
    """Return the parameters of every combination, the last changing fastest."""
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def _shown(value: Any) -> Any:
    """Return a value as it may stand in an index: lists and arrays by their text."""
    try:
        hash(value)
    except TypeError:
        return " ".join(repr(value).split())
    return value


def _label(name: str, place: tuple[int, ...]) -> str:
    return f"{name}[{','.join(map(str, place))}]" if place else name


def _file(number: int) -> str:
    return f"cell-{number:06d}"
