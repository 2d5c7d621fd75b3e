"""Pictures of a thermo-elastic camera: whole or cut open, coloured by temperature, with rays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, number, shaped
from losbench.thermoelastic.camera import ThermoelasticCamera

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection

__all__ = ["draw_camera"]

_RAY_COLOURS = ("#e4572e", "#2e8b57", "#2a7fff")
_FIELD = np.array([[0.0, 0.018], [0.0, 0.0], [0.0, -0.018]])
_PIECES = 40  # of a ray, so that each hides behind the right wall
_TILES = 4  # a facet's side, so that neither depth nor colour is one number for a whole wall
_NAMES = {"M1": (16, 8), "M2, the stop": (-62, 22), "M3": (16, 0), "detector": (-62, -4)}
_LAMP = np.array([0.45, 0.80, 0.40])


def draw_camera(
    ax: Axes,
    camera: ThermoelasticCamera,
    values: ArrayLike,
    *,
    cut_mm: float | None = None,
    displacement_mm: Floats | None = None,
    exaggerate: float = 1.0,
    rays: bool = False,
    azimuth_deg: float = 55.0,
    elevation_deg: float = 24.0,
    limits: tuple[float, float] | None = None,
    cmap: str = "plasma",
) -> PolyCollection:
    """Draw the bricks of a camera, far ones first, coloured by a value of each vertex.

    Parameters
    ----------
    ax : matplotlib Axes
        Plain two-dimensional axes.
    camera : ThermoelasticCamera
    values : (vertices,) array
        Temperatures, or anything else.
    cut_mm : float, optional
        Bricks with a larger x are left out, to look inside.
    displacement_mm : (nodes, 3) array, optional
        From `ThermoelasticCamera.displace`; drawn ``exaggerate`` times.
    rays : bool
        Draw the rays of three field points through the optics at rest.
    azimuth_deg, elevation_deg : float
        From where to look: about the vertical y, 0 from the object, and above the horizon.
    limits : (float, float), optional
        Of the colours.
    cmap : str
        Name of a matplotlib colour map.

    Returns
    -------
    PolyCollection
        For a colour bar.

    Raises
    ------
    ValueError
        If a shape does not fit.
    """
    from matplotlib.collections import PolyCollection

    mesh = camera.structure.mesh
    colours = finite("values", values)
    shaped("values", colours, (int(mesh.nvertices),))
    place = np.asarray(mesh.p.T, dtype=np.float64)
    if displacement_mm is not None:
        nodes = camera.elasticity.vertex_nodes
        place = place + number("exaggerate", exaggerate) * displacement_mm[nodes]
    view = _view(azimuth_deg, elevation_deg)
    corners, outward = _skin(camera, np.inf if cut_mm is None else cut_mm)
    corners, outward = (each[outward @ view[2] > 1e-9] for each in (corners, outward))
    tiles = _tiled(place[corners] @ view.T)
    tone = _tiled(colours[corners][..., None]).mean(axis=-2)[:, 0]
    light = 0.55 + 0.45 * np.clip(outward @ _LAMP, 0.0, 1.0)

    low, high = limits or (float(colours.min()), float(colours.max()))
    result = PolyCollection([], cmap=cmap)
    result.set_clim(low, max(high, low + 1e-9))
    rgba = np.asarray(result.to_rgba(tone))
    rgba[:, :3] *= np.repeat(light, _TILES**2)[:, None]
    edge, width = rgba, np.full(len(rgba), 0.8)
    if rays:
        pieces, owner = _light(camera, view)
        tiles = np.concatenate([tiles, pieces])
        edge = np.concatenate([edge, owner])
        rgba = np.concatenate([rgba, np.zeros_like(owner)])
        width = np.append(width, np.full(len(owner), 0.9))
    order = np.argsort(tiles[..., 2].mean(axis=1))  # the painter's way
    result.set(
        verts=tiles[order, :, :2],
        facecolor=rgba[order],
        edgecolor=edge[order],
        linewidth=width[order],
    )
    ax.add_collection(result)
    if rays:
        white = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8}
        for (name, off), at in zip(_NAMES.items(), camera.optics.pivot_mm @ view.T, strict=True):
            ax.annotate(name, at[:2], off, textcoords="offset points", fontsize=8, bbox=white)
    ax.update_datalim(tiles[..., :2].reshape(-1, 2))
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.set_axis_off()
    return result


def _view(azimuth_deg: float, elevation_deg: float) -> Floats:
    """Rows: to the right, up, and towards the eye, (3, 3)."""
    turn, lift = np.radians(azimuth_deg), np.radians(elevation_deg)
    eye = np.array([np.cos(lift) * np.sin(turn), np.sin(lift), np.cos(lift) * np.cos(turn)])
    right = np.cross([0.0, 1.0, 0.0], eye)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(eye, right), eye])


def _skin(camera: ThermoelasticCamera, cut_mm: float) -> tuple[Floats, Floats]:
    """Corners (facets, 4) of the faces between kept bricks and nothing: low-low, high-low,
    low-high, high-high along the two axes that they span; and outward normals (facets, 3).
    """
    mesh = camera.structure.mesh
    kept = mesh.p[0][mesh.t].mean(axis=0) < cut_mm
    one, two = mesh.f2t
    first, second = kept[one], (two >= 0) & kept[two]
    facets = np.flatnonzero(first != second)
    inner = np.where(first, one, two)[facets]
    corners = mesh.facets[:, facets].T
    place = mesh.p.T[corners]
    normal = np.ptp(place, axis=1) < 1e-9
    keys = (place > place.mean(axis=1, keepdims=True)) * ~normal[:, None]
    rank = np.where(normal, 0, np.cumsum(~normal, axis=1))
    order = np.argsort(np.sum(keys * rank[:, None], axis=-1), axis=1)
    middle = mesh.p[:, mesh.t[:, inner]].mean(axis=1).T
    outward = np.where(normal, np.sign(place.mean(axis=1) - middle), 0.0)
    return np.take_along_axis(corners, order, axis=1), outward


def _tiled(corner: Floats) -> Floats:
    """Cut quadrilaterals (n, 4, k), corners in the order of `_skin`, into (n * tiles, 4, k) in
    cyclic order.
    """
    u = np.linspace(0.0, 1.0, _TILES + 1)
    weight = np.stack(
        [np.outer(1 - u, 1 - u), np.outer(1 - u, u), np.outer(u, 1 - u), np.outer(u, u)], axis=-1
    )
    grid = np.einsum("abc,nck->nabk", weight, corner)
    tiles = np.stack(
        [grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]], axis=3
    )
    return tiles.reshape(-1, 4, corner.shape[-1])


def _light(camera: ThermoelasticCamera, view: Floats) -> tuple[Floats, Floats]:
    """Pieces (n, 4, 3) of the rays, as flat polygons, and their colours (n, 4)."""
    from matplotlib.colors import to_rgba_array

    beams = camera.optics.launch(_FIELD, rings=2)
    points, _ = camera.optics.trace(beams)
    way = np.concatenate([beams.origin_mm[None], points])[:, :, [0, 10, 16]]  # middle, top, bottom
    # Begin a little before the body does.
    start = 1.3 * np.max(camera.structure.mesh.p[2])
    share = (start - way[1, ..., 2]) / (way[0, ..., 2] - way[1, ..., 2])
    way[0] = way[1] + share[..., None] * (way[0] - way[1])
    u = np.linspace(0.0, 1.0, _PIECES + 1)[:, None, None, None, None]
    line = way[:-1] + u * (way[1:] - way[:-1])
    ends = np.stack([line[:-1], line[1:], line[1:], line[:-1]], axis=-2)
    owner = np.broadcast_to(np.arange(3)[:, None], ends.shape[:-2])
    return ends.reshape(-1, 4, 3) @ view.T, to_rgba_array(_RAY_COLOURS)[owner.ravel()]
