"""Pointing metrics from a power spectrum: each is an integral with a weight of its own."""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats

__all__ = ["spectrum", "weights"]

_SEGMENT = 65_536
_SEGMENTS = 8  # at least so many of them, where the record is long enough for its windows
_WINDOWS = 8  # and so many windows in each
_NEAR_ZERO = 1e-3  # n theta below which the smear's weight is its first term


def spectrum(
    series: Floats, pieces: list[slice], step_s: float, samples: int
) -> tuple[Floats, Floats, int]:
    """One-sided power spectrum (f, k) by Welch's method about zero, its frequencies, its segments.

    Pieces shorter than a segment are left out.
    """
    from scipy.signal import welch

    longest = max(piece.stop - piece.start for piece in pieces)
    size = min(_SEGMENT, longest, max(longest // _SEGMENTS, _WINDOWS * samples))
    total, count, frequency = np.zeros((size // 2 + 1, series.shape[1])), 0, np.empty(0)
    for piece in pieces:
        length = piece.stop - piece.start
        if length < size:
            continue
        segments = (length - size) // (size - size // 2) + 1
        frequency, density = welch(
            series[piece], fs=1.0 / step_s, nperseg=size, detrend=False, axis=0
        )
        total += segments * density
        count += segments
    return frequency, total / count, count


def weights(
    frequency_Hz: Floats, step_s: float, samples: int, separation: int | None
) -> dict[str, Floats]:
    """What each metric takes of a sine's power at a frequency, exact for windows of ``samples``.

    For many samples a window these are, with x = pi f T: MPE j0(x)^2, smear 3 j1(x)^2, RPE 1 -
    j0(x)^2, PDE 2 (1 - cos 2 pi f Ts) j0(x)^2 (Lucke, Sirlin and San Martin, J. Astronaut. Sci. 40,
    557, 1992, with the window's line split off).
    """
    theta = np.pi * frequency_Hz * step_s
    sine = np.sin(theta)
    inner = samples * theta > _NEAR_ZERO
    safe = np.where(inner, sine, 1.0)
    mean = np.where(inner, np.sin(samples * theta) / (samples * safe), 1.0) ** 2
    odd = 0.5 * (samples * np.cos(samples * theta) * safe - np.sin(samples * theta) * np.cos(theta))
    norm = samples * (samples**2 - 1) / 12
    first = (2.0 * theta) ** 2 * norm / samples  # of the series about zero frequency
    smear = np.where(inner, (odd / safe**2) ** 2 / (samples * norm), first)
    rpe = np.where(inner, 1.0 - mean, first)
    table = {
        "ape": np.ones_like(theta),
        "mpe": mean,
        "rpe": rpe,
        "smear": smear,
        "jitter": np.maximum(rpe - smear, 0.0),
    }
    if separation is not None:
        table["pde"] = 2.0 * (1.0 - np.cos(2.0 * theta * separation)) * mean
    return table
