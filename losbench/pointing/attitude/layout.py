"""Where spots should lie: the best places under the errors and the number of bad spots that are
asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import integer, number, positive
from losbench.estimation.breakdown import design_breakdown
from losbench.optics.camera import Camera, Model, design_matrix
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SpotLayout", "bad_spots_survived", "design_layout", "largest_shares"]

_DIRECTIONS, _FEW = 1500, 200
_GRID = 15  # places along the longer side that a spot is tried at
_FINER = (0.5, 0.25, 0.125, 0.0625)  # of that grid, around where a spot lies
_PASSES = 12
_STARTS = 6
_LEVELS = (1.01, 1.02, 1.04, 1.08, 1.16, 1.32, 1.64, 2.3, 3.6)  # of a map, in what was found
_HALF = 0.5 - 1e-9
_SAFE = 0.49  # the few directions of the search miss up to a hundredth of a share


@dataclass(frozen=True)
class SpotLayout:
    """Places of spots, and what they can do.

    Attributes
    ----------
    xy_px : (n, 2) array
        Where the spots lie.
    sigma_arcsec : (3,) array
        Errors of the angles that least squares of good spots would have, about x, y and z.
    survives : int
        Bad spots that a monotone M-estimate survives, wherever they are.
    wanted_arcsec : (3,) array
        Errors that were asked for.
    wanted_survives : int
        Bad spots that were asked for.
    camera : Camera
    sigma_px : float
        Error of a coordinate of a centroid.
    model : str
        Rows of the design matrix.
    stack : int
        Frames solved together.
    """

    xy_px: Floats
    sigma_arcsec: Floats
    survives: int
    wanted_arcsec: Floats
    wanted_survives: int
    camera: Camera
    sigma_px: float
    model: Model
    stack: int

    @property
    def worst(self) -> float:
        """Largest of the three errors in those wanted; at most 1 where all are met."""
        return float(np.max(self.sigma_arcsec / self.wanted_arcsec))

    @property
    def meets(self) -> bool:
        """Whether the errors and the number of bad spots are as wanted."""
        return self.worst <= 1.0 and self.survives >= self.wanted_survives

    def map(self, spot: int, xy_px: ArrayLike) -> Floats:
        """`worst`, if one spot (counted from 0) lay at other places (..., 2) and all others stayed;
        (...).
        """
        rows = _rows(self.camera, self._with(spot, xy_px), self.model)
        return _errors_arcsec(self, rows).max(axis=-1)

    def draw(self, axes: Axes, *, spot: int = 0) -> None:
        """Draw the spots on their sensor, `map` of one of them as contours, and hatched where it
        must not lie if as many bad spots as wanted are to be survived.
        """
        high, wide = self.camera.shape
        grid = np.meshgrid(np.linspace(0, wide - 1, 61), np.linspace(0, high - 1, 41))
        places = np.stack(grid, axis=-1)
        levels = self.worst * np.array(_LEVELS)
        lines = axes.contour(*grid, self.map(spot, places), levels=levels, cmap="viridis")
        axes.clabel(lines, fmt="%.3g", fontsize=8)
        if self.wanted_survives:
            rows = _rows(self.camera, self._with(spot, places), self.model)
            shares = largest_shares(rows, directions=_FEW)[..., self.wanted_survives]
            axes.contourf(*grid, shares, levels=[_HALF, 2.0], colors="none", hatches=["//"])
        axes.plot(*self.xy_px.T, "o", color="#0072B2", ms=7, clip_on=False)
        axes.plot(*self.xy_px[spot], "o", mfc="none", mec="#D55E00", ms=13, mew=1.8, clip_on=False)
        axes.set(xlim=(0, wide - 1), ylim=(high - 1, 0), aspect="equal")
        axes.set(xlabel="x (px)", ylabel="y (px)")
        axes.set_title("largest error, in that wanted, if ○ lay elsewhere", fontsize=10)

    def _with(self, spot: int, xy_px: ArrayLike) -> Floats:
        places = np.asarray(xy_px, dtype=np.float64)
        layouts = np.broadcast_to(self.xy_px, (*places.shape[:-1], *self.xy_px.shape)).copy()
        layouts[..., spot, :] = places
        return layouts


def design_layout(
    n: int,
    camera: Camera,
    sigma_px: float,
    *,
    wanted_arcsec: ArrayLike = 1.0,
    survives: int = 0,
    margin_px: float = 20.0,
    apart_px: float = 40.0,
    model: Model = "pinhole",
    stack: int = 1,
    seed: int = 0,
) -> SpotLayout:
    """Find the places of n spots at which the largest of the three errors, in those wanted, is
    least, among layouts that survive a number of bad spots.

    Parameters
    ----------
    n : int
        Spots, at least 2.
    camera : Camera
    sigma_px : float
        Error of a coordinate of a centroid.
    wanted_arcsec : float or (3,)
        Errors about x, y and z that are wanted, one sigma.
    survives : int
        Bad spots that Huber's estimate is to survive, wherever they are.
    margin_px, apart_px : float
        Least distance of a spot from the edge of the sensor and from another spot.
    model : "pinhole" or "paper"
        Rows of the design matrix, see `design_matrix`.
    stack : int
        Frames solved together.
    seed : int
        Of the layouts that the search begins with.

    Returns
    -------
    SpotLayout
        With the best layout found; its `meets` says whether that is good enough.

    Raises
    ------
    ValueError
        If a number does not fit, or the sensor has no room for n spots so far apart.

    Notes
    -----
    Coordinate exchange (Meyer and Nachtsheim, Technometrics 37, 60 (1995)): spot by spot goes to
    the best of a grid of places until none moves, then on finer grids; from the corners, a ring and
    random layouts. Errors by the inverse normal matrix; bad spots by Ellis and Morgenthaler's
    shares over a few hundred directions on the way, and by `design_breakdown` in the end.

    Examples
    --------
    >>> camera = Camera(focal_mm=260.0, pixel_um=10.0, shape=(1080, 1920))
    >>> found = design_layout(2, camera, 0.02)
    >>> found.xy_px[np.argsort(found.xy_px[:, 0])].tolist() in (
    ...     [[20.0, 20.0], [1899.0, 1059.0]],
    ...     [[20.0, 1059.0], [1899.0, 20.0]],
    ... )
    True
    """
    count = integer("n", n, low=2)
    errors = np.broadcast_to(positive("wanted_arcsec", wanted_arcsec), (3,))
    task = SpotLayout(
        xy_px=np.empty((count, 2)),
        sigma_arcsec=np.full(3, np.inf),
        survives=0,
        wanted_arcsec=errors.astype(np.float64),
        wanted_survives=integer("survives", survives, low=0, high=count - 1),
        camera=camera,
        sigma_px=float(positive("sigma_px", number("sigma_px", sigma_px))),
        model=model,
        stack=integer("stack", stack, low=1),
    )
    margin = number("margin_px", margin_px, low=0.0)
    ends = np.array([[margin, margin], np.array(camera.shape[::-1]) - 1.0 - margin])
    if (ends[1] < ends[0]).any():
        raise ValueError(f"margin_px leaves no room on {camera.shape[1]} x {camera.shape[0]} px")
    apart = number("apart_px", apart_px, low=0.0)
    rng = np.random.default_rng(seed)
    found = [_exchanged(task, start, ends, apart) for start in _starts(count, ends, apart, rng)]
    best, _ = min(found, key=lambda each: each[1])
    return _judged(task, best)


def bad_spots_survived(points: ArrayLike, *, model: Model = "pinhole") -> int:
    """Count the bad spots that a layout of points (n, 3) survives under Huber's estimate, in a
    millisecond.

    `design_breakdown` finds the worst direction by climbing; here 1500 fixed directions and those
    that each spot leaves free are looked at, which misses at most about a hundredth of a share.

    >>> turn = np.arange(8) * np.pi / 4
    >>> bad_spots_survived(np.stack([4 * np.cos(turn), 4 * np.sin(turn), np.full(8, 260.0)], -1))
    2
    """
    shares = largest_shares(design_matrix(points, model))
    return int(np.sum(shares[1:] < _HALF))


def largest_shares(rows: Floats, *, directions: int = _DIRECTIONS) -> Floats:
    """Largest part of the pull that k = 0 .. n spots can have, of rows (..., 2n, 3); (..., n + 1).

    Ellis and Morgenthaler, J. Amer. Statist. Assoc. 87, 143 (1992): with Q R = A and Q_g the two
    rows of a spot, its pull in direction d is |Q_g d|.
    """
    basis = np.linalg.qr(rows)[0]
    spots = basis.reshape(*basis.shape[:-2], -1, 2, 3)
    free = np.cross(spots[..., 0, :], spots[..., 1, :])  # what a spot alone says nothing about
    sphere = _half_sphere(directions)
    every = np.concatenate(
        [np.broadcast_to(sphere, (*free.shape[:-2], *sphere.shape)), free], axis=-2
    )
    seen = every @ np.swapaxes(basis, -1, -2)
    pulls = np.sqrt(seen[..., ::2] ** 2 + seen[..., 1::2] ** 2)
    pulls.sort(axis=-1)
    running = np.cumsum(pulls[..., ::-1], axis=-1)
    with np.errstate(invalid="ignore"):
        shares = np.nanmax(running / running[..., -1:], axis=-2)
    return np.concatenate([np.zeros((*shares.shape[:-1], 1)), shares], axis=-1)


@cache
def _half_sphere(count: int) -> Floats:
    """Directions (count, 3), evenly over half a sphere: a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z, turn = k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=-1)


