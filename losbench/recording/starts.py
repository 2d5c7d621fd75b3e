"""What a measurement begins with: a camera that fits, and spots that are given or found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import finite, shaped
from losbench.imaging.finder import Find
from losbench.optics.camera import Camera
from losbench.recording.readers import Recording
from losbench.recording.stamps import Stamp

__all__ = ["check_shape", "first_places"]


# Two spots of one brightness must not be numbered by their noise.
_FIND = Find(order="x")


def check_shape(recording: Recording, camera: Camera | None) -> None:
    """Raise ``ValueError`` unless whole frames have the shape of the camera."""
    whole = recording.stamps[0]
    if camera is None or len(recording.stamps) > 1:
        return
    shape = whole.whole or whole.shape
    if shape != camera.shape:
        raise ValueError(f"camera must have the shape of the frames, {shape}, got {camera.shape}")


def first_places(recording: Recording, spots: ArrayLike | Find | None) -> list[Floats]:
    """Return the first positions (n, 2) of each stamp, in its own pixels.

    ``spots`` are positions on the detector, how many to find, or how.

    Raises
    ------
    ValueError
        If positions lie outside the frame, none is found, or there is more than one stamp and
        positions or a number are given.
    """
    if len(recording.stamps) > 1:
        if not (spots is None or isinstance(spots, Find)):
            raise ValueError(
                "spots are for whole frames: a folder of pixel files has one spot in each"
            )
        one = replace(spots or _FIND, n=1)
        return [_found(recording, stamp, one) for stamp in recording.stamps]
    stamp = recording.stamps[0]
    if spots is None or isinstance(spots, Find):
        return [_found(recording, stamp, spots or _FIND)]
    if np.ndim(spots) == 0:
        return [_found(recording, stamp, replace(_FIND, n=spots))]  # type: ignore[arg-type]
    given = finite("spots", spots)
    shaped("spots", given, ("n", 2))
    local = given - np.array(stamp.origin_px)
    if not ((local >= -0.5) & (local <= np.array(stamp.shape[::-1]) - 0.5)).all():
        raise ValueError(
            f"spots must lie inside the {stamp.shape[0]}x{stamp.shape[1]} frame, got "
            f"{given.tolist()}"
        )
    return [local]


def _found(recording: Recording, stamp: Stamp, how: Find) -> Floats:
    for k in range(recording.n_frames):
        block = stamp.read(k, k + 1, skip=recording.skip_unreadable)
        if block.good[0]:
            found = how.find(block.frames[0])
            if not len(found):
                raise ValueError(
                    f"no spot stands out in the first frame of {stamp.name}: give spots, or look "
                    "at it"
                )
            return found
    raise ValueError(f"no frame of {recording.source} can be read")
