"""What a fit hands back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from losbench.arrays import Bools, Floats, Indices, Ints
from losbench.checks import number
from losbench.display import html_table, table, with_error

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["RobustFit"]


_ROWS_SHOWN = 10
_UNKNOWNS_SHOWN = 6


class OnDemand:
    """Field of a frozen dataclass that may be given as a function, which is then called at first
    use.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Any: ...
    @overload
    def __get__(self, instance: object, owner: type) -> Floats: ...
    def __get__(self, instance: object | None, owner: type) -> Any:
        if instance is None:
            raise AttributeError(self._name)  # to the dataclass: there is no default
        value = vars(instance)[self._name]
        if callable(value):
            value = vars(instance)[self._name] = value()
        return value

    def __set__(self, instance: object, value: Floats | Callable[[], Floats]) -> None:
        vars(instance)[self._name] = value


@dataclass(frozen=True, repr=False, kw_only=True)
class RobustFit:
    """Result of `lstsq` or `irls`; batch axes (...) lead, and are absent for a single system.

    Attributes
    ----------
    x : (..., p) array
        Unknowns.
    residuals : (..., n) array
        A x - y.
    weights : (..., n) array
        Weight of each row at ``x``, between 0 and 1; all 1 for least squares.
    scale : (...) array
        Residual scale at ``x``. Never reported below the rounding error of ``y`` (16 eps times its
        norm), so that a perfect fit keeps its weights. Least squares: sqrt(sum r^2 / dof), NaN
        where dof is 0.
    cov : (..., p, p) array
        Covariance of ``x``; see the function that made the fit for its formula. NaN where dof is 0
        and the scale was not given.
    dof : (...) int array
        Redundancy n - rank.
    n_iter : (...) int array
        Steps of the iteration; 0 for least squares.
    converged : (...) bool array
        Whether the iteration settled, with enough rows of non-zero weight left.
    leverage : (..., n) array
        Diagonal of the hat matrix of A, unweighted; rank / n on average, 1 where a row alone fixes
        an unknown.
    rank : (...) int array
        Rank of A. Where it is short, ``x`` is the solution of smallest norm in unit columns.
    loss : str
        The loss, with its constant.
    scale_method : str
        How ``scale`` was made.
    group : (n,) int array or None
        Group of each row, where groups share a weight.
    """

    x: Floats
    residuals: Floats
    weights: Floats
    scale: Floats
    cov: OnDemand = OnDemand()
    dof: Ints
    n_iter: Ints
    converged: Bools
    leverage: OnDemand = OnDemand()
    rank: Ints
    loss: str
    scale_method: str
    group: Indices | None = field(default=None)

    def __getstate__(self) -> dict[str, Any]:
        """What copies and pickles hold: arrays, not ways to compute them."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @property
    def std_error(self) -> Floats:
        """Standard errors of the unknowns, (..., p): the root of the diagonal of ``cov``."""
        return np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))

    def outliers(self, threshold: float = 3.0) -> Bools:
        """Mark rows whose residual exceeds ``threshold`` scales, (..., n).

        Examples
        --------
        >>> import losbench as lb
        >>> lb.irls(np.ones((5, 1)), [1.0, 1.1, 0.9, 1.0, 8.0]).outliers()
        array([False, False, False, False,  True])
        """
        limit = number("threshold", threshold, low=0.0) * self.scale[..., None]
        return np.abs(self.residuals) > limit

    def summary(self) -> str:
        """Everything worth knowing about the fit, on one screen."""
        return "\n".join(
            [repr(self), *(self._batch_lines() if self.x.ndim > 1 else self._single_lines())]
        )

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas table with one row per system: unknowns x0, x1, ... with their errors,
        scale, rows of weight below 1, and how the iteration ended.
        """
        p = self.x.shape[-1]
        columns: dict[str, Any] = {f"x{k}": self.x[..., k] for k in range(p)}
        columns |= {f"std_error{k}": self.std_error[..., k] for k in range(p)}
        columns["scale"] = self.scale
        columns["doubted"] = np.count_nonzero(self.weights < 1.0, axis=-1)
        columns |= {"dof": self.dof, "rank": self.rank}
        columns |= {"n_iter": self.n_iter, "converged": self.converged}
        return table(columns, axes=["system"])

    def _repr_html_(self) -> str:
        if self.x.ndim > 1:
            return self._batch_html()
        rows = (
            (k, with_error(float(value), float(error)))
            for k, (value, error) in enumerate(zip(self.x, self.std_error, strict=True))
        )
        doubted = int(np.count_nonzero(self.weights < 1.0))
        note = f"{doubted} of {self.weights.size} rows have a weight below 1."
        return html_table(repr(self), ["unknown", "value"], rows, count=len(self.x), note=note)

    def _batch_html(self) -> str:
        p = min(self.x.shape[-1], _UNKNOWNS_SHOWN)
        batch = self.x.shape[:-1]
        heads = ["system", *(f"x{k}" for k in range(p)), "scale", ""]
        rows = (
            (
                ", ".join(map(str, at)),
                *map(with_error, self.x[at][:p].tolist(), self.std_error[at][:p].tolist()),
                f"{self.scale[at]:.4g}",
                "" if self.converged[at] else "not converged",
            )
            for at in np.ndindex(batch)
        )
        return html_table(repr(self), heads, rows, count=self.scale.size)

    def __repr__(self) -> str:
        """One line: what was fitted, how, and whether it settled."""
        n, p = self.residuals.shape[-1], self.x.shape[-1]
        batch = self.x.shape[:-1]
        systems = f"{batch} systems of " if batch else ""
        settled = int(np.count_nonzero(self.converged))
        state = f"{settled} of {self.converged.size} converged" if batch else _state(self)
        size = "" if batch else f" = {float(self.scale):.6g}"
        return (
            f"RobustFit({systems}{n} x {p}, loss {self.loss}, scale {self.scale_method}{size}, "
            f"{state})"
        )

    def _single_lines(self) -> list[str]:
        n, p = self.residuals.shape[-1], self.x.shape[-1]
        lines = [
            f"rank {int(self.rank)} of {p}, dof {int(self.dof)}",
            "unknown        value   std error",
        ]
        lines += [
            f"{i:7d} {value:12.6g} {error:11.4g}"
            for i, (value, error) in enumerate(
                zip(self.x[:_ROWS_SHOWN], self.std_error, strict=False)
            )
        ]
        doubted = np.flatnonzero(self.weights < 1.0)
        doubted = doubted[np.argsort(self.weights[doubted], kind="stable")]
        lines.append(
            f"{doubted.size} of {n} rows have a weight below 1"
            + (", lowest first:" if doubted.size else "")
        )
        if doubted.size:
            lines.append("    row  residual/scale   weight  leverage")
        lines += [
            f"{i:7d} {self.residuals[i] / self.scale:15.2f} {self.weights[i]:8.3f} "
            f"{self.leverage[i]:9.3f}"
            for i in doubted[:_ROWS_SHOWN]
        ]
        return lines

    def _batch_lines(self) -> list[str]:
        rows = {
            "scale": self.scale,
            "iterations": self.n_iter,
            "lowest weight": self.weights.min(axis=-1),
            "rank": self.rank,
        }
        rows |= {f"x[{i}]": self.x[..., i] for i in range(min(self.x.shape[-1], _ROWS_SHOWN))}
        lines = ["                      least      median    greatest"]
        for name, values in rows.items():
            spread = np.min(values), np.median(values), np.max(values)
            lines.append(f"{name:15s}" + "".join(f"{v:12.5g}" for v in spread))
        return lines


def _state(fit: RobustFit) -> str:
    if not fit.n_iter:
        return "direct"
    return f"{'converged' if fit.converged else 'NOT CONVERGED'} in {int(fit.n_iter)} iterations"
