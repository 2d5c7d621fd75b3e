"""Heat in a small basis that stays good when films, joints and materials are not as thought."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import splu

from losbench.arrays import Floats
from losbench.checks import positive, shaped
from losbench.thermoelastic.camera import ThermoelasticCamera
from losbench.thermoelastic.heat import Heat, HeatModes
from losbench.thermoelastic.loads import Flux, Power
from losbench.thermoelastic.model import example_camera

__all__ = ["ReducedHeat", "prepared_camera"]


@dataclass(frozen=True)
class ReducedHeat:
    """Galerkin's projection of C dT/dt = -K T + B u on modes and steady fields, load by load.

    Attributes
    ----------
    heat : Heat
        As it was built.
    basis : (vertices, r) array
        Orthonormal with respect to the capacity.
    conduction : (r, r) array
    losses, gains : (loads, r, r), (loads, r) arrays
        Of each load, in the order of ``heat.loads``.

    Notes
    -----
    The basis holds the slow modes, the steady field of each load, and how that field changes with
    each load's conductance; a film may be off by a factor of two and temperatures stay good to a
    few millikelvin.
    """

    heat: Heat
    basis: Floats
    conduction: Floats
    losses: Floats
    gains: Floats

    @classmethod
    def of(cls, heat: Heat, modes: HeatModes) -> ReducedHeat:
        """Project a structure's heat on its modes and steady fields."""
        parts = [load.assemble(heat.structure) for load in heat.loads]
        factor = splu(heat.loss)
        gains = np.stack([gain for _, gain in parts], axis=-1)
        steady = factor.solve(gains)
        changed = [factor.solve(loss @ steady) for loss, _ in parts if loss.nnz]
        added = np.hstack([steady, *changed])
        for _ in range(2):  # once leaves rounding of the size of what is left
            added = added - modes.shapes @ (modes.shapes.T @ (heat.capacity @ added))
        size, turn = np.linalg.eigh(added.T @ (heat.capacity @ added))
        keep = size > 1e-12 * size.max()
        basis = np.hstack([modes.shapes, added @ turn[:, keep] / np.sqrt(size[keep])])
        losses = np.stack([basis.T @ (loss @ basis) for loss, _ in parts])
        return cls(
            heat,
            basis,
            basis.T @ (heat.loss @ basis) - losses.sum(axis=0),
            losses,
            gains.T @ basis,
        )

    def lagged(self, factor: float) -> ReducedHeat:
        """Return the same heat with all lags of the loads scaled."""
        loads = tuple(replace(load, lag_s=load.lag_s * factor) for load in self.heat.loads)  # type: ignore[type-var]
        return replace(self, heat=Heat(self.heat.structure, loads))

    def modes(
        self,
        scale: Iterable[float] | None = None,
        *,
        conduction: float = 1.0,
        capacity: float = 1.0,
    ) -> HeatModes:
        """Modes once loads, conduction and capacity are scaled, in milliseconds.

        Parameters
        ----------
        scale : (loads,) floats, optional
            Factor on each load: conductance of a film, share of a flux, watts of electronics.
        conduction, capacity : float
            Factors on all conductivities and heat capacities.

        Raises
        ------
        ValueError
            If a factor is not positive or their number is not that of the loads.

        Examples
        --------
        >>> from losbench.thermoelastic.model import example_camera
        >>> camera = example_camera()
        >>> reduced = ReducedHeat.of(camera.heat, camera.heat_modes)
        >>> still, windy = reduced.modes(), reduced.modes([3.0, 1.0, 1.0])
        >>> bool(windy.rates_per_s[0] > 2 * still.rates_per_s[0])
        True
        """
        factors = np.ones(len(self.losses)) if scale is None else positive("scale", list(scale))
        shaped("scale", factors, (len(self.losses),), why="to match the loads")
        heat = positive("conduction", conduction) * self.conduction
        heat = heat + np.tensordot(factors, self.losses, 1)
        rates, turn = eigh(heat)
        gains = np.zeros((len(heat), len(self.heat.drives)))
        for load, factor, gain in zip(self.heat.loads, factors, self.gains, strict=True):
            gains[:, self.heat.drives.index((load.input, load.lag_s))] += factor * gain
        push = turn.T @ gains / positive("capacity", capacity)
        rates = rates / capacity
        # All of the basis runs as modes, so nothing is left to follow at once.
        return HeatModes(
            rates, self.basis @ turn, push, np.zeros((len(self.basis), gains.shape[1]))
        )


@cache
def prepared_camera(materials: str) -> tuple[ThermoelasticCamera, ReducedHeat]:
    """Return the example camera of one of the `MATERIAL_SETS` with its heat reduced, made once.

    Loads beside room, draught and table: ``sun_W_per_m2``, absorbed by the +x wall, and
    ``electronics_W`` in the focal plane.

    Examples
    --------
    >>> camera, reduced = prepared_camera("Invar + Zerodur")
    >>> reduced.heat.inputs
    ('room_degC', 'sun_W_per_m2', 'electronics_W')
    """
    room = example_camera(materials)
    more = (Flux("sun_W_per_m2", 1.0, "wall+", "+x"), Power("electronics_W", "FP"))
    camera = replace(room, loads=(*room.loads, *more))
    return camera, ReducedHeat.of(camera.heat, camera.heat_modes)
