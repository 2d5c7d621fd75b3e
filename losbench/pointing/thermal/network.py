"""Lumped thermal nodes under a room temperature, and the tilt of the line of sight that they
cause.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, increasing, non_negative, positive, shaped
from losbench.units import arcsec_to_rad

__all__ = ["ThermalNetwork", "thermoelastic_tilt"]


@dataclass(frozen=True)
class ThermalNetwork:
    """Lumped nodes that exchange heat with each other and with the room, solved exactly.

    Parameters
    ----------
    capacity_J_per_K : mapping of node to float
        Heat capacity of every node; its order is the order of nodes everywhere.
    link_W_per_K : mapping of (node, node) to float
        Conductance between two nodes; pairs left out exchange nothing.
    room_W_per_K : mapping of node to float
        Conductance from a node to the room; nodes left out do not touch it.

    Raises
    ------
    ValueError
        If a capacity is not positive, a conductance negative, a node unknown or a pair given twice.

    Notes
    -----
    C dT/dt = -L T + h (T_room - T), with L the weighted Laplacian of the links. As L leaves a
    common temperature alone, d = T - T_room obeys dd/dt = M d - dT_room/dt with M = -C^-1 (L + diag
    h), whose matrix exponential is diagonal in the modes of the symmetric C^(1/2) M C^(-1/2).

    Examples
    --------
    >>> mirror = ThermalNetwork({"mirror": 500.0}, {}, {"mirror": 0.5})
    >>> mirror.time_constants_s.round(6).tolist()
    [1000.0]
    >>> mirror.simulate([0.0, 1000.0], [25.0, 25.0], initial_degC=18.0).round(3).ravel().tolist()
    [18.0, 22.425]
    """

    capacity_J_per_K: Mapping[str, float]
    link_W_per_K: Mapping[tuple[str, str], float]
    room_W_per_K: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check names and values."""
        positive("capacity_J_per_K", list(self.capacity_J_per_K.values()))
        pairs = [frozenset(pair) for pair in self.link_W_per_K]
        if any(len(pair) != 2 for pair in pairs) or len(set(pairs)) < len(pairs):
            raise ValueError(
                "link_W_per_K must name two different nodes per link and each pair once"
            )
        for name, table, nodes in (
            ("link_W_per_K", self.link_W_per_K, {node for pair in pairs for node in pair}),
            ("room_W_per_K", self.room_W_per_K, set(self.room_W_per_K)),
        ):
            if table:
                non_negative(name, list(table.values()))
            if unknown := sorted(nodes - set(self.names)):
                raise ValueError(
                    f"{name} must join nodes of {', '.join(self.names)}, got {', '.join(unknown)}"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the nodes, in the order of every array of node temperatures."""
        return tuple(self.capacity_J_per_K)

    @property
    def time_constants_s(self) -> Floats:
        """Time constants of the modes, slowest first; infinite for nodes that no path joins to the
        room.
        """
        rates = self._modes()[0]
        return np.divide(1.0, rates, out=np.full_like(rates, np.inf), where=rates > 0)

    def simulate(
        self, time_s: ArrayLike, room_degC: ArrayLike, initial_degC: ArrayLike | None = None
    ) -> Floats:
        """Node temperatures under a room temperature that runs straight between its samples; exact
        for any step.

        Parameters
        ----------
        time_s : (n,) array
            Increasing times, evenly spaced or not.
        room_degC : (n,) array
            Room temperature at those times.
        initial_degC : float or (nodes,) array, optional
            Node temperatures at the first time; in equilibrium with the room unless given.

        Returns
        -------
        (n, nodes) array, degrees Celsius
            In the order of :attr:`names`.

        Raises
        ------
        ValueError
            If times do not increase or a shape does not fit.
        """
        t, room = increasing("time_s", time_s), finite("room_degC", room_degC)
        shaped("room_degC", room, (t.size,), why="to match time_s")
        start = (
            room[:1]
            if initial_degC is None
            else np.atleast_1d(finite("initial_degC", initial_degC))
        )
        if start.shape not in {(1,), (len(self.names),)}:
            shaped(
                "initial_degC",
                start,
                (len(self.names),),
                why="to match the nodes, or be one number",
            )
        rates, to_modes, from_modes = self._modes()
        step_s = np.diff(t)[:, None]
        decay = np.exp(-rates * step_s)
        # Integral of the decay over a step: (1 - exp(-rate step)) / rate, and the step itself where
        # the rate is zero.
        held_s = np.divide(
            -np.expm1(-rates * step_s), rates, out=step_s + 0 * rates, where=rates > 0
        )
        pull = held_s * (np.diff(room)[:, None] / step_s) * to_modes.sum(axis=1)
        modes = np.empty((t.size, rates.size))
        modes[0] = to_modes @ np.broadcast_to(start - room[0], rates.shape)
        for i in range(t.size - 1):
            modes[i + 1] = decay[i] * modes[i] - pull[i]
        return room[:, None] + modes @ from_modes.T

    def _modes(self) -> tuple[Floats, Floats, Floats]:
        index = {name: i for i, name in enumerate(self.names)}
        loss = np.diag([float(self.room_W_per_K.get(name, 0.0)) for name in self.names])
        for (one, other), conductance in self.link_W_per_K.items():
            i, j = index[one], index[other]
            loss[[i, j], [i, j]] += conductance
            loss[[i, j], [j, i]] -= conductance
        root = np.sqrt(np.array(list(self.capacity_J_per_K.values()), dtype=np.float64))
        rates, vectors = np.linalg.eigh(loss / np.outer(root, root))
        noise = rates.size * np.finfo(float).eps * np.abs(rates).max()
        return np.where(rates > noise, rates, 0.0), vectors.T * root, vectors / root[:, None]


def thermoelastic_tilt(
    temperature_degC: ArrayLike,
    sensitivity_arcsec_per_degC: ArrayLike,
    *,
    reference_degC: ArrayLike,
) -> Floats:
    """Line-of-sight angles that node temperatures cause.

    Parameters
    ----------
    temperature_degC : (..., nodes) array
        Node temperatures, e.g. from :meth:`ThermalNetwork.simulate`.
    sensitivity_arcsec_per_degC : (3, nodes) array
        Angle about x, y, z per degree of each node.
    reference_degC : float or (nodes,) array
        Temperatures at which the angles are zero.

    Returns
    -------
    (..., 3) array, radians

    Raises
    ------
    ValueError
        If a shape does not fit the number of nodes.

    Examples
    --------
    >>> thermoelastic_tilt(
    ...     [21.0, 20.0], [[0, 0], [206.264806, 0], [0, 9]], reference_degC=20.0
    ... ).round(6).tolist()
    [0.0, 0.001, 0.0]
    """
    temperature = finite("temperature_degC", temperature_degC)
    shaped("temperature_degC", temperature, ("...", "nodes"))
    nodes = temperature.shape[-1]
    matrix, reference = (
        finite("sensitivity_arcsec_per_degC", sensitivity_arcsec_per_degC),
        np.asarray(reference_degC),
    )
    shaped("sensitivity_arcsec_per_degC", matrix, (3, nodes), why=f"to match {nodes} nodes")
    if reference.ndim:
        shaped("reference_degC", reference, (nodes,), why=f"to match {nodes} nodes")
    return arcsec_to_rad((temperature - finite("reference_degC", reference)) @ matrix.T)
