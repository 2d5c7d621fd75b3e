"""Telemetry of the pair: orbit, drift, slow error, noise and spots, with the truth beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation

from losbench.imaging.centroid import centroid
from losbench.imaging.spots import render_spots
from losbench.papers.ren2023.scenario import CONVENTION, Pair
from losbench.pointing.optics import project
from losbench.pointing.starcamera import PairTelemetry, earth_velocity_km_s, remove_aberration
from losbench.units import arcsec_to_rad

__all__ = ["Simulation", "body_attitude", "simulate"]

Floats = NDArray[np.float64]

FIRST_DAY = "2022-01-26T04:00:00"  # year and hour are assumed; aberration is all that depends on them
_ORBIT_TO_INERTIAL = Rotation.from_rotvec([1.2, 0.4, -0.8])  # where the first track begins: any
_ORBITAL_SPEED_KM_S = 7.6
_STAMP = 33  # pixels


@dataclass(frozen=True)
class Simulation:
    """What the pair reports, and what is true: ``drift_rad`` (2, n, 3) and ``attitude`` (2, n, 4) without drift."""

    telemetry: PairTelemetry
    drift_rad: Floats
    attitude: Floats


def simulate(
    setting: Pair, seed: int | np.random.Generator | None = None, *, pixels: bool = False, aberration: bool = False
) -> Simulation:
    """Simulate every track of the pair.

    Parameters
    ----------
    setting : Pair
        The scenario.
    seed : int or numpy Generator, optional
        Of all noise; the scenario's by default.
    pixels : bool
        Render, expose and centroid every spot instead of drawing the noise of its centroid.
    aberration : bool
        Leave stellar aberration in the attitudes (needs astropy).

    Returns
    -------
    Simulation
    """
    rng = np.random.default_rng(setting.seed if seed is None else seed)
    t, drift = setting.time_s, setting.drift_rad(setting.time_s)
    body = body_attitude(setting, t)
    error = attitude_error(setting, rng)
    points = np.stack([setting.points_mm] * 2)
    at_rest, reported, shifts = [], [], []
    for k in range(2):
        head = body * setting.axes[k]
        at_rest.append(head.as_quat())
        reported.append((head * Rotation.from_rotvec(drift[k]) * Rotation.from_rotvec(error[k])).as_quat())
        true_mm = project(points[k], -drift[k])[..., :2] - points[k, :, :2]
        shifts.append(_imaged(setting, true_mm, rng) if pixels else _blurred(setting, true_mm, rng))
    telemetry = PairTelemetry(
        time_s=t,
        quaternions=np.stack(reported),
        points_mm=points,
        shifts_mm=np.stack(shifts),
        convention=CONVENTION,
        installation=np.stack([np.eye(3)] * 2),
    )
    if aberration:
        telemetry = replace(telemetry, quaternions=_aberrated(telemetry.quaternions, body, t))
    return Simulation(telemetry, drift, np.stack(at_rest))


def body_attitude(setting: Pair, time_s: Floats) -> Rotation:
    """Body to inertial: z up, x ahead, pitching once per orbit, with a wobble of all three axes."""
    pitch = np.zeros((len(time_s), 3))
    pitch[:, 1] = 2 * np.pi * time_s / setting.orbit_s
    phase = 2 * np.pi * (time_s[:, None] / setting.wobble_s + np.array([0.0, 0.3, 0.7]))
    wobble = arcsec_to_rad(setting.wobble_arcsec) * np.sin(phase)
    return _ORBIT_TO_INERTIAL * Rotation.from_rotvec(pitch) * Rotation.from_rotvec(wobble)


def attitude_error(setting: Pair, rng: np.random.Generator) -> Floats:
    """Errors of both cameras' attitudes as rotation vectors (2, n, 3), a new realisation for each track."""
    tracks = len(setting.days)
    n = round(setting.track_s * setting.rate_hz)
    kernel = _memory(setting.correlation_s * setting.rate_hz)
    white = rng.standard_normal((tracks, n + len(kernel) - 1, 6))
    slow = fftconvolve(white, kernel[None, :, None], mode="valid", axes=1) * setting.lsfe_arcsec
    noise = rng.standard_normal((tracks, n, 6)) * setting.nea_arcsec
    error = arcsec_to_rad((slow + noise) / 3.0).reshape(tracks * n, 2, 3)
    return np.swapaxes(error * np.array([1.0, 1.0, setting.roll_factor]), 0, 1)


@cache
def _memory(correlation_samples: float) -> Floats:
    """Weights that turn white noise into noise of covariance exp(-k^2 / (2 correlation^2)) and variance one."""
    width = correlation_samples / np.sqrt(2.0)
    half = int(5 * width) + 1
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / width) ** 2)
    return kernel / np.linalg.norm(kernel)


def _blurred(setting: Pair, shifts_mm: Floats, rng: np.random.Generator) -> Floats:
    return shifts_mm + setting.spot_noise_um * 1e-3 * rng.standard_normal(shifts_mm.shape)


def _imaged(setting: Pair, shifts_mm: Floats, rng: np.random.Generator) -> Floats:
    """Shifts as the detector's images of the spots give them: a window per spot, rendered, exposed, centroided."""
    rest = setting.camera.pixels(setting.points_mm)
    found = []
    for k, place in enumerate(rest):
        corner = np.rint(place) - _STAMP // 2
        xy = place + shifts_mm[:, k, None] / setting.camera.pixel_mm
        light = render_spots(xy, setting.spot_flux_e, setting.spot_sigma_px, (_STAMP, _STAMP), corner)
        frames = setting.detector.expose(light + 20.0, rng)
        measured = centroid(frames, (place - corner)[None], noise=setting.detector).xy[:, 0] + corner
        found.append((measured - place) * setting.camera.pixel_mm)
    return np.stack(found, axis=1)


def _aberrated(quaternions: Floats, body: Rotation, time_s: Floats) -> Floats:
    """Attitudes as star matching without aberration gives them: turned against the velocity."""
    utc = np.datetime64(FIRST_DAY, "ns") + (time_s * 1e9).astype("timedelta64[ns]")
    each_minute = earth_velocity_km_s(utc[::480]).repeat(480, axis=0)[: len(utc)]
    velocity = each_minute + _ORBITAL_SPEED_KM_S * body.apply([1.0, 0.0, 0.0])
    return np.stack([remove_aberration(q, -velocity, convention=CONVENTION) for q in quaternions])
