"""From node temperatures to displacements, and straight to the motions of the optics.

Bricks of 20 nodes for displacements on bricks of 8 for temperatures: a linear temperature bends
them exactly, where bricks of 8 nodes would be twice too stiff.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, csc_array

from losbench.arrays import Floats, Indices
from losbench.optics.threemirror import OPTICS
from losbench.thermoelastic.structure import Structure

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU
    from skfem import CellBasis

__all__ = ["Elasticity"]


@dataclass(frozen=True)
class Elasticity:
    """Linear thermo-elasticity of a structure on its feet.

    Notes
    -----
    K u = L T with K the strain energy of lambda and mu and L = int (3 lambda + 2 mu) alpha T div v
    (Boley and Weiner, Theory of Thermal Stresses, 1960, chapter 2). Displacements are numbered 3
    node + axis.

    Examples
    --------
    >>> from losbench.thermoelastic.materials import MATERIALS
    >>> from losbench.thermoelastic.shapes import Box, Foot
    >>> from losbench.thermoelastic.structure import Structure
    >>> feet = {
    ...     "A": Foot((0, 0, 0), "xyz"),
    ...     "B": Foot((0, 0, 100), "xy"),
    ...     "C": Foot((10, 0, 0), "y"),
    ... }
    >>> bar = Structure((Box("bar", (0, 0, 0), (10, 10, 100)),), {"bar": MATERIALS["SiC"]}, feet)
    >>> elastic = Elasticity(bar)
    >>> moved_um = 1e3 * elastic.displace(np.ones(bar.mesh.nvertices))
    >>> round(float(moved_um[:, 2].max()), 6)  # 2.2e-6 x 100 mm
    0.22
    """

    structure: Structure

    @cached_property
    def basis(self) -> CellBasis:
        """Return the scalar 20-node basis; each displacement component is one of it."""
        from skfem import Basis, ElementHexS2

        return Basis(self.structure.mesh, ElementHexS2(), intorder=4)

    @property
    def nodes_mm(self) -> Floats:
        """Places of the displacement nodes, (nodes, 3)."""
        return np.asarray(self.basis.doflocs.T, dtype=np.float64)

    @property
    def vertex_nodes(self) -> Indices:
        """Numbers of the displacement nodes that are vertices, (vertices,)."""
        return np.asarray(self.basis.nodal_dofs[0], dtype=np.intp)

    @cached_property
    def stiffness(self) -> csc_array:
        """K of the free body, (3 nodes, 3 nodes), N/mm."""
        lam, mu = self._lame
        grad, weight = self._gradients, self.basis.dx
        # One einsum for all cells; vector forms of 60 unknowns would take a hundred times longer.
        cross = np.einsum("iaeq,jbeq,eq->eijab", grad, grad, weight, optimize=True)
        same = np.einsum("eijaa->eij", cross)
        local = lam[:, None, None, None, None] * cross
        local += mu[:, None, None, None, None] * cross.transpose(0, 1, 2, 4, 3)
        for a in range(3):
            local[..., a, a] += mu[:, None, None] * same
        local = local.transpose(0, 1, 3, 2, 4)
        rows = self._unknowns
        size = 3 * self.basis.N
        shape = (*rows.shape, rows.shape[1])
        i, j = np.broadcast_to(rows[:, :, None], shape), np.broadcast_to(rows[:, None, :], shape)
        return coo_array((local.ravel(), (i.ravel(), j.ravel())), shape=(size, size)).tocsc()

    @cached_property
    def load(self) -> csc_array:
        """L, forces (3 nodes) per kelvin of each vertex, N/K."""
        return self.load_of(self.structure.per_cell("expansion_per_K"))

    def load_of(self, expansion_per_K: Floats) -> csc_array:
        """L of other expansions (cells,); it is linear in them."""
        from skfem import ElementHex1

        lam, mu = self._lame
        push = (3.0 * lam + 2.0 * mu) * expansion_per_K
        heat = self.basis.with_element(ElementHex1())
        shapes = np.stack([np.broadcast_to(b[0], self.basis.dx.shape) for b in heat.basis])
        weight = self.basis.dx * push[:, None]
        local = np.einsum("iaeq,teq,eq->eiat", self._gradients, shapes, weight, optimize=True)
        rows, cols = self._unknowns, heat.element_dofs.T
        shape = (*rows.shape, cols.shape[1])
        i, j = np.broadcast_to(rows[:, :, None], shape), np.broadcast_to(cols[:, None, :], shape)
        return coo_array(
            (local.ravel(), (i.ravel(), j.ravel())),
            shape=(3 * self.basis.N, self.structure.mesh.nvertices),
        ).tocsc()

    def displace(self, rise_K: Floats) -> Floats:
        """Displacements (nodes, 3), millimetres, under temperature rises (vertices,), kelvin."""
        moved = np.zeros(3 * self.basis.N)
        moved[self._free] = self._factor.solve((self.load @ rise_K)[self._free])
        return moved.reshape(-1, 3)

    def motion_rows(self, pivot_mm: Floats) -> Floats:
        """Rows (32, 3 nodes) that read `MOTIONS` of the four optics off the displacements.

        Least squares of t + w x r + g r + bending over the nodes of each face, r from the pivot:
        that lies on the curved surface, the nodes on the flat face behind it.

        Raises
        ------
        ValueError
            If a face is not given, or not on the outside of the body.
        """
        rows = np.zeros((32, 3 * self.basis.N))
        for i, name in enumerate(OPTICS):
            nodes = self._face_nodes(name)
            r = self.nodes_mm[nodes] - pivot_mm[i]
            x, y, z = r.T
            zero, one = np.zeros_like(x), np.ones_like(x)
            columns = [
                (one, zero, zero),
                (zero, one, zero),
                (zero, zero, one),
                (zero, -z, y),
                (z, zero, -x),
                (-y, x, zero),
                (x, y, z),
                (zero, zero, 0.5 * (x**2 + y**2)),
            ][: 7 if name == "FP" else 8]
            design = np.array(columns).transpose(2, 1, 0).reshape(3 * nodes.size, -1)
            unknowns = (3 * nodes[:, None] + np.arange(3)).ravel()
            rows[8 * i : 8 * i + len(columns), unknowns] = np.linalg.pinv(design)
        return rows

    def motion_map(self, pivot_mm: Floats, expansion_per_K: Floats | None = None) -> Floats:
        """Motions (32, vertices) of the optics per kelvin of each vertex, by 32 adjoint solves.

        The map is linear in ``expansion_per_K`` (cells,), those of the materials unless given.
        """
        rows = self.motion_rows(pivot_mm)
        adjoint = np.zeros_like(rows)
        adjoint[:, self._free] = self._factor.solve(rows[:, self._free].T.copy()).T
        load = self.load if expansion_per_K is None else self.load_of(expansion_per_K)
        return adjoint @ load

    @cached_property
    def _gradients(self) -> Floats:
        """Gradients (20, 3, cells, quadrature) of the shape functions."""
        return np.stack([b[0].grad for b in self.basis.basis])

    @cached_property
    def _unknowns(self) -> Indices:
        """Unknowns (cells, 60) of each cell, node by node."""
        return (3 * self.basis.element_dofs.T[:, :, None] + np.arange(3)).reshape(
            self.structure.mesh.nelements, -1
        )

    @cached_property
    def _lame(self) -> tuple[Floats, Floats]:
        pairs = self.structure.per_cell("lame_MPa")
        return pairs[:, 0], pairs[:, 1]

    @cached_property
    def _free(self) -> Indices:
        held = [
            3 * self._node_at(foot.mm) + axis
            for foot in self.structure.feet.values()
            for axis in foot.axes
        ]
        return np.setdiff1d(np.arange(3 * self.basis.N), held)

    @cached_property
    def _factor(self) -> SuperLU:
        from scipy.sparse.linalg import splu

        # The matrix is symmetric and definite: no pivoting, half the time and memory.
        return splu(
            self.stiffness[self._free][:, self._free].tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def _node_at(self, place_mm: tuple[float, float, float]) -> int:
        return int(np.abs(self.nodes_mm - place_mm).max(axis=1).argmin())

    def _face_nodes(self, name: str) -> Indices:
        facets = self.structure.face_facets(name)
        corners = self.structure.mesh.facets[:, facets]
        low, high = (f(self.structure.mesh.p[:, corners], axis=1).T for f in (np.min, np.max))
        places = self.nodes_mm[:, None]
        on = np.all((places > low - 1e-6) & (places < high + 1e-6), axis=-1)
        return np.flatnonzero(on.any(axis=1))
