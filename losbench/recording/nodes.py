"""Spots followed through frames spread over a recording, its nodes, from each to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self

import numpy as np

from losbench.arrays import Bools, Floats, Indices, Ints, Pixels
from losbench.imaging.auto import AutoCentroid
from losbench.imaging.background import Background
from losbench.imaging.centroid import centroid
from losbench.imaging.eiwa import EIWA
from losbench.imaging.empirical import Empirical
from losbench.imaging.noise import Gain, step_of
from losbench.imaging.places import evenly, in_frame
from losbench.imaging.protocols import CentroidMethod
from losbench.imaging.results import Centroids, SpotFlag
from losbench.imaging.sizes import window_in_first
from losbench.imaging.stamps import RING, cut_stamps
from losbench.recording.acquire import Known, elsewhere, strangers
from losbench.recording.bands import Bands
from losbench.recording.frames.protocol import Spans
from losbench.recording.readers import Recording
from losbench.recording.stamps import Block, Stamp

__all__ = [
    "Nodes",
    "is_open",
    "median_light",
    "places_side_by_side",
    "side_by_side",
    "sides_of",
    "through",
]

_TOGETHER, _BYTES = 16, 2**26  # nodes in memory at a time: so many, or as many as fit
_MOST = 64  # nodes that are looked at closely
_KEPT = 2**25  # pixels that are kept of them
_MARGIN = 2  # pixels, in which a window finds its spot


@dataclass(frozen=True, eq=False)
class Nodes:
    """What K nodes show of n spots.

    Attributes
    ----------
    path : (K, n, 2) array, pixels of the stamp
        Where the spots are; NaN where one was not seen.
    flux : (K, n) array, DN
        Their light, NaN where one was not seen, or only found again elsewhere.
    method : CentroidMethod
        With its window, unless no node could be read.
    strangers : (m, 2) array, pixels of the stamp
        What else stood in the first that could be read.
    reach : int, pixels
        From the middle of the squares in ``close`` to their sides.
    close : dict of int to array
        Squares around the spots, `side_by_side`, of up to 64 nodes, by their place among all.
    """

    path: Floats
    flux: Floats
    method: CentroidMethod
    strangers: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    reach: int = 0
    close: dict[int, Pixels] = field(default_factory=dict)


def through(
    recording: Recording,
    stamp: Stamp,
    frames: Ints,
    start: Floats,
    method: CentroidMethod,
    background: Background,
) -> Nodes:
    """Follow spots from their places (n, 2) in the first of some frames (K,) through all of them.

    Nodes are measured together as long as each shows every spot within reach of where it was before
    them. In one that does not, the spots are looked for from where they were in the last before it,
    and a lost one in the whole frame.
    """
    count = (len(frames), len(start))
    found = Nodes(np.full((*count, 2), np.nan), np.full(count, np.nan), method)
    for k in frames.tolist():
        block = stamp.read(k, k + 1, skip=recording.skip_unreadable)
        if block.good[0]:
            walk = _Walk.from_first(recording, stamp, frames, start, found, background, block)
            break
    else:
        return found
    node, last, many = 0, start, 1
    while node < len(frames):
        done, last = walk.together(node, many, last) if many > 1 else walk.alone(node, last)
        # Where few keep to their places, few are measured in vain.
        node, many = node + done, min(max(1, 2 * done), _TOGETHER)
    return walk.found


@dataclass(frozen=True, eq=False)
class _Walk:
    """How nodes are looked at, and what has been found, which is filled in place."""

    recording: Recording
    stamp: Stamp
    frames: Ints
    start: Floats
    sides: Ints
    ring: int | None  # side of what the background is taken from
    looked: Indices
    see: Callable[..., Centroids]
    found: Nodes

    @classmethod
    def from_first(
        cls,
        recording: Recording,
        stamp: Stamp,
        frames: Ints,
        start: Floats,
        found: Nodes,
        background: Background,
        block: Block,
    ) -> Self:
        """Settle windows and the rest on the first node that can be read."""
        image, method = block.frames[0], found.method
        method = replace(method, window=method.window or window_in_first(image, start))
        sides = sides_of(method, len(start))
        reach = max(int(sides.max()), background.side or 0) // 2 + RING + _MARGIN
        room = max(3, _KEPT // (len(start) * (2 * reach + 1) ** 2))
        see = partial(
            centroid,
            method=_on_the_way(method, sides),
            background=background,
            detector=recording.detector or Gain(0.0, np.inf, step_of(block.frames)),
            full_scale_dn=recording.full_scale_dn,
        )
        others = strangers(image, start, sides)
        found = replace(found, method=method, strangers=others, reach=reach)
        looked = evenly(len(frames), min(_MOST, room))
        return cls(recording, stamp, frames, start, sides, background.side, looked, see, found)

    def alone(self, node: int, last: Floats) -> tuple[int, Floats]:
        """Look for the spots in the whole of one node, from their places (n, 2) in those before;
        return that it is done, and the places from then on.
        """
        frames, good = self._read(self.frames[node : node + 1], None)
        if not good[0]:
            return 1, last
        xy, flux = _seen(self.see(frames, last))
        lost = np.isnan(xy[0, :, 0])
        if lost.any() and node:
            at = np.where(lost[:, None], last, xy[0])
            known = Known(
                self.start, self.sides, median_light(self.found.flux[:node]), self.found.strangers
            )
            again = elsewhere(frames, at, lost, known, self.see)
            if again is not None:
                xy = np.where(np.isfinite(again.xy), again.xy, xy)
        self._keep(node, xy[0], flux[0], frames, xy[0])
        return 1, np.where(np.isnan(xy[0]), last, xy[0])

    def together(self, node: int, many: int, last: Floats) -> tuple[int, Floats]:
        """Measure up to ``many`` nodes from one place (n, 2) of the spots, in the rows around it,
        as far as they are found near it; return how many are done, and the places in the last.
        """
        rows = self.stamp.shape[0]
        bands = Bands.around(last[None], int(self.sides.max()), self.ring, rows)
        read = rows if bands.spans is None else sum(end - begin for begin, end in bands.spans)
        fit = _BYTES // (read * self.stamp.shape[1] * self.stamp.frames.dtype.itemsize)
        frames, good = self._read(self.frames[node : node + min(many, max(1, fit))], bands.spans)
        reach, done = np.maximum(2, self.sides // 4) - 0.5, 0
        while done < len(frames) and bands.hold(last):
            xy, flux = _seen(self.see(frames[done:], bands.within(last)))
            xy = bands.outside(xy)
            near = (np.abs(xy - last).max(axis=2) < reach).all(axis=1) | ~good[done:]
            more = len(near) if near.all() else int(near.argmin())
            if not more:
                break
            for k in np.flatnonzero(good[done : done + more]).tolist():
                at = bands.within(np.rint(xy[k]))
                self._keep(node + done + k, xy[k], flux[k], frames[done + k : done + k + 1], at)
                last = xy[k]
            done += more
        return done, last

    def _keep(self, node: int, xy: Floats, flux: Floats, frames: Pixels, at: Floats) -> None:
        """Keep what a node shows; spots are at places (n, 2) of the rows that were read of it."""
        self.found.path[node], self.found.flux[node] = xy, flux
        if node in self.looked:
            self.found.close[node] = side_by_side(frames, at, self.found.reach)

    def _read(self, numbers: Ints, spans: Spans | None) -> tuple[Pixels, Bools]:
        """Return frames of these numbers, or rows of them, and which could be read."""
        skip = self.recording.skip_unreadable
        blocks = [self.stamp.read(k, k + 1, skip=skip, spans=spans) for k in numbers.tolist()]
        good = np.array([block.good[0] for block in blocks])
        if len(blocks) == 1:
            return blocks[0].frames, good
        return np.concatenate([block.frames for block in blocks]), good


def _seen(seen: Centroids) -> tuple[Floats, Floats]:
    """Places (F, n, 2) and light (F, n) of the spots, NaN where a spot is lost."""
    lost = (seen.flags & SpotFlag.NOT_CONVERGED > 0) | np.isnan(seen.xy[..., 0])
    return np.where(lost[..., None], np.nan, seen.xy), np.where(lost, np.nan, seen.flux)


def median_light(flux: Floats) -> Floats:
    """Median light (n,) of the frames (K, n) that show each spot, NaN where none does."""
    seen = np.isfinite(flux).any(axis=0)
    return np.where(seen, np.nanmedian(np.where(seen, flux, 0.0), axis=0), np.nan)


def is_open(method: CentroidMethod) -> bool:
    """Whether a method waits to be chosen, or its template, or the width of that, to be found."""
    if isinstance(method, Empirical):
        return method.shape is None
    return isinstance(method, AutoCentroid) or (method.template and method.width is None)


def sides_of(method: CentroidMethod, count: int) -> Ints:
    """Side of the window of each spot, 0 where it is not known yet."""
    return np.broadcast_to(np.asarray(method.window or 0, dtype=np.int64), count)


def _on_the_way(method: CentroidMethod, sides: Ints) -> CentroidMethod:
    """What follows the spots, before what is left open in the method is known."""
    if isinstance(method, AutoCentroid) or (isinstance(method, Empirical) and is_open(method)):
        return EIWA(method.window, centre=method.centre, hot_pixel_gate=method.hot_pixel_gate)
    if not is_open(method):
        return method
    return replace(method, width=np.repeat(sides[:, None] / 6.0, 2, axis=1))


def side_by_side(frames: Pixels, places: Floats, reach: int) -> Pixels:
    """Squares around the spots (n, 2) of one frame (1, rows, columns), cut out and laid side by
    side, (2 reach + 1, n (2 reach + 1)); NaN beyond the frame, and for a spot that is missing.
    """
    _, spot, middle = in_frame(frames, places[None])
    side = 2 * reach + 1
    row = np.full((len(places), side, side), np.nan, np.result_type(frames.dtype, np.float32))
    row[spot] = cut_stamps(frames, np.zeros(len(spot), np.intp), middle, reach)
    return row.swapaxes(0, 1).reshape(side, -1)


def places_side_by_side(path: Floats, reach: int) -> Floats:
    """Where spots (K, n, 2) are in `side_by_side`."""
    corner = np.rint(path) - reach
    corner[..., 0] -= (2 * reach + 1) * np.arange(path.shape[1])
    return path - corner
