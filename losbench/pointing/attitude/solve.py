"""From shifts to angles: linear blocks, robust or not, and Gauss-Newton on the exact projection."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from losbench.arrays import Bools, Floats, Indices, Ints
from losbench.checks import boolean, choice, finite_or_nan, integer, shaped
from losbench.estimation.losses import Loss
from losbench.estimation.robust import lstsq
from losbench.estimation.robust.failures import warn_of_failures
from losbench.estimation.robust.scales import Scale
from losbench.estimation.solvers import LeastSquares, Solver, as_part, pooling, read_solver
from losbench.optics.camera import Model, design_matrix, project
from losbench.pointing.attitude.blocks import Blocks, distinct_points, uncut
from losbench.pointing.attitude.result import AttitudeFit
from losbench.records import changed, put

__all__ = ["solve_attitude"]


_PER_SHIFT = ("residuals", "weights", "leverage")
_PER_SOLVE = ("angles", "cov", "redundancy", "p_value", "scale", "converged")
_EXACT_ROUNDS = 20
_LONGEST_STEP_RAD = 0.5  # of one exact round
_TWO_SPOTS = (
    "with two spots per solve no outlier can be identified: both residuals are equal whichever "
    "spot is bad, "
    "and IRLS gives what least squares gives"
)


def solve_attitude(
    points: ArrayLike,
    shifts: ArrayLike,
    *,
    solver: Solver | str | None = None,
    model: Model = "pinhole",
    sigma: ArrayLike | None = None,
    stack: int = 1,
    group: Literal["spot"] | None = "spot",
    exact: bool = False,
    method: Solver | str | None = None,
    loss: Loss | str | None = None,
    scale: Scale | None = None,
    max_iter: int | None = None,
) -> AttitudeFit:
    """Find the rotation that carries reference points into where their spots are seen.

    Parameters
    ----------
    points : (n, 3) array, any unit of length
        Reference points, e.g. from :meth:`Camera.points_mm`; at least two, no two equal. Any two
        directions will do: spots on one straight line are no worse than others.
    shifts : (..., n, 2) array, unit of ``points``
        Displacements of the spots on the image plane. A spot with a NaN is missing from that frame.
    solver : IRLS(...), LeastSquares(), LTS(...), MM(...), their name, or any with a ``fit``
        How the equations are solved; `IRLS` unless given. "irls", "ls", "lts" and "mm" are these
        four, the last two of which almost half of the spots cannot mislead.
    model : "pinhole" or "paper"
        Rows of the design matrix, see `design_matrix`.
    sigma : float or array that broadcasts to ``shifts``, unit of ``shifts``, optional
        Standard deviation of each shift. Weighs the rows, makes the covariance absolute and p_value
        known.
    stack : int
        Number of consecutive frames (along the axis before the spots) solved together for common
        angles. Frames left over make a last, shorter block.
    group : "spot" or None
        One weight for x and y of a spot, because a spot goes bad as a whole (and one for both,
        where a solve has but two spots); or one each, as in liu2026, eq. (9).
    exact : bool
        Iterate on the exact projection (Gauss-Newton) instead of solving for small angles once;
        pinhole only.
    method
        Second word for ``solver``.
    loss, scale, max_iter
        Beside a solver's name, its options: ``method="irls", loss="cauchy"`` is
        ``solver=IRLS("cauchy")``. Unless a scale is given, it is the solver's own, or the known one
        where ``sigma`` is given.

    Returns
    -------
    AttitudeFit
        Angles, covariance and tests lead with the solves; residuals, weights and leverage with the
        frames.

    Raises
    ------
    ValueError
        If shapes do not match, a shift is infinite, the points leave a rotation undetermined,
        options come beside a solver that is an object, or scale "pooled" meets frames that lack
        spots.

    Warns
    -----
    UserWarning
        If two spots are asked to tell which of them is bad: their residuals are equal, so no weight
        can.
    RuntimeWarning
        Once each, if a solve did not converge (its last iterate is kept), or does not determine all
        three angles, as where all spots but one have next to no weight (errors of what it leaves
        open are NaN).

    Notes
    -----
    liu2026, eq. (6)-(10): A v = b by least squares, or reweighted with w = min(1, c / abs(r)).

    Examples
    --------
    >>> points = [[5.0, 0.0, 260.0], [-5.0, 0.0, 260.0], [0.0, 5.0, 260.0]]
    >>> angles = np.array([1e-5, -2e-5, 3e-5])
    >>> shifts = (design_matrix(points) @ angles).reshape(3, 2)
    >>> solve_attitude(points, shifts).angles.round(12)
    array([ 1.e-05, -2.e-05,  3.e-05])
    """
    p, moved = distinct_points(points), finite_or_nan("shifts", shifts)
    shaped("shifts", moved, ("...", len(p), 2), why=f"to match {len(p)} points")
    chosen = read_solver(solver, method, default="irls", loss=loss, scale=scale, max_iter=max_iter)
    if group is not None:
        choice("group", group, ("spot",))
    if boolean("exact", exact) and model != "pinhole":
        raise ValueError(
            f"exact must be False with model {model!r}: the exact projection is that of a pinhole"
        )
    if integer("stack", stack, low=1) > 1 and moved.ndim < 3:
        raise ValueError(
            f"shifts must have shape (..., frames, {len(p)}, 2) to be stacked, got {moved.shape}"
        )
    if (
        not isinstance(chosen, LeastSquares)
        and len(p) == 2
        and (stack == 1 or moved.shape[-3] == 1)
    ):
        warnings.warn(_TWO_SPOTS, UserWarning, stacklevel=2)
    recipe = _Recipe(
        as_part(chosen, None if sigma is None else 1.0), group == "spot", known=sigma is not None
    )
    blocks = Blocks.read(p, moved, sigma, stack)
    if pooling(chosen) and not blocks.present.all():
        raise ValueError('scale "pooled" needs every spot in every frame, got shifts with NaN')
    fit = (
        _solve_exact(blocks, recipe)
        if exact
        else recipe.solve(blocks, design_matrix(p, model)[None], blocks.shifts)
    )
    # The sum of leverages is the rank.
    rank = fit.leverage.sum(axis=(1, 2), where=blocks.present[..., None])
    blind = int(np.count_nonzero(fit.ok & (rank < 2.5)))
    if blind:
        warnings.warn(
            f"{blind} of {fit.ok.size} solves do not determine all three angles; errors of what "
            "they leave open are NaN",
            RuntimeWarning,
            stacklevel=2,
        )
    failed = int(np.count_nonzero(fit.ok & ~fit.converged))
    if failed:
        warn_of_failures(
            failed,
            f"{failed} of {fit.ok.size} attitudes did not converge; their last iterate is kept, "
            "see .converged",
        )
    return _restored(fit, blocks.batch, moved.shape)


@dataclass(frozen=True)
class _Recipe:
    """How to solve linear blocks."""

    solver: Solver
    by_spot: bool
    known: bool

    def solve(self, blocks: Blocks, rows: Floats, shifts: Floats) -> AttitudeFit:
        """Solve blocks with rows (B or 1, 2n, 3) of one frame for shifts (B, m, 2).

        Blocks that miss equally many spots are one batch: what is missing is left out, not given a
        zero.
        """
        count, size, _ = shifts.shape
        design = (
            np.tile(rows.reshape(len(rows), -1, 2, 3), (1, blocks.stack, 1, 1))
            / blocks.sigma[..., None]
        )
        if blocks.present.all():
            return self._solve_whole(design if len(design) > 1 else design[0], shifts, blocks.sigma)
        sigma = np.broadcast_to(blocks.sigma, shifts.shape)
        spots = np.count_nonzero(blocks.present, axis=1)
        fit = _unsolved(count, size, ok=blocks.ok, redundancy=2 * spots - 3)
        for seen in np.unique(spots[fit.ok]):
            members = np.flatnonzero(fit.ok & (spots == seen))
            chosen = np.argsort(~blocks.present[members], axis=1, kind="stable")[:, :seen]
            places = members[:, None], chosen
            matrix = (
                design[places]
                if len(design) > 1
                else design[0, chosen if seen < size else slice(None)]
            )
            part = self._solve_whole(matrix, shifts[places], sigma[places])
            put(fit, members, part, only=_PER_SOLVE)
            put(fit, places, part, only=_PER_SHIFT)
        return fit

    def _solve_whole(self, design: Floats, shifts: Floats, sigma: Floats) -> AttitudeFit:
        """Solve blocks (B, m, 2) that miss nothing, with whitened rows (m, 2, 3) or (B, m, 2,
        3).
        """
        count, size, _ = shifts.shape
        matrix, right = (
            design.reshape(*design.shape[:-3], -1, 3),
            (shifts / sigma).reshape(count, -1),
        )
        solved = self.solver.fit(
            matrix, right, group=_spot_labels(right.shape[1]) if self.by_spot else None
        )
        p_value = np.full(count, np.nan)
        if self.known:
            least = (
                solved
                if isinstance(self.solver, LeastSquares)
                else lstsq(matrix, right, on_fail="ignore")
            )
            p_value = chdtrc(least.dof, np.vecdot(least.residuals, least.residuals))
        return AttitudeFit(
            angles=solved.x,
            cov=solved.cov,
            residuals=solved.residuals.reshape(shifts.shape) * sigma,
            weights=solved.weights.reshape(shifts.shape),
            leverage=solved.leverage.reshape(shifts.shape),
            redundancy=np.full(count, 2 * size - 3),
            p_value=p_value,
            scale=solved.scale,
            converged=solved.converged,
            ok=np.ones(count, dtype=bool),
        )


def _spot_labels(rows: int) -> Indices:
    """One label per spot; one for all of two spots, whose residuals are equal: to doubt one is to
    doubt both.
    """
    return np.arange(rows) // 2 if rows > 4 else np.zeros(rows, dtype=np.intp)


def _solve_exact(blocks: Blocks, recipe: _Recipe) -> AttitudeFit:
    """Gauss-Newton on the exact projection; its derivative is the design matrix of where the spots
    have got to.
    """
    from scipy.spatial.transform import Rotation  # half the time that `import losbench` may take

    angles = np.zeros((len(blocks.shifts), 3))
    tiny = 1e-14 * np.abs(blocks.points).max()
    for _ in range(_EXACT_ROUNDS):
        seen = project(blocks.points, angles)
        rows = design_matrix(seen)
        ahead = (seen - blocks.points)[..., :2] - np.matvec(rows, angles).reshape(
            *seen.shape[:-1], 2
        )
        fit = recipe.solve(blocks, rows, blocks.shifts - np.tile(ahead, (1, blocks.stack, 1)))
        step = np.where(fit.ok[:, None], fit.angles - angles, 0.0)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(1.0, _LONGEST_STEP_RAD / np.maximum(length, _LONGEST_STEP_RAD))
        turned = (Rotation.from_rotvec(step) * Rotation.from_rotvec(angles)).as_rotvec()
        visible = np.all(np.isfinite(project(blocks.points, turned)), axis=(1, 2))
        angles = np.where(visible[:, None], turned, angles)
        moved = np.abs(np.matvec(rows, step)).max(axis=1)
        settled = visible & (moved <= 1e-9 * np.abs(np.matvec(rows, angles)).max(axis=1) + tiny)
        if settled.all():
            break
    return replace(
        fit, angles=np.where(fit.ok[:, None], angles, np.nan), converged=fit.converged & settled
    )


def _unsolved(count: int, size: int, *, ok: Bools, redundancy: Ints) -> AttitudeFit:
    return AttitudeFit(
        angles=np.full((count, 3), np.nan),
        cov=np.full((count, 3, 3), np.nan),
        residuals=np.full((count, size, 2), np.nan),
        weights=np.zeros((count, size, 2)),
        leverage=np.full((count, size, 2), np.nan),
        redundancy=redundancy,
        p_value=np.full(count, np.nan),
        scale=np.full(count, np.nan),
        converged=np.zeros(count, dtype=bool),
        ok=ok,
    )


def _restored(fit: AttitudeFit, batch: tuple[int, ...], shape: tuple[int, ...]) -> AttitudeFit:
    """Give the batch its axes back, and the frames of the given shape their places."""
    if fit.residuals.shape == shape:  # one axis of frames, none of them stacked
        return fit
    fit = changed(fit, lambda array: uncut(array, shape), only=_PER_SHIFT)
    return changed(
        fit, lambda array: array.reshape(batch + array.shape[1:]), only=(*_PER_SOLVE, "ok")
    )
