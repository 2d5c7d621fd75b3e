"""Attitude from frame to frame: neighbours tell which spot of a frame is bad where the frame alone
cannot.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Bools, Floats, Indices
from losbench.checks import finite_or_nan, increasing, integer, number, positive, shaped
from losbench.estimation.solvers import IRLS, SOLVERS, Solver, as_part, pooling, read_solver
from losbench.optics.camera import Model, design_matrix
from losbench.pointing.attitude.blocks import distinct_points
from losbench.records import join
from losbench.units import rad_to_arcsec

__all__ = ["AttitudeTrack", "track_attitude"]

_NAMED = SOLVERS | {"irls": IRLS(max_iter=500)}
_CHUNK = 4096  # windows solved at once
_BAD = 3.0  # scales beyond which a spot is called bad, as in RobustFit.outliers


@dataclass(frozen=True)
class AttitudeTrack:
    """Angles and rates of every frame, each from a window of frames around it.

    Attributes
    ----------
    angles : (F, 3) array
        Rotation vector (alpha, beta, gamma) at each frame, radians; NaN where the window holds too
        few spots.
    rates : (F, 3) array
        Its rate of change, radians per second.
    cov : (F, 6, 6) array
        Covariance of angles and rates. Neighbouring frames share most of their windows, so their
        errors are alike.
    residuals : (F, n, 2) array
        Track minus shift of each spot at its frame, unit of the shifts; NaN where the spot is
        missing.
    weights : (F, n, 2) array
        Weight of each shift in its own frame's window; 0 where the spot is missing.
    scale : (F,) array
        Residual scale of each window: unit of the shifts, or of sigma where that was given.
    bad : (F, n) bool array
        Spots whose residual is larger than three scales in root mean square of x and y.
    converged : (F,) bool array
        Whether the solve settled.
    """

    angles: Floats
    rates: Floats
    cov: Floats
    residuals: Floats
    weights: Floats
    scale: Floats
    bad: Bools
    converged: Bools

    @property
    def angles_arcsec(self) -> Floats:
        """The angles (F, 3) in arcseconds."""
        return rad_to_arcsec(self.angles)


def track_attitude(
    points: ArrayLike,
    shifts: ArrayLike,
    *,
    time_s: ArrayLike | None = None,
    window: int = 9,
    solver: Solver | str | None = None,
    model: Model = "pinhole",
    sigma: float | None = None,
    method: Solver | str | None = None,
) -> AttitudeTrack:
    """Follow the attitude over frames with a model of constant rate in a sliding window, robustly.

    A single frame of two spots cannot tell which of them is bad. A window of K frames with six
    unknowns, three angles and three rates, has 4 K equations and can, as long as the rotation is
    nearly uniform over the window.

    Parameters
    ----------
    points : (n, 3) array, any unit of length
        Reference points of the spots.
    shifts : (F, n, 2) array, unit of ``points``
        Displacements of the spots; NaN marks a missing one.
    time_s : (F,) array, optional
        When the frames were taken, rising; 0, 1, 2 ... unless given, so that rates are per frame.
    window : int
        Number of frames K in a solve, centred where there are frames on both sides.
    solver : MM(...), LTS(...), IRLS(...), LeastSquares(), or a name
        How the window is solved, with one weight for x and y of a spot in a frame; `MM` unless
        given. It and "lts" survive most; with a window of 9 frames of two spots, "mm" takes some 15
        ms a frame and "lts" 10, "irls" 0.1 ("irls" by name with at most 500 iterations, as Huber
        may need many where a window of two spots is nearly exactly determined).
    model : "pinhole" or "paper"
        Rows of the design matrix, see `design_matrix`.
    sigma : float, unit of ``points``, optional
        Standard deviation of a shift, if known.
    method
        Second word for ``solver``.

    Returns
    -------
    AttitudeTrack

    Raises
    ------
    ValueError
        If shapes do not match, a shift is infinite, times do not rise, or the window is shorter
        than 3 or longer than the series.

    Warns
    -----
    RuntimeWarning
        If a solve did not converge; its last iterate is kept.

    Notes
    -----
    Rows [A, (t - t_f) A] for each frame of the window about frame f, with A that of liu2026, eq.
    (6).

    Examples
    --------
    Two spots, a steady turn about the line of sight, and one spot thrown off in one frame:

    >>> points = [[5.0, 0.0, 260.0], [-5.0, 0.0, 260.0]]
    >>> turn = np.outer(np.arange(20.0), [0.0, 0.0, 1e-4])
    >>> shifts = (turn @ design_matrix(points).T).reshape(20, 2, 2)
    >>> shifts += 1e-5 * np.random.default_rng(0).standard_normal(shifts.shape)
    >>> shifts[7, 1] += [0.01, -0.02]
    >>> track = track_attitude(points, shifts)
    >>> np.argwhere(track.bad).tolist()
    [[7, 1]]
    """
    p, moved = distinct_points(points), finite_or_nan("shifts", shifts, ndim=3)
    shaped("shifts", moved, ("F", len(p), 2), why=f"to match {len(p)} points")
    frames = len(moved)
    size = integer("window", window, low=3)
    if size > frames:
        raise ValueError(f"window must not be longer than the {frames} frames, got {size}")
    time = _times(time_s, frames)
    known = None if sigma is None else float(positive("sigma", number("sigma", sigma)))
    chosen = read_solver(solver, method, named=_NAMED, default="mm")
    if pooling(chosen):
        raise ValueError('scale "pooled" has no meaning here: windows share their frames')
    chosen = as_part(chosen, known)
    parts = [
        _solve_windows(
            p, moved, time, np.arange(first, min(first + _CHUNK, frames)), size, model, chosen
        )
        for first in range(0, frames, _CHUNK)
    ]
    track = join(parts)
    failed = int(np.count_nonzero(~track.converged & np.isfinite(track.angles[:, 0])))
    if failed:
        warnings.warn(
            f"{failed} of {frames} windows did not converge; their last iterate is kept, see "
            ".converged",
            RuntimeWarning,
            stacklevel=2,
        )
    return track


def _times(time_s: ArrayLike | None, frames: int) -> Floats:
    if time_s is None:
        return np.arange(float(frames))
    shaped("time_s", np.asarray(time_s), (frames,), why=f"to match {frames} frames")
    return increasing("time_s", time_s)


def _solve_windows(
    points: Floats,
    shifts: Floats,
    time: Floats,
    frames: Indices,
    size: int,
    model: Model,
    solver: Solver,
) -> AttitudeTrack:
    """Solve the windows about ``frames``, those with equally many spots in one batch."""
    count, n = len(frames), len(points)
    first = np.clip(frames - size // 2, 0, len(time) - size)
    inside = first[:, None] + np.arange(size)
    since = time[inside] - time[frames, None]
    rows = design_matrix(points, model).reshape(n, 2, 3)
    design = np.broadcast_to(rows, (count, size, n, 2, 3))
    design = np.concatenate([design, since[..., None, None, None] * design], axis=-1).reshape(
        count, size * n, 2, 6
    )
    seen = shifts[inside].reshape(count, size * n, 2)
    present = np.isfinite(seen).all(axis=-1)
    own = (frames - first)[:, None] * n + np.arange(n)
    found = _unsolved(count, n)
    for spots, members in _alike(present, size, n):
        chosen = np.argsort(~present[members], axis=1, kind="stable")[:, :spots]
        places = members[:, None], chosen
        fit = solver.fit(
            design[places].reshape(len(members), -1, 6),
            seen[places].reshape(len(members), -1),
            group=np.arange(2 * spots) // 2,
        )
        found.angles[members], found.rates[members] = fit.x[:, :3], fit.x[:, 3:]
        found.cov[members], found.scale[members] = fit.cov, fit.scale
        found.converged[members] = fit.converged
        for per_frame, values, missing in (
            (found.residuals, fit.residuals, np.nan),
            (found.weights, fit.weights, 0.0),
        ):
            whole = np.full((len(members), size * n, 2), missing)
            np.put_along_axis(
                whole, chosen[..., None], values.reshape(len(members), spots, 2), axis=1
            )
            per_frame[members] = np.take_along_axis(whole, own[members][..., None], axis=1)
    sizes = np.sqrt(np.mean(found.residuals**2, axis=-1))
    return replace(found, bad=sizes > _BAD * found.scale[:, None])


def _unsolved(count: int, n: int) -> AttitudeTrack:
    return AttitudeTrack(
        angles=np.full((count, 3), np.nan),
        rates=np.full((count, 3), np.nan),
        cov=np.full((count, 6, 6), np.nan),
        residuals=np.full((count, n, 2), np.nan),
        weights=np.zeros((count, n, 2)),
        scale=np.full(count, np.nan),
        bad=np.zeros((count, n), dtype=bool),
        converged=np.zeros(count, dtype=bool),
    )


def _alike(present: Bools, size: int, n: int) -> Iterator[tuple[int, Indices]]:
    """Numbers of spots seen, with the windows that saw so many: in two frames at least two spots
    each.
    """
    by_frame = present.reshape(-1, size, n).sum(axis=2)
    enough = (by_frame >= 2).sum(axis=1) >= 2
    counts = present.sum(axis=1)
    for spots in np.unique(counts[enough]):
        yield int(spots), np.flatnonzero(enough & (counts == spots))
