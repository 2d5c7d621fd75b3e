"""Telemetry of a pair of star cameras as a CSV file, and the TOML file that says what its columns mean."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from losbench.checks import choice, number, positive
from losbench.parameters import from_table, read_toml, to_table
from losbench.pointing.starcamera import (
    PairTelemetry,
    QuaternionConvention,
    check_design,
    interpolate_attitude,
    split_tracks,
)
from losbench.recording.times import FrameTimes, numbers, read_table, utc_times
from losbench.units import ARCSEC_PER_RAD

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["HeadColumns", "Telemetry", "TelemetryFormat", "read_telemetry"]

Floats = NDArray[np.float64]

_UNITS_MM = {"mm": 1.0, "um": 1e-3, "px": None}
_FEWEST_DECIMALS = 8  # below, rounding is seen in the angle
_SLOWEST_S = 1.0  # step that two clocks are bridged over
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class HeadColumns:
    """Columns and layout of one head.

    Parameters
    ----------
    quaternion : four column names
        In the order that `TelemetryFormat.scalar` says.
    spots : pairs of column names
        x and y of each reference spot; two spots or more.
    reference : pairs of numbers, unit of the spots, optional
        Where the spots are without drift; by default their mean over the first track.
    installation : (3, 3)
        Rotation from the axes of the spots to those of the attitude.
    """

    quaternion: tuple[str, ...]
    spots: tuple[tuple[str, str], ...]
    reference: tuple[tuple[float, float], ...] = ()
    installation: tuple[tuple[float, ...], ...] = _IDENTITY

    def __post_init__(self) -> None:
        if len(self.quaternion) != 4:
            raise ValueError(f"quaternion must name four columns, got {len(self.quaternion)}")
        if len(self.spots) < 2 or any(len(pair) != 2 for pair in self.spots):
            raise ValueError("spots must name two columns, x and y, for each of two spots or more")
        if self.reference and np.shape(self.reference) != (len(self.spots), 2):
            raise ValueError(f"reference must have x and y of {len(self.spots)} spots")


@dataclass(frozen=True, kw_only=True)
class TelemetryFormat:
    """What the columns of a pair's telemetry mean; nothing about a quaternion is guessed.

    Parameters
    ----------
    time : one or two column names
        Seconds, or ISO 8601 UTC. Two where each head has its own clock: the second head is interpolated.
    scalar, direction
        As for `QuaternionConvention`.
    design_angle_deg : float
        Angle between the boresights as built, by which a mixed-up convention is noticed.
    focal_mm : float
        Focal length of the star cameras.
    spot_unit : "mm", "um" or "px"
        Unit of the spot positions; "px" needs ``pixel_um``.
    principal : (float, float)
        Where the optical axis meets the detector, in that unit.
    pixel_um : float, optional
        Pixel pitch.
    spot_sigma_um : float, optional
        Standard deviation of a spot position, for the drift's uncertainty.
    head_1, head_2 : HeadColumns
        The two heads.
    """

    time: str | tuple[str, ...]
    scalar: Any
    direction: Any
    design_angle_deg: float
    focal_mm: float
    head_1: HeadColumns
    head_2: HeadColumns
    spot_unit: str = "mm"
    principal: tuple[float, float] = (0.0, 0.0)
    pixel_um: float | None = None
    spot_sigma_um: float | None = None

    def __post_init__(self) -> None:
        QuaternionConvention(scalar=self.scalar, direction=self.direction)
        if len(self.clocks) not in (1, 2):
            raise ValueError(f"time must name one column, or one for each head, got {len(self.clocks)}")
        number("design_angle_deg", self.design_angle_deg, low=0.0, high=180.0)
        positive("focal_mm", number("focal_mm", self.focal_mm))
        if choice("spot_unit", self.spot_unit, _UNITS_MM) == "px" and self.pixel_um is None:
            raise ValueError("spot_unit 'px' needs pixel_um")
        if len(self.head_1.spots) != len(self.head_2.spots):
            raise ValueError("both heads must have equally many spots")

    @property
    def clocks(self) -> tuple[str, ...]:
        """Names of the time columns, one or two."""
        return (self.time,) if isinstance(self.time, str) else tuple(self.time)

    @property
    def convention(self) -> QuaternionConvention:
        """The quaternions' order and direction."""
        return QuaternionConvention(scalar=self.scalar, direction=self.direction)

    @property
    def unit_mm(self) -> float:
        """Millimetres per unit of the spot positions."""
        return (self.pixel_um or 0.0) * 1e-3 if self.spot_unit == "px" else float(_UNITS_MM[self.spot_unit] or 0.0)

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """Read a format; ``ValueError`` names the file and the key that is missing, unknown or wrong."""
        table = read_toml(path)
        for head in ("head_1", "head_2"):
            if not isinstance(table.get(head), dict):
                raise ValueError(f"{path}: table [{head}] is missing")
            table[head] = from_table(HeadColumns, table[head], where=f"{path}: [{head}]")
        return from_table(cls, table, where=str(path))

    def to_toml(self) -> str:
        """Return the format as TOML that :meth:`from_toml` reads."""
        heads = ("head_1", "head_2")
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in heads}
        top = [f"{name} = {_toml(value)}" for name, value in plain.items() if value is not None]
        return (
            "# Columns and conventions of a pair's telemetry, for `losbench drift`.\n"
            + "\n".join(top)
            + "".join(f"\n\n[{h}]\n{to_table(getattr(self, h))}" for h in heads)
            + "\n"
        )


