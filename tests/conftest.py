"""What several tests share: real recordings, and the camera of lyu2015 with its smeared stars."""

import dataclasses
import inspect
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import losbench as lb
from losbench.optics.motion.path import AttitudePath

_BESIDE = Path(__file__).resolve().parents[1].parent / "shared" / "real"


@pytest.fixture(scope="session")
def real_data() -> Callable[[str], Path]:
    """Return a folder of real recordings, which are not part of the project, or skip the test where
    it is missing.
    """

    def folder(name: str) -> Path:
        path = Path(os.environ.get("LOSBENCH_DATA", _BESIDE)) / name
        if not path.is_dir():
            pytest.skip(
                f"no folder {name} in LOSBENCH_DATA or beside the checkout; data/README.md "
                "says what it holds"
            )
        return path

    return folder


PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b55"
    "0000000a49444154789c6360000000020001e221bc330000000049454e44ae426082"
)


@pytest.fixture
def undrawn(monkeypatch, request):
    """Pictures are made but not drawn, which is most of the time of a report: for tests that look
    at none, and are not marked as ``drawn``.
    """
    if request.node.get_closest_marker("drawn"):
        return

    def save(_, file, *, format, **__):
        file.write("<svg></svg>" if format == "svg" else PIXEL)

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save)


EXPOSURE_S = 0.025


@dataclasses.dataclass(frozen=True)
class Shot:
    """Windows (..., n, h, w) of stars, and where the stars were at the end of the exposure."""

    windows: np.ndarray
    origin: np.ndarray
    end: np.ndarray
    path: AttitudePath

    def centre(self):
        """Plain grey centre of each window."""
        pixel = np.arange(self.windows.shape[-1])
        total = self.windows.sum(axis=(-1, -2))
        x, y = self.windows.sum(axis=-2) @ pixel / total, self.windows.sum(axis=-1) @ pixel / total
        return np.stack([x, y], axis=-1) + self.origin


@pytest.fixture(scope="session")
def camera():
    """512 x 512 pixels and 8 x 8 degrees."""
    return lb.Camera(focal_mm=2.56 / np.tan(np.radians(4.0)), pixel_um=10.0, shape=(512, 512))


@pytest.fixture(scope="session")
def expose(camera):
    def shot(motion, xy, *, sigma=0.45, flux=1.0, size=17, mounting=None, nodes=4):
        path = lb.motion_path(motion, EXPOSURE_S, mounting=mounting, nodes=nodes)
        tracks = path.tracks(xy, camera)
        origin = np.rint(tracks.mean(axis=-2)) - size // 2
        windows = lb.render_streaks(
            tracks[..., None, :, :], path.share, flux, sigma, (size, size), origin
        )
        return Shot(windows, origin, path.carry(xy, camera), path)

    return shot


@pytest.fixture(scope="session")
def sense():
    def path(
        motion,
        *,
        rate_hz=200.0,
        interpolation="linear",
        mounting=None,
        nodes=4,
        margin=0,
        gyro=None,
    ):
        gyro = gyro or lb.Gyro(rate_hz=rate_hz)
        return lb.gyro_path(
            gyro.increments(motion, EXPOSURE_S, margin=margin),
            interval_s=1 / gyro.rate_hz,
            first_s=-margin / gyro.rate_hz,
            exposure_s=EXPOSURE_S,
            interpolation=interpolation,
            mounting=mounting,
            nodes=nodes,
        )

    return path


@pytest.fixture
def defaults_of():
    """What a class or a function takes where nothing is said, by name; what a factory makes is
    none.
    """

    def found(thing):
        if inspect.isclass(thing):
            return {field.name: field.default for field in dataclasses.fields(thing)}
        return {name: one.default for name, one in inspect.signature(thing).parameters.items()}

    return found
