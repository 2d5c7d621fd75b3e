"""The warm-up with a thermo-elastic camera: heat, deformation and rays in place of five nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from losbench.arrays import Floats
from losbench.optics.camera import Camera, design_matrix
from losbench.papers.liu2026.scenario import ThermalBench
from losbench.papers.provenance import assumed
from losbench.thermoelastic.camera import ThermoelasticCamera
from losbench.thermoelastic.model import example_camera
from losbench.units import rad_to_arcsec

__all__ = ["CameraBench", "bench_of"]


@dataclass(frozen=True)
class CameraBench(ThermalBench):
    """Section 3.1's warm-up in front of a camera of mirrors and metal.

    The optics say where the spots are, and the pinhole that describes them turns shifts into
    angles; :attr:`model` says how they move. Angles are about the axes of that pinhole, which
    :attr:`field_turn` turns to the line of sight.
    """

    materials: str = assumed(
        "aluminium + Zerodur",
        "",
        'a drift "of arcseconds" (section 1) over 7 degC; three other sets are tried beside it',
    )
    model: ThermoelasticCamera | None = None

    @cached_property
    def chain(self) -> ThermoelasticCamera:
        """Return the camera: the model, or else the example of these materials."""
        return self.model or example_camera(self.materials)

    @cached_property
    def camera(self) -> Camera:
        """Return the pinhole that describes the optics."""
        return self.chain.optics.pinhole

    @cached_property
    def spots_px(self) -> Floats:
        """Return where the spots are at rest, (2, 2)."""
        return self.chain.optics.observe()[0]

    @property
    def steady_arcsec_per_degC(self) -> Floats:
        """Return the true angles (3,) once the whole camera is a degree warmer."""
        return rad_to_arcsec(self.chain.steady_rad_per_degC)

    @property
    def field_turn(self) -> Floats:
        """Return the matrix (3, 3) from axes of :attr:`camera` to those of the line of sight."""
        return self.chain.optics.field_turn

    def follow(self, time_s: Floats, room_degC: Floats) -> tuple[Floats, Floats, Floats]:
        """Return temperatures at the sensors (F, sensors), angles (F, 3) and spots (F, 2, 2)."""
        run = self.chain.simulate(time_s, {"room_degC": room_degC})
        shifts_mm = (run.px - run.px[0]) * self.camera.pixel_mm
        rows = np.linalg.pinv(design_matrix(self.points_mm))
        return run.temperature_degC, shifts_mm.reshape(-1, 4) @ rows.T, run.px


def bench_of(model: ThermoelasticCamera, *, where: str = "model") -> CameraBench:
    """Return the warm-up in front of a camera of one's own; ``where`` begins its messages.

    Raises
    ------
    ValueError
        If a load asks for an input that is neither ``room_degC`` nor given by the model, or the
        spots' windows do not fit on the detector.

    Examples
    --------
    >>> bench_of(example_camera("all aluminium")).camera.shape
    (1080, 1920)
    """
    if missing := [n for n in model.heat.inputs if n != "room_degC" and n not in model.inputs]:
        raise ValueError(
            f"{where}: inputs: key {missing[0]} is missing; the warm-up gives only room_degC"
        )
    pinhole = model.optics.pinhole
    bench = CameraBench(
        focal_mm=pinhole.focal_mm, pixel_um=pinhole.pixel_um, shape=pinhole.shape, model=model
    )
    edge = bench.window_px // 2 + 1
    room = np.array(pinhole.shape[::-1]) - edge
    if (bench.spots_px < edge).any() or (bench.spots_px > room).any():
        raise ValueError(
            f"{where}: optics: key spot_separation_deg puts a spot less than {edge} px from the "
            "edge of the detector"
        )
    return bench