def _rows(camera: Camera, xy_px: Floats, model: Model) -> Floats:
    return design_matrix(camera.points_mm(xy_px), model)


def _errors_arcsec(task: SpotLayout, rows: Floats) -> Floats:
    """Errors (..., 3) in those wanted; infinite where a rotation is left undetermined."""
    size = np.linalg.norm(rows, axis=-2, keepdims=True)
    scaled = rows / size
    normal = np.swapaxes(scaled, -1, -2) @ scaled
    flat = np.linalg.det(normal) < 1e-14
    normal[flat] = np.eye(3)
    own = np.sqrt(np.diagonal(np.linalg.inv(normal), axis1=-2, axis2=-1)) / size[..., 0, :]
    error = rad_to_arcsec(own) * task.sigma_px * task.camera.pixel_mm / np.sqrt(task.stack)
    return np.where(flat[..., None], np.inf, error / task.wanted_arcsec)


def _costs(task: SpotLayout, layouts: Floats) -> list[tuple[float, float]]:
    """By how much the bad spots wanted are too many, and the largest error, of layouts (m, n, 2);
    less is better, in this order.
    """
    rows = _rows(task.camera, layouts, task.model)
    worst = _errors_arcsec(task, rows).max(axis=-1)
    excess = np.zeros(len(layouts))
    if task.wanted_survives:
        shares = largest_shares(rows, directions=_FEW)[:, task.wanted_survives]
        excess = np.maximum(shares - _SAFE, 0.0)
    return list(zip(excess.tolist(), worst.tolist(), strict=True))


