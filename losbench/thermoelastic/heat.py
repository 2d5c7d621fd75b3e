"""Heat in a structure: conduction, storage and loads on its bricks, and its slow modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csc_array

from losbench.arrays import Floats
from losbench.checks import finite, integer, shaped
from losbench.thermoelastic.loads import Load, drives
from losbench.thermoelastic.structure import Structure

__all__ = ["Drive", "Heat", "HeatModes", "ramps"]


@dataclass(frozen=True)
class Drive:
    """What drives the heat: series that run straight, plus a decay where an input lags.

    Attributes
    ----------
    series : (n, drives) array
        At the samples.
    decay : (n - 1, drives) array
        Part of each step that dies away from its first sample, with the drive's own rate.
    rate_per_s : (drives,) array
        One over the lag; 0 for drives that do not lag.
    """

    series: Floats
    decay: Floats
    rate_per_s: Floats


@dataclass(frozen=True)
class Heat:
    """C dT/dt = -K T + B u on the vertices of a structure.

    Parameters
    ----------
    structure : Structure
    loads : tuple of Load
        At least one must lose heat, or no steady state exists.

    Examples
    --------
    >>> from losbench.thermoelastic.loads import Film
    >>> from losbench.thermoelastic.materials import MATERIALS
    >>> from losbench.thermoelastic.shapes import Box, Foot
    >>> feet = {
    ...     "A": Foot((0, 0, 0), "xyz"),
    ...     "B": Foot((0, 0, 50), "xy"),
    ...     "C": Foot((10, 0, 0), "y"),
    ... }
    >>> bar = Structure((Box("bar", (0, 0, 0), (10, 10, 50)),), {"bar": MATERIALS["SiC"]}, feet)
    >>> Heat(bar, (Film("air", 10.0),)).modes(3).rates_per_s.round(5).tolist()[0]
    0.00202
    """

    structure: Structure
    loads: tuple[Load, ...]

    def __post_init__(self) -> None:
        """Raise if no load loses heat."""
        if not self.loads:
            raise ValueError("loads must hold at least one")

    @cached_property
    def drives(self) -> list[tuple[str | float, float]]:
        """What moves the heat: pairs of an input, or a constant, and its lag in seconds."""
        return drives(self.loads)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs that must be given."""
        return tuple(dict.fromkeys(name for name, _ in self.drives if isinstance(name, str)))

    @cached_property
    def capacity(self) -> csc_array:
        """C, J/K."""
        density = self.structure.per_cell("density_kg_per_m3") * 1e-9
        return self._assemble(
            self._one_d("mass"), density * self.structure.per_cell("heat_J_per_kgK")
        )

    @cached_property
    def loss(self) -> csc_array:
        """K, W/K: conduction and what the loads take away.

        Raises
        ------
        ValueError
            If no load loses heat.
        """
        taken = [load.assemble(self.structure)[0] for load in self.loads]
        if not any(matrix.nnz for matrix in taken):
            raise ValueError("loads must lose heat somewhere: no film and no foot does")
        conductivity = self.structure.per_cell("conductivity_W_per_mK") * 1e-3
        return sum(taken, self._assemble(self._one_d("stiffness"), conductivity))

    @cached_property
    def gain(self) -> Floats:
        """B, watts per unit of each of :attr:`drives`, (vertices, drives)."""
        columns = np.zeros((self.structure.mesh.nvertices, len(self.drives)))
        for load in self.loads:
            columns[:, self.drives.index((load.input, load.lag_s))] += load.assemble(
                self.structure
            )[1]
        return columns

    @cached_property
    def steady(self) -> Floats:
        """Steady temperatures (vertices, drives) per unit of each drive."""
        from scipy.sparse.linalg import splu

        return splu(self.loss).solve(self.gain)

    def drive(self, time_s: Floats, inputs: Mapping[str, ArrayLike]) -> Drive:
        """Return all drives for series (n,), or constants, of the inputs.

        Raises
        ------
        ValueError
            If an input is missing, unknown, or of another length than the times.
        """
        if missing := [name for name in self.inputs if name not in inputs]:
            raise ValueError(f"inputs must give {', '.join(self.inputs)}; {missing[0]} is missing")
        if unknown := sorted(set(inputs) - set(self.inputs)):
            raise ValueError(f"inputs must be of {', '.join(self.inputs)}, got {unknown[0]}")
        columns, decays = [], []
        for name, lag_s in self.drives:
            series = finite(f"inputs[{name!r}]", inputs[name] if isinstance(name, str) else name)
            if series.ndim:
                shaped(f"inputs[{name!r}]", series, (time_s.size,), why="to match time_s")
            column = np.broadcast_to(series, time_s.shape)
            decays.append(np.zeros(time_s.size - 1))
            if lag_s > 0:
                rate = np.array([1.0 / lag_s])
                straight = column
                column = ramps(time_s, rate, straight[:, None] * rate, straight[:1])[:, 0]
                # Behind a ramp the lagged one ends up parallel, late by the lag.
                behind = straight[:-1] - lag_s * np.diff(straight) / np.diff(time_s)
                decays[-1] = column[:-1] - behind
            columns.append(column)
        rates = np.array([1.0 / lag_s if lag_s > 0 else 0.0 for _, lag_s in self.drives])
        return Drive(np.stack(columns, axis=-1), np.stack(decays, axis=-1), rates)

    def modes(self, count: int = 40) -> HeatModes:
        """Return the slowest modes; all of them from one less than there are vertices."""
        integer("count", count, low=1)
        size = self.structure.mesh.nvertices
        if count < size - 1:
            from scipy.sparse.linalg import eigsh

            # A start of its own: eigsh draws it from a stream that nobody seeded.
            rates, shapes = eigsh(
                self.loss, count, self.capacity, sigma=0.0, v0=np.ones(size), tol=1e-12
            )
        else:
            from scipy.linalg import eigh

            rates, shapes = eigh(self.loss.toarray(), self.capacity.toarray())
        order = np.argsort(rates)
        rates, shapes = rates[order], shapes[:, order]
        push = shapes.T @ self.gain
        return HeatModes(rates, shapes, push, self.steady - shapes @ (push / rates[:, None]))

    def _assemble(self, local: Floats, per_cell: Floats) -> csc_array:
        mesh = self.structure.mesh
        values = local * per_cell[:, None, None]
        i = np.broadcast_to(mesh.t.T[:, :, None], values.shape)
        j = np.broadcast_to(mesh.t.T[:, None, :], values.shape)
        return coo_array(
            (values.ravel(), (i.ravel(), j.ravel())), shape=(mesh.nvertices,) * 2
        ).tocsc()

    def _one_d(self, kind: str) -> Floats:
        """Element matrices (cells, 8, 8) of the unit coefficient, products of those of a rod."""
        mesh = self.structure.mesh
        place = mesh.p[:, mesh.t]  # (3, 8, cells)
        side = np.ptp(place, axis=1).T  # (cells, 3)
        same = (place[:, :, None] == place[:, None, :]).transpose(0, 3, 1, 2)  # (3, cells, 8, 8)
        length = side.T[:, :, None, None]
        mass = np.where(same, 2.0, 1.0) * length / 6.0
        stiff = np.where(same, 1.0, -1.0) / length
        if kind == "mass":
            return mass.prod(axis=0)
        return sum(
            (stiff[axis] * mass[(axis + 1) % 3] * mass[(axis + 2) % 3] for axis in range(3)),
            np.zeros_like(mass[0]),
        )


