"""How heat comes and goes: air and space over faces, flux on them, power in parts, the table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.constants import Stefan_Boltzmann, zero_Celsius
from scipy.sparse import coo_array, csc_array, diags_array

from losbench.arrays import Floats, Indices
from losbench.checks import non_negative, number, positive
from losbench.thermoelastic.structure import Structure

__all__ = ["Feet", "Film", "Flux", "Load", "Power", "radiation"]


class Load(Protocol):
    """Heat that one input drives: a conductance to it, or a power that it scales."""

    @property
    def input(self) -> str | float:
        """Name of the input that drives it, or its constant value."""

    @property
    def lag_s(self) -> float:
        """First-order lag behind the input."""

    def assemble(self, structure: Structure) -> tuple[csc_array, Floats]:
        """Return loss (vertices, vertices) in W/K and gain (vertices,) in watts per unit input."""


@dataclass(frozen=True)
class Film:
    """Air or another surrounding of temperature ``input`` (degC) over outside faces.

    ``part`` and ``side`` ("+x" ...) narrow the faces; films over the same faces add up.
    """

    input: str | float
    W_per_m2K: float
    part: str | None = None
    side: str | None = None
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the values."""
        _named_or_constant(self.input)
        non_negative("W_per_m2K", number("W_per_m2K", self.W_per_m2K))
        non_negative("lag_s", number("lag_s", self.lag_s))

    def assemble(self, structure: Structure) -> tuple[csc_array, Floats]:
        """Return the loss W/K and the gain, W per degree of the surroundings."""
        facets = structure.facets(self.part, self.side)
        loss = _facet_mass(structure, facets) * (self.W_per_m2K * 1e-6)
        return loss, np.asarray(loss.sum(axis=1), dtype=np.float64)


@dataclass(frozen=True)
class Flux:
    """Radiation of ``input`` (W/m2) on outside faces that absorb a share of it."""

    input: str | float
    absorbed: float = 1.0
    part: str | None = None
    side: str | None = None
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the values."""
        _named_or_constant(self.input)
        number("absorbed", self.absorbed, low=0.0, high=1.0)
        non_negative("lag_s", number("lag_s", self.lag_s))

    def assemble(self, structure: Structure) -> tuple[csc_array, Floats]:
        """Return no loss, and the gain in W per W/m2."""
        mass = _facet_mass(structure, structure.facets(self.part, self.side))
        gain = np.asarray(mass.sum(axis=1), dtype=np.float64) * (self.absorbed * 1e-6)
        return csc_array(mass.shape), gain


@dataclass(frozen=True)
class Power:
    """Electronics: ``input`` watts, spread evenly over a part."""

    input: str | float
    part: str
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the values."""
        _named_or_constant(self.input)
        non_negative("lag_s", number("lag_s", self.lag_s))

    def assemble(self, structure: Structure) -> tuple[csc_array, Floats]:
        """Return no loss, and the gain in W per W."""
        if self.part not in structure.parts:
            raise ValueError(f"part must be one of {', '.join(structure.parts)}, got {self.part!r}")
        mesh = structure.mesh
        cells = mesh.t[:, structure.cell_part == structure.parts.index(self.part)]
        volume = np.prod(np.ptp(mesh.p[:, cells], axis=1), axis=0)
        share = np.broadcast_to(volume / volume.sum() / len(cells), cells.shape)
        gain = np.bincount(cells.ravel(), share.ravel(), mesh.nvertices).astype(float)
        return csc_array((mesh.nvertices, mesh.nvertices)), gain


@dataclass(frozen=True)
class Feet:
    """Conductance of each foot to the table, whose temperature lags behind ``input`` (degC)."""

    input: str | float
    W_per_K: float
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the values."""
        _named_or_constant(self.input)
        non_negative("W_per_K", number("W_per_K", self.W_per_K))
        non_negative("lag_s", number("lag_s", self.lag_s))

    def assemble(self, structure: Structure) -> tuple[csc_array, Floats]:
        """Return the loss W/K and the gain, W per degree of the table."""
        gain = np.zeros(structure.mesh.nvertices)
        for name, foot in structure.feet.items():
            gain[structure.node_at(f"feet: {name}", foot.mm)] += self.W_per_K
        return csc_array(diags_array(gain)), gain


def radiation(
    emissivity: float, mean_degC: float, *, part: str | None = None, side: str | None = None
) -> Film:
    """Radiate to empty space, linearised about a mean temperature.

    eps s T^4 = 4 eps s T0^3 (T - 3/4 T0) to first order: a film to three quarters of the absolute
    mean. A surface d kelvin off the mean T0 comes out too warm by 1.5 d^2 / T0 if it only radiates:
    0.13 K at 5 K, 0.5 K at 10 K about 20 degC. Conduction evens this out: `orbit_loads`.

    >>> film = radiation(0.0768, 20.0)
    >>> round(film.W_per_m2K, 3), round(film.input, 1)
    (0.439, -53.3)
    """
    share = number("emissivity", emissivity, low=0.0, high=1.0)
    mean_K = float(positive("mean_degC + 273.15", number("mean_degC", mean_degC) + zero_Celsius))
    film = 4.0 * share * Stefan_Boltzmann * mean_K**3
    return Film(0.75 * mean_K - zero_Celsius, film, part, side)


def _named_or_constant(value: object) -> None:
    if not isinstance(value, str):
        number("input, if it is not a name,", value)
    elif not value:
        raise ValueError("input must be a name or a number, got ''")


def _facet_mass(structure: Structure, facets: Indices) -> csc_array:
    """Integrals of products of vertex functions over rectangles, mm2: bilinear, in closed form."""
    mesh = structure.mesh
    corners = mesh.facets[:, facets]
    place = mesh.p[:, corners]
    sides = np.ptp(place, axis=1)
    area = np.prod(np.where(sides > 0, sides, 1.0), axis=0)
    # 4 on the diagonal, 2 for neighbours along an edge, 1 across, over 36.
    apart = np.sum(place[:, :, None] != place[:, None, :], axis=0)
    local = area / 36.0 * np.exp2(2.0 - apart)
    i, j = (np.broadcast_to(c, local.shape).ravel() for c in (corners[:, None], corners[None]))
    return coo_array((local.ravel(), (i, j)), shape=(mesh.nvertices,) * 2).tocsc()


def drives(loads: Iterable[Load]) -> list[tuple[str | float, float]]:
    """Return the distinct pairs of input and lag, in the order of the loads."""
    return list(dict.fromkeys((load.input, load.lag_s) for load in loads))
