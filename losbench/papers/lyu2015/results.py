"""The numbers behind Fig. 6, Fig. 7 and the 1000 images, and what the paper does not test."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.imaging.smeared.aided import aided_centroid
from losbench.imaging.smeared.bound import streak_bound
from losbench.optics.motion.gyro import Gyro
from losbench.optics.motion.path import AttitudePath
from losbench.optics.motion.vibration import Vibration
from losbench.papers.lyu2015.scenario import Setting
from losbench.papers.lyu2015.twin import Exposures, expose, random_exposures

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "accuracy",
    "floor_px",
    "gyro_errors",
    "improves",
    "one_frequency",
    "quiet",
    "readings",
    "sigma_sweep",
    "stays",
    "width_error",
    "worsens",
]


def quiet(shots: Exposures, path: AttitudePath, **choices: Any) -> Floats:
    """Errors (M,) of aided centroids; those that did not settle are kept, without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return shots.error(shots.aided(path, **choices).xy)


def sigma_sweep(setting: Setting, sigmas_px: Sequence[float], images: int) -> pd.DataFrame:
    """Mean aided error for each width of the spot (Fig. 6), by the iteration and by two other
    methods, in pixels.
    """
    import pandas as pd

    rows = []
    for sigma in sigmas_px:
        here = replace(setting, sigma_px=sigma)
        shots = random_exposures(here, images)
        path = here.sensed(shots.motion, here.biased_gyro(images, here.seed + 1), nodes=8)
        errors = {
            name: shots.per_image(quiet(shots, path, method=name))
            for name in ("iterative", "closed_form")
        }
        rows.append(
            {"sigma_px": sigma}
            | {name: error.mean() for name, error in errors.items()}
            | {"uncertainty": errors["iterative"].std() / np.sqrt(len(errors["iterative"]))}
        )
    return pd.DataFrame(rows)


def gyro_errors(
    setting: Setting, shots: Exposures, values: Sequence[float], error: str
) -> pd.DataFrame:
    """Mean aided error for gyros that have one error each, in pixels; a bias (Fig. 7), a late clock
    or a random walk.

    Parameters
    ----------
    setting : Setting
    shots : Exposures
    values : sequence of float
    error : str
        Field of `Gyro`: "bias_deg_h", "time_offset_s", "angle_random_walk_deg_rt_h" or
        "scale_factor_ppm".
    """
    import pandas as pd

    rows = []
    count = len(shots.truth.turns)
    signs = np.random.default_rng(setting.seed + 1).choice([-1.0, 1.0], (count, 3))
    for value in values:
        gyro = Gyro(
            rate_hz=setting.gyro_rate_hz,
            **{error: value * signs if error == "bias_deg_h" else value},  # type: ignore[arg-type]
        )
        found = {
            kind: shots.per_image(
                quiet(
                    shots,
                    setting.sensed(
                        shots.motion, gyro, interpolation=kind, margin=margin, rng=setting.seed
                    ),
                )
            ).mean()
            for kind, margin in (("linear", 0), ("spline", 2))
        }
        rows.append({error: value, **found})
    return pd.DataFrame(rows)


def floor_px(setting: Setting, motion: Vibration, rate_hz: float | None = None) -> Floats:
    """Sampling floor of linear interpolation, ``f h^2 / (12 T) |w(T) - w(0)|`` across the line of
    sight, (F,) pixels.
    """
    h = 1.0 / (rate_hz or setting.gyro_rate_hz)
    change = np.diff(motion.rate([0.0, setting.exposure_s]), axis=-2)[..., 0, :2]
    across = np.linalg.norm(change, axis=-1)
    return setting.camera.focal_px * h**2 / (12 * setting.exposure_s) * across


def one_frequency(
    setting: Setting, frequencies_hz: Sequence[float], phases: int = 16
) -> pd.DataFrame:
    """Mean error over the phase of a full-rate sinusoid, for a star on the axis and each frequency,
    in pixels.
    """
    import pandas as pd

    phase = 2 * np.pi * np.arange(phases) / phases
    rows = []
    image, middle = np.arange(phases), np.full((phases, 2), (setting.pixels - 1) / 2)
    amplitude = [0.0, np.radians(setting.max_rate_deg_s), 0.0]
    for frequency in frequencies_hz:
        motion = Vibration(
            amplitude_rad_s=amplitude, frequency_hz=frequency, phase_rad=phase[:, None]
        )
        shots = expose(setting, motion, image, middle, np.zeros(phases))
        gyro = Gyro(rate_hz=setting.gyro_rate_hz)
        row = {"frequency_hz": frequency, "traditional": shots.error(shots.traditional).mean()}
        for name, kind, margin in (
            ("linear", "linear", 0),
            ("spline", "spline", 0),
            ("spline, 2 more", "spline", 2),
        ):
            row[name] = quiet(
                shots, setting.sensed(motion, gyro, interpolation=kind, margin=margin)
            ).mean()
        rows.append(row | {"floor": floor_px(setting, motion).mean()})
    return pd.DataFrame(rows)


