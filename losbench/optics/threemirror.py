"""An off-axis camera of three conic mirrors: rays through it, however its parts have moved.

Frame: z to the object along the common axis of the mirrors, the first mirror's vertex at z = 0, x
along the columns and y down the rows of what the detector sees. Light comes down from +z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, integer, number, positive, shaped
from losbench.optics.camera import Camera
from losbench.optics.poses import Moved
from losbench.optics.rays import Rays, disc, meet

__all__ = ["OPTICS", "ThreeMirror"]

OPTICS = ("M1", "M2", "M3", "FP")
_RINGS = 4


@dataclass(frozen=True)
class ThreeMirror:
    """Three conics about one axis, used off it, and a plane detector; the second is the stop.

    Parameters
    ----------
    radius_mm, conic : (3,) floats
        Vertex radius and conic constant of each mirror; a positive radius has its centre towards
        the object.
    vertex_z_mm : (4,) floats
        Vertices of the mirrors and the plane of the detector.
    beam_mm : float
        Diameter of the beam that enters.
    bias_deg : float
        Angle between the common axis and the middle of the field, about x.
    pixel_um : float
        Pixel pitch, square pixels.
    shape : (int, int)
        Rows and columns of the detector.
    detector_y_mm : float, optional
        Height of the detector's middle; by default where the middle of the field falls.
    spot_separation_deg : float
        Angle between the two laser spots, which lie on the middle row.

    Raises
    ------
    ValueError
        If a length is not positive, a tuple has the wrong length, or the middle of the field misses
        a mirror.

    Notes
    -----
    Surfaces are c (x^2 + y^2 + (1 + k) z^2) = 2 z about each vertex, met in closed form (Welford,
    Aberrations of Optical Systems, 1986, section 4.5). A moved part is traced by carrying the rays
    into its own frame and back, so that poses and growth are exact, however large.

    Examples
    --------
    >>> from losbench.optics.design import design_three_mirror
    >>> camera = design_three_mirror(260.0)
    >>> px, focus_um = camera.observe()
    >>> px.round(1).tolist()
    [[1229.1, 539.5], [689.9, 539.5]]
    """

    radius_mm: tuple[float, float, float]
    conic: tuple[float, float, float]
    vertex_z_mm: tuple[float, float, float, float]
    beam_mm: float
    bias_deg: float
    pixel_um: float
    shape: tuple[int, int]
    detector_y_mm: float | None = None
    spot_separation_deg: float = 1.1914

    def __post_init__(self) -> None:
        """Check the values, and that the middle of the field gets through."""
        for name, size in (("radius_mm", 3), ("conic", 3), ("vertex_z_mm", 4)):
            values = finite(name, getattr(self, name))
            shaped(name, values, (size,))
            object.__setattr__(self, name, tuple(float(value) for value in values))
        if 0.0 in self.radius_mm:
            raise ValueError("radius_mm must not be zero")
        for name in ("beam_mm", "pixel_um", "spot_separation_deg"):
            object.__setattr__(self, name, float(positive(name, number(name, getattr(self, name)))))
        number("bias_deg", self.bias_deg, low=-45.0, high=45.0)
        sides = tuple(integer("shape", side, low=1) for side in np.ravel(self.shape))
        shaped("shape", np.array(sides), (2,))
        object.__setattr__(self, "shape", sides)
        if self.detector_y_mm is not None:
            number("detector_y_mm", self.detector_y_mm)
        if not np.isfinite(self.pivot_mm).all():
            raise ValueError("bias_deg, radius_mm and vertex_z_mm let no ray through the stop")

    @cached_property
    def pivot_mm(self) -> Floats:
        """Where the middle of the field meets each optic, (4, 3): parts turn and grow about it."""
        chief = self.launch(np.zeros(2), rings=0)
        points, _ = self.trace(chief, in_place=True)
        pivots = points[..., 0, :].reshape(4, 3)
        if self.detector_y_mm is not None:
            pivots[3, 1] = self.detector_y_mm
        return pivots

    @cached_property
    def spot_tangents(self) -> Floats:
        """Directions of the two laser beams as tangents (x, y) from the field's middle, (2, 2)."""
        half = np.tan(np.radians(self.spot_separation_deg / 2))
        return np.array([[half, 0.0], [-half, 0.0]])

    @cached_property
    def laser(self) -> Rays:
        """The two laser beams, (2, rays, 3), as the camera at rest takes them in."""
        return self.launch(self.spot_tangents)

    @cached_property
    def field_turn(self) -> Floats:
        """Matrix (3, 3) that takes vectors about the common axis to those about the field's middle,
        the frame of the line of sight.
        """
        c, s = np.cos(np.radians(self.bias_deg)), np.sin(np.radians(self.bias_deg))
        return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])

    def directions(self, tangents: ArrayLike) -> Floats:
        """Unit vectors (..., 3) towards objects at tangents (x, y), (..., 2), from the middle of
        the field.
        """
        t = np.asarray(tangents, dtype=np.float64)
        ray = np.concatenate([t, np.ones_like(t[..., :1])], axis=-1) @ self.field_turn
        return ray / np.linalg.norm(ray, axis=-1, keepdims=True)

    def launch(self, tangents: ArrayLike, *, rings: int = _RINGS) -> Rays:
        """Collimated beams whose chief rays meet the middle of the stop.

        Parameters
        ----------
        tangents : (..., 2) array
            Directions, tangents (x, y) from the middle of the field.
        rings : int
            Rings of 6, 12, 18 ... rays about the chief ray; 4 make 61 rays.

        Returns
        -------
        Rays of shape (..., rays, 3)
            They start in front of all mirrors; the chief ray comes first.
        """
        direction = -self.directions(tangents)
        start = np.zeros_like(direction)
        start[..., 2] = 2.0 * max(np.abs(self.vertex_z_mm))
        start[..., :2] -= direction[..., :2] / direction[..., 2:] * -start[..., 2:]
        for _ in range(8):  # secant on the linear map from entry to stop, good to 1e-12 mm
            start[..., :2] -= self._miss(start, direction)
        pupil = disc(rings) * self.beam_mm / 2.0
        across = np.cross(direction, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        sideways = np.cross(across, direction)
        origin = (
            start[..., None, :]
            + pupil[:, :1] * sideways[..., None, :]
            + pupil[:, 1:] * across[..., None, :]
        )
        return Rays(origin, np.broadcast_to(direction[..., None, :], origin.shape))

    def trace(
        self,
        rays: Rays,
        motion: ArrayLike | None = None,
        growth: ArrayLike | None = None,
        bending: ArrayLike | None = None,
        *,
        in_place: bool = False,
    ) -> tuple[Floats, Floats]:
        """Follow rays over the mirrors to the detector.

        Parameters
        ----------
        rays : Rays
            Of shape (..., spots, rays, 3).
        motion : (..., 4, 6) array, optional
            Translations, millimetres, and rotation vectors about the pivots, radians, of the four
            optics.
        growth : (..., 4) array, optional
            Each optic grows to 1 + growth times its size about its pivot.
        bending : (..., 3) array, 1/mm, optional
            Curvature added to each mirror about its pivot.
        in_place : bool
            The optics are at rest; the pivots are not asked for.

        Returns
        -------
        points_mm : (4, ..., spots, rays, 3) array
            Where each optic is met; NaN from where a ray misses. Those on the detector are in its
            own frame, which has moved with it.
        direction : (..., spots, rays, 3) array
            Of the rays that arrive, in that frame too.
        """
        points: list[Floats] = []
        moved = None if in_place else Moved.of(self.pivot_mm, motion, growth, bending)
        for i in range(4):
            local = rays if moved is None else moved.enter(i, rays)
            vertex = np.array([0.0, 0.0, self.vertex_z_mm[i]])
            local = Rays(local.origin_mm - vertex, local.direction)
            with np.errstate(invalid="ignore", divide="ignore"):
                flat = local.at(-local.origin_mm[..., 2] / local.direction[..., 2])
                if i == 3:
                    return np.stack(np.broadcast_arrays(*points, flat + vertex)), local.direction
                bend = (0.0, vertex) if moved is None else moved.bend(i)
                hit, normal = meet(
                    Rays(flat, local.direction),
                    1.0 / self.radius_mm[i],
                    self.conic[i],
                    bend[0],
                    bend[1] - vertex,
                )
            along = np.sum(local.direction * normal, axis=-1, keepdims=True)
            out = Rays(hit + vertex, local.direction - 2.0 * along * normal)
            rays = out if moved is None else moved.leave(i, out)
            points.append(rays.origin_mm)
        raise AssertionError  # the detector returns

    def observe(
        self,
        motion: ArrayLike | None = None,
        growth: ArrayLike | None = None,
        bending: ArrayLike | None = None,
        *,
        rays: Rays | None = None,
    ) -> tuple[Floats, Floats]:
        """See where beams fall, and how far from the detector they are sharpest.

        Parameters
        ----------
        motion, growth, bending : arrays (..., 4, 6), (..., 4), (..., 3), optional
            As in :meth:`trace`; all batch axes broadcast.
        rays : Rays, optional
            Beams of shape (spots, rays, 3); by default the two lasers, which do not move.

        Returns
        -------
        px : (..., spots, 2) array
            Mean of each beam's rays on the detector, (x, y) in pixels.
        focus_um : (..., spots) array
            Distance along z from the detector to where the beam is narrowest.

        Raises
        ------
        ValueError
            If a shape does not fit.
        """
        points, direction = self.trace(
            self.laser if rays is None else rays, motion, growth, bending
        )
        place = points[3][..., :2]
        slope = direction[..., :2] / direction[..., 2:]
        spread = slope - slope.mean(axis=-2, keepdims=True)
        power = np.sum(spread**2, axis=(-1, -2))
        # A single ray has no focus.
        focus_um = -1e3 * np.divide(
            np.sum(spread * place, axis=(-1, -2)),
            power,
            out=np.full(power.shape, np.nan),
            where=power > 0,
        )
        return self.pixels(place).mean(axis=-2), focus_um

    def pixels(self, xy_mm: Floats) -> Floats:
        """Pixels (x, y) of places (x, y) on the detector, millimetres, (..., 2)."""
        rows, cols = self.shape
        middle = np.array([(cols - 1) / 2, (rows - 1) / 2])
        return middle - (xy_mm - np.array([0.0, self.pivot_mm[3, 1]])) / (self.pixel_um * 1e-3)

    def field_tangents(self, columns: int = 9, rows: int = 5) -> Floats:
        """Tangents (x, y) of a grid over the detector, (rows * columns, 2)."""
        half = np.array(self.shape[::-1]) * self.pixel_um * 5e-4 / np.mean(self.plate_scale_mm)
        x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
        return np.stack([x.ravel(), y.ravel()], axis=-1) * half

    @cached_property
    def plate_scale_mm(self) -> Floats:
        """Millimetres on the detector per unit tangent at the middle of the field, along x, y."""
        step = 1e-4
        beams = self.launch(step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]), rings=0)
        x1, x0, y1, y0 = self.observe(rays=beams)[0]
        return np.array([x1[0] - x0[0], y1[1] - y0[1]]) * self.pixel_um * 1e-3 / (2 * step)

    @cached_property
    def pinhole(self) -> Camera:
        """The undistorted camera about the common axis that describes this one best.

        Its angles are about axes along and across the common axis; turn them by ``bias_deg`` about
        x into the frame of the line of sight.
        """
        rows, cols = self.shape
        axis = ((cols - 1) / 2, (rows - 1) / 2 + self.pivot_mm[3, 1] / (self.pixel_um * 1e-3))
        tangents, seen = self._field
        toward = self.directions(tangents)
        ideal = toward[:, :2] / toward[:, 2:]
        focal = np.sum((seen - axis) * ideal) / np.sum(ideal**2) * self.pixel_um * 1e-3
        return Camera(float(focal), self.pixel_um, self.shape, axis)

    @cached_property
    def distortion_px(self) -> float:
        """Root mean square, over a grid of the field, of what :attr:`pinhole` leaves over."""
        tangents, seen = self._field
        off = seen - self.pinhole.pixels(self.directions(tangents))
        return float(np.sqrt(np.mean(np.sum(off**2, axis=-1))))

    @cached_property
    def _field(self) -> tuple[Floats, Floats]:
        """Tangents of a grid and the pixels that they fall on."""
        tangents = self.field_tangents()
        return tangents, self.observe(rays=self.launch(tangents))[0]

    def _miss(self, start: Floats, direction: Floats) -> Floats:
        """Entry shift that would put each chief ray on the stop's vertex, to first order."""
        step_mm = 0.1
        shifts = np.array([[0.0, 0, 0], [step_mm, 0, 0], [0, step_mm, 0]])
        origin = start[..., None, :] + shifts
        points, _ = self.trace(
            Rays(origin, np.broadcast_to(direction[..., None, :], origin.shape)), in_place=True
        )
        at, along_x, along_y = np.moveaxis(points[1][..., :2], -2, 0)
        slopes = np.stack([along_x - at, along_y - at], axis=-1) / step_mm
        slopes = np.where(np.isfinite(slopes), slopes, np.eye(2))
        return np.linalg.solve(slopes, at[..., None])[..., 0]
