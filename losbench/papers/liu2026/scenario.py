"""What liu2026 states and what had to be assumed: the Monte Carlo of section 2, the camera and the
runs of section 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from losbench.arrays import Floats
from losbench.imaging.detector import Detector
from losbench.optics.camera import Camera, project
from losbench.papers.provenance import assumed, calibrated, stated
from losbench.pointing.thermal import ThermalNetwork, thermoelastic_tilt

__all__ = ["Bench", "ConstantBench", "MonteCarlo", "ThermalBench", "next_odd"]


_OFF_THE_SHELF = "a usual 12-bit industrial CMOS sensor"


@dataclass(frozen=True)
class Bench:
    """Section 3.1: an off-axis three-mirror camera that looks at two fibre spots."""

    focal_mm: float = stated(260.0, "mm", "section 3.1")
    pixel_um: float = stated(10.0, "um", "section 3.1")
    shape: tuple[int, int] = stated((1080, 1920), "px", "section 3.1, rows and columns")
    spot_separation_deg: float = assumed(
        1.1914,
        "deg",
        "the angle between the beams of section 2.2, the only layout that the paper gives",
    )
    spot_row_px: float = assumed(
        539.5, "px", "both spots on the middle row: the baseline lies along x as in section 2.2"
    )
    spot_sigma_px: float | tuple[float, float] = assumed(
        3.0, "px", "a spot diameter (4 sigma) of 12 px; other sizes are tried beside it"
    )
    flux_e: tuple[float, float] = assumed(
        (2.25e5, 2.1e5),
        "e-",
        "as bright as in the run at constant temperature, whose noise Table 1 gives",
    )
    background_e: float = assumed(50.0, "e-", "stray light and dark current of a short exposure")
    gain_e_per_dn: float = assumed(4.0, "e-/DN", _OFF_THE_SHELF)
    read_noise_e: float = assumed(5.0, "e-", _OFF_THE_SHELF)
    offset_dn: float = assumed(100.0, "DN", _OFF_THE_SHELF)
    full_well_e: float = assumed(15000.0, "e-", _OFF_THE_SHELF)
    bits: int = assumed(12, "", _OFF_THE_SHELF)
    subpixel_px: tuple[tuple[float, float], tuple[float, float]] = assumed(
        ((0.31, -0.17), (-0.23, 0.38)),
        "px",
        "where on its pixel each spot sits; any, but not the middle",
    )
    window_px: int = assumed(
        51,
        "px",
        "rendered instead of whole frames, wide enough for the drift and a background ring",
    )

    @cached_property
    def camera(self) -> Camera:
        """Return the camera as stated."""
        return Camera(self.focal_mm, self.pixel_um, self.shape)

    @cached_property
    def detector(self) -> Detector:
        """Return the sensor as assumed."""
        return Detector(
            gain_e_per_dn=self.gain_e_per_dn,
            read_noise_e=self.read_noise_e,
            offset_dn=self.offset_dn,
            full_well_e=self.full_well_e,
            bits=self.bits,
        )

    @cached_property
    def spots_px(self) -> Floats:
        """Return where the spots are at rest, (2, 2)."""
        half_mm = self.focal_mm * np.tan(np.radians(self.spot_separation_deg / 2))
        x = (self.shape[1] - 1) / 2 + np.array([1.0, -1.0]) * np.rint(
            half_mm / (self.pixel_um * 1e-3)
        )
        return np.stack([x, np.full(2, np.floor(self.spot_row_px))], axis=-1) + np.array(
            self.subpixel_px
        )

    @cached_property
    def points_mm(self) -> Floats:
        """Return the rays of the spots at rest, (2, 3)."""
        return self.camera.points_mm(self.spots_px)

    @property
    def spot_diameter_px(self) -> float:
        """Return four sigma, of the wider axis where sigma is a pair (x, y)."""
        return 4.0 * float(np.max(self.spot_sigma_px))

    @property
    def grey_window_px(self) -> int:
        """Return the odd side of the grey-weighted window: 1.5 spot diameters of four sigma
        (section 2.2).
        """
        return next_odd(1.5 * self.spot_diameter_px)

    @property
    def eiwa_window_px(self) -> int:
        """Return N of EIWA: odd, "a little over the spot diameter" (section 2.2)."""
        return next_odd(self.spot_diameter_px)


def next_odd(length: float) -> int:
    """Return the smallest odd number above ``length``."""
    whole = int(np.floor(length)) + 1
    return whole + (whole + 1) % 2


@dataclass(frozen=True)
class ThermalBench(Bench):
    """Section 3.1's warm-up: the room goes from 18 to 25 degC, a frame is taken every 5 s."""

    frame_period_s: float = stated(5.0, "s", "section 3.1")
    room_start_degC: float = stated(18.0, "degC", "section 3.1")
    room_end_degC: float = stated(25.0, "degC", "section 3.1")
    hold_s: float = assumed(600.0, "s", "quiet time before the ramp, for the reference frames")
    ramp_s: float = assumed(4800.0, "s", 'the room is "slowly" warmed; 80 min are 5.25 degC/h')
    soak_s: float = assumed(
        3600.0, "s", "time at 25 degC at the end, so that the structure catches up"
    )
    capacity_J_per_K: tuple[float, ...] = assumed(
        (4000.0, 1200.0, 300.0, 800.0, 200.0),
        "J/K",
        "base plate of 4.5 kg aluminium; three mirror mounts; focal plane",
    )
    link_to_base_W_per_K: tuple[float, ...] = assumed(
        (0.8, 0.25, 0.6, 0.4), "W/K", "bolted joints; the secondary hangs on thin struts"
    )
    room_W_per_K: tuple[float, ...] = assumed(
        (2.4, 0.8, 0.4, 0.7, 0.3),
        "W/K",
        "10 W/(m2 K) over each part's surface: moving air, and radiation",
    )
    sensitivity_arcsec_per_degC: tuple[tuple[float, ...], ...] = assumed(
        (
            (0.30, 0.95, -0.45, 0.55, 0.10),
            (-0.20, 0.40, 1.10, -0.35, 0.05),
            (0.15, 0.60, 0.25, 0.40, 0.80),
        ),
        "arcsec/degC",
        'rows X, Y, Z, columns as the nodes: a drift "of arcseconds" (section 1) over 7 degC',
    )
    seed: int = assumed(20260005, "", "any; no verdict depends on it")

    NODES = ("base plate", "primary mount", "secondary mount", "tertiary mount", "focal plane")

    @cached_property
    def network(self) -> ThermalNetwork:
        """Return the thermal network: every mount is bolted to the base plate and cooled by the
        room.
        """
        return ThermalNetwork(
            capacity_J_per_K=dict(zip(self.NODES, self.capacity_J_per_K, strict=True)),
            link_W_per_K={
                ("base plate", node): g
                for node, g in zip(self.NODES[1:], self.link_to_base_W_per_K, strict=True)
            },
            room_W_per_K=dict(zip(self.NODES, self.room_W_per_K, strict=True)),
        )

    @property
    def steady_arcsec_per_degC(self) -> Floats:
        """Return the true angles (3,) once the whole camera is a degree warmer."""
        return np.array(self.sensitivity_arcsec_per_degC).sum(axis=1)

    @property
    def field_turn(self) -> Floats:
        """Return the matrix (3, 3) from axes of :attr:`camera` to those of the line of sight."""
        return np.eye(3)

    def follow(self, time_s: Floats, room_degC: Floats) -> tuple[Floats, Floats, Floats]:
        """Return temperatures (F, nodes), angles (F, 3) and spots (F, 2, 2) under a room that runs
        straight between its samples.
        """
        nodes = self.network.simulate(time_s, room_degC)
        angles = thermoelastic_tilt(
            nodes,
            np.array(self.sensitivity_arcsec_per_degC),
            reference_degC=self.room_start_degC,
        )
        return nodes, angles, self.camera.pixels(project(self.points_mm, angles))

    @property
    def duration_s(self) -> float:
        """Return the length of the experiment."""
        return self.hold_s + self.ramp_s + self.soak_s

    def room_degC(self, time_s: Floats) -> Floats:
        """Return the room temperature: hold, ramp, soak."""
        return np.interp(
            time_s,
            [self.hold_s, self.hold_s + self.ramp_s],
            [self.room_start_degC, self.room_end_degC],
        )


