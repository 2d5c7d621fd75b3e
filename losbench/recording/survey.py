"""What is fixed before a recording is measured, by frames spread over it: where its spots are to
be expected, and how each is measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from losbench.arrays import Floats, Ints, Pixels
from losbench.imaging.background import Background
from losbench.imaging.centroid import centroid
from losbench.imaging.detector import Detector
from losbench.imaging.gain import recording_gain
from losbench.imaging.groups import grouped
from losbench.imaging.noise import Gain
from losbench.imaging.places import evenly
from losbench.imaging.protocols import CentroidMethod
from losbench.recording.acquire import Known
from losbench.recording.contradiction import contradictions
from losbench.recording.nodes import (
    is_open,
    median_light,
    places_side_by_side,
    sides_of,
    through,
)
from losbench.recording.readers import Recording
from losbench.recording.stamps import Stamp

__all__ = ["Survey", "survey"]


_UNKNOWN = Gain(0.0, np.inf)
_FEWEST = 64  # nodes of the path, or every frame
_EVERY = 64  # frames from one node of the path to the next, in a long recording
_WITNESSES = 3  # frames
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
        return sides_of(self.method, len(self.start))

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
    nodes = evenly(n, max(_FEWEST, -(-(n - 1) // _EVERY) + 1))
    eager = replace(method, centre=method.centre or "peak")
    on_way = through(recording, stamp, nodes, start, eager, background)
    path, how, close = on_way.path, on_way.method, on_way.close
    found, black = _UNKNOWN, 0.0
    if close:
        stack = np.stack(list(close.values()))
        at = places_side_by_side(path[list(close)], on_way.reach)
        still = replace(how, centre="start")
        sides = sides_of(how, len(start))
        groups = grouped(stack, at, sides, still, background, None, recording.full_scale_dn)
        found, black = recording_gain(groups, stack), _clipped_black(stack)
    known = recording.detector
    noise = found if known is None else known
    # What one frame or two leave of a Gaussian is no witness: a shape hardly off it would testify.
    doubts = [] if known is None or len(close) < _WITNESSES else contradictions(known, found)
    reason = ""
    if is_open(how) and close:
        seen = centroid(
            stack,
            at,
            method=still,
            background=background,
            detector=noise,
            full_scale_dn=recording.full_scale_dn,
        )
        how, reason = replace(seen.method or still, centre=how.centre), seen.reason
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
        median_light(on_way.flux),
        on_way.strangers,
        black,
    )


def _clipped_black(stack: Pixels) -> float:
    """Share of readings at the lowest, if that is more than the next above it has; else 0."""
    readings = stack[np.isfinite(stack)]
    lowest = readings == readings.min() if readings.size else readings > 0
    above = readings[~lowest]
    share = float(lowest.mean()) if above.size else 0.0
    next_above = float((above == above.min()).mean()) * (1.0 - share) if above.size else 1.0
    return share if share >= _CLIPPED and share > next_above else 0.0
