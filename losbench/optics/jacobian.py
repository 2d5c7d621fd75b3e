"""What each small motion of each optic does to the line of sight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats
from losbench.optics.camera import design_matrix
from losbench.optics.threemirror import OPTICS, ThreeMirror
from losbench.units import arcsec_to_rad, rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["MOTIONS", "apart", "jacobian_table", "los_angles", "los_jacobian"]

MOTIONS = ("tx", "ty", "tz", "rx", "ry", "rz", "growth", "bending")
_STEPS = np.array([1e-3] * 3 + [1e-5] * 3 + [1e-5, 1e-8])  # mm, rad, 1, 1/mm


def apart(motions: Floats) -> tuple[Floats, Floats, Floats]:
    """Motion (..., 4, 6), growth (..., 4) and bending (..., 3) of motions (..., 32)."""
    parts = motions.reshape(*motions.shape[:-1], len(OPTICS), len(MOTIONS))
    return parts[..., :6], parts[..., 6], parts[..., :3, 7]


def los_jacobian(camera: ThreeMirror) -> Floats:
    """Two spots and their focus per unit of each motion of each optic, by central differences.

    Parameters
    ----------
    camera : ThreeMirror

    Returns
    -------
    (6, 32) array
        Rows: x, y of spot A, x, y of spot B, pixels; focus of A, of B, micrometres. Columns: for
        M1, M2, M3 and the focal plane the eight `MOTIONS`: translations, per millimetre; rotations
        about the pivot, per radian; growth; bending, per 1/mm (none for the focal plane).

    Notes
    -----
    The map holds to 3e-5 px for motions of 10 um or 10 arcsec; its error grows as their square.

    Examples
    --------
    >>> from losbench.optics.design import design_three_mirror
    >>> jacobian = los_jacobian(design_three_mirror())
    >>> jacobian.shape, round(float(jacobian[1, 25]) / 1e3, 4)
    ((6, 32), 0.1)
    """
    steps = np.tile(_STEPS, len(OPTICS))
    px, focus_um = camera.observe(*apart(np.array([1.0, -1.0])[:, None, None] * np.diag(steps)))
    seen = np.concatenate([px.reshape(2, -1, 4), focus_um], axis=-1)
    return ((seen[0] - seen[1]) / (2.0 * steps[:, None])).T


def los_angles(camera: ThreeMirror) -> Floats:
    """Angles about x, y, z of the line of sight, radians, per pixel of two spots: (3, 4).

    Least squares of the exact rows (`design_matrix`) of the camera's pinhole, turned from the
    common axis to the middle of the field; columns x, y of spot A, x, y of spot B.
    """
    pinhole = camera.pinhole
    rows = design_matrix(pinhole.points_mm(camera.observe()[0]))
    return camera.field_turn @ np.linalg.pinv(rows) * pinhole.pixel_mm


def jacobian_table(camera: ThreeMirror) -> pd.DataFrame:
    """What a micrometre and an arcsecond of each optic do to the line of sight.

    Returns
    -------
    DataFrame of 4 x 6 rows (optic, motion)
        Angles about x, y and z in arcseconds, by both spots; scale of their distance, ppm; focus,
        micrometres.
    """
    import pandas as pd

    unit = np.array([1e-3] * 3 + [float(arcsec_to_rad(1.0))] * 3)
    jacobian = los_jacobian(camera).reshape(6, len(OPTICS), len(MOTIONS))[..., :6] * unit
    per_px = rad_to_arcsec(los_angles(camera))
    spots = camera.observe()[0]
    apart_px = spots[0] - spots[1]
    scale_ppm = np.tensordot(
        apart_px / (apart_px @ apart_px) * 1e6, jacobian[:2] - jacobian[2:4], 1
    )
    columns = [*np.tensordot(per_px, jacobian[:4], 1), scale_ppm, jacobian[4:].mean(axis=0)]
    names = ["alpha_arcsec", "beta_arcsec", "gamma_arcsec", "scale_ppm", "focus_um"]
    index = pd.MultiIndex.from_product(
        [OPTICS, [f"{m}, per {'um' if m[0] == 't' else 'arcsec'}" for m in MOTIONS[:6]]],
        names=["optic", "motion"],
    )
    return pd.DataFrame({n: c.ravel() for n, c in zip(names, columns, strict=True)}, index=index)
