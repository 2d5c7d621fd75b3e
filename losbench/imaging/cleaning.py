"""A second look at the spots whose residual asks for it: bad pixels masked, neighbours flagged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats, Indices, Pixels
from losbench.imaging.flags import Cut, judged
from losbench.imaging.neighbours import (
    OF_PEAK,
    SURE,
    dark_in_the_middle,
    lopsided,
    one_sided,
    two_tops,
)
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import CentroidMethod, Estimate, Windows
from losbench.imaging.results import Measured, SpotFlag
from losbench.imaging.scrutiny import Looked, asks, filled, look_into
from losbench.imaging.stamps import RING, cut_stamps

__all__ = ["Scene", "captured", "look_again"]


_OUTLIER = 5.0  # scatters of the ring
_CHEAP = 0.8  # of what makes a neighbour, in a first look
_ON_THE_WAY = np.linspace(0.0, 1.0, 9)  # parts of the way of a window
_STRONG = 0.1  # of the peak, where no template tells more
_TOLD = SpotFlag.BAD_PIXEL | SpotFlag.NOT_CONVERGED  # of a spot that is measured anew


@dataclass(frozen=True)
class Scene:
    """Frames (F, H, W), from which of them each of M windows is, the centroid, the side of the
    square in the ring, and whether the background is that of the ring.
    """

    stack: NDArray[Any]
    frame: Indices
    method: CentroidMethod
    ring: int
    tilts: bool


def look_again(
    scene: Scene, cut: Cut, windows: Windows, fit: Estimate, result: Measured, settled: Bools
) -> None:
    """Mask what stands out of the spots that ask for it, measure those anew, and flag light of
    another spot, of the windows that have ``settled`` (M,); where the method has looked by itself,
    say so.
    """
    settled = settled & np.isfinite(result.xy).all(axis=1)
    if fit.n_bad is not None:
        result.n_bad[settled] += fit.n_bad[settled]
        result.flags[settled & (fit.n_bad > 0)] |= SpotFlag.BAD_PIXEL
        return
    some = _asking(scene, cut, windows, fit, settled, result.flags & SpotFlag.RING == 0)
    if some.size:
        _look_closely(scene, cut, windows, fit, result, some)
    height = cut.peak - cut.plane.level
    dark = dark_in_the_middle(windows.signal, fit.centroid, height, windows.noise)
    some = np.flatnonzero(settled & dark)
    if some.size:
        between = two_tops(windows.of(some), fit.centroid[some])
        result.flags[some[between]] |= SpotFlag.NEIGHBOUR


def _look_closely(
    scene: Scene, cut: Cut, windows: Windows, fit: Estimate, result: Measured, some: Indices
) -> None:
    """Mask what stands out of some of the windows, measure those anew, and flag other light."""
    part = replace(windows.of(some), start=fit.centroid[some], leave=windows.side / 3.0)
    looked = look_into(part, moves=not scene.method.template)
    bad = looked.n_bad > 0
    result.n_bad[some] += looked.n_bad
    result.flags[some[bad]] |= SpotFlag.BAD_PIXEL
    heals = bad & looked.sparse & scene.tilts  # what does not fit a background left on means little
    anew = bad if scene.method.template else heals
    if anew.any():
        where = some[anew]
        again = replace(part.of(anew), kept=looked.kept[anew])
        if not scene.method.template:  # a moment has no use for holes
            again = replace(part.of(anew), healed=filled(part, looked)[anew])
        cleaned = judged(
            scene.stack.shape[1:], windows.middle[where], cut.of(where), scene.method.measure(again)
        )
        cleaned.n_iter[:] += result.n_iter[where]
        cleaned.n_bad[:] = result.n_bad[where]
        cleaned.flags[:] |= result.flags[where] & _TOLD
        result.put(where, cleaned)
    if not scene.method.template:
        # Pixels side by side are light, which a moment cannot leave out.
        looked = looked.without(bad & ~looked.sparse)
    crowded = _crowded(scene, cut, part, looked, some)
    result.flags[some[crowded]] |= SpotFlag.NEIGHBOUR


def _asking(
    scene: Scene, cut: Cut, windows: Windows, fit: Estimate, settled: Bools, lean: Bools
) -> Indices:
    """Which windows ask for a close look, by themselves or by a ring without the spot's own light
    (``lean``).
    """
    height = cut.peak - cut.plane.level
    found = settled & asks(windows, fit)
    # Pixels below 1 % of the peak may be wings of the spot, and make no neighbour worth a flag.
    least = np.maximum(_OUTLIER * cut.plane.scatter, 0.5 * OF_PEAK * height)
    outlying = settled & lean & (cut.plane.outlier * cut.plane.scatter > least)
    rest = np.flatnonzero(outlying & ~found)
    if rest.size:
        # One pixel that stands out is no neighbour, and a template would cost more.
        stamps = _stamps(scene, cut, windows.middle[rest], rest)
        beside = one_sided(
            np.nan_to_num(stamps),
            np.isfinite(stamps).astype(stamps.dtype),
            windows.noise.of(rest),
            fit.centroid[rest],
            windows.side,
            sure=_CHEAP,
            of_peak=_CHEAP * OF_PEAK,
        )
        found[rest[beside]] = True
    return np.flatnonzero(found)


def _crowded(scene: Scene, cut: Cut, part: Windows, looked: Looked, some: Indices) -> Bools:
    """Whether window and ring of some of the windows show light of another spot."""
    stamps = _stamps(scene, cut, part.middle, some)
    near = stamps.shape[1] // 2 - part.side // 2 - 1
    kept = np.isfinite(stamps).astype(stamps.dtype)
    kept[:, near:-near, near:-near] *= looked.kept
    kept[:, near:-near] *= ~looked.lines.all(axis=2, keepdims=True)
    kept[:, :, near:-near] *= ~looked.lines.all(axis=1, keepdims=True)
    stamps = np.nan_to_num(stamps)
    found = lopsided(stamps, kept, part.noise, looked.fit) & looked.fits
    # A template that is drawn to other light, or is no likeness, tells nothing of it.
    lost = ~looked.fits
    if lost.any():
        light, seen, centre = stamps[lost], kept[lost], part.start[lost]
        # The top of a sharp spot may well be all in one pixel.
        found[lost] = one_sided(
            light, seen, part.noise.of(lost), centre, part.side, of_peak=_STRONG, lone=None
        )
    return found


def captured(
    stack: NDArray[Any], frame: Indices, start: Floats, now: Floats, noise: PixelNoise
) -> Bools:
    """Whether windows that strayed from (M, 2) to (M, 2), frame pixels, have left a spot behind:
    the mean of 3 x 3 pixels at the start, and a dip on the way that is surely darker.
    """
    way = start + _ON_THE_WAY[:, None, None] * (now - start)
    at = np.rint(way).astype(np.intp).clip(0, np.array(stack.shape[:0:-1]) - 1)
    which = np.tile(frame, len(way))
    stamps = cut_stamps(stack, which, at.reshape(-1, 2), 1).reshape(*at.shape[:2], 9)
    with np.errstate(invalid="ignore"):
        light = stamps.mean(axis=2, dtype=np.float64)
        drop = light[0] - light.min(axis=0)
        error = np.sqrt(np.maximum(noise.floor + noise.per_dn * drop, 0.0) * 2.0 / 9.0)
        left: Bools = drop > SURE * error
    return left


def _stamps(scene: Scene, cut: Cut, middle: Indices, some: Indices) -> Pixels:
    """Window and ring (K, T, T) of some of the windows, without background; NaN where not read."""
    stamps = cut_stamps(scene.stack, scene.frame[some], middle, scene.ring // 2 + RING)
    return cut.plane.of(some).off(stamps)