def _exchanged(
    task: SpotLayout, start: Floats, ends: Floats, apart: float
) -> tuple[Floats, tuple[float, float]]:
    """Move spot by spot to the best place, on the whole sensor and then nearby."""
    layout, step = start.copy(), float(np.max(ends[1] - ends[0])) / (_GRID - 1)
    sides = [np.linspace(low, high, max(2, round((high - low) / step) + 1)) for low, high in ends.T]
    whole = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    near = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2) * step
    cost = _costs(task, layout[None])[0]
    for part in (None, *_FINER):
        for _ in range(_PASSES):
            before = cost
            for spot in range(len(layout)):
                others = np.delete(layout, spot, axis=0)
                places = whole if part is None else layout[spot] + part * near
                places = np.clip(places, *ends)
                far = np.linalg.norm(places[:, None] - others, axis=-1).min(axis=1) >= apart
                if not far.any():
                    continue
                tried = np.repeat(layout[None], far.sum(), axis=0)
                tried[:, spot] = places[far]
                costs = _costs(task, tried)
                best = min(range(len(costs)), key=costs.__getitem__)
                if costs[best] < cost:
                    layout, cost = tried[best], costs[best]
            if not cost < before:
                break
    return layout, cost


def _starts(count: int, ends: Floats, apart: float, rng: np.random.Generator) -> list[Floats]:
    """Layouts to begin with: a ring that fills the sensor, and random ones."""
    turn = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    middle, half = ends.mean(axis=0), (ends[1] - ends[0]) / 2
    ring = middle + half * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return [ring, *(random_layout(count, ends, apart, rng) for _ in range(_STARTS - 1))]


def random_layout(count: int, ends: Floats, apart: float, rng: np.random.Generator) -> Floats:
    """Return spots (count, 2) anywhere between the ends, no two nearer than ``apart``."""
    placed = np.empty((0, 2))
    for _ in range(1000 * count):
        place = rng.uniform(*ends)
        if (np.linalg.norm(placed - place, axis=-1) >= apart).all():
            placed = np.vstack([placed, place])
            if len(placed) == count:
                return placed
    raise ValueError(f"apart_px leaves no room for {count} spots, {apart:g} px apart")


def _judged(task: SpotLayout, xy_px: Floats) -> SpotLayout:
    rows = _rows(task.camera, xy_px, task.model)
    breakdown = design_breakdown(rows, group=np.repeat(np.arange(len(xy_px)), 2))
    values = vars(task) | {
        "xy_px": xy_px,
        "sigma_arcsec": _errors_arcsec(task, rows) * task.wanted_arcsec,
        "survives": breakdown.monotone,
    }
    return SpotLayout(**values)
