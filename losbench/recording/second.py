"""A second opinion: the same spots by another centroid, in some of the frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from losbench.imaging.background import Background
from losbench.imaging.centroid import centroid
from losbench.imaging.methods import as_method
from losbench.imaging.places import evenly
from losbench.imaging.protocols import CentroidMethod
from losbench.recording.measurement import Measurement
from losbench.recording.readers import Recording
from losbench.recording.table import measurement_table

__all__ = ["second_opinion"]


_BLOCK = 32  # frames


def second_opinion(
    recording: Recording,
    measured: Measurement,
    method: CentroidMethod | str,
    *,
    background: Background | str | float | None = "ring",
    most: int = 200,
) -> Measurement:
    """Measure up to ``most`` frames of a recording again, where its spots have been seen.

    Parameters
    ----------
    recording : Recording
    measured : Measurement
        Of that recording.
    method, background
        As for `centroid`.
    most : int
        Frames, evenly spread from the first to the last.

    Returns
    -------
    Measurement
        Without angles, and NaN in the frames that were left out: for `Measurement.belief`.
    """
    how = as_method(method, {})
    chosen = evenly(recording.n_frames, most)
    xy, sigma = np.full_like(measured.xy_px, np.nan), np.full_like(measured.xy_px, np.nan)
    flags = np.zeros_like(measured.flags)
    spot = 0
    for stamp, survey in zip(recording.stamps, measured.surveys, strict=True):
        count = measured.xy_px.shape[1] if len(recording.stamps) == 1 else 1
        of_stamp, origin = slice(spot, spot + count), np.array(stamp.origin_px)
        for first in range(0, len(chosen), _BLOCK):
            some = chosen[first : first + _BLOCK]
            read = [stamp.read(k, k + 1, skip=True) for k in some.tolist()]
            found = centroid(
                np.concatenate([block.frames for block in read]),
                measured.xy_px[some, of_stamp] - origin,
                method=how if how.window else replace(how, window=survey.method.window),
                background=background,
                detector=survey.noise,
                full_scale_dn=recording.full_scale_dn,
            )
            good = np.concatenate([block.good for block in read])[:, None, None]
            xy[some, of_stamp] = np.where(good, found.xy + origin, np.nan)
            sigma[some, of_stamp] = np.where(good, found.sigma_xy, np.nan)
            flags[some, of_stamp] = found.flags
        spot += count
    shifts = xy - measured.reference_px
    return replace(
        measured,
        xy_px=xy,
        sigma_xy_px=sigma,
        flags=flags,
        shifts_px=shifts,
        sigma_shifts_px=sigma,
        attitude=None,
        table=measurement_table(recording, {}, xy, sigma, flags, shifts, None),
        notes=(),
    )
