"""How to solve A x = y, as an object that can be handed on: the choice, where `irls` is the call.

Whatever takes a solver takes one of these four, its name, or any object with ``fit(A, y, group)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol

from numpy.typing import ArrayLike

from losbench.checks import choice, number
from losbench.estimation.highbreakdown import lts, mm
from losbench.estimation.highbreakdown.search import Random
from losbench.estimation.losses import Huber, Loss, read_loss
from losbench.estimation.robust import RobustFit, irls, lstsq
from losbench.estimation.robust.scales import Scale, pools

__all__ = [
    "IRLS",
    "LTS",
    "MM",
    "SOLVERS",
    "LeastSquares",
    "Solver",
    "as_part",
    "pooling",
    "read_solver",
]


class Solver(Protocol):
    """What a function that is handed a solver asks of it."""

    def fit(self, A: ArrayLike, y: ArrayLike, group: ArrayLike | None = None) -> RobustFit:
        """Solve A (n, p) or (..., n, p) for y (..., n); rows of one ``group`` (n,) share a
        weight.
        """


@dataclass(frozen=True)
class LeastSquares:
    """Least squares, to be handed on; `lstsq` is the call.

    Parameters
    ----------
    scale : float or (...) array, unit of y, optional
        As `lstsq` takes it.
    on_fail : "warn", "raise" or "ignore"

    Examples
    --------
    >>> LeastSquares().fit([[1.0], [1.0], [1.0]], [1.0, 2.0, 6.0]).x
    array([3.])
    """

    scale: float | ArrayLike | None = None
    on_fail: str = "warn"

    def fit(self, A: ArrayLike, y: ArrayLike, group: ArrayLike | None = None) -> RobustFit:
        """Solve A x = y; all weights are 1, whatever the group."""
        return lstsq(A, y, scale=self.scale, on_fail=self.on_fail)


@dataclass(frozen=True)
class IRLS:
    """Iteratively reweighted least squares, to be handed on; `irls` is the call and explains the
    parameters.

    Parameters
    ----------
    loss : loss object or name
        As `irls` takes it; a name is replaced by its object.
    scale : str, float, (...) array or callable, optional
        As `irls` takes it; "mad" unless given, or 1 where rows have known errors.
    leverage : bool
    max_iter : int
    tolerance : float
    on_fail : "warn", "raise" or "ignore"

    Raises
    ------
    ValueError
        If the loss is none.

    Examples
    --------
    >>> IRLS("cauchy").fit([[1.0], [1.0], [1.0], [1.0]], [1.0, 2.0, 3.0, 60.0]).x.round(2)
    array([2.08])
    """

    loss: Loss | str = Huber(1.345)  # noqa: RUF009 - frozen
    scale: Scale | None = None
    leverage: bool = False
    max_iter: int = 100
    tolerance: float = 1e-10
    on_fail: str = "warn"

    def __post_init__(self) -> None:
        object.__setattr__(self, "loss", read_loss(self.loss))

    def fit(self, A: ArrayLike, y: ArrayLike, group: ArrayLike | None = None) -> RobustFit:
        """Solve A x = y; rows of one group (n,) share a weight."""
        return irls(
            A,
            y,
            loss=self.loss,
            scale="mad" if self.scale is None else self.scale,
            group=group,
            leverage=self.leverage,
            max_iter=self.max_iter,
            tolerance=self.tolerance,
            on_fail=self.on_fail,
        )


@dataclass(frozen=True)
class LTS:
    """Least trimmed squares, to be handed on; `lts` is the call and explains the parameters.

    Parameters
    ----------
    h : int, optional
    scale : float or (...) array, unit of y, optional
    starts : int, optional
    seed : int or Generator, optional
    on_fail : "warn", "raise" or "ignore"

    Examples
    --------
    >>> LTS().fit([[1.0], [1.0], [1.0], [1.0], [1.0]], [1.0, 2.0, 3.0, 60.0, 61.0]).x
    array([2.])
    """

    h: int | None = None
    scale: float | ArrayLike | None = None
    starts: int | None = None
    seed: Random = None
    on_fail: str = "warn"

    def fit(self, A: ArrayLike, y: ArrayLike, group: ArrayLike | None = None) -> RobustFit:
        """Solve A x = y; rows of one group (n,) are good or bad together."""
        return lts(
            A,
            y,
            h=self.h,
            group=group,
            scale=self.scale,
            starts=self.starts,
            seed=self.seed,
            on_fail=self.on_fail,
        )


@dataclass(frozen=True)
class MM:
    """MM-estimate, to be handed on; `mm` is the call and explains the parameters.

    Parameters
    ----------
    efficiency : float
    scale : float or (...) array, unit of y, optional
    starts : int, optional
    seed : int or Generator, optional
    on_fail : "warn", "raise" or "ignore"

    Examples
    --------
    >>> A = [[1.0], [1.0], [1.0], [1.0], [1.0], [1.0], [1.0]]
    >>> MM().fit(A, [1.0, 2.0, 2.0, 2.0, 3.0, 60.0, 61.0]).x.round(2)
    array([2.])
    """

    efficiency: float = 0.95
    scale: float | ArrayLike | None = None
    starts: int | None = None
    seed: Random = None
    on_fail: str = "warn"

    def fit(self, A: ArrayLike, y: ArrayLike, group: ArrayLike | None = None) -> RobustFit:
        """Solve A x = y; rows of one group (n,) are good or bad together."""
        return mm(
            A,
            y,
            efficiency=self.efficiency,
            group=group,
            scale=self.scale,
            starts=self.starts,
            seed=self.seed,
            on_fail=self.on_fail,
        )


SOLVERS: dict[str, Solver] = {
    "irls": IRLS(),
    "ls": LeastSquares(),
    "lts": LTS(),
    "mm": MM(),
}


def read_solver(
    solver: Solver | str | None,
    method: Solver | str | None,
    *,
    named: Mapping[str, Solver] = SOLVERS,
    default: str,
    **options: Any,
) -> Solver:
    """Return the solver that was handed over, or the one of that name with its own ``options``,
    None where not given.

    ``method`` is a second word for ``solver``.
    """
    if solver is not None and method is not None:
        raise ValueError("solver and method are one thing, got both: give solver alone")
    word, chosen = ("solver", solver) if method is None else ("method", method)
    given = {name: value for name, value in options.items() if value is not None}
    if chosen is None or isinstance(chosen, str):
        name = choice(word, default if chosen is None else chosen, named)
        found: Any = named[name]
        known = {field.name for field in fields(found)}
        if "max_iter" not in known:
            given.pop("max_iter", None)  # a limit that a direct solver keeps to, whatever it is
        unknown = sorted(given.keys() - known)
        if unknown:
            raise ValueError(f"{unknown[0]} is no option of the solver {name!r}")
        return replace(found, **given)
    if isinstance(chosen, type) or not callable(getattr(chosen, "fit", None)):
        names = ", ".join(map(repr, named))
        raise ValueError(
            f"{word} must be one of {names}, or an object with fit(A, y, group), got {chosen!r}"
        )
    if given:
        option = next(iter(given))
        raise ValueError(
            f"{option} belongs to the solver, {type(chosen).__name__}({option}=...), got both an "
            f"object as {word} and {option}"
        )
    return chosen


def as_part(solver: Solver, scale: float | None = None) -> Solver:
    """Return the solver for one part of a larger task: silent about what does not settle, as the
    task counts that over all parts, and with the known scale where it has none of its own.

    A scale of its own is then a rule or one number: an array would belong to one batch.
    """
    if not isinstance(solver, LeastSquares | IRLS | LTS | MM):
        return solver
    own = solver.scale
    if not (own is None or isinstance(own, str) or callable(own)):
        number("scale", own)
    known: Any = scale if own is None else own
    return replace(solver, scale=known, on_fail="ignore")


def pooling(solver: Solver) -> bool:
    """Whether the systems of a batch share one scale, so that they must not be solved in parts."""
    return isinstance(solver, IRLS) and pools(solver.scale)