def width_error(
    setting: Setting, shots: Exposures, path: AttitudePath, factors: Sequence[float]
) -> pd.DataFrame:
    """Mean error where the assumed sigma is wrong by a factor, with and without a threshold, in
    pixels.
    """
    import pandas as pd

    rows = []
    for factor in factors:
        sigma = factor * setting.sigma_px
        rows.append(
            {
                "sigma assumed / true": factor,
                "every pixel": quiet(shots, path, width=sigma).mean(),
                "above 3 %": quiet(shots, path, width=sigma, threshold=0.03).mean(),
                "least squares": quiet(shots, path, width=sigma, method="least_squares").mean(),
            }
        )
    return pd.DataFrame(rows)


def readings(setting: Setting, shots: Exposures, path: AttitudePath) -> pd.DataFrame:
    """The 1000 images in every reading: means over images and over stars, RMS, median, in
    pixels.
    """
    import pandas as pd

    def row(name: str, error: Floats) -> dict[str, Any]:
        image = shots.per_image(error)
        return {
            "method": name,
            "mean of images": image.mean(),
            "uncertainty": image.std() / np.sqrt(len(image)),
            "mean of stars": error.mean(),
            "RMS of stars": np.sqrt(np.mean(error**2)),
            "median of stars": np.median(error),
        }

    gyro = setting.biased_gyro(setting.images, setting.seed + 1)
    spline = setting.sensed(shots.motion, gyro, interpolation="spline")
    wide = setting.sensed(shots.motion, gyro, interpolation="spline", margin=2)
    rows = [
        row("traditional", shots.error(shots.traditional)),
        row("aided, iterative", quiet(shots, path)),
        row("aided, closed form", quiet(shots, path, method="closed_form")),
        row("aided, least squares", quiet(shots, path, method="least_squares")),
        row("aided, spline", quiet(shots, spline)),
        row("aided, spline, 2 more increments on either side", quiet(shots, wide)),
    ]
    return pd.DataFrame(rows).set_index("method")


def improves(by_sigma: pd.DataFrame, column: str = "iterative") -> bool:
    """Whether the error of `sigma_sweep` falls to 0.4 px and ends at what rounds to 0.01 px
    (inertial-20).
    """
    error = by_sigma.set_index("sigma_px")[column]
    falls = error[0.1] > error[0.2] > error[0.4] and error[1.5] <= error[0.2]
    return bool(falls and 0.005 <= error[1.5] < 0.015)


def stays(error: Floats) -> bool:
    """Whether every error rounds to 0.01 px (inertial-22)."""
    return bool(((error >= 0.005) & (error < 0.015)).all())


def worsens(error: Floats) -> bool:
    """Whether the last error is larger than the first, by less than a fifth (inertial-27)."""
    return bool(error[0] < error[-1] < 1.2 * error[0])


_METHODS: dict[str, dict[str, Any]] = {
    "iterative, every pixel": {},
    "iterative, above 3 %": {"threshold": 0.03},
    "least squares, plain": {"method": "least_squares", "noise": None},
    "least squares": {"method": "least_squares"},
}


def accuracy(
    setting: Setting, fluxes_e: Sequence[float], images: int = 200, stars: int = 8
) -> pd.DataFrame:
    """Root mean square error per axis of each method under noise, on true paths, as a multiple of
    the Cramer-Rao bound.

    Every image has the same number of stars, of one brightness, anywhere in the frame.
    """
    import pandas as pd

    rng = np.random.default_rng(setting.seed)
    motion = setting.vibrations(images, rng)
    camera, detector = setting.camera, setting.detector
    start = rng.uniform(30, setting.pixels - 31, (images * stars, 2))
    shots = expose(
        setting, motion, np.repeat(np.arange(images), stars), start, np.zeros(len(start))
    )
    path = setting.truth(motion, nodes=2)
    options: dict[str, Any] = {"noise": detector, "background": setting.background_dn}
    grouped = (images, stars)
    rows = []
    for flux in fluxes_e:
        frames = detector.expose(shots.windows * flux + setting.background_e, rng)
        bound = streak_bound(
            shots.start.reshape(*grouped, 2),
            flux,
            path=path,
            camera=camera,
            width=setting.sigma_px,
            noise=detector,
            background=setting.background_dn,
        )
        row = {"flux_e": flux, "bound_px": np.sqrt(np.mean(bound**2))}
        for name, choices in _METHODS.items():
            found = shots.aided(path, frames, **(options | choices))
            relative = (found.xy[:, 0] - shots.end) / bound.reshape(-1, 2)
            row[name] = np.sqrt(np.mean(relative**2))
        row["joint"] = _joint(shots, path, frames, grouped, options, bound)
        rows.append(row)
    return pd.DataFrame(rows).set_index("flux_e")


def _joint(
    shots: Exposures,
    path: AttitudePath,
    frames: NDArray[np.uint16],
    grouped: tuple[int, int],
    options: dict[str, Any],
    bound: Floats,
) -> float:
    end = shots.end.reshape(*grouped, 2)
    found = aided_centroid(
        frames.reshape(*grouped, *frames.shape[-2:]),
        origin=shots.origin.reshape(*grouped, 2),
        path=path,
        camera=shots.setting.camera,
        width=shots.setting.sigma_px,
        method="joint",
        predicted=end,
        **options,
    )
    return float(np.sqrt(np.mean(((found.xy - end) / bound) ** 2)))