@dataclass(frozen=True)
class HeatModes:
    """Slow modes of a structure's heat, and the static answer of all the fast ones.

    Attributes
    ----------
    rates_per_s : (modes,) array
        Slowest first.
    shapes : (vertices, modes) array
    push : (modes, drives) array
    static : (vertices, drives) array
        What the modes leave of the steady temperatures: the fast modes follow at once.
    """

    rates_per_s: Floats
    shapes: Floats
    push: Floats
    static: Floats

    def amplitudes(self, time_s: Floats, drive: Drive) -> Floats:
        """Amplitudes (n, modes) under drives, in equilibrium at first; exact for any step."""
        step = np.diff(time_s)[:, None]
        late = drive.decay * np.exp(-drive.rate_per_s * step)
        added = _straight(step, self.rates_per_s, drive.series[:-1] - drive.decay, self.push)
        added += _straight(step, self.rates_per_s, drive.series[1:] - late, self.push, last=True)
        for k in np.flatnonzero(drive.rate_per_s):
            apart = np.abs(self.rates_per_s - drive.rate_per_s[k]) * step + 1e-300
            slow = np.exp(-np.minimum(self.rates_per_s, drive.rate_per_s[k]) * step)
            kernel = step * slow * -np.expm1(-apart) / apart
            added += drive.decay[:, k, None] * self.push[:, k] * kernel
        return _stepped(
            step, self.rates_per_s, added, self.push @ drive.series[0] / self.rates_per_s
        )


def ramps(time_s: Floats, rates_per_s: Floats, force: Floats, start: Floats) -> Floats:
    """Solve dq/dt = -rate q + force for forces (n, modes) straight between samples; (n, modes).

    >>> ramps(np.array([0.0, 1.0]), np.array([1.0]), np.ones((2, 1)), np.zeros(1)).ravel().round(4)
    array([0.    , 0.6321])
    """
    step, each = np.diff(time_s)[:, None], np.eye(rates_per_s.size)
    added = _straight(step, rates_per_s, force[:-1], each)
    added += _straight(step, rates_per_s, force[1:], each, last=True)
    return _stepped(step, rates_per_s, added, start)


def _straight(
    step: Floats, rates: Floats, value: Floats, push: Floats, *, last: bool = False
) -> Floats:
    """What the value at the first, or last, end of each straight step adds to the modes."""
    x = rates * step
    held = -np.expm1(-x) / x
    late = (1.0 - held) / x
    return step * (value @ push.T) * (late if last else held - late)


def _stepped(step: Floats, rates: Floats, added: Floats, start: Floats) -> Floats:
    decay = np.exp(-rates * step)
    q = np.empty((len(step) + 1, rates.size))
    q[0] = start
    for i in range(len(step)):
        q[i + 1] = decay[i] * q[i] + added[i]
    return q
