"""When FITS frames were taken: DATE-OBS on the clock of TIMESYS, or an axis of time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from losbench.logs import FrameTimes, increasing, times_from_utc
from losbench.recording.frames.handles import opened
from losbench.recording.frames.plane import Plane, hdu_list
from losbench.recording.frames.protocol import decoding, quietly

__all__ = ["axis_times", "dated"]

_UTC = ("UTC", "UT", "UT1", "GMT")  # UT1 stays within 0.9 s of UTC
_OTHER_CLOCKS = ("TT", "TDT", "ET", "TDB", "TAI", "IAT", "GPS", "TCG", "TCB")
_SAME = {"TDT": "tt", "ET": "tt", "IAT": "tai"}
_GPS_BEHIND_TAI_S = 19.0


def dated(dates: list[str | None], clock: str, source: str) -> FrameTimes | None:
    """Return times from DATE-OBS, one for each frame, on the clock that TIMESYS names."""
    if not any(dates):
        return None
    name = f"DATE-OBS of {source}"
    if clock not in ("", *_UTC, *_OTHER_CLOCKS):
        raise ValueError(f"TIMESYS of {source} must be a clock such as UTC, TT or TAI, got {clock}")
    return increasing(times_from_utc([d and _in_utc(d, clock) for d in dates], name), name)


def _in_utc(date: str, clock: str) -> str:
    """Return an instant of another clock as UTC."""
    if clock in ("", *_UTC):
        return date
    from astropy.time import Time, TimeDelta

    with decoding(f"DATE-OBS {date!r}"), quietly():
        scale = "tai" if clock == "GPS" else _SAME.get(clock, clock.lower())
        at = Time(date.rstrip("Z"), scale=scale)
        if clock == "GPS":
            at = at + TimeDelta(_GPS_BEHIND_TAI_S, format="sec")
        return f"{at.utc.to_value('isot', subfmt='date_hms')}Z"


def axis_times(path: Path, plane: Plane, n_frames: int) -> FrameTimes | None:
    """Return the times of a cube whose third axis is time in seconds."""
    with decoding(path.name), quietly():
        header = opened(hdu_list, path)[plane.index].header
        kind, unit = (str(header.get(key, "")).strip() for key in ("CTYPE3", "CUNIT3"))
        if kind.upper() != "TIME" or unit not in ("", "s"):
            return None
        steps = np.arange(n_frames) + 1.0 - float(header.get("CRPIX3", 1.0))
        step_s = float(header.get("CDELT3", 1.0))
        seconds = float(header.get("CRVAL3", 0.0)) + steps * step_s
    return increasing(FrameTimes(seconds.astype(np.float64)), f"axis 3 of {path.name}")
