"""The digital twin of section 3: a warm-up or a rest, where the spots truly are, and what the
sensor shows of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.imaging.spots import render_spots
from losbench.papers.liu2026.scenario import Bench, ConstantBench, ThermalBench

__all__ = ["WarmUp", "Windows", "constant_truth", "expose_windows", "warm_up"]


@dataclass(frozen=True)
class Windows:
    """What the twin's sensor shows of its spots.

    Attributes
    ----------
    frames : (spots, F, rows, cols) array of uint16
        A window around each spot.
    origin_px : (spots, 2) array
        Frame position (x, y) of each window's first pixel.
    truth_px : (F, spots, 2) array
        Where the spots really were.
    """

    frames: NDArray[np.uint16]
    origin_px: Floats
    truth_px: Floats


def expose_windows(setting: Bench, truth_px: Floats, rng: np.random.Generator) -> Windows:
    """Expose a window around each spot for spot positions (F, 2, 2)."""
    origin = np.rint(setting.spots_px) - setting.window_px // 2
    size = (setting.window_px, setting.window_px)
    frames = [
        setting.detector.expose(
            setting.background_e
            + render_spots(
                truth_px[:, k, None], setting.flux_e[k], setting.spot_sigma_px, size, origin[k]
            ),
            rng,
        )
        for k in range(2)
    ]
    return Windows(np.stack(frames), origin, truth_px)


def constant_truth(setting: ConstantBench, rng: np.random.Generator) -> Floats:
    """Return spot positions (F, 2, 2) at constant temperature: at rest along y, moving along x."""
    n = setting.frames
    phase = 2 * np.pi * (setting.sinusoid_cycles * np.arange(n) / n + rng.random())
    forms = {"noise": rng.standard_normal(n), "sinusoid": np.sqrt(2.0) * np.sin(phase)}
    truth = np.tile(setting.spots_px, (n, 1, 1))
    for spot in range(2):
        truth[:, spot, 0] += setting.motion_x_px[spot] * forms[setting.motion_form[spot]]
    return truth


@dataclass(frozen=True)
class WarmUp:
    """The truth of a warm-up.

    Attributes
    ----------
    time_s, room_degC : (F,) arrays
        Frame times and room temperature.
    node_degC : (F, nodes) array
        Temperatures of the camera's parts, or at its sensors.
    angles_rad : (F, 3) array
        Rotation of the line of sight.
    truth_px : (F, 2, 2) array
        Spot positions on the detector.
    """

    time_s: Floats
    room_degC: Floats
    node_degC: Floats
    angles_rad: Floats
    truth_px: Floats


def warm_up(setting: ThermalBench, *, time_s: Floats | None = None) -> WarmUp:
    """Warm the room, let the heat spread, tilt the line of sight, move the spots.

    Parameters
    ----------
    setting : ThermalBench
        The twin.
    time_s : (F,) array, optional
        Times of the frames; by default every ``frame_period_s``.
    """
    t = (
        np.arange(0.0, setting.duration_s + 1e-9, setting.frame_period_s)
        if time_s is None
        else time_s
    )
    # The network is exact for a room temperature that is straight between samples, so its corners
    # must be samples.
    corners = [0.0, setting.hold_s, setting.hold_s + setting.ramp_s]
    every = np.union1d(t, corners)
    room = setting.room_degC(t)
    asked = np.searchsorted(every, t)
    nodes, angles, truth = setting.follow(every, setting.room_degC(every))
    return WarmUp(t, room, nodes[asked], angles[asked], truth[asked])