@dataclass(frozen=True)
class ConstantBench(Bench):
    """Section 3.2's rest: 1000 frames at constant temperature, of which 100 enter the tables."""

    flux_e: tuple[float, float] = calibrated(
        (2.25e5, 2.1e5),
        "e-",
        "grey-weighted RMS along y of Table 1, which a hundred frames give to 7 %",
        to=("irls-17", "irls-21"),
        low=(1.5e5, 1.4e5),
        high=(3.6e5, 3.4e5),
    )
    frames: int = stated(1000, "", "section 3.2")
    sample: int = stated(100, "", "section 3.2")
    motion_x_px: tuple[float, float] = calibrated(
        (0.0264, 0.0508),
        "px",
        "grey-weighted RMS along x of Table 1, three to four times that along y",
        to=("irls-15", "irls-19"),
        low=(0.0208, 0.0401),
        high=(0.0319, 0.0615),
    )
    motion_form: tuple[str, str] = calibrated(
        ("noise", "sinusoid"),
        "",
        "PV over RMS along x in Table 1: 5.5 for A as of noise, 3.2 for B as of a sinusoid",
        to=("irls-16", "irls-20"),
        low=("noise", "noise"),
        high=("sinusoid", "sinusoid"),
    )
    sinusoid_cycles: float = assumed(
        37.3, "", "cycles of B's motion in the run; any number that is not whole"
    )
    seed: int = assumed(20260006, "", "any; no verdict depends on it")


@dataclass(frozen=True)
class MonteCarlo:
    """Section 2.2: two beams, four noisy displacements, three angles."""

    spot_a_mm: tuple[float, float, float] = stated(
        (5.0, 75.0, -475.0), "mm", "section 2.2, vector A; the unit is assumed"
    )
    spot_b_mm: tuple[float, float, float] = stated(
        (-5.0, 75.0, -475.0), "mm", "section 2.2, vector B; the unit is assumed"
    )
    rotation_deg: float = stated(0.01, "deg", "section 2.2, about each axis")
    pixel_um: float = stated(4.5, "um", "section 2.2")
    precisions_px: tuple[float, ...] = stated((0.5, 0.1, 0.01), "px", "section 2.2")
    trials: int = stated(5000, "", "section 2.2")
    noise: str = assumed(
        "clipped",
        "",
        'the paper wants Gaussian noise with a fluctuation "within +-0.1 px": a precision p is '
        "read as three sigma, "
        'clipped at +-p; "gaussian" reads p as sigma, "truncated" cuts that at +-p, "uniform" '
        "takes the range alone",
    )
    seed: int = assumed(20260039, "", "any; no verdict depends on it")

    @property
    def points_mm(self) -> Floats:
        """Return the two beams, (2, 3)."""
        return np.array([self.spot_a_mm, self.spot_b_mm])

    @property
    def angles_rad(self) -> Floats:
        """Return the true rotation, (3,)."""
        return np.radians(np.full(3, self.rotation_deg))
