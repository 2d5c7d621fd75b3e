"""What is fixed before a recording is measured, by frames spread over it: where its spots are to
be expected, and how each is measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from losbench.arrays import Floats, Ints, Pixels
from losbench.imaging.auto import AutoCentroid
from losbench.imaging.background import Background
from losbench.imaging.centroid import centroid
from losbench.imaging.detector import Detector
from losbench.imaging.eiwa import EIWA
from losbench.imaging.empirical import Empirical
from losbench.imaging.gain import recording_gain
from losbench.imaging.groups import grouped
from losbench.imaging.noise import Gain, step_of
from losbench.imaging.places import evenly, in_frame
from losbench.imaging.protocols import CentroidMethod
from losbench.imaging.results import SpotFlag
from losbench.imaging.sizes import window_in_first
from losbench.imaging.stamps import RING, cut_stamps
from losbench.recording.acquire import Known, elsewhere, strangers
from losbench.recording.contradiction import contradictions
from losbench.recording.readers import Recording
from losbench.recording.stamps import Stamp

__all__ = ["Survey", "survey"]


_UNKNOWN = Gain(0.0, np.inf)
_EVERY = 64  # frames from one node of the path to the next, in a long recording
_MOST = 64  # frames that are looked at closely
_KEPT = 2**25  # pixels that are kept of them
_WITNESSES = 3  # frames
_MARGIN = 2  # pixels, in which a window finds its spot
_CLIPPED = 0.08  # of the readings at the lowest: no noise does that


@dataclass(frozen=True, eq=False)
class Survey:
    """What holds for every frame of a recording, whatever part of it is measured where.

    Attributes
    ----------
    frames : (K,) array of int
        Numbers of the frames that were looked at, from the first to the last.
    path : (K, n, 2) array, pixels of the stamp
        Where the spots are in them; NaN where one was not seen.
    start : (n, 2) array, pixels of the stamp
        Where they were looked for in the first.
    method : CentroidMethod
        With its window, and the width or the shape of its template.
    noise : Detector or Gain
        What predicted errors rest on: the detector, or what the frames tell.
    found : Gain
        What the frames tell, also beside a detector.
    doubts : tuple of str
        Where they contradict it.
    reason : str
        Why this method, where `AutoCentroid` chose it.
    flux : (n,) array, DN
        Median light of each spot.
    strangers : (m, 2) array, pixels of the stamp
        What else stood in the first frame.
    black : float
        Share of the pixels around the spots at the lowest reading, where black is clipped; or 0.
    """

    frames: Ints
    path: Floats
    start: Floats
    method: CentroidMethod
    noise: Detector | Gain = _UNKNOWN
    found: Gain = _UNKNOWN
    doubts: tuple[str, ...] = ()
    reason: str = ""
    flux: Floats = field(default_factory=lambda: np.array(np.nan))
    strangers: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    black: float = 0.0

    @property
    def known(self) -> Known:
        """What a spot that is lost can be told by."""
        return Known(self.start, self.sides, self.flux, self.strangers)

    @property
    def sides(self) -> Ints:
        """Side of the window (n,) of each spot; 0 where no frame could be read."""
        return _sides(self.method, len(self.start))

    def predicted(self, first: int, last: int) -> Floats:
        """Where the spots are to be expected in frames ``first`` to ``last`` (excluded), (F, n, 2):
        on straight lines between where they were seen.
        """
        wanted = np.arange(first, last)
        expected = np.empty((len(wanted), *self.start.shape))
        for spot, start in enumerate(self.start):
            seen = np.isfinite(self.path[:, spot, 0])
            for axis in range(2):
                expected[:, spot, axis] = (
                    np.interp(wanted, self.frames[seen], self.path[seen, spot, axis])
                    if seen.any()
                    else start[axis]
                )
        return expected


def survey(
    recording: Recording,
    stamp: Stamp,
    start: Floats,
    method: CentroidMethod,
    background: Background,
) -> Survey:
    """Follow the spots of a stamp through frames spread over the recording, and fix what is left
    open in the method: window, and width or shape of a template, or the method itself.

    Parameters
    ----------
    recording, stamp
        Where the frames come from.
    start : (n, 2) array, pixels of the stamp
        Where the spots are in the first frame.
    method, background
        As for `centroid`.
    """
    n = recording.n_frames
    nodes = evenly(n, max(_MOST, -(-(n - 1) // _EVERY) + 1))
    how = replace(method, centre=method.centre or "peak")
    path = np.full((len(nodes), *start.shape), np.nan)
    flux, others = np.full(path.shape[:2], np.nan), np.zeros((0, 2))
    close: dict[int, Pixels] = {}
    last, look, reach, looked = start, how, 0, np.array([], dtype=np.intp)
    sides = _sides(how, len(start))
    for node, k in enumerate(nodes.tolist()):
        read = stamp.read(k, k + 1, skip=recording.skip_unreadable)
        if not read.good[0]:
            continue
        if not reach:
            how = replace(how, window=how.window or window_in_first(read.frames[0], last))
            sides = _sides(how, len(start))
            look = _on_the_way(how, sides)
            others = strangers(read.frames[0], last, sides)
            reach = max(int(sides.max()), background.side or 0) // 2 + RING + _MARGIN
            room = max(3, _KEPT // (len(start) * (2 * reach + 1) ** 2))
            looked = evenly(len(nodes), min(_MOST, room))
        see = partial(
            centroid,
            method=look,
            background=background,
            detector=recording.detector or Gain(0.0, np.inf, step_of(read.frames)),
            full_scale_dn=recording.full_scale_dn,
        )
        seen = see(read.frames, last)
        lost = (seen.flags[0] & SpotFlag.NOT_CONVERGED > 0) | np.isnan(seen.xy[0, :, 0])
        path[node] = np.where(lost[:, None], np.nan, seen.xy[0])
        flux[node] = np.where(lost, np.nan, seen.flux[0])
        if lost.any() and node:
            at = np.where(lost[:, None], last, path[node])
            light = _median(flux[:node])
            again = elsewhere(read.frames, at, lost, Known(start, sides, light, others), see)
            if again is not None:
                path[node] = np.where(np.isfinite(again.xy[0]), again.xy[0], path[node])
        last = np.where(np.isnan(path[node]), last, path[node])
        if node in looked:
            close[node] = side_by_side(read.frames, path[node], reach)
    found, black = _UNKNOWN, 0.0
    if close:
        stack = np.stack(list(close.values()))
        at = places_side_by_side(path[list(close)], reach)
        still = replace(how, centre="start")
        groups = grouped(stack, at, sides, still, background, None, recording.full_scale_dn)
        found, black = recording_gain(groups, stack), _clipped_black(stack)
    known = recording.detector
    noise = found if known is None else known
    # What one frame or two leave of a Gaussian is no witness: a shape hardly off it would testify.
    doubts = [] if known is None or len(close) < _WITNESSES else contradictions(known, found)
    reason = ""
    if _open(how) and close:
        seen = centroid(
            stack,
            at,
            method=still,
            background=background,
            detector=noise,
            full_scale_dn=recording.full_scale_dn,
        )
        how, reason = replace(seen.method or still, centre=look.centre), seen.reason
        if seen.width_px is not None:
            how = replace(how, width=seen.width_px)
    return Survey(
        nodes,
        path,
        start,
        how,
        noise,
        found,
        tuple(doubts),
        reason,
        _median(flux),
        others,
        black,
    )


def _median(flux: Floats) -> Floats:
    """Median light (n,) of the frames (K, n) that show each spot, NaN where none does."""
    seen = np.isfinite(flux).any(axis=0)
    return np.where(seen, np.nanmedian(np.where(seen, flux, 0.0), axis=0), np.nan)


def _open(method: CentroidMethod) -> bool:
    if isinstance(method, Empirical):
        return method.shape is None
    return isinstance(method, AutoCentroid) or (method.template and method.width is None)


def _clipped_black(stack: Pixels) -> float:
    """Share of readings at the lowest, if that is more than the next above it has; else 0."""
    readings = stack[np.isfinite(stack)]
    lowest = readings == readings.min() if readings.size else readings > 0
    above = readings[~lowest]
    share = float(lowest.mean()) if above.size else 0.0
    next_above = float((above == above.min()).mean()) * (1.0 - share) if above.size else 1.0
    return share if share >= _CLIPPED and share > next_above else 0.0


def _sides(method: CentroidMethod, count: int) -> Ints:
    return np.broadcast_to(np.asarray(method.window or 0, dtype=np.int64), count)


def _on_the_way(method: CentroidMethod, sides: Ints) -> CentroidMethod:
    """What follows the spots, before what is left open in the method is known."""
    if isinstance(method, AutoCentroid) or (isinstance(method, Empirical) and _open(method)):
        return EIWA(method.window, centre=method.centre, hot_pixel_gate=method.hot_pixel_gate)
    if not _open(method):
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
