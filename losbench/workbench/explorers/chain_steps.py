"""The steps from pixels to arcseconds that the chain explorer shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import losbench as lb
from losbench.papers import liu2026

__all__ = ["camera_and_places", "lost_left_out", "pixels_to_arcsec"]


_OFFSET_DN = 100.0
_TABLE_2_MM = ((4.68, 3.36), (9.48, 0.87))  # from the axis: what notebook 07 finds Table 2 to need
_RING = 0.42  # radius of the ring, in the sensor's height
_AROUND = 14  # pixels of a stamp beyond the side of its background ring


def camera_and_places(
    *, layout: str, spots: int, moved: tuple[tuple[float, ...], ...], camera_file: str
) -> tuple[lb.Camera, np.ndarray]:
    """Return the paper's camera or one's own, and the places (n, 2) of the spots on its pixels."""
    bench = liu2026.Bench()
    camera = bench.camera if camera_file == "none" else lb.Camera.from_toml(camera_file)
    middle = np.array(camera.principal_px)
    if layout == "ring":
        turn = 2 * np.pi * (np.arange(spots) + 0.31) / spots
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        places = middle + _RING * min(camera.shape) * ring
    elif layout == "table 2":
        places = middle + np.array(_TABLE_2_MM) / camera.pixel_mm
    else:
        offset_mm = bench.points_mm[:, :2] / bench.focal_mm * camera.focal_mm
        places = middle + offset_mm / camera.pixel_mm
    for spot, *at in moved:
        if spot <= len(places):
            places[int(spot) - 1] = at
    return camera, places


def stamps(
    places: np.ndarray,
    *,
    light_e: float,
    read_noise_e: float,
    background_e: float,
    sigma_px: tuple[float, float],
    side: int,
    seed: int,
    noise: Callable[..., np.ndarray] | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Expose a stamp around each of the places (F, n, 2): (F, n, side, side), and their corners."""
    corner = places.round() - side // 2
    inside = (places - corner)[..., None, :]
    expected = lb.render_spots(inside, light_e, sigma_px, (side, side)) + background_e
    if noise:
        spread = np.sqrt(expected + read_noise_e**2, dtype=np.float32)
        return expected + _OFFSET_DN + spread * noise(expected.shape, seed), corner
    detector = lb.Detector(read_noise_e=read_noise_e, offset_dn=_OFFSET_DN)
    return detector.expose(expected, np.random.default_rng([seed, 1])), corner


def lost_left_out(
    points: np.ndarray, shifts: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows per arcsecond and observations of all frames (F, n, 2), each in its own error, those of
    lost spots left out.
    """
    # Arcseconds, since RLM stops at an absolute step of its unknowns.
    rows = lb.design_matrix(points) * lb.units.arcsec_to_rad(1.0) / sigma.reshape(-1, 1)
    y = (shifts / sigma).ravel()
    seen = np.isfinite(y)
    return np.tile(rows, (len(shifts), 1))[seen], y[seen]


def pixels_to_arcsec(
    *,
    layout: str,
    spots: int,
    moved: tuple[tuple[float, ...], ...],
    camera_file: str,
    light_e: float,
    read_noise_e: float,
    background_e: float,
    sigma_x_px: float,
    sigma_y_px: float,
    window_px: int,
    frames: int,
    bad_percent: int,
    bad_px: float,
    c: float,
    seed: int,
    noise: Callable[..., np.ndarray] | None = None,
) -> dict[str, Any]:
    """Expose spots at rest, some of them off in some frames; measure, solve all frames together,
    and tell by how much the angles are wrong.

    Normals that ``noise`` keeps take the place of photons where there is no time for them.
    """
    camera, places = camera_and_places(
        layout=layout, spots=spots, moved=moved, camera_file=camera_file
    )
    rng = np.random.default_rng([seed, 0])
    bad = rng.random((frames, len(places))) < bad_percent / 100
    where = places + bad[..., None] * np.array([0.8, 0.6]) * bad_px
    ring = max(window_px, 2 * round(3 * max(sigma_x_px, sigma_y_px)) + 1)
    images, corner = stamps(
        where,
        light_e=light_e,
        read_noise_e=read_noise_e,
        background_e=background_e,
        sigma_px=(sigma_x_px, sigma_y_px),
        side=ring + _AROUND,
        seed=seed,
        noise=noise,
    )
    flat = images.reshape(-1, *images.shape[-2:])
    found = lb.centroid(
        flat,
        (places - corner).reshape(-1, 1, 2),
        method=lb.EIWA(window_px),
        background=lb.Ring(ring),
        detector=lb.Detector(read_noise_e=read_noise_e, offset_dn=_OFFSET_DN),
    )
    shifts_px = found.xy.reshape(where.shape) + corner - places
    own = found.sigma_xy.reshape(where.shape)
    seen = np.isfinite(own).any(axis=0)
    sigma_px = np.ones_like(places)
    sigma_px[seen] = [np.nanmedian(own[:, *k], axis=0) for k in np.argwhere(seen)]
    points, unit = camera.points_mm(places), camera.pixel_mm
    told: dict[str, Any] = {"group": None, "stack": frames, "sigma": sigma_px * unit}
    huber = lb.IRLS(loss=lb.Huber(c), scale="mad", tolerance=1e-12)
    fits = {
        "least squares": lb.solve_attitude(points, shifts_px * unit, solver="ls", **told),
        "Huber": lb.solve_attitude(points, shifts_px * unit, solver=huber, **told),
    }
    errors = {name: fit.angles_arcsec[0] for name, fit in fits.items()}
    rows, y = lost_left_out(points, shifts_px * unit, sigma_px * unit)
    # Fewer equations than two spots give leave a rotation free.
    solvable = np.isfinite(errors["Huber"]).all()
    errors["RLM"] = lb.statsmodels_rlm(rows, y, c=c) if solvable else np.full(3, np.nan)
    covariance = lb.attitude_covariance(points, sigma_px * unit, stack=frames)
    return {
        "camera": camera,
        "places": places,
        "first": images[0, 0],
        "corner": corner[0, 0],
        "bad": bad,
        "found": found,
        "sigma_px": np.where(seen, sigma_px, np.nan),
        "huber": fits["Huber"],
        "errors_arcsec": errors,
        "covariance_arcsec2": lb.units.rad_to_arcsec(lb.units.rad_to_arcsec(covariance)),
    }
