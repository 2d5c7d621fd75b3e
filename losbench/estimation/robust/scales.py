"""Scales of residuals: how far off is normal."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats, Indices
from losbench.checks import choice, positive
from losbench.estimation.robust.problem import Problem
from losbench.units import MAD_PER_SIGMA

__all__ = ["Scale", "ScaleRule", "known_scale", "pools"]

Scale = str | float | ArrayLike | Callable[[Floats], ArrayLike]

_CANCELLED = 1e-3  # share of the mean square below which a variance is not to be had by subtraction


def _median_absolute(residuals: Floats) -> Floats:
    size = residuals.shape[-1]
    half = size // 2
    ordered = np.partition(np.abs(residuals), half, axis=-1)
    upper = ordered[..., half]
    median = upper if size % 2 else 0.5 * (upper + ordered[..., :half].max(axis=-1))
    return median / MAD_PER_SIGMA


def _median_of_rest(residuals: Floats, dropped: int) -> Floats:
    """Median absolute residual of those left without the smallest, over 0.6745, as GSL and
    robustfit have it.
    """
    ordered = np.sort(np.abs(residuals), axis=-1)
    return np.median(ordered[..., dropped:], axis=-1) / 0.6745


def _rms(residuals: Floats) -> Floats:
    return np.sqrt(np.vecdot(residuals, residuals) / residuals.shape[-1])


def _std(residuals: Floats) -> Floats:
    size = residuals.shape[-1]
    mean = residuals @ np.full(
        size, 1.0 / size
    )  # many times faster than .mean() along a short axis
    square = np.vecdot(residuals, residuals) / size
    variance = square - mean**2
    if (variance > _CANCELLED * square).all():
        return np.sqrt(variance)
    return _rms(residuals - mean[..., None])


def _std1(residuals: Floats) -> Floats:
    size = residuals.shape[-1]
    return _std(residuals) * np.sqrt(size / max(size - 1, 1))


_NAMED: dict[str, Callable[[Floats], Floats]] = {
    "std": _std,
    "std1": _std1,
    "rms": _rms,
    "mad": _median_absolute,
}
_POOLED = {"pooled": _rms}  # of the residuals of all systems as of one


def known_scale(scale: ArrayLike, problem: Problem) -> ScaleRule:
    """Scale of methods that take a number (...) and no other rule."""
    if isinstance(scale, str) or callable(scale):
        raise ValueError(f"scale must be a number, got {scale!r}")
    return ScaleRule(scale, problem.batch, problem.y_unit)


def pools(scale: object) -> bool:
    """Whether that scale is one for the whole batch."""
    return isinstance(scale, str) and scale in _POOLED


class ScaleRule:
    """One way of turning residuals (b, n) into scales (b,), for a flattened batch.

    Parameters
    ----------
    scale : str, float, array or callable
        As `irls` takes it.
    batch : tuple of int
        Batch shape of the systems.
    unit : (B,) array
        Working unit of each system; known scales and callables speak the user's.
    dropped : int, optional
        Number of the smallest residuals that "mad" leaves out, where residuals are adjusted for
        leverage.
    size : float, optional
        What a pooled scale has come to, in the user's unit.
    """

    def __init__(
        self,
        scale: Scale,
        batch: tuple[int, ...],
        unit: Floats,
        *,
        dropped: int | None = None,
        size: float | None = None,
    ) -> None:
        self._unit = unit
        self.pooled = pools(scale)
        self._known = None if size is None else np.full(len(unit), size)
        self._call: Callable[[Floats], ArrayLike] | None = None
        if isinstance(scale, str):
            named = _NAMED | _POOLED
            self._named = named[choice("scale", scale, named)]
            self.name = scale
            if scale == "mad" and dropped is not None:
                self._named = partial(_median_of_rest, dropped=dropped)
        elif isinstance(scale, bool):
            raise ValueError(f"scale must be a name, a number or a callable, got {scale!r}")
        elif callable(scale):
            self._call = scale
            self.name = getattr(scale, "__name__", type(scale).__name__)
        else:
            self._known = _known(scale, batch)
            self.name = "given"

    @property
    def known(self) -> bool:
        """Whether the scale was given, not estimated."""
        return self._known is not None and not self.pooled

    @property
    def proportional(self) -> bool:
        """Whether each scale is made of its system's residuals, and grows as they do."""
        return self._known is None and self._call is None and not self.pooled

    def at(self, size: float) -> ScaleRule:
        """Return a pooled rule at the scale that it has come to, in the user's unit."""
        return ScaleRule(self.name, (), self._unit, size=size)

    def __call__(self, residuals: Floats, systems: Indices) -> Floats:
        """Scales of ``residuals``, which belong to the ``systems`` of the batch, in their working
        units.
        """
        if self._known is not None:
            return self._known[systems] / self._unit[systems]
        if self._call is None:
            return self._named(residuals)
        unit = self._unit[systems]
        scales = np.asarray(self._call(residuals * unit[:, None]), dtype=np.float64)
        if scales.shape != unit.shape or not (scales >= 0).all():
            raise ValueError(
                "scale must turn residuals (..., n) into one non-negative number for each system "
                "(...), "
                f"got {scales} from residuals of shape {residuals.shape}"
            )
        return scales / unit


def _known(scale: ArrayLike, batch: tuple[int, ...]) -> Floats:
    values = positive("scale", scale)
    try:
        return np.broadcast_to(values, batch).reshape(-1)
    except ValueError:
        raise ValueError(
            f"scale must broadcast to the batch {batch}, got shape {values.shape}"
        ) from None
