"""A thermo-elastic camera: from the heat about it to the places of two spots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, integer, number, shaped
from losbench.optics.jacobian import los_angles, los_jacobian
from losbench.optics.threemirror import ThreeMirror
from losbench.thermoelastic.elastic import Elasticity
from losbench.thermoelastic.heat import Drive, Heat, HeatModes
from losbench.thermoelastic.loads import Load
from losbench.thermoelastic.structure import Structure

__all__ = ["CameraRun", "ThermoelasticCamera"]


@dataclass(frozen=True)
class CameraRun:
    """What a camera did while heat came and went.

    Attributes
    ----------
    time_s : (n,) array
    temperature_degC : (n, sensors) array
        At the camera's sensors, in their order.
    px : (n, 2, 2) array
        Places (x, y) of spots A and B.
    angles_rad : (n, 3) array
        Rotation of the line of sight since the reference temperature, by both spots.
    focus_um : (n, 2) array
        Distance of each spot's focus from the detector.
    """

    time_s: Floats
    temperature_degC: Floats
    px: Floats
    angles_rad: Floats
    focus_um: Floats


@dataclass(frozen=True)
class ThermoelasticCamera:
    """Structure, optics and loads as one linear chain from inputs to spots.

    Parameters
    ----------
    structure : Structure
    optics : ThreeMirror
    loads : tuple of Load
    sensors_mm : mapping of name to (3,) floats
        Thermometers; each reads the nearest vertex.
    reference_degC : float
        Uniform temperature at which the optics stand as designed.
    modes : int
        Thermal modes of :meth:`simulate`; 80 are good to 1e-4 px and 1 mK in a room that
        warms, to 5e-3 px where the sun on one wall goes out within 15 s.
    inputs : mapping of name to float, optional
        Values of inputs that a run does not give.

    Raises
    ------
    ValueError
        If the structure cuts the beam; as `Structure` and `ThreeMirror` raise.

    Notes
    -----
    Displacements follow temperatures at once and to first order: px = px0 + J P K^-1 L (T - T0),
    one matrix :attr:`los_map`, made of as many solves as there are motions of the optics.

    Examples
    --------
    >>> from losbench.thermoelastic.model import example_camera
    >>> camera = example_camera()
    >>> run = camera.simulate([0.0, 1e9], {"room_degC": [18.0, 19.0]})
    >>> (run.angles_rad[-1] * 206265).round(2)[0]  # arcsec per degree, about x
    np.float64(-0.32)
    """

    structure: Structure
    optics: ThreeMirror
    loads: tuple[Load, ...]
    sensors_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    reference_degC: float = 20.0
    modes: int = 80
    inputs: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that light gets through."""
        number("reference_degC", self.reference_degC)
        integer("modes", self.modes, low=1)
        for name, place in self.sensors_mm.items():
            shaped(f"sensors_mm: {name}", finite(f"sensors_mm: {name}", place), (3,))
        for name, value in self.inputs.items():
            number(f"inputs: {name}", value)
        self.structure.check_light(self.optics)

    @cached_property
    def elasticity(self) -> Elasticity:
        """Return the structure's answer to temperatures."""
        return Elasticity(self.structure)

    @cached_property
    def heat(self) -> Heat:
        """Return the structure's answer to its loads."""
        return Heat(self.structure, self.loads)

    @cached_property
    def heat_modes(self) -> HeatModes:
        """Return the slow thermal modes."""
        return self.heat.modes(self.modes)

    @cached_property
    def motion_map(self) -> Floats:
        """Motions (32, vertices) of the optics per kelvin of each vertex."""
        return self.elasticity.motion_map(self.optics.pivot_mm)

    @cached_property
    def los_map(self) -> Floats:
        """Per kelvin of each vertex, (6, vertices): x, y of A, x, y of B, pixels; focus of A, B,
        micrometres.
        """
        return los_jacobian(self.optics) @ self.motion_map

    @cached_property
    def angle_map(self) -> Floats:
        """Angles of the line of sight per kelvin of each vertex, radians, (3, vertices)."""
        return los_angles(self.optics) @ self.los_map[:4]

    @cached_property
    def sensor_nodes(self) -> tuple[int, ...]:
        """Vertices that the sensors read."""
        places = self.structure.mesh.p.T
        return tuple(
            int(np.sum((places - place) ** 2, axis=1).argmin())
            for place in self.sensors_mm.values()
        )

    def check(self) -> None:
        """Raise ``ValueError`` now for what would come up with the first run: faces without nodes,
        loads on parts or sides that are not there, heat that cannot leave, inputs that nothing
        asks for, sensors further from the body than a cell.
        """
        self.elasticity.motion_rows(self.optics.pivot_mm)
        for kind, load in ((type(load).__name__.lower(), load) for load in self.loads):
            try:
                load.assemble(self.structure)
            except ValueError as error:
                raise ValueError(f"{kind}: {error}") from None
        self.heat.loss  # noqa: B018
        for (name, place), node in zip(self.sensors_mm.items(), self.sensor_nodes, strict=True):
            off = float(np.linalg.norm(self.structure.mesh.p[:, node] - place))
            if off > self.structure.cell_mm:
                raise ValueError(
                    f"sensors_mm: {name} must lie on the body, got {list(place)}, {off:.0f} mm off"
                )
        if unknown := sorted(set(self.inputs) - set(self.heat.inputs)):
            raise ValueError(f"inputs: no load asks for {unknown[0]}")

    @property
    def steady_rad_per_degC(self) -> Floats:
        """Angles (3,) once everything about the camera, and it, is a degree warmer."""
        return self.angle_map.sum(axis=1)

    def displace(self, temperature_degC: ArrayLike) -> Floats:
        """Displacements (nodes, 3), millimetres, at vertex temperatures (vertices,)."""
        return self.elasticity.displace(
            np.asarray(temperature_degC, dtype=np.float64) - self.reference_degC
        )

    def simulate(self, time_s: ArrayLike, inputs: Mapping[str, ArrayLike]) -> CameraRun:
        """Follow temperatures and spots while the inputs run straight between their samples.

        Parameters
        ----------
        time_s : (n,) array
            Increasing times; the camera is in equilibrium at the first.
        inputs : mapping of name to (n,) array or float
            As the loads name them; those of :attr:`inputs` may be left out.

        Raises
        ------
        ValueError
            If times do not increase or an input is missing, unknown or of the wrong length.
        """
        time, drive = self._drive(time_s, inputs)
        modes, nodes = self.heat_modes, list(self.sensor_nodes)
        reading = np.zeros((len(nodes), self.structure.mesh.nvertices))
        reading[np.arange(len(nodes)), nodes] = 1.0
        out = np.vstack([self.los_map, reading])
        series = modes.amplitudes(time, drive) @ (out @ modes.shapes).T
        series += drive.series @ (out @ modes.static).T
        moved = series[:, :6] - self.reference_degC * self.los_map.sum(axis=1)
        px, focus_um = self.optics.observe()
        return CameraRun(
            time,
            series[:, 6:],
            px + moved[:, :4].reshape(-1, 2, 2),
            moved[:, :4] @ los_angles(self.optics).T,
            focus_um + moved[:, 4:],
        )

    def temperatures(self, time_s: ArrayLike, inputs: Mapping[str, ArrayLike]) -> Floats:
        """Vertex temperatures (n, vertices) of the same run."""
        time, drive = self._drive(time_s, inputs)
        modes = self.heat_modes
        return modes.amplitudes(time, drive) @ modes.shapes.T + drive.series @ modes.static.T

    def trace(self, temperature_degC: ArrayLike) -> tuple[Floats, Floats]:
        """Places and focus of the spots at vertex temperatures (..., vertices) by rays, without the
        Jacobian: (..., 2, 2) pixels and (..., 2) micrometres.
        """
        from losbench.optics.jacobian import apart

        rise = np.asarray(temperature_degC, dtype=np.float64) - self.reference_degC
        return self.optics.observe(*apart(rise @ self.motion_map.T))

    def _drive(self, time_s: ArrayLike, inputs: Mapping[str, ArrayLike]) -> tuple[Floats, Drive]:
        time = finite("time_s", time_s, ndim=1)
        if (np.diff(time) <= 0).any():
            raise ValueError(f"time_s must increase, got a step of {np.diff(time).min():g} s")
        return time, self.heat.drive(time, {**self.inputs, **inputs})
