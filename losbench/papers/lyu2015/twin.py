"""Exposures of real stars at random attitudes under vibration, as windows around each star."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats, Indices
from losbench.imaging.smeared.aided import aided_centroid
from losbench.imaging.smeared.result import AidedCentroids
from losbench.imaging.smeared.windows import grey_centre
from losbench.imaging.spots import render_streaks
from losbench.optics.catalogue import load_catalogue, random_attitudes
from losbench.optics.motion.path import AttitudePath
from losbench.optics.motion.vibration import Vibration
from losbench.papers.lyu2015.scenario import TABLE_1, Setting

__all__ = ["Exposures", "example", "expose", "random_exposures", "traditional_shift_px"]


_BLOCK = 500  # stars rendered at a time
_EXAMPLE_DRAWS = 20_000


@dataclass(frozen=True)
class Exposures:
    """M stars in F exposures, flat.

    Parameters
    ----------
    setting : Setting
    motion : Vibration
        Of each exposure, parameters (F, 3).
    image : (M,) array of int
        Which exposure a star belongs to.
    start : (M, 2) array, pixels
        Where it was when the exposure began.
    magnitude : (M,) array
    windows : (M, 1, h, w) array
        Its light, without noise, for a flux of 1.
    origin : (M, 1, 2) array, pixels
    """

    setting: Setting
    motion: Vibration
    image: Indices
    start: Floats
    magnitude: Floats
    windows: Floats
    origin: Floats

    @cached_property
    def truth(self) -> AttitudePath:
        """Path of each exposure."""
        return self.setting.truth(self.motion)

    @cached_property
    def end(self) -> Floats:
        """Where each star was when the exposure ended, (M, 2)."""
        return self.truth.part(self.image).carry(self.start[:, None], self.setting.camera)[:, 0]

    @property
    def traditional(self) -> Floats:
        """Plain grey centre of each star, (M, 2)."""
        return grey_centre(self.windows[:, 0], self.origin[:, 0])

    def aided(
        self, path: AttitudePath, frames: NDArray[Any] | None = None, **choices: Any
    ) -> AidedCentroids:
        """Aided centroids of the clean windows, or of ``frames`` in their place; parameters as for
        `aided_centroid`.
        """
        options = {"background": 0.0, "width": self.setting.sigma_px} | choices
        return aided_centroid(
            self.windows if frames is None else frames,
            origin=self.origin,
            path=path.part(self.image) if path.batch else path,
            camera=self.setting.camera,
            **options,
        )

    def error(self, xy: Floats) -> Floats:
        """Distance to the true position at the end, (M,)."""
        return np.linalg.norm(xy.reshape(-1, 2) - self.end, axis=1)

    def per_image(self, error: Floats) -> Floats:
        """Mean over the stars of each exposure that has any."""
        count = np.bincount(self.image)
        return (np.bincount(self.image, error) / np.maximum(count, 1))[count > 0]


def expose(
    setting: Setting, motion: Vibration, image: Indices, start: Floats, magnitude: Floats
) -> Exposures:
    """Render the windows of stars that begin at ``start``."""
    path = setting.truth(motion)
    reach = np.ptp(path.tracks([[255.5, 255.5]], setting.camera), axis=-2).max() / 2
    size = 2 * int(np.ceil(reach + 6 * setting.sigma_px + 0.5)) + 1
    windows, origin = np.empty((len(start), 1, size, size)), np.empty((len(start), 1, 2))
    for first in range(0, len(start), _BLOCK):
        part = slice(first, first + _BLOCK)
        tracks = path.part(image[part]).tracks(start[part, None], setting.camera)
        middle = (tracks.max(axis=-2) + tracks.min(axis=-2)) / 2
        origin[part] = np.rint(middle) - size // 2
        shape = (size, size)
        windows[part] = render_streaks(
            tracks[..., None, :, :], path.share, 1.0, setting.sigma_px, shape, origin[part]
        )
    return Exposures(setting, motion, image, start, magnitude, windows, origin)


def random_exposures(setting: Setting, n: int | None = None) -> Exposures:
    """Point the camera anywhere in the sky, n times, and shake it."""
    count = setting.images if n is None else n
    rng = np.random.default_rng(setting.seed)
    stars, camera = load_catalogue(faintest=setting.faintest_hp), setting.camera
    fields = [
        stars.field(turn, camera, margin_px=setting.border_px)
        for turn in random_attitudes(count, rng)
    ]
    image = np.repeat(np.arange(count), [len(field.xy) for field in fields])
    xy, magnitude = (
        np.concatenate([f.xy for f in fields]),
        np.concatenate([f.magnitude for f in fields]),
    )
    return expose(setting, setting.vibrations(count, rng), image, xy, magnitude)


def traditional_shift_px(setting: Setting, motion: Vibration, end: Floats) -> Floats:
    """Distance (F, n) of stars that end at ``end`` (n, 2) from the means of their tracks."""
    path, camera = setting.truth(motion, nodes=1), setting.camera
    mean = np.matmul(path.share, path.tracks(end, camera, epoch="end"))
    return np.linalg.norm(end - mean, axis=-1)


def example(setting: Setting) -> Exposures:
    """Return the image of Fig. 4 and Table 1: stars that end where the table says, and the
    vibration that fits best.
    """
    end = TABLE_1["xy"] - 0.5
    shakes = setting.vibrations(_EXAMPLE_DRAWS, setting.table_1_seed)
    blocks = range(0, _EXAMPLE_DRAWS, 2000)
    shifts = [traditional_shift_px(setting, _some(shakes, slice(k, k + 2000)), end) for k in blocks]
    best = int(np.argmin(np.sum((np.concatenate(shifts) - TABLE_1["traditional"]) ** 2, axis=1)))
    motion = _some(shakes, slice(best, best + 1))
    start = setting.truth(motion).carry(end, setting.camera, start="end", end="start")[0]
    return expose(setting, motion, np.zeros(len(end), dtype=np.intp), start, np.full(len(end), 5.0))


def _some(motion: Vibration, part: slice) -> Vibration:
    names = ("constant_rad_s", "amplitude_rad_s", "frequency_hz", "phase_rad")
    return replace(motion, **{name: getattr(motion, name)[part] for name in names})
