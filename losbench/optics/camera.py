"""From pixels to lines of sight, and from small rotations to the displacements that a camera sees.

Points are vectors (x, y, z) in the camera frame: x along the columns, y down the rows, z along the
line of sight. Angles are the rotation vector (alpha, beta, gamma) that carries the reference
directions into the observed ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import choice, finite, finite_or_nan, integer, number, positive, shaped
from losbench.parameters import from_table, read_toml, to_table
from losbench.units import px_to_arcsec

__all__ = ["Camera", "design_matrix", "project", "rotate"]

Model = Literal["pinhole", "paper"]


@dataclass(frozen=True)
class Camera:
    """An undistorted camera: focal length, pixel pitch and detector format.

    Parameters
    ----------
    focal_mm : float
        Focal length in millimetres.
    pixel_um : float
        Pixel pitch in micrometres, square pixels.
    shape : (int, int)
        Rows and columns of the detector.
    principal_px : (float, float), optional
        Where the optical axis meets the detector, (x, y) in pixels; by default the middle, ((W - 1)
        / 2, (H - 1) / 2).

    Raises
    ------
    ValueError
        If a length is not positive, ``shape`` is not two whole numbers or ``principal_px`` not two
        finite ones.

    Examples
    --------
    >>> camera = Camera(focal_mm=260.0, pixel_um=10.0, shape=(1080, 1920))
    >>> [round(side, 2) for side in camera.fov_deg]
    [4.23, 2.38]
    >>> camera.points_mm([959.5, 639.5]).tolist()
    [0.0, 1.0, 260.0]
    """

    focal_mm: float
    pixel_um: float
    shape: tuple[int, int]
    principal_px: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check the values and put the principal point in the middle unless given."""
        rows, cols = (integer("shape", side, low=1) for side in _pair("shape", self.shape))
        centre = (
            ((cols - 1) / 2, (rows - 1) / 2) if self.principal_px is None else self.principal_px
        )
        checked = {
            "focal_mm": float(positive("focal_mm", number("focal_mm", self.focal_mm))),
            "pixel_um": float(positive("pixel_um", number("pixel_um", self.pixel_um))),
            "shape": (rows, cols),
            "principal_px": tuple(
                number("principal_px", value) for value in _pair("principal_px", centre)
            ),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def fov_deg(self) -> tuple[float, float]:
        """Full field of view along x (columns) and y (rows), from edge to edge of the outer
        pixels.
        """
        low = self.points_mm([-0.5, -0.5])
        high = self.points_mm([self.shape[1] - 0.5, self.shape[0] - 0.5])
        x, y = np.degrees(np.arctan(high / self.focal_mm) - np.arctan(low / self.focal_mm))[:2]
        return float(x), float(y)

    @property
    def arcsec_per_px(self) -> float:
        """Angle that one pixel spans on the optical axis."""
        return float(px_to_arcsec(1.0, focal_mm=self.focal_mm, pixel_um=self.pixel_um))

    @property
    def pixel_mm(self) -> float:
        """Pixel pitch in the unit of :meth:`points_mm`: turns shifts in pixels into millimetres."""
        return self.pixel_um * 1e-3

    @property
    def focal_px(self) -> float:
        """Focal length in pixels: a ray's slope becomes as many."""
        return self.focal_mm / self.pixel_mm

    def points_mm(self, xy_px: ArrayLike) -> Floats:
        """Return the rays (x, y, f) in millimetres, (..., 3), of pixels (x, y), (..., 2); NaN stays
        NaN.
        """
        xy = finite_or_nan("xy_px", xy_px)
        shaped("xy_px", xy, ("...", 2))
        offset_mm = (xy - np.asarray(self.principal_px)) * self.pixel_mm
        return np.concatenate([offset_mm, np.full_like(offset_mm[..., :1], self.focal_mm)], axis=-1)

    def pixels(self, points_mm: ArrayLike) -> Floats:
        """Return the pixels (x, y), (..., 2), on which points (..., 3) in front of the camera fall;
        NaN for z <= 0.
        """
        points = finite_or_nan("points_mm", points_mm)
        shaped("points_mm", points, ("...", 3))
        ahead = np.where(points[..., 2:] > 0, points[..., 2:], np.nan)
        return points[..., :2] / ahead * self.focal_px + np.asarray(self.principal_px)

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """Read a camera from a TOML file with the keys focal_mm, pixel_um, shape = [rows, cols] and
        maybe principal_px.

        A table ``[detector]`` in it is left to `Detector.from_toml`.

        Raises
        ------
        ValueError
            Naming the file, if it is not TOML, lacks a key, has an unknown one or a value that does
            not fit.
        """
        return from_table(cls, read_toml(path), where=str(path), ignore=["detector"])

    def to_toml(self) -> str:
        """Return the camera as the text of a TOML file that :meth:`from_toml` reads."""
        return to_table(self) + "\n"


def design_matrix(points: ArrayLike, model: Model = "pinhole") -> Floats:
    r"""Rows that turn three small angles into the displacements of points on their image plane.

    Parameters
    ----------
    points : (..., n, 3) array, any unit of length
        Reference points (x, y, z), z other than zero.
    model : "pinhole" or "paper"
        "pinhole" is exact to first order in the angles; "paper" drops the perspective terms.

    Returns
    -------
    (..., 2n, 3) array, unit of ``points`` per radian
        Rows x then y of each point; columns alpha, beta, gamma.

    Raises
    ------
    ValueError
        If a point is not finite or has z = 0, the shape does not fit, or the model is unknown.

    Notes
    -----
    With u = x/z and v = y/z, rotating (x, y, z) and projecting it back on its plane gives, to first
    order,

    .. math::

        dx / z &= -u v\,\alpha + (1 + u^2)\,\beta - v\,\gamma \\
        dy / z &= -(1 + v^2)\,\alpha + u v\,\beta + u\,\gamma

    The paper (liu2026, eq. 2) has dx = z beta - y gamma and dy = -z alpha + x gamma.

    Examples
    --------
    >>> design_matrix([[5.0, 75.0, -475.0]], model="paper").tolist()
    [[0.0, -475.0, -75.0], [475.0, 0.0, 5.0]]
    """
    p = checked_points(points)
    choice("model", model, ("pinhole", "paper"))
    x, y, z = np.moveaxis(p, -1, 0)
    uv, uu, vv = (
        (x * y / z, x * x / z, y * y / z) if model == "pinhole" else (np.zeros_like(z),) * 3
    )
    row_x = np.stack([0.0 - uv, z + uu, -y], axis=-1)
    row_y = np.stack([-z - vv, uv, x], axis=-1)
    return np.stack([row_x, row_y], axis=-2).reshape(*p.shape[:-2], -1, 3)


def rotate(points: ArrayLike, angles: ArrayLike) -> Floats:
    """Points (..., n, 3) turned by rotation vectors ``angles`` (..., 3) in radians, exactly; (...,
    n, 3).

    >>> rotate([[0.0, 0.0, 1.0]], [0.0, np.pi / 2, 0.0]).round(12).tolist()
    [[1.0, 0.0, 0.0]]
    """
    from scipy.spatial.transform import Rotation  # half the time that `import losbench` may take

    p, vectors = checked_points(points), finite("angles", angles)
    shaped("angles", vectors, ("...", 3))
    matrices = (
        Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape[:-1], 3, 3)
    )
    return p @ np.swapaxes(matrices, -1, -2)