@dataclass(frozen=True)
class Telemetry:
    """A pair's telemetry as read: times from the first row, UTC of that row where known, and what was noticed."""

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
    wanted = [
        *form.clocks,
        *(c for head in heads for c in (*head.quaternion, *(x for pair in head.spots for x in pair))),
    ]
    missing = [column for column in wanted if column not in table.columns]
    if missing:
        raise ValueError(f"{name} has no column {', '.join(missing)}; it has {', '.join(map(str, table.columns))}")
    clocks = [_clock(table, column, name) for column in form.clocks]
    kept = np.all([np.isfinite(clock.seconds) for clock in clocks], axis=0)
    notes = [f"{np.count_nonzero(~kept)} of {len(table)} rows have no time and are left out."] if not kept.all() else []
    table = table[kept]
    times = [clock.seconds_since(clocks[0], "the second head")[kept] for clock in clocks]
    quaternions = np.stack([_columns(table, head.quaternion, name) for head in heads])
    spots = np.stack([_columns(table, [c for xy in head.spots for c in xy], name) for head in heads])
    for t, column in zip(times, form.clocks, strict=True):
        _check_order(t, f"{name}: column {column!r}")
    notes += _remarks(times[0], quaternions, spots)
    if len(times) == 2:
        quaternions[1], spots[1] = _on_first_clock(times, quaternions[1], spots[1], form.convention)
        notes.append("The second head is interpolated to the first one's times, which lowers its noise.")
    check_design(*quaternions, convention=form.convention, angle_deg=form.design_angle_deg)
    return Telemetry(_pair(form, times[0], quaternions, spots), clocks[0].start, tuple(notes))


def _pair(form: TelemetryFormat, time_s: Floats, quaternions: Floats, spots: Floats) -> PairTelemetry:
    time_s = time_s - time_s[0]
    position = spots.reshape(2, len(time_s), -1, 2)
    first_track = split_tracks(time_s) == 0
    references = []
    for head, seen in zip((form.head_1, form.head_2), position, strict=True):
        if not head.reference and not np.isfinite(seen[first_track]).all(axis=(1, 2)).any():
            raise ValueError("no row of the first track shows all spots: give their reference positions")
        references.append(np.array(head.reference) if head.reference else np.nanmean(seen[first_track], axis=0))
    reference = np.stack(references)
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


def _check_order(t: Floats, what: str) -> None:
    late = np.diff(t) <= 0
    if late.any():
        k = int(np.argmax(late)) + 1
        kind = "repeats the time of" if t[k] == t[k - 1] else "is earlier than"
        raise ValueError(
            f"{what} must increase, but row {k + 1} {kind} the row before; {np.count_nonzero(late)} rows do: "
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


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return f"[{', '.join(_toml(item) for item in value)}]" if isinstance(value, tuple) else repr(value)
