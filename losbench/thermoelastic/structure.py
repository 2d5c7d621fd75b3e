"""Boxes on one grid of bricks: which part is where, what it stands on, which faces are outside."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats, Indices
from losbench.checks import choice, number, positive
from losbench.optics.threemirror import OPTICS, ThreeMirror
from losbench.thermoelastic.materials import Material
from losbench.thermoelastic.shapes import Box, Face, Foot

if TYPE_CHECKING:
    from skfem import MeshHex

__all__ = ["SIDES", "Structure"]

SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")
_RIGID = (
    "shift along x",
    "shift along y",
    "shift along z",
    "turn about x",
    "turn about y",
    "turn about z",
)
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])


@dataclass(frozen=True)
class Structure:
    """A camera's body of axis-parallel boxes, each part of one material.

    Parameters
    ----------
    boxes : sequence of Box
        Boxes of unlike parts may not overlap unless the later one says that it replaces the part.
    materials : mapping of part to Material
    feet : mapping of name to Foot
    faces : mapping of "M1", "M2", "M3", "FP" to Face
    holes : sequence of Box, optional
        Cut from their parts.
    planes_mm : mapping of "x", "y", "z" to floats, optional
        Further grid planes beside those of boxes, feet and faces.
    cell_mm : float
        No cell is longer.

    Raises
    ------
    ValueError
        In one line that names part and key: an overlap, a part without a material or without a box,
        one that touches nothing, a foot or face off the body, a mount that leaves a motion free.

    Examples
    --------
    >>> from losbench.thermoelastic.materials import MATERIALS
    >>> bar = Structure(
    ...     [Box("bar", (0, 0, 0), (10, 10, 100))],
    ...     {"bar": MATERIALS["Al 6061"]},
    ...     {"A": Foot((0, 0, 0), "xyz"), "B": Foot((0, 0, 100), "xy"), "C": Foot((10, 0, 0), "y")},
    ... )
    >>> bar.mesh.nelements
    2
    """

    boxes: tuple[Box, ...]
    materials: Mapping[str, Material]
    feet: Mapping[str, Foot]
    faces: Mapping[str, Face] = field(default_factory=dict)
    holes: tuple[Box, ...] = ()
    planes_mm: Mapping[str, Iterable[float]] = field(default_factory=dict)
    cell_mm: float = 50.0

    def __post_init__(self) -> None:
        """Check the model, cheapest first."""
        positive("cell_mm", number("cell_mm", self.cell_mm))
        if missing := [part for part in self.parts if part not in self.materials]:
            raise ValueError(f"part {missing[0]!r} has no key in materials")
        for kind, named in (("materials", self.materials), ("holes", [h.part for h in self.holes])):
            if unknown := sorted(set(named) - set(self.parts)):
                raise ValueError(f"{kind}: there is no box of part {unknown[0]!r}")
        for k, box in enumerate(self.boxes):
            for part in box.replaces:
                choice(f"box {k + 1}: replaces", part, self.parts)
        for name in self.faces:
            choice("faces", name, OPTICS)
        for axis in self.planes_mm:
            choice("planes_mm", axis, "xyz")
        if not self.boxes:
            raise ValueError("boxes must hold at least one box")
        self._check_whole()
        self._check_mount()

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts, in the order of their first boxes."""
        return tuple(dict.fromkeys(box.part for box in self.boxes))

    @cached_property
    def grid_mm(self) -> tuple[Floats, Floats, Floats]:
        """Planes of the grid along x, y, z."""
        ends = [[b.low_mm, b.high_mm] for b in (*self.boxes, *self.holes)]
        ends += [[(*f.low_mm, f.z_mm), (*f.high_mm, f.z_mm)] for f in self.faces.values()]
        planes = np.array(
            [corner for pair in ends for corner in pair] + [foot.mm for foot in self.feet.values()],
            dtype=np.float64,
        )
        x, y, z = (
            self._split(np.unique(np.append(planes[:, i], list(self.planes_mm.get(axis, ())))))
            for i, axis in enumerate("xyz")
        )
        return x, y, z

    @cached_property
    def mesh(self) -> MeshHex:
        """Return the bricks that hold material, a scikit-fem mesh in millimetres."""
        from skfem import MeshHex

        whole = MeshHex.init_tensor(*self.grid_mm)
        return whole.restrict(np.flatnonzero(self._label(_middles(whole)) >= 0))

    @cached_property
    def cell_part(self) -> Indices:
        """Number of the part, in :attr:`parts`, of each cell."""
        return self._label(_middles(self.mesh))

    @cached_property
    def vertex_volume_mm3(self) -> Floats:
        """Return the material about each vertex, an eighth of each of its cells, (vertices,)."""
        mesh = self.mesh
        share = np.prod(np.ptp(mesh.p[:, mesh.t], axis=1), axis=0) / 8.0
        return np.bincount(mesh.t.ravel(), np.tile(share, 8), mesh.nvertices).astype(float)

    @cached_property
    def outside(self) -> Indices:
        """Facets (boundary,) that have no cell on their other side."""
        return self.mesh.boundary_facets()

    def per_cell(self, name: str) -> Floats:
        """Return a number of the materials, an attribute of `Material`, for each cell, (cells,)."""
        return np.array([getattr(self.materials[part], name) for part in self.parts])[
            self.cell_part
        ]

    def facets(self, part: str | None = None, side: str | None = None) -> Indices:
        """Outside facets, of one part only or facing one of `SIDES`.

        Raises
        ------
        ValueError
            If there is no such part or side, or no such facet.
        """
        mesh, found = self.mesh, self.outside
        cells = mesh.f2t[0, found]
        keep = np.ones(found.size, dtype=bool)
        if part is not None:
            keep &= self.cell_part[cells] == self.parts.index(choice("part", part, self.parts))
        if side is not None:
            axis, sign = divmod(SIDES.index(choice("side", side, SIDES)), 2)
            facing = _facet_middles(mesh, found)[:, axis] - _middles(mesh)[cells, axis]
            flat = np.ptp(mesh.p[axis][mesh.facets[:, found]], axis=0) == 0
            keep &= flat & (np.sign(facing) == 2 * sign - 1)
        if not keep.any():
            raise ValueError(f"part {part!r} has no outside facet on side {side!r}")
        return found[keep]

    def face_facets(self, name: str) -> Indices:
        """Outside facets that make an optic's face.

        Raises
        ------
        ValueError
            If the face is not given, or they do not cover it.
        """
        face = self.faces.get(name)
        if face is None:
            raise ValueError(f"faces: key {name} is missing")
        mesh = self.mesh
        place = mesh.p[:, mesh.facets[:, self.outside]]
        inside = np.all(np.abs(place[2] - face.z_mm) < 1e-6, axis=0)
        for axis in range(2):
            middle = place[axis].mean(axis=0)
            inside &= (middle > face.low_mm[axis]) & (middle < face.high_mm[axis])
        covered = np.prod(np.ptp(place[:2, :, inside], axis=1), axis=0).sum()
        if covered < np.prod(np.subtract(face.high_mm, face.low_mm)) * (1 - 1e-9):
            raise ValueError(
                f"faces: {name} must lie on the outside of the body: at z_mm = {face.z_mm:g} only "
                f"{covered:.0f} mm2 between low_mm and high_mm do"
            )
        return self.outside[inside]

    def check_light(self, optics: ThreeMirror) -> None:
        """Raise ``ValueError``, naming the part, if one stands in the way of the field's beams."""
        half = 0.5 * (np.array(optics.shape[::-1]) - 1) * optics.pixel_um * 1e-3
        rays = optics.launch(_CORNERS * half / optics.plate_scale_mm)
        points, _ = optics.trace(rays)
        stations = np.concatenate([rays.origin_mm[None], points])
        behind = [self.mesh.f2t[0, self.face_facets(name)] for name in OPTICS]
        own = [{self.parts[k] for k in self.cell_part[cells]} for cells in behind]
        for leg in range(4):
            for number_, box in enumerate(self.boxes):
                # A mirror's slab is flat where its surface is hollow: light may touch it.
                if box.part in own[leg] | own[max(leg - 1, 0)]:
                    continue
                entry, leaving = _through(stations[leg], stations[leg + 1], box)
                for hole in (h for h in self.holes if h.part == box.part):
                    open_, shut = _through(stations[leg], stations[leg + 1], hole)
                    leaving = np.where(
                        (open_ <= entry + 1e-9) & (shut >= leaving - 1e-9), -1.0, leaving
                    )
                if (entry < leaving).any():
                    raise ValueError(
                        f"box {number_ + 1}: part {box.part!r} cuts the beam on its way to "
                        f"{OPTICS[leg]}; change its low_mm or high_mm, or cut a hole"
                    )

    def _split(self, planes: Floats) -> Floats:
        planes = planes[np.append(True, np.diff(planes) > 1e-9)]
        pieces = [
            np.linspace(low, high, int(np.ceil((high - low) / self.cell_mm - 1e-9)) + 1)[:-1]
            for low, high in pairwise(planes)
        ]
        return np.append(np.concatenate(pieces), planes[-1])

    def _label(self, middles: Floats) -> Indices:
        """Return the part of the box that holds each point (n,), -1 for none."""
        label = np.full(len(middles), -1, dtype=np.intp)
        for k, box in enumerate(self.boxes):
            inside, mine = box.holds(middles), self.parts.index(box.part)
            for other in np.unique(label[inside]):
                taken = "" if other < 0 else self.parts[other]
                if other >= 0 and other != mine and taken not in box.replaces:
                    raise ValueError(
                        f"box {k + 1}: part {box.part!r} overlaps part {taken!r}; if that is "
                        f"meant, give it the key replaces = [{taken!r}]"
                    )
            label[inside] = mine
        for hole in self.holes:
            label[hole.holds(middles) & (label == self.parts.index(hole.part))] = -1
        return label

    def _check_whole(self) -> None:
        """Raise if some cells are not joined to the first by facets."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        one, two = self.mesh.f2t[:, self.mesh.f2t[1] >= 0]
        cells = self.mesh.nelements
        joined = coo_array((np.ones(one.size), (one, two)), shape=(cells, cells))
        pieces, piece = connected_components(joined, directed=False)
        if pieces > 1:
            main = np.bincount(piece).argmax()
            loose = self.parts[self.cell_part[np.flatnonzero(piece != main)[0]]]
            raise ValueError(
                f"part {loose!r} floats free: its boxes share no face with the body; check low_mm "
                "and high_mm"
            )

    def _check_mount(self) -> None:
        """Raise if the feet leave a rigid motion free, or stand on nothing."""
        rows = []
        for name, foot in self.feet.items():
            self.node_at(f"feet: {name}", foot.mm)
            x, y, z = foot.mm
            turns = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]], dtype=np.float64)
            rows.append(np.hstack([np.eye(3), turns / 100.0])[foot.axes])
        held = np.vstack([np.zeros((1, 6)), *rows])
        _, values, motions = np.linalg.svd(held)
        free = motions[np.append(values, np.zeros(6))[:6] < 1e-9]
        if len(free):
            what = _RIGID[int(np.abs(free[0]).argmax())]
            raise ValueError(
                f"feet: the keys held of {', '.join(self.feet) or 'no foot'} leave the body free "
                f"to {what}"
            )

    def node_at(self, name: str, place_mm: Iterable[float]) -> int:
        """Return the number of the vertex at a place; ``ValueError`` begins with ``name``."""
        place = np.asarray(tuple(place_mm), dtype=np.float64)
        distance = np.abs(self.mesh.p.T - place).max(axis=1)
        if distance.min() > 1e-6:
            raise ValueError(f"{name}: there is no material at {place.tolist()} mm")
        return int(distance.argmin())


def _middles(mesh: MeshHex) -> Floats:
    return np.asarray(mesh.p[:, mesh.t].mean(axis=1).T, dtype=np.float64)


def _facet_middles(mesh: MeshHex, facets: Indices) -> Floats:
    return np.asarray(mesh.p[:, mesh.facets[:, facets]].mean(axis=1).T, dtype=np.float64)


def _through(start: Floats, end: Floats, box: Box) -> tuple[Floats, Floats]:
    """Shares of the way from start to end (..., 3) at which a segment enters and leaves a box."""
    way = np.where(start == end, 1e-300, end - start)
    low, high = (np.array(box.low_mm) - start) / way, (np.array(box.high_mm) - start) / way
    return (
        np.maximum(np.minimum(low, high).max(axis=-1), 0.0),
        np.minimum(np.maximum(low, high).min(axis=-1), 1.0),
    )
