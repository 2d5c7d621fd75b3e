"""How a camera turns while it exposes, and the tracks that stars draw on its detector meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats, Indices
from losbench.checks import choice, finite, integer, number, positive, rotation, shaped
from losbench.optics.camera import Camera
from losbench.optics.motion.vibration import Motion

__all__ = ["EPOCHS", "AttitudePath", "Epoch", "gyro_path", "motion_path"]

Epoch = Literal["start", "middle", "end"]
EPOCHS = ("start", "middle", "end")

_TRUTH_PIECES = 20  # of a motion that is known at any time


@dataclass(frozen=True)
class AttitudePath:
    """Rotations of a camera during an exposure, at the nodes of a quadrature over time.

    Make it with `gyro_path` or `motion_path`.

    Parameters
    ----------
    time_s : (S,) array, seconds
        Nodes, after the start of the exposure.
    share : (S,) array
        Part of the exposure that each node stands for; they add up to 1.
    turns : (..., S, 3, 3) array
        Matrices that carry a star's ray at the start, in the camera frame, into its ray at each
        node.
    epochs : (..., 3, 3, 3) array
        The same for start (the unit matrix), middle and end of the exposure.
    exposure_s : float, seconds
    """

    time_s: Floats
    share: Floats
    turns: Floats
    epochs: Floats
    exposure_s: float

    @cached_property
    def mean_back(self) -> Floats:
        """Matrices (..., 3, 3) that carry a ray's mean over the exposure back into the ray at the
        start.

        A track's mean is that of its rays but for its change of scale on the way, some 1e-5 px.
        """
        return np.linalg.inv(np.einsum("s,...sij->...ij", self.share, self.turns))

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the exposures; () for one."""
        return self.turns.shape[:-3]

    def part(self, images: slice | Indices) -> AttitudePath:
        """Return the path of some of the exposures, along the first batch axis."""
        return replace(self, turns=self.turns[images], epochs=self.epochs[images])

    def tracks(self, xy: ArrayLike, camera: Camera, *, epoch: Epoch = "start") -> Floats:
        """Where stars are at the nodes.

        Parameters
        ----------
        xy : (..., n, 2) array, pixels
            Positions at ``epoch``; batch axes broadcast against those of the path.
        camera : Camera
        epoch : "start", "middle" or "end"

        Returns
        -------
        (..., n, S, 2) array, pixels
        """
        rays = self._start_rays(xy, camera, epoch)
        return camera.pixels(
            np.matmul(self.turns[..., None, :, :, :], rays[..., None, :, None])[..., 0]
        )

    def carry(
        self, xy: ArrayLike, camera: Camera, *, start: Epoch = "start", end: Epoch = "end"
    ) -> Floats:
        """Where stars at ``xy`` (..., n, 2) at one epoch are at another, (..., n, 2), pixels."""
        there = self.epochs[..., EPOCHS.index(choice("end", end, EPOCHS)), :, :]
        return camera.pixels(self._start_rays(xy, camera, start) @ np.swapaxes(there, -1, -2))

    def _start_rays(self, xy: ArrayLike, camera: Camera, epoch: str) -> Floats:
        here = self.epochs[..., EPOCHS.index(choice("epoch", epoch, EPOCHS)), :, :]
        return camera.points_mm(xy) @ here  # the transpose undoes a rotation, and these are rows


def gyro_path(
    increments_rad: ArrayLike,
    *,
    interval_s: float,
    exposure_s: float,
    first_s: float = 0.0,
    interpolation: Literal["linear", "spline"] = "linear",
    mounting: ArrayLike | None = None,
    nodes: int = 4,
) -> AttitudePath:
    """Path of a camera from the angle increments of its gyro.

    Parameters
    ----------
    increments_rad : (..., k, 3) array, rad
        Body angle increments, about the camera's axes unless ``mounting`` says otherwise.
    interval_s : float, seconds
        What each of them spans.
    exposure_s : float, seconds
    first_s : float, seconds
        When the first increment begins, after the start of the exposure; negative for a record that
        begins before it.
    interpolation : "linear" or "spline"
        Of the summed angle between samples: a constant rate within each increment, or a cubic
        spline (not-a-knot). The spline is far better for vibrations well below half the sampling
        rate, and worse near it.
    mounting : (3, 3) array, optional
        Rotation from gyro axes to camera axes, the C of lyu2015, eq. (8).
    nodes : int
        Gauss-Legendre nodes per increment. Four do for spots whose sigma is a third of the track
        per increment or more.

    Returns
    -------
    AttitudePath

    Raises
    ------
    ValueError
        If an increment is not finite, the increments do not span the exposure, or the mounting is
        no rotation.

    Notes
    -----
    lyu2015, eq. (5) and (8): C(t2) = exp(-[a x]) C(t1), increments applied on the left in order.

    Examples
    --------
    >>> camera = Camera(focal_mm=36.6097, pixel_um=10.0, shape=(512, 512))
    >>> path = gyro_path(np.full((5, 3), [0.0, 1e-4, 0.0]), interval_s=0.005, exposure_s=0.025)
    >>> path.carry([[255.5, 255.5]], camera).round(3).tolist()
    [[253.67, 255.5]]
    """
    increments = finite("increments_rad", increments_rad)
    shaped("increments_rad", increments, ("...", "k", 3))
    interval = float(positive("interval_s", number("interval_s", interval_s)))
    exposure = float(positive("exposure_s", number("exposure_s", exposure_s)))
    knots = number("first_s", first_s) + interval * np.arange(increments.shape[-2] + 1)
    if knots[0] > 1e-9 * exposure or knots[-1] < exposure * (1 - 1e-9):
        raise ValueError(
            f"increments must span the exposure from 0 to {exposure:g} s, got {knots[0]:g} to "
            f"{knots[-1]:g} s"
        )
    if mounting is not None:
        increments = increments @ rotation("mounting", mounting).T
    angles = np.concatenate(
        [np.zeros_like(increments[..., :1, :]), np.cumsum(increments, axis=-2)], axis=-2
    )
    kind = choice("interpolation", interpolation, ("linear", "spline"))
    inner = knots[(knots > 1e-6 * interval) & (knots < exposure - 1e-6 * interval)]
    return _path(
        _interpolator(knots, angles, kind), exposure, inner, integer("nodes", nodes, low=1)
    )


