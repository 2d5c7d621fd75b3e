"""What a template that was made from the spots themselves leaves over of their windows: bad pixels,
and light that is not like it.
"""

from __future__ import annotations

import numpy as np

from losbench.arrays import Bools, Floats, Pixels
from losbench.imaging.protocols import Windows
from losbench.imaging.scrutiny import lone_pixels, sure

__all__ = ["bad_pixels", "unlike"]


_WRONG = 0.03  # of its light that a template may be wrong by in every pixel, and in all
_TENTH = 0.1  # of the light of a window, where the noise of its light is not known
_SURE = 5.0  # errors


def bad_pixels(windows: Windows, light: Pixels, kept: Pixels | None) -> Bools:
    """Pixels (M, S, S) that stand out of the light (M, S, S), by themselves: by 5.5 errors, and
    half as much as the worst, from the median of what their 3 x 3 neighbours leave over.
    """
    noise, rest = windows.noise, windows.signal[:, 1:-1, 1:-1] - light
    above = np.maximum(light, 0)
    if kept is not None:
        rest = rest * kept
    variance = noise.floor.astype(light.dtype)[:, None, None] + (_WRONG * above) ** 2
    if noise.per_dn:
        variance += noise.per_dn * above
    else:  # where the noise of the light is not known, the spot itself tells it
        weight = above if kept is None else above * kept
        with np.errstate(divide="ignore", invalid="ignore"):
            told = ((rest**2 - noise.floor[:, None, None]) * weight).sum(axis=(1, 2))
            told = np.nan_to_num(told / (above * weight).sum(axis=(1, 2)))
        variance += np.maximum(told, 0.0)[:, None, None] * above
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = np.nan_to_num(rest / np.sqrt(variance), posinf=0.0, neginf=0.0)
    found = np.zeros(rest.shape, dtype=bool)
    some = np.flatnonzero((np.abs(rest) > sure(noise)).any(axis=(1, 2)))
    if some.size:
        around = np.pad(rest[some], ((0, 0), (1, 1), (1, 1)))
        found[some] = lone_pixels(around)[:, 1:-1, 1:-1]
    return found if kept is None else found & (kept > 0)


def unlike(windows: Windows, light: Pixels, kept: Pixels | None, own: Floats) -> Bools:
    """Whether windows (M,) hold light that is not like the light (M, S, S): by five errors and 3 %
    of it, pixel by pixel, or by five errors and a tenth of it in all.

    ``own`` (M,) is the variance of the light itself, in parts of that of a pixel.
    """
    noise, pixels = windows.noise, windows.signal[:, 1:-1, 1:-1]
    use = np.ones_like(pixels) if kept is None else kept
    variance = noise.floor[:, None, None] + noise.per_dn * np.maximum(light, 0.0)
    rest = (pixels - light) * use
    total, count = (pixels * use).sum(axis=(1, 2), dtype=np.float64), use.sum(axis=(1, 2))
    error = (variance * use).sum(axis=(1, 2)) + count**2 * noise.plane[:, 0]
    much: Bools = np.abs(rest.sum(axis=(1, 2), dtype=np.float64)) > _TENTH * np.abs(
        total
    ) + _SURE * np.sqrt(error)
    if not noise.per_dn:
        return much
    excess = (rest**2 - (1.0 + own)[:, None, None] * variance * use).sum(axis=(1, 2))
    chance = np.sqrt(2.0 * (variance**2 * use).sum(axis=(1, 2)))
    whole = (light**2 * use).sum(axis=(1, 2), dtype=np.float64)
    much |= (excess > _SURE * chance) & (excess > _WRONG**2 * whole)
    return much
