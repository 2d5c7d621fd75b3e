"""The pointing metrics of a measurement's angles."""

from __future__ import annotations

import numpy as np

from losbench.arrays import Floats
from losbench.pointing.performance import PointingMetrics, pointing_metrics
from losbench.recording.measurement import Measurement
from losbench.series import runs

__all__ = ["metrics_of"]

_FEWEST = 20  # frames with angles
_WINDOWS = 10  # of a record, where no length was asked for
_SHORTEST = 4  # frames


def metrics_of(measurement: Measurement, window_s: float | None = None) -> PointingMetrics | None:
    """Metrics over windows of ``window_s``, by default a tenth of the record; None where frames
    have no times, or hold too few angles.

    Raises
    ------
    ValueError
        If a window was asked for that does not fit.
    """
    t, angles = _timed_angles(measurement)
    if window_s is not None:
        if not t.size:
            raise ValueError("window_s needs angles over time: a camera, and frames with times")
        return pointing_metrics(angles, t, window_s)
    known = np.asarray(np.isfinite(angles).all(axis=1))
    if known.sum() < _FEWEST or not (np.diff(t) > 0).all():
        return None
    samples = max(t.size // _WINDOWS, _SHORTEST)
    if max(piece.stop - piece.start for piece in runs(t, known)) < samples:
        return None
    return pointing_metrics(angles, t, samples * float(np.median(np.diff(t))))


def _timed_angles(measurement: Measurement) -> tuple[Floats, Floats]:
    """Times (n,) and angles (n, 3) of the frames that have a time."""
    if measurement.attitude is None or "time_s" not in measurement.table:
        return np.empty(0), np.empty((0, 3))
    time_s = measurement.table["time_s"].to_numpy()
    timed = np.isfinite(time_s)
    return time_s[timed], measurement.attitude.angles[timed]