def motion_path(
    motion: Motion, exposure_s: float, *, mounting: ArrayLike | None = None, nodes: int = 4
) -> AttitudePath:
    """Path of a camera whose motion is known at any time: the truth of a simulation.

    Parameters
    ----------
    motion : Motion
        Its rates are about the camera's axes unless ``mounting`` says otherwise.
    exposure_s : float, seconds
    mounting : (3, 3) array, optional
        Rotation from the motion's axes to the camera's.
    nodes : int
        Gauss-Legendre nodes in each of 20 equal parts of the exposure.

    Returns
    -------
    AttitudePath

    Raises
    ------
    ValueError
        If the exposure is not positive or the mounting is no rotation.
    """
    exposure = float(positive("exposure_s", number("exposure_s", exposure_s)))
    turn = np.eye(3) if mounting is None else rotation("mounting", mounting)
    inner = exposure * np.arange(1, _TRUTH_PIECES) / _TRUTH_PIECES
    return _path(
        lambda time: motion.angle(time) @ turn.T, exposure, inner, integer("nodes", nodes, low=1)
    )


def _path(
    angle: Callable[[Floats], Floats], exposure: float, inner: Floats, nodes: int
) -> AttitudePath:
    """Chain small rotations from node to node, with the epochs in between."""
    edges = np.concatenate([[0.0], inner, [exposure]])
    place, weight = np.polynomial.legendre.leggauss(nodes)
    half = np.diff(edges)[:, None] / 2
    time = ((edges[1:] + edges[:-1])[:, None] / 2 + half * place).ravel()
    share = (half * weight).ravel() / exposure
    # No step goes past the end of an increment: across it, the two parts would not commute.
    stops = np.concatenate([time, [0.0, exposure / 2, exposure], inner])
    order = np.argsort(stops, kind="stable")
    steps = np.diff(angle(stops[order]), axis=-2)
    chained = _chained(steps)
    turns = np.empty_like(chained)
    turns[..., order, :, :] = chained
    return AttitudePath(
        time,
        share,
        turns[..., : len(time), :, :],
        turns[..., len(time) : len(time) + 3, :, :],
        exposure,
    )


def _chained(steps: Floats) -> Floats:
    """Products of exp(-[step x]), each on the left of those before it, the unit matrix first; (...,
    k + 1, 3, 3).
    """
    from scipy.spatial.transform import Rotation  # half the time that `import losbench` may take

    turns = np.empty((*steps.shape[:-2], steps.shape[-2] + 1, 3, 3))
    turns[..., 0, :, :] = np.eye(3)
    single = Rotation.from_rotvec(-steps.reshape(-1, 3)).as_matrix().reshape(*steps.shape, 3)
    for k in range(steps.shape[-2]):
        np.matmul(single[..., k, :, :], turns[..., k, :, :], out=turns[..., k + 1, :, :])
    return turns


def _interpolator(knots: Floats, angles: Floats, kind: str) -> Callable[[Floats], Floats]:
    from scipy.interpolate import make_interp_spline  # not needed before the first path

    degree = min(3, len(knots) - 1) if kind == "spline" else 1
    spline = make_interp_spline(knots, np.moveaxis(angles, -2, 0), k=degree)
    # A record that ends with the exposure may fall short of it by a rounding.
    return lambda time: np.moveaxis(spline(np.clip(time, knots[0], knots[-1])), 0, -2)
