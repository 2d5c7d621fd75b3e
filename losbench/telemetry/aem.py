"""Attitudes as a CCSDS Attitude Ephemeris Message (CCSDS 504.0-B-2), key-value notation."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from losbench.arrays import Floats
from losbench.checks import finite_or_nan, increasing, shaped
from losbench.pointing.starcamera.convention import Attitudes
from losbench.series import runs

if TYPE_CHECKING:
    from losbench.telemetry.report import PairReport

__all__ = ["AttitudeMessage", "aem_text"]


def aem_text(
    time_s: ArrayLike,
    quaternions: ArrayLike,
    *,
    start: np.datetime64,
    frame_a: str,
    frame_b: str,
    object_name: str,
    object_id: str,
    originator: str = "LOSBENCH",
    created: datetime | None = None,
) -> tuple[str, int]:
    """Return a message of attitudes with rates, and how many segments it has: a new one after each
    gap or missing sample.

    Parameters
    ----------
    time_s : (n,) array
        Seconds since ``start``, increasing.
    quaternions : (n, 4) array
        Scalar last, from frame A to frame B: the coordinates of a vector in B are those in A turned
        by the inverse of the rotation that carries the axes of A into those of B.
    start : numpy.datetime64
        UTC.
    frame_a, frame_b, object_name, object_id, originator : str
        As the message has them; frames and object are never guessed.
    created : datetime, optional
        Now unless given.

    Returns
    -------
    str, int
        The message, and how many segments it has.

    Raises
    ------
    ValueError
        If a name is missing, shapes do not fit, or no two samples stand together.

    Notes
    -----
    ATTITUDE_TYPE = QUATERNION/ANGVEL: Q1 Q2 Q3 QC, then the angular velocity of frame B relative to
    frame A in the axes of B, deg/s, the mean of the steps before and after.
    """
    t = increasing("time_s", time_s)
    q = finite_or_nan("quaternions", quaternions)
    shaped("quaternions", q, (t.size, 4), why="to match time_s")
    names = {
        "frame_a": frame_a,
        "frame_b": frame_b,
        "object_name": object_name,
        "object_id": object_id,
        "originator": originator,
    }
    for key, value in names.items():
        if not isinstance(value, str) or not value.strip():
            raise ValueError(f"{key} must be named in an attitude message, got {value!r}")
    whole = np.logical_and.reduce(np.isfinite(q), axis=1)
    pieces = [piece for piece in runs(t, whole) if piece.stop > piece.start + 1]
    if not pieces:
        raise ValueError("quaternions must hold two neighbouring samples for rates, got none")
    moment = created or datetime.now(UTC)
    lines = [
        "CCSDS_AEM_VERS = 2.0",
        f"CREATION_DATE = {moment:%Y-%m-%dT%H:%M:%S}",
        f"ORIGINATOR = {originator}",
    ]
    for piece in pieces:
        epochs = _epochs(start, t[piece])
        lines += [
            "",
            "META_START",
            f"OBJECT_NAME = {object_name}",
            f"OBJECT_ID = {object_id}",
            f"REF_FRAME_A = {frame_a}",
            f"REF_FRAME_B = {frame_b}",
            "TIME_SYSTEM = UTC",
            f"START_TIME = {epochs[0]}",
            f"STOP_TIME = {epochs[-1]}",
            "ATTITUDE_TYPE = QUATERNION/ANGVEL",
            "ANGVEL_FRAME = REF_FRAME_B",
            "META_STOP",
            "",
            "DATA_START",
        ]
        values = np.column_stack([q[piece], np.degrees(_rates(t[piece], q[piece]))])
        lines += [
            f"{epoch} " + " ".join(f"{value:.15g}" for value in row)
            for epoch, row in zip(epochs, values, strict=True)
        ]
        lines.append("DATA_STOP")
    return "\n".join(lines) + "\n", len(pieces)


@dataclass(frozen=True)
class AttitudeMessage:
    """What a message of a pair's corrected attitudes names.

    Parameters
    ----------
    frames : three of str
        Inertial frame, frame of the first head, frame of the second.
    satellite : two of str
        Name and identifier.
    """

    frames: tuple[str, str, str]
    satellite: tuple[str, str]

    def of(self, report: PairReport) -> dict[str, str]:
        """Return the messages of both heads by the name of their file, ``corrected-1.aem`` and
        ``corrected-2.aem``.

        Raises
        ------
        ValueError
            If the times are not UTC, no spots tell of a drift, or there are more than two heads.
        """
        telemetry = report.telemetry
        if report.others:
            raise ValueError("an attitude message is of two heads: name them with --heads")
        if telemetry.start is None:
            raise ValueError(
                "an attitude message needs times in UTC, but the telemetry has seconds"
            )
        if report.pair is None:
            raise ValueError(
                "an attitude message needs corrected attitudes: no spots tell of a drift"
            )
        messages = {}
        for k, head in enumerate(report.heads):
            read = Attitudes.read(report.pair.quaternions[k], telemetry.pair.convention)
            turned = read.stored if read.convention.to_inertial else read.stored.inv()
            q = turned.as_quat()
            q[read.missing] = np.nan
            messages[f"corrected-{head}.aem"], _ = aem_text(
                telemetry.pair.time_s,
                q,
                start=telemetry.start,
                frame_a=self.frames[0],
                frame_b=self.frames[1 + k],
                object_name=self.satellite[0],
                object_id=self.satellite[1],
            )
        return messages


def _rates(t: Floats, quaternions: Floats) -> Floats:
    """Angular velocities (n, 3) in the axes of frame B, rad/s."""
    turned = Rotation.from_quat(quaternions)
    steps = (turned[:-1].inv() * turned[1:]).as_rotvec() / np.diff(t)[:, None]
    rates = np.empty((t.size, 3))
    rates[0], rates[-1] = steps[0], steps[-1]
    rates[1:-1] = 0.5 * (steps[:-1] + steps[1:])
    return rates


def _epochs(start: np.datetime64, seconds: Floats) -> list[str]:
    moments = start.astype("datetime64[us]") + np.rint(1e6 * seconds).astype("timedelta64[us]")
    return [str(moment) for moment in moments]