def project(points: ArrayLike, angles: ArrayLike) -> Floats:
    """Where a camera sees points after an exact rotation: each projected back on its own plane z.

    Parameters
    ----------
    points : (..., n, 3) array, any unit of length
        Reference points (x, y, z).
    angles : (..., 3) array, radians
        Rotation vectors; batch axes broadcast against those of ``points``.

    Returns
    -------
    (..., n, 3) array, unit of ``points``
        z is that of the reference point; x and y are NaN where the rotation takes a point behind
        the camera.

    Examples
    --------
    >>> points = [[0.0, 0.0, 100.0]]
    >>> project(points, [0.0, np.arctan(0.01), 0.0]).round(9).tolist()
    [[1.0, 0.0, 100.0]]
    """
    p = checked_points(points)
    turned = rotate(p, angles)
    plane = np.broadcast_to(p[..., 2:], (*turned.shape[:-1], 1))
    ratio = turned[..., 2:] / plane
    seen = turned[..., :2] / np.where(ratio > 0, ratio, np.nan)
    return np.concatenate([seen, plane], axis=-1)


def checked_points(points: ArrayLike) -> Floats:
    """Return ``points`` as a finite float array (..., n, 3) with z other than zero, or raise
    ``ValueError``.
    """
    p = finite("points", points)
    shaped("points", p, ("...", "n", 3))
    if (p[..., 2] == 0).any():
        raise ValueError(
            "points must have z other than zero: x/z and y/z are the direction that a camera sees"
        )
    return p


def _pair(name: str, value: Any) -> tuple[Any, Any]:
    if not isinstance(value, list | tuple | np.ndarray) or len(value) != 2:
        raise ValueError(f"{name} must be two numbers, got {value!r}")
    return value[0], value[1]
