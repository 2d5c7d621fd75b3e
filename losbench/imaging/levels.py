"""Level and noise of a frame: one of each if they hold everywhere, else those of a mesh."""

from __future__ import annotations

from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.imaging.mesh import mesh
from losbench.imaging.pattern import FLAT
from losbench.imaging.ranks import digit_step, level_and_noise, medians
from losbench.imaging.sky import Sky

__all__ = ["sky_of"]


_SAMPLES = 2048  # enough for the noise to 3 %
_STAMP = 1024  # pixels; what is smaller is a stamp, of which a spot may fill more than half
_NOISELESS = 1e-6  # of the peak


def sky_of(pixels: NDArray[Any], peak: float, threshold: float) -> Sky:
    """Level and noise of a frame (rows, columns) without NaN, whose highest reading is ``peak``."""
    step = _stride(pixels.size)
    sample = pixels[::step, ::step].astype(np.float64)
    digit = digit_step(sample)
    most = 0.5 if pixels.size <= _STAMP else 0.75
    values = sample.reshape(1, -1)
    level, noise = level_and_noise(values, digit, values <= values.min(), most=most)
    least = _least_noise(digit, peak - float(level[0]), threshold)
    noise = np.maximum(noise, least)
    row, column = (np.array([0.0, size - 1.0]) for size in pixels.shape)
    flat = Sky(np.full((2, 2), level[0]), np.full((2, 2), noise[0]), row, column, FLAT)
    if pixels.size <= _STAMP or min(sample.shape) < 8:
        return flat
    cells = _cells(sample)
    # Of cells, because a pattern or a gradient over the frame counts as noise of the whole.
    local = median(level_and_noise(cells, digit, cells <= values.min())[1].tolist())
    if _is_flat(cells, sample, max(local, least), digit):
        return flat
    return mesh(pixels, digit, max(local, least), least)


def _stride(size: int) -> int:
    """Every how many rows and columns of so many pixels are sampled.

    Odd and no multiple of three, so that a pattern of the sensor is seen in all its phases.
    """
    step = max(1, round(np.sqrt(size / _SAMPLES)))
    while step % 2 == 0 or step % 3 == 0:
        step += 1
    return step


def _least_noise(digit: float, height: float, threshold: float) -> float:
    """Noise that whole numbers hide; and what stands for it in frames that have none at all."""
    return 0.29 * digit if digit else _NOISELESS * max(height, 0.0) / max(threshold, 1.0)


def _cells(sample: Floats) -> Floats:
    """The sample in 4 x 4 cells, (16, n)."""
    height, width = (size // 4 for size in sample.shape)
    cells = sample[: 4 * height, : 4 * width].reshape(4, height, 4, width)
    return cells.swapaxes(1, 2).reshape(16, -1)


def _is_flat(cells: Floats, sample: Floats, noise: float, digit: float) -> bool:
    """Whether medians of 4 x 4 cells agree, and those of even and odd rows and columns."""
    if np.ptp(medians(cells)) > max(noise / 2, 6.25 * noise / np.sqrt(cells.shape[1])) + digit:
        return False
    height, width = (size // 2 for size in sample.shape)
    halves = sample[: 2 * height, : 2 * width].reshape(height, 2, width, 2)
    phases = np.moveaxis(halves, (1, 3), (0, 1)).reshape(4, -1)
    allowed = max(noise / 2, digit, 6.25 * noise / np.sqrt(height * width))
    return bool(np.ptp(medians(phases)) <= allowed)
