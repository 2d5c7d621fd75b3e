"""A second look at the spots whose residual asks for it: bad pixels masked, neighbours flagged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Indices, Pixels
from losbench.imaging.flags import Cut, judged
from losbench.imaging.protocols import CentroidMethod, Estimate, Windows
from losbench.imaging.results import Measured, SpotFlag
from losbench.imaging.scrutiny import OF_PEAK, Looked, asks, look_into, lopsided, may_be_lopsided
from losbench.imaging.stamps import RING, cut_stamps

__all__ = ["Scene", "look_again"]


_OUTLIER = 5.0  # scatters of the ring
_TOLD = SpotFlag.BAD_PIXEL | SpotFlag.NOT_CONVERGED  # of a spot that is measured anew


@dataclass(frozen=True)
class Scene:
    """Frames (F, H, W), from which of them each of M windows is, the centroid, and the side of the
    square in the ring.
    """

    stack: NDArray[Any]
    frame: Indices
    method: CentroidMethod
    ring: int


def look_again(
    scene: Scene, cut: Cut, windows: Windows, fit: Estimate, result: Measured, settled: Bools
) -> None:
    """Mask what stands out of the spots that ask for it, measure those anew, and flag light of
    another spot, of the windows that have ``settled`` (M,).
    """
    settled = settled & np.isfinite(result.xy).all(axis=1)
    # Pixels below 1 % of the peak may be wings of the spot, and make no neighbour worth a flag.
    height = cut.peak - cut.plane.level
    least = np.maximum(_OUTLIER * cut.plane.scatter, 0.5 * OF_PEAK * height)
    outlying = (cut.plane.outlier * cut.plane.scatter > least) & (result.flags & SpotFlag.RING == 0)
    asking = settled & asks(windows, fit)
    rest = np.flatnonzero(settled & outlying & ~asking)
    if rest.size:
        stamps = _stamps(scene, cut, windows.middle[rest], rest)
        centre, noise = fit.centroid[rest], cut.noise.of(rest)
        asking[rest[may_be_lopsided(stamps, windows.side, centre, noise)]] = True
    some = np.flatnonzero(asking)
    if not some.size:
        return
    part = replace(windows.of(some), start=fit.centroid[some], leave=windows.side / 3.0)
    looked = look_into(part)
    bad = looked.n_bad > 0
    result.n_bad[some] += looked.n_bad
    result.flags[some[bad]] |= SpotFlag.BAD_PIXEL
    if bad.any() and scene.method.template:
        where = some[bad]
        again = replace(part.of(bad), kept=looked.kept[bad])
        cleaned = judged(
            scene.stack.shape[1:], windows.middle[where], cut.of(where), scene.method.measure(again)
        )
        cleaned.n_iter[:] += result.n_iter[where]
        cleaned.n_bad[:] = result.n_bad[where]
        cleaned.flags[:] |= result.flags[where] & _TOLD
        result.put(where, cleaned)
    crowded = _crowded(scene, cut, part, looked, some)
    result.flags[some[crowded]] |= SpotFlag.NEIGHBOUR


def _crowded(scene: Scene, cut: Cut, part: Windows, looked: Looked, some: Indices) -> Bools:
    """Whether window and ring of some of the windows show light of another spot."""
    stamps = _stamps(scene, cut, part.middle, some)
    near = stamps.shape[1] // 2 - part.side // 2 - 1
    kept = np.isfinite(stamps).astype(stamps.dtype)
    kept[:, near:-near, near:-near] *= looked.kept
    kept[:, near:-near] *= ~looked.lines.all(axis=2, keepdims=True)
    kept[:, :, near:-near] *= ~looked.lines.all(axis=1, keepdims=True)
    return lopsided(np.nan_to_num(stamps), kept, part, looked.fit) & looked.fit.converged


def _stamps(scene: Scene, cut: Cut, middle: Indices, some: Indices) -> Pixels:
    """Window and ring (K, T, T) of some of the windows, without background; NaN where not read."""
    stamps = cut_stamps(scene.stack, scene.frame[some], middle, scene.ring // 2 + RING)
    return cut.plane.of(some).off(stamps)
