"""Which terms? Added one by one as long as what was left out is predicted better."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats
from losbench.checks import integer, number
from losbench.estimation.robust import RobustFit
from losbench.estimation.solvers import Solver, as_part, read_solver
from losbench.pointing.thermal.design import bind, read_series
from losbench.pointing.thermal.folds import check_folds, read_folds, sigma_about_zero
from losbench.pointing.thermal.terms import Adds, Lagged, Model, Offset
from losbench.units import rad_to_arcsec

__all__ = ["Choice", "choose"]

_NEW = 1e-10  # of a column, beside the model: less is rounding, and explains nothing


@dataclass(frozen=True, repr=False)
class Choice:
    """Terms chosen for one axis.

    Attributes
    ----------
    model : Model
    path : tuple of (name, sigma) pairs
        What was added, in order, and the sigma of all folds left out, radians, from "offset" on.
    nested_sigma : float, radians
        Of predictions for folds that had no part in the choice either: the number to quote.
    nested_errors : (n,) array, radians
    picked : dict of int
        In how many of the nested choices each candidate was taken.
    folds : int
    """

    model: Model
    path: tuple[tuple[str, float], ...]
    nested_sigma: float
    nested_errors: Floats
    picked: Mapping[str, int]
    folds: int

    def __repr__(self) -> str:
        """The path in arcseconds."""
        lines = [f"{float(rad_to_arcsec(s)):10.3f}  + {name}" for name, s in self.path]
        lines.append(f"{float(rad_to_arcsec(self.nested_sigma)):10.3f}  nested")
        counts = [f"{name} {count}" for name, count in self.picked.items() if count]
        return "\n".join([*lines, f"picked in {self.folds} nested choices: {', '.join(counts)}"])


def choose(
    candidates: Mapping[str, Adds],
    angles: ArrayLike,
    sensors: Mapping[str, ArrayLike],
    time_s: ArrayLike,
    *,
    start: Adds | None = None,
    folds: str | int | ArrayLike = 5,
    solver: Solver | str = "irls",
    least_gain: float = 0.02,
    at_most: int = 8,
) -> Choice:
    """Add candidate terms one by one, each time the one that predicts folds left out best.

    Candidates are ranked with the weights that the solver gives the model so far; then the chosen
    model is solved anew. Errors are judged about zero by `sigma_about_zero`.

    Parameters
    ----------
    candidates : dict of terms
        By name; lags must be known numbers.
    angles : (n,) array, radians
        One axis.
    sensors, time_s, folds, solver
        As for `cross_validate`.
    start : terms, optional
        What every model has; an offset unless given.
    least_gain : float
        Stop where the best candidate takes less than this share off sigma.
    at_most : int
        Candidates to take.

    Returns
    -------
    Choice
        Of all data, and judged by choices that each did without one fold: an error that a choice
        has seen is no prediction.

    Raises
    ------
    ValueError
        As `cross_validate`; if fewer than three folds are given or a candidate has a lag to fit.

    Examples
    --------
    >>> from losbench.pointing.thermal.terms import Linear, Trend
    >>> rng = np.random.default_rng(1)
    >>> t, room, other = np.arange(600.0), rng.standard_normal(600), rng.standard_normal(600)
    >>> angle = 1e-6 * room + 1e-7 * rng.standard_normal(600)
    >>> found = choose(
    ...     {"room": Linear("room"), "other": Linear("other"), "trend": Trend(1)},
    ...     angle,
    ...     {"room": room, "other": other},
    ...     t,
    ...     folds=4,
    ... )
    >>> [name for name, _ in found.path], found.picked["room"]
    (['start', 'room'], 4)
    """
    parts: dict[str, Adds] = {"start": Offset() if start is None else start, **candidates}
    for name, part in parts.items():
        terms = part.terms if isinstance(part, Model) else (part,)
        if any(isinstance(term, Lagged) and term.free for term in terms):
            raise ValueError(f"candidates must have known lags, got one to fit in {name}")
    designs = {name: bind(part, sensors, time_s) for name, part in parts.items()}
    first = designs["start"]
    y = read_series(angles, first.time_s.size)
    if y.shape[1] != 1:
        raise ValueError(f"angles must be one axis (n,), got {y.shape}")
    fold, labels = read_folds(folds, first.time_s)
    if len(labels) < 3:
        raise ValueError(f"folds must be at least three for a nested choice, got {len(labels)}")
    known = np.isfinite(y[:, 0])
    for design in designs.values():
        known &= design.known
    check_folds(fold, labels, known)
    columns = {name: design.matrix(np.empty(0))[known] for name, design in designs.items()}
    search = _Search(
        columns,
        y[known, 0],
        fold[known],
        as_part(read_solver(solver, None, default="irls")),
        number("least_gain", least_gain, low=0.0, high=1.0),
        integer("at_most", at_most, low=1),
    )
    everything = list(range(len(labels)))
    path = search.forward(everything)
    errors = np.full(y.shape[0], np.nan)
    picked = dict.fromkeys(candidates, 0)
    inner = np.full(int(known.sum()), np.nan)
    for left in everything:
        names = [name for name, _ in search.forward([i for i in everything if i != left])]
        inner[search.fold == left] = search.errors(names, [left], everything)[search.fold == left]
        for name in names[1:]:
            picked[name] += 1
    errors[known] = inner
    terms = tuple(term for name, _ in path for term in designs[name].model.terms)
    nested = float(sigma_about_zero(errors[:, None])[0])
    return Choice(Model(terms), tuple(path), nested, errors, picked, len(labels))


@dataclass(frozen=True)
class _Search:
    """Columns of every candidate over the rows that know them all."""

    columns: Mapping[str, Floats]
    y: Floats
    fold: NDArray[np.intp]
    solver: Solver
    least_gain: float
    at_most: int
    fits: dict[Any, RobustFit] = field(default_factory=dict)
    solved: dict[Any, Mapping[str, tuple[Floats, Floats]]] = field(default_factory=dict)

    def forward(self, among: list[int]) -> list[tuple[str, float]]:
        """Names taken and sigma after each, over the folds in ``among``."""
        taken = ["start"]
        path = [("start", self._sigma(self.errors(taken, among, among)))]
        while len(taken) <= self.at_most and len(taken) < len(self.columns):
            ranked = self._ranked(taken, among)
            best = min(ranked, key=lambda name: ranked[name])
            sigma = self._sigma(self.errors([*taken, best], among, among))
            if not sigma < (1.0 - self.least_gain) * path[-1][1]:
                break
            taken.append(best)
            path.append((best, sigma))
        return path

    def errors(self, names: list[str], tested: list[int], among: list[int]) -> Floats:
        """Errors (n,) in the tested folds of fits to the others in ``among``; NaN elsewhere."""
        matrix = self._matrix(names)
        errors = np.full(self.y.size, np.nan)
        for left in tested:
            test = self.fold == left
            x = self._fit(tuple(names), frozenset(among) - {left}).x
            errors[test] = self.y[test] - matrix[test] @ x
        return errors

    def _matrix(self, names: Iterable[str]) -> Floats:
        return np.concatenate([self.columns[name] for name in names], axis=1)

    def _rows(self, folds: frozenset[int]) -> Bools:
        return np.isin(self.fold, list(folds))

    def _fit(self, names: tuple[str, ...], folds: frozenset[int]) -> RobustFit:
        """Fit to some folds; the choices without one fold and without another share many."""
        if (names, folds) not in self.fits:
            rows = self._rows(folds)
            self.fits[names, folds] = self.solver.fit(self._matrix(names)[rows], self.y[rows])
        return self.fits[names, folds]

    def _sigma(self, errors: Floats) -> float:
        return float(sigma_about_zero(errors[np.isfinite(errors)][:, None])[0])

    def _ranked(self, taken: list[str], among: list[int]) -> dict[str, float]:
        """Sigma of each candidate beside those taken."""
        base = self._matrix(taken)
        rest = [name for name in self.columns if name not in taken]
        errors = {name: np.full(self.y.size, np.nan) for name in rest}
        for left in among:
            test = self.fold == left
            solved = self._beside(tuple(taken), frozenset(among) - {left})
            for name in rest:
                x, gain = solved[name]
                fitted = base[test] @ x + self.columns[name][test] @ gain
                errors[name][test] = self.y[test] - fitted
        return {name: self._sigma(error) for name, error in errors.items()}

    def _beside(
        self, taken: tuple[str, ...], folds: frozenset[int]
    ) -> Mapping[str, tuple[Floats, Floats]]:
        """Unknowns of the model and of each further candidate, by the weights of the model
        alone.
        """
        if (taken, folds) in self.solved:
            return self.solved[taken, folds]
        rows = self._rows(folds)
        root = np.sqrt(self._fit(taken, folds).weights)
        q, r = np.linalg.qr(self._matrix(taken)[rows] * root[:, None])
        y = self.y[rows] * root
        plain = q.T @ y
        found = {}
        for name in self.columns:
            if name in taken:
                continue
            new = self.columns[name][rows] * root[:, None]
            shared = q.T @ new
            size = np.maximum(np.linalg.norm(new, axis=0), 1e-300)
            own = (new - q @ shared) / size
            own[:, np.linalg.norm(own, axis=0) < _NEW] = 0.0
            gain = np.linalg.lstsq(own.T @ own, own.T @ y, rcond=1e-12)[0] / size
            found[name] = np.linalg.lstsq(r, plain - shared @ gain, rcond=1e-12)[0], gain
        self.solved[taken, folds] = found
        return found
