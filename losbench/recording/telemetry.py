"""Telemetry of a pair of star cameras from a CSV file, checked."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from losbench.pointing.starcamera import (
    PairTelemetry,
    QuaternionConvention,
    check_design,
    interpolate_attitude,
    split_tracks,
)
from losbench.recording.columns import TelemetryFormat
from losbench.recording.times import FrameTimes, numbers, read_table, utc_times
from losbench.units import ARCSEC_PER_RAD

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Telemetry", "read_telemetry"]

Floats = NDArray[np.float64]

_UNIT = 1e-3  # text of three decimals keeps unit length to this
_FEWEST_DECIMALS = 8  # below, rounding is seen in the angle
_FARTHEST = 0.005  # of the focal length: the shift that a turn of 1000 arcsec makes
_SLOWEST_S = 1.0  # step that two clocks are bridged over


@dataclass(frozen=True)
class Telemetry:
    """A pair's telemetry as read: times as in the file or since ``start``, where UTC is known; what was noticed."""

    pair: PairTelemetry
    start: np.datetime64 | None
    notes: tuple[str, ...]


def read_telemetry(path: str | Path, form: TelemetryFormat) -> Telemetry:
    """Read and check a pair's telemetry.

    Parameters
    ----------
    path : path
        CSV file.
    form : TelemetryFormat
        What its columns mean.

    Returns
    -------
    Telemetry
        A row with a NaN in a quaternion or a spot is kept as missing; a row without a time is left out.

    Raises
    ------
    ValueError
        If a column is missing, times do not increase, a quaternion is not of unit length, the boresights do not stand
        as designed (a mixed-up convention), or the heads do not overlap in time.

    Warns
    -----
    UserWarning
        If the quaternions have so few decimals that rounding shows, with what it costs in arcsec.
    """
    table, name = read_table(path), Path(path).name
    heads = (form.head_1, form.head_2)
    missing = [column for column in form.columns if column not in table.columns]
    if missing:
        raise ValueError(f"{name} has no column {', '.join(missing)}; it has {', '.join(map(str, table.columns))}")
    clocks = [_clock(table, column, name) for column in form.clocks]
    if len({clock.start is None for clock in clocks}) > 1:
        raise ValueError(f"{name}: columns {' and '.join(form.clocks)} must both hold seconds, or both UTC")
    kept = np.all([np.isfinite(clock.seconds) for clock in clocks], axis=0)
    notes = [f"{np.count_nonzero(~kept)} of {len(table)} rows have no time and are left out."] if not kept.all() else []
    table = table[kept]
    times = [clock.seconds_since(clocks[0], "the second head")[kept] for clock in clocks]
    quaternions = np.stack([_columns(table, head.quaternion, name) for head in heads])
    spots = np.stack([_columns(table, [c for xy in head.spots for c in xy], name) for head in heads])
    for t, column in zip(times, form.clocks, strict=True):
        _check_order(t, f"{name}: column {column!r}", table.index.to_numpy() + 1)
    for k in range(2):
        _check_head(quaternions[k], spots[k], f"{name}: head {k + 1}", table.index.to_numpy() + 1)
    notes += _remarks(times[0], quaternions, spots)
    if len(times) == 2:
        quaternions[1], spots[1] = _on_first_clock(times, quaternions[1], spots[1], form.convention)
        notes.append("The second head is interpolated to the first one's times, which lowers its noise.")
    if np.isnan(quaternions).any(axis=(0, 2)).all():
        raise ValueError(f"{name}: no row has the attitudes of both heads")
    check_design(*quaternions, convention=form.convention, angle_deg=form.design_angle_deg)
    return Telemetry(_pair(form, times[0], quaternions, spots), clocks[0].start, tuple(notes))


def _pair(form: TelemetryFormat, time_s: Floats, quaternions: Floats, spots: Floats) -> PairTelemetry:
    position = spots.reshape(2, len(time_s), -1, 2)
    first_track = split_tracks(time_s) == 0
    references = []
    for head, seen in zip((form.head_1, form.head_2), position, strict=True):
        if not head.reference and not np.isfinite(seen[first_track]).all(axis=(1, 2)).any():
            raise ValueError("no row of the first track shows all spots: give their reference positions")
        references.append(np.array(head.reference) if head.reference else np.nanmean(seen[first_track], axis=0))
    reference = np.stack(references)
    far = np.argwhere(_typical_shift(position - reference[:, None]) * form.unit_mm > _FARTHEST * form.focal_mm)
    if far.size:
        k, spot = far[0] + 1
        raise ValueError(
            f"head {k}: spot {spot} is too far from its reference for a drift: check its columns, spot_unit, "
            "principal and reference"
        )
    flat_mm = (reference - np.array(form.principal)) * form.unit_mm
    return PairTelemetry(
        time_s=time_s,
        quaternions=quaternions,
        points_mm=np.concatenate([flat_mm, np.full_like(flat_mm[..., :1], form.focal_mm)], axis=-1),
        shifts_mm=(position - reference[:, None]) * form.unit_mm,
        convention=form.convention,
        installation=np.stack([np.array(head.installation) for head in (form.head_1, form.head_2)]),
    )


