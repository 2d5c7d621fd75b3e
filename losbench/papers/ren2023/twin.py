"""Telemetry of the pair: orbit, drift, slow error, noise and spots, with the truth beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation

from losbench.arrays import Floats
from losbench.imaging.centroid import centroid
from losbench.imaging.spots import render_spots
from losbench.optics.camera import project
from losbench.papers.ren2023.scenario import CONVENTION, Pair
from losbench.pointing.starcamera import PairTelemetry, earth_velocity_km_s, remove_aberration
from losbench.units import arcsec_to_rad

__all__ = ["Simulation", "body_attitude", "simulate"]


FIRST_DAY = (
    "2022-01-26T04:00:00"  # year and hour are assumed; aberration is all that depends on them
)
_ORBIT_TO_INERTIAL = Rotation.from_rotvec([1.2, 0.4, -0.8])  # where the first track begins: any
_ORBITAL_SPEED_KM_S = 7.6
_STAMP = 33  # pixels


@dataclass(frozen=True)
class Simulation:
    """What the pair reports, and what is true: ``drift_rad`` (2, n, 3) and ``attitude`` (2, n, 4)
    without drift.
    """

    telemetry: PairTelemetry
    drift_rad: Floats
    attitude: Floats


def simulate(
    setting: Pair,
    seed: int | np.random.Generator | None = None,
    *,
    pixels: bool = False,
    aberration: bool = False,
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
    truth = _truth(setting)
    error = attitude_error(setting, rng)
    see = _imaged if pixels else _blurred
    reported = [(truth.turned[k] * Rotation.from_rotvec(error[k])).as_quat() for k in range(2)]
    shifts = [see(setting, truth.shifts_mm[k], rng) for k in range(2)]
    telemetry = PairTelemetry(
        time_s=setting.time_s,
        quaternions=np.stack(reported),
        points_mm=np.stack([setting.points_mm] * 2),
        shifts_mm=np.stack(shifts),
        convention=CONVENTION,
        installation=np.stack([np.eye(3)] * 2),
    )
    if aberration:
        body = body_attitude(setting, setting.time_s)
        telemetry = replace(
            telemetry, quaternions=_aberrated(telemetry.quaternions, body, setting.time_s)
        )
    return Simulation(telemetry, truth.drift_rad, truth.attitude)


@dataclass(frozen=True)
class _Truth:
    """What no noise touches: attitudes without drift (2, n, 4) and with it, drift (2, n, 3), shifts
    (2, n, 2, 2).
    """

    attitude: Floats
    turned: tuple[Rotation, Rotation]
    drift_rad: Floats
    shifts_mm: Floats


@lru_cache(maxsize=2)
def _truth(setting: Pair) -> _Truth:
    """Compute once what every seed shares: compositions of rotations are most of the work."""
    points, drift = setting.points_mm, setting.drift_rad(setting.time_s)
    body = body_attitude(setting, setting.time_s)
    first, second = (body * axes for axes in setting.axes)
    turned = first * Rotation.from_rotvec(drift[0]), second * Rotation.from_rotvec(drift[1])
    attitude = np.stack([first.as_quat(), second.as_quat()])
    shifts = (project(points, -drift) - points)[..., :2]
    for array in (attitude, drift, shifts):
        array.setflags(write=False)
    return _Truth(attitude, turned, drift, shifts)


def body_attitude(setting: Pair, time_s: Floats) -> Rotation:
    """Body to inertial: z up, x ahead, pitching once per orbit, with a wobble of all three axes."""
    pitch = np.zeros((len(time_s), 3))
    pitch[:, 1] = 2 * np.pi * time_s / setting.orbit_s
    phase = 2 * np.pi * (time_s[:, None] / setting.wobble_s + np.array([0.0, 0.3, 0.7]))
    wobble = arcsec_to_rad(setting.wobble_arcsec) * np.sin(phase)
    return _ORBIT_TO_INERTIAL * Rotation.from_rotvec(pitch) * Rotation.from_rotvec(wobble)


def attitude_error(setting: Pair, rng: np.random.Generator) -> Floats:
    """Errors of both cameras' attitudes as rotation vectors (2, n, 3), a new realisation for each
    track.
    """
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
    """Weights that turn white noise into noise of covariance exp(-k^2 / (2 correlation^2)) and
    variance one.
    """
    width = correlation_samples / np.sqrt(2.0)
    half = int(5 * width) + 1
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / width) ** 2)
    return kernel / np.linalg.norm(kernel)


def _blurred(setting: Pair, shifts_mm: Floats, rng: np.random.Generator) -> Floats:
    return shifts_mm + setting.spot_noise_um * 1e-3 * rng.standard_normal(shifts_mm.shape)


def _imaged(setting: Pair, shifts_mm: Floats, rng: np.random.Generator) -> Floats:
    """Shifts as the detector's images of the spots give them: a window per spot, rendered, exposed,
    centroided.
    """
    rest = setting.camera.pixels(setting.points_mm)
    found = []
    for k, place in enumerate(rest):
        corner = np.rint(place) - _STAMP // 2
        xy = place + shifts_mm[:, k, None] / setting.camera.pixel_mm
        light = render_spots(
            xy, setting.spot_flux_e, setting.spot_sigma_px, (_STAMP, _STAMP), corner
        )
        frames = setting.detector.expose(light + 20.0, rng)
        measured = (
            centroid(frames, (place - corner)[None], noise=setting.detector).xy[:, 0] + corner
        )
        found.append((measured - place) * setting.camera.pixel_mm)
    return np.stack(found, axis=1)


def _aberrated(quaternions: Floats, body: Rotation, time_s: Floats) -> Floats:
    """Attitudes as star matching without aberration gives them: turned against the velocity."""
    utc = np.datetime64(FIRST_DAY, "ns") + (time_s * 1e9).astype("timedelta64[ns]")
    each_minute = earth_velocity_km_s(utc[::480]).repeat(480, axis=0)[: len(utc)]
    velocity = each_minute + _ORBITAL_SPEED_KM_S * body.apply([1.0, 0.0, 0.0])
    return np.stack([remove_aberration(q, -velocity, convention=CONVENTION) for q in quaternions])
