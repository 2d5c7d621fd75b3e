"""What the reader of a measurement must know, a line each."""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats, Ints
from losbench.imaging.detector import Detector
from losbench.imaging.results import SpotFlag
from losbench.recording.track import Track

__all__ = ["notes_on_frames"]


_SKIPPED_NAMED = 3
_SILENT = (SpotFlag.EDGE, SpotFlag.TOO_FAINT, SpotFlag.MISSING)  # told by the spots that are lost


def notes_on_frames(track: Track, detector: Detector | None) -> list[str]:
    """Say what was skipped, lost and flagged, and whether the noise was known."""
    notes = [*_on_skipped(track.skipped, len(track.xy)), *_on_loss(track.xy, track.flags)]
    if detector is None:
        notes.append(
            "No detector was given: predicted errors leave out the shot noise of the spots, and "
            "are too small."
        )
    return notes


def _on_skipped(skipped: dict[int, str], n_frames: int) -> list[str]:
    """Say which frames could not be read, and why."""
    if not skipped:
        return []
    named = [f"frame {k} ({skipped[k]})" for k in sorted(skipped)[:_SKIPPED_NAMED]]
    more = [f"and {len(skipped) - len(named)} more"] if len(skipped) > len(named) else []
    return [
        f"{len(skipped)} of {n_frames} frames are left out as unreadable: "
        f"{', '.join([*named, *more])}."
    ]


def _on_loss(xy: Floats, flags: Ints) -> list[str]:
    """Say how often each spot is lost, and how many centroids carry which flag."""
    notes = []
    for spot in range(xy.shape[1]):
        lost = int(np.isnan(xy[:, spot]).any(axis=-1).sum())
        if lost:
            notes.append(f"Spot {spot + 1} is lost in {lost} of {len(xy)} frames.")
    for flag in (each for each in SpotFlag if each not in _SILENT):
        marked = int((flags & flag > 0).sum())
        if marked:
            notes.append(f"{marked} of {flags.size} centroids carry the flag {flag.name}.")
    return notes