def _clock(table: pd.DataFrame, column: str, name: str) -> FrameTimes:
    if table[column].dtype.kind in "iuf":
        return FrameTimes(numbers(table, column, name))
    utc = utc_times(f"column {column!r} of {name}", table[column].tolist())
    known = utc[~np.isnat(utc)]
    if not known.size:
        raise ValueError(f"column {column!r} of {name} must hold at least one time")
    return FrameTimes(np.where(np.isnat(utc), np.nan, (utc - known[0]) / np.timedelta64(1, "ns") * 1e-9), known[0])


def _columns(table: pd.DataFrame, names: list[str] | tuple[str, ...], file: str) -> Floats:
    values = np.stack([numbers(table, column, file) for column in names], axis=-1)
    return np.where(np.isfinite(values).all(axis=-1, keepdims=True) | (values.shape[-1] != 4), values, np.nan)


def _typical_shift(shifts: Floats) -> Floats:
    """Median length of the shifts (2, n, m, 2) of each spot, (2, m); 0 where it was never seen."""
    length = np.linalg.norm(shifts, axis=-1)
    unseen = np.isnan(length).all(axis=1)
    return np.where(unseen, 0.0, np.nanmedian(np.where(unseen[:, None], 0.0, length), axis=1))


def _check_head(quaternions: Floats, spots: Floats, what: str, rows: NDArray[np.int64]) -> None:
    length = np.linalg.norm(quaternions, axis=1)
    if np.isnan(length).all():
        raise ValueError(f"{what} has no row with a whole quaternion")
    bad = np.abs(length - 1.0) > _UNIT
    if bad.any():
        k = int(np.argmax(bad))
        raise ValueError(
            f"{what}: quaternions must have unit length to {_UNIT:g}, but {np.count_nonzero(bad)} of {len(bad)} have "
            f"not; row {rows[k]} has length {length[k]:.4g}"
        )
    seen = np.isfinite(spots.reshape(len(spots), -1, 2)).all(axis=2).sum(axis=1)
    if seen.max() < 2:
        raise ValueError(f"{what} has no row with two spots, which a drift takes")


def _check_order(t: Floats, what: str, rows: NDArray[np.int64]) -> None:
    late = np.diff(t) <= 0
    if late.any():
        k = int(np.argmax(late)) + 1
        kind = "repeats the time of" if t[k] == t[k - 1] else "is earlier than"
        raise ValueError(
            f"{what} must increase, but row {rows[k]} {kind} the row before; {np.count_nonzero(late)} rows do: "
            "sort the file and drop duplicates"
        )


def _remarks(time_s: Floats, quaternions: Floats, spots: Floats) -> list[str]:
    """What the reader of the results must know; a warning for rounded quaternions."""
    notes = []
    neighbours = np.diff(split_tracks(time_s)) == 0
    for k in range(2):
        gone = int(np.isnan(quaternions[k]).any(axis=1).sum())
        if gone:
            notes.append(f"Head {k + 1}: {gone} rows without a quaternion.")
        dark = int(np.isnan(spots[k]).any(axis=1).sum())
        if dark:
            notes.append(f"Head {k + 1}: {dark} rows miss a spot; drifts are interpolated over up to 10 s.")
        flips = int((neighbours & (np.vecdot(quaternions[k][1:], quaternions[k][:-1]) < 0)).sum())
        if flips:
            notes.append(f"Head {k + 1}: the quaternion changes its sign {flips} times, which is harmless.")
    decimals = _decimals(quaternions)
    if decimals < _FEWEST_DECIMALS:
        cost = 3.0 * np.sqrt(2.0) * 2.0 * 10.0**-decimals / np.sqrt(12.0) * ARCSEC_PER_RAD
        text = f"quaternions hold {decimals} decimals, which costs {cost:.2g} arcsec (3 sigma) of the angle"
        warnings.warn(f"{text}; {_FEWEST_DECIMALS} or more would not", UserWarning, stacklevel=3)
        notes.append(f"The {text}.")
    return notes


def _decimals(values: Floats) -> int:
    known = values[np.isfinite(values)]
    return next((d for d in range(1, 15) if np.abs(known - np.round(known, d)).max() < 1e-14), 15)


def _on_first_clock(
    times: list[Floats], quaternions: Floats, spots: Floats, convention: QuaternionConvention
) -> tuple[Floats, Floats]:
    """Quaternions (n, 4) and spots (n, 2 m) of the second head at the times of the first."""
    first_s, second_s = times
    if first_s[0] > second_s[-1] or second_s[0] > first_s[-1]:
        raise ValueError(
            f"the heads must overlap in time, but the first runs from {first_s[0]:g} to {first_s[-1]:g} s "
            f"and the second from {second_s[0]:g} to {second_s[-1]:g} s"
        )
    turned = interpolate_attitude(second_s, quaternions, first_s, convention=convention, max_gap_s=_SLOWEST_S)
    after = np.clip(np.searchsorted(second_s, first_s), 1, len(second_s) - 1)
    share = ((first_s - second_s[after - 1]) / (second_s[after] - second_s[after - 1]))[:, None]
    moved = (1.0 - share) * spots[after - 1] + share * spots[after]
    return turned, np.where(np.isnan(turned[:, :1]), np.nan, moved)
