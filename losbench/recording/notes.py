"""What the reader of a measurement must know, a line each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from losbench.arrays import Floats, Ints
from losbench.imaging.detector import Detector
from losbench.imaging.results import SpotFlag
from losbench.recording.survey import Survey
from losbench.recording.track import Track

__all__ = ["notes_on_frames"]


_SKIPPED_NAMED = 3
_SILENT = (SpotFlag.EDGE, SpotFlag.TOO_FAINT, SpotFlag.MISSING)  # told by the spots that are lost


def notes_on_frames(track: Track, surveys: Sequence[Survey]) -> list[str]:
    """Say what was skipped, lost and flagged, and what the predicted errors rest on."""
    return [
        *_on_skipped(track.skipped, len(track.xy)),
        *_on_loss(track.xy, track.flags),
        *_on_choice(surveys),
        *_on_black(surveys),
        *_on_noise(surveys),
    ]


def _on_choice(surveys: Sequence[Survey]) -> list[str]:
    """Say which centroid was chosen and why, where that was left to the frames."""
    reasons = [survey.reason for survey in surveys]
    if not any(reasons):
        return []
    if len(reasons) == 1:
        return [f"Centroids by {reasons[0]}."]
    stamps: dict[str, list[str]] = {}
    for k, reason in enumerate(reasons, 1):
        if reason:
            stamps.setdefault(reason.partition(":")[0], []).append(str(k))
    each = (
        f"{method} (stamp{'s' * (len(those) > 1)} {', '.join(those)})"
        for method, those in stamps.items()
    )
    return [f"Centroids by {'; '.join(each)}."]


def _on_black(surveys: Sequence[Survey]) -> list[str]:
    """Say where black is clipped."""
    black = max(survey.black for survey in surveys)
    if not black:
        return []
    return [
        f"{black:.0%} of the pixels around the spots stand at the lowest reading: black is "
        "clipped, and levels by the ring are too high."
    ]


def _on_noise(surveys: Sequence[Survey]) -> list[str]:
    """Say where the noise comes from, and where a detector and the frames disagree."""
    given = surveys[0].noise
    if isinstance(given, Detector):
        said = (
            f"Predicted errors rest on the detector: {given.gain_e_per_dn:.4g} e-/DN, "
            f"{given.read_noise_e:.4g} e- read noise."
        )
        return [said, *_against_detector(surveys)]
    found = [survey.found for survey in surveys if survey.found.known]
    notes = []
    if len(found) < len(surveys):
        of = "" if not found else f" of {len(surveys) - len(found)} of {len(surveys)} stamps"
        notes.append(
            f"No detector was given, and the frames do not tell the noise of bright pixels: "
            f"predicted errors{of} leave out the shot noise of the spots. They are lower bounds, "
            "and flagged LOWER_BOUND."
        )
    if found:
        told = sorted(found, key=lambda gain: gain.per_dn)[len(found) // 2]
        most = "" if len(found) == 1 else f", the median of {len(found)} stamps"
        scatter = "" if told.curve is None else f" and {np.sqrt(told.curve.floor_dn2):.3g} DN rms"
        notes.append(
            f"No detector was given: predicted errors rest on the noise of the frames, "
            f"{told.per_dn:.3g} +- {told.std_error:.2g} DN of variance per DN of signal{most}"
            f"{scatter} around the spots."
        )
    if any(gain.coarse for gain in found):
        notes.append(
            "The noise is below half a step of the readings: predicted errors are too large."
        )
    return notes


def _against_detector(surveys: Sequence[Survey]) -> list[str]:
    """What speaks against the detector: of several stamps the first one's, and how many there
    are.
    """
    doubted = [k for k, survey in enumerate(surveys) if survey.doubts]
    if not doubted:
        return []
    first = surveys[doubted[0]].doubts
    if len({doubt for survey in surveys for doubt in survey.doubts}) <= len(first):
        return list(first)
    return [
        *first,
        f"That is stamp {doubted[0] + 1}; the frames of {len(doubted)} of {len(surveys)} stamps "
        "contradict the detector, each by numbers of its own.",
    ]


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
