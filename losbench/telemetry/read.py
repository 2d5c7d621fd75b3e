"""Telemetry of a pair of star cameras from a CSV file, checked."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from losbench.arrays import Bools, Floats, Ints
from losbench.checks import unit_quaternions
from losbench.logs import FrameTimes, utc_of
from losbench.page import Doubt
from losbench.pointing.starcamera import (
    PairTelemetry,
    QuaternionConvention,
    check_design,
    interpolate_attitude,
)
from losbench.series import neighbours, split_tracks
from losbench.tables import Dialect, Table, read_table
from losbench.telemetry.columns import HeadColumns, TelemetryFormat
from losbench.telemetry.conventions import check_convention, check_steady, proposal
from losbench.units import ARCSEC_PER_RAD

__all__ = ["Telemetry", "read_telemetry"]


_FEWEST_DECIMALS = 8  # below, rounding is seen in the angle
_FARTHEST = 0.005  # of the focal length: the shift that a turn of 1000 arcsec makes
_SLOWEST_S = 1.0  # step that two clocks are bridged over


@dataclass(frozen=True)
class Telemetry:
    """A pair's telemetry as read: times as in the file or since ``start``, where UTC is known; what
    was noticed; temperatures (n,) by their column, degC.
    """

    pair: PairTelemetry
    start: np.datetime64 | None
    notes: tuple[str, ...]
    sensors: Mapping[str, Floats] = field(default_factory=dict)


def read_telemetry(
    path: str | Path | Sequence[str | Path],
    form: TelemetryFormat,
    *,
    heads: tuple[int, int] = (1, 2),
    dialect: Dialect | None = None,
) -> Telemetry:
    """Read and check the telemetry of two heads.

    Parameters
    ----------
    path : path, or a sequence of paths
        CSV file of all heads, or one for each head of the format.
    form : TelemetryFormat
        What its columns mean.
    heads : two numbers
        Which of the format's heads.
    dialect : Dialect, optional
        What of the files cannot be found out.

    Returns
    -------
    Telemetry
        A row with a NaN in a quaternion or a spot is kept as missing; a row without a time is left
        out.

    Raises
    ------
    ValueError
        If a column is missing, times do not increase, a quaternion is not of unit length, no
        convention is named or another fits better, the boresights do not stand as designed or not
        still, or the heads do not overlap in time.

    Warns
    -----
    UserWarning
        If the quaternions have so few decimals that rounding shows, with what it costs in arcsec.
    """
    return read_pairs(path, form, [heads], dialect=dialect)[0]


def read_pairs(
    path: str | Path | Sequence[str | Path],
    form: TelemetryFormat,
    pairs: Sequence[tuple[int, int]],
    *,
    dialect: Dialect | None = None,
) -> list[Telemetry]:
    """Read several pairs of heads as `read_telemetry` does, each file once."""
    files = [Path(p) for p in ([path] if isinstance(path, str | Path) else path)]
    if len(files) not in (1, len(form.heads)) or (len(files) == 1 and form.a_file_each):
        raise ValueError(
            f"telemetry must be a file for each of {len(form.heads)} heads"
            f"{' or one for all' * (not form.a_file_each)}, got {len(files)}"
        )
    wanted = sorted({head for pair in pairs for head in pair})
    if wanted[-1] > len(form.heads):
        raise ValueError(f"heads must be among the {len(form.heads)} described, got {wanted[-1]}")
    of_head = {head: files[head - 1] if len(files) > 1 else files[0] for head in wanted}
    if form.numbered:
        dialect = replace(dialect or Dialect(), header=False)
    tables = {file: read_table(file, dialect) for file in dict.fromkeys(of_head.values())}
    sources = {head: _source(tables[of_head[head]], head, form, len(files)) for head in wanted}
    first = tables[of_head[pairs[0][0]]]
    if lost := [name for name in form.temperatures if name not in first.names]:
        raise ValueError(f"{first.file} has no column {', '.join(lost)}; it has {first.listed()}")
    return [_pair(sources[j], sources[k], form) for j, k in pairs]


def _pair(one: _Source, other: _Source, form: TelemetryFormat) -> Telemetry:
    sources, heads = (one, other), (one.number, other.number)
    clocks = [source.clock for source in sources]
    name = " and ".join(dict.fromkeys(source.table.file for source in sources))
    if len({clock.start is None for clock in clocks}) > 1:
        columns = " and ".join(source.clock_name for source in sources)
        raise ValueError(f"{name}: columns {columns} must both hold seconds, or both UTC")
    notes = [note for each in sources for note in (*each.table.notes, *each.clock.notes)]
    times = [clock.seconds_since(clocks[0], "the second head") for clock in clocks]
    first, second = (_head(each, t, form, notes) for each, t in zip(sources, times, strict=True))
    _warn_of_rounding(np.concatenate([first.quaternions, second.quaternions]), notes)
    if not np.array_equal(first.time_s, second.time_s):
        second = _on_clock_of(
            first, second, form.convention or QuaternionConvention.every()[0], name
        )
        at, without = first.time_s, np.isnan(second.quaternions).any(axis=1)
        notes.append(
            "The second head is interpolated to the first one's times, which lowers its noise; "
            f"{np.count_nonzero(without)} of {len(at)} lie outside its own or in a gap of more "
            f"than {_SLOWEST_S:g} s."
        )
    quaternions = np.stack([first.quaternions, second.quaternions])
    if np.isnan(quaternions).any(axis=(0, 2)).all():
        raise ValueError(f"{name}: no row has the attitudes of both heads")
    designed = form.design_angle_deg if heads == (1, 2) else None
    try:
        convention, said = _settled_convention(quaternions, form, designed, first.time_s)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    pair = PairTelemetry(
        time_s=first.time_s,
        quaternions=quaternions,
        points_mm=np.stack([first.points_mm, second.points_mm]),
        shifts_mm=np.stack([first.shifts_mm, second.shifts_mm]),
        convention=convention,
        installation=np.stack([np.array(form.heads[k - 1].installation) for k in heads]),
        boresight=form.boresight,
    )
    timed = np.isfinite(times[0]) & one.own
    # Temperatures keep the clock of the file they stand in, which is that of the pair's first head.
    there = [column for column in form.temperatures if column in one.table.names]
    sensors = {column: one.table.numbers(column)[timed] for column in there}
    return Telemetry(pair, clocks[0].start, tuple(dict.fromkeys([*notes, *said])), sensors)


def _settled_convention(
    quaternions: Floats, form: TelemetryFormat, designed_deg: float | None, time_s: Floats
) -> tuple[QuaternionConvention, list[str]]:
    """The convention that is named, if neither design nor the telemetry itself speaks against it,
    and what is to be said about it.
    """
    convention, boresight = form.convention, form.boresight
    if convention is None:
        raise ValueError(proposal(quaternions, boresight))
    said = []
    if designed_deg is None:
        said = check_convention(quaternions, convention, boresight)
    else:
        axis = np.array(boresight)
        check_design(*quaternions, convention=convention, angle_deg=designed_deg, boresight=axis)
    check_steady(quaternions, convention, boresight, time_s)
    return convention, said


@dataclass(frozen=True)
class _Source:
    """One head's columns, and where they stand."""

    table: Table
    columns: HeadColumns
    number: int
    clock_name: str
    clock: FrameTimes
    own: Bools


def _source(table: Table, head: int, form: TelemetryFormat, n_files: int) -> _Source:
    columns, clock = form.heads[head - 1], form.clocks[min(head, len(form.clocks)) - 1]
    fraction = (form.time_fraction or ())[:1]
    wanted = form.columns if n_files == 1 else [clock, *fraction, *columns.columns]
    missing = [column for column in wanted if column not in table.names]
    if missing:
        raise ValueError(
            f"{table.file} has no column {', '.join(missing)}; it has {table.listed()}"
        )
    moments, own = _clock(table, clock, form.time_fraction), np.ones(len(table), bool)
    if columns.rows:
        column, number = columns.rows
        own = table.numbers(column) == number
        if not own.any():
            raise ValueError(
                f"{table.file}: column {column!r} never holds {number:g}, which tells the rows of "
                f"head {head}"
            )
    return _Source(table, columns, head, clock, moments, own)


@dataclass(frozen=True)
class _Head:
    """One head on its own clock: times (n,), quaternions (n, 4), shifts (n, m, 2), reference points
    (m, 3).
    """

    time_s: Floats
    quaternions: Floats
    shifts_mm: Floats
    points_mm: Floats


def _head(source: _Source, time_s: Floats, form: TelemetryFormat, notes: list[str]) -> _Head:
    """Read and check a head, leaving out the rows without its time; what is noticed goes to
    ``notes``.
    """
    table, columns, file = source.table, source.columns, source.table.file
    quaternions = _columns(table, columns.quaternion)
    quaternions = np.where(np.isfinite(quaternions).all(axis=1, keepdims=True), quaternions, np.nan)
    spots = _columns(table, [c for xy in columns.spots for c in xy])
    timed = np.isfinite(time_s) & source.own
    lost = np.count_nonzero(
        ~timed & source.own & np.isfinite(np.concatenate([quaternions, spots], axis=1)).any(axis=1)
    )
    if lost:
        notes.append(f"{lost} of {len(table)} rows have no {source.clock_name} and are left out.")
    rows = np.flatnonzero(timed) + 1
    t, quaternions, spots = time_s[timed], quaternions[timed], spots[timed]
    _check_order(t, f"{file}: column {source.clock_name!r}", rows)
    _check_head(quaternions, spots, f"{file}: head {source.number}", rows)
    position = spots.reshape(len(t), len(columns.spots), 2)
    if not columns.spots:
        notes += _remarks(f"Head {source.number}", t, quaternions, position)
        return _Head(t, quaternions, position, np.empty((0, 3)))
    position, reference = _near(position, t, rows, form, source, notes)
    notes += _remarks(f"Head {source.number}", t, quaternions, position)
    flat_mm = (reference - np.array(form.principal)) * form.unit_mm
    points = np.concatenate([flat_mm, np.full_like(flat_mm[:, :1], form.focal_mm)], axis=1)
    return _Head(t, quaternions, (position - reference) * form.unit_mm, points)


def _near(
    position: Floats,
    time_s: Floats,
    rows: Ints,
    form: TelemetryFormat,
    source: _Source,
    notes: list[str],
) -> tuple[Floats, Floats]:
    """Positions (n, m, 2) without those too far from their reference for a drift, and the reference
    (m, 2).
    """
    given, head = source.columns.reference, source.number
    first_track = split_tracks(time_s) == 0
    if not given and not np.isfinite(position[first_track]).all(axis=(1, 2)).any():
        raise ValueError(
            f"{source.table.file}: head {head}: no row of the first track shows all spots: give "
            "their reference positions"
        )
    centre = np.array(given) if given else np.nanmedian(position[first_track], axis=0)
    farthest = _FARTHEST * (form.focal_mm or 0.0) / form.unit_mm
    length = np.linalg.norm(position - centre, axis=-1)
    far = length > farthest
    for spot in range(far.shape[1]):
        seen = length[np.isfinite(length[:, spot]), spot]
        if seen.size and np.median(seen) > farthest:
            raise ValueError(
                f"{source.table.file}: head {head}: spot {spot + 1} is too far from its reference "
                "for a drift: check its columns, spot_unit, principal and reference"
            )
        if far[:, spot].any():
            notes.append(
                f"Head {head}: in {np.count_nonzero(far[:, spot])} of {len(rows)} rows spot "
                f"{spot + 1} lies more than "
                f"{farthest:.3g} {form.spot_unit} from its reference, farther than any drift, and "
                "is left out there; "
                f"the first is row {rows[np.argmax(far[:, spot])]}."
            )
    kept = np.where(far[..., None], np.nan, position)
    return kept, np.array(given) if given else np.nanmean(kept[first_track], axis=0)


def _clock(table: Table, column: str, fraction: tuple[Any, ...] | None) -> FrameTimes:
    if table.holds(column) != "n":
        return utc_of(table, column)
    seconds = table.numbers(column)
    if fraction is not None:
        seconds = seconds + table.numbers(fraction[0]) * fraction[1]
    return FrameTimes(seconds)


def _columns(table: Table, names: Sequence[str]) -> Floats:
    if not names:
        return np.empty((len(table), 0))
    return np.stack([table.numbers(column) for column in names], axis=-1)


def _check_head(quaternions: Floats, spots: Floats, what: str, rows: Ints) -> None:
    if np.isnan(quaternions).any(axis=1).all():
        raise ValueError(f"{what} has no row with a whole quaternion")
    unit_quaternions(f"{what}: quaternions", quaternions, rows=rows)
    pairs = spots.reshape(len(spots), spots.shape[1] // 2, 2)
    seen = np.isfinite(pairs).all(axis=2).sum(axis=1)
    if spots.size and seen.max() < 2:
        raise ValueError(f"{what} has no row with two spots, which a drift takes")


def _check_order(t: Floats, what: str, rows: Ints) -> None:
    late = np.diff(t) <= 0
    if late.any():
        k = int(np.argmax(late)) + 1
        kind = "repeats the time of" if t[k] == t[k - 1] else "is earlier than"
        raise ValueError(
            f"{what} must increase, but row {rows[k]} {kind} the row before; "
            f"{np.count_nonzero(late)} rows do: "
            "sort the file and drop duplicates"
        )


def _remarks(who: str, time_s: Floats, quaternions: Floats, position: Floats) -> list[str]:
    """What the reader of the results must know of one head."""
    beside = neighbours(time_s)
    gone = int(np.isnan(quaternions).any(axis=1).sum())
    dark = int(np.isnan(position).any(axis=(1, 2)).sum())
    flips = int((beside & (np.vecdot(quaternions[1:], quaternions[:-1]) < 0)).sum())
    lines = {
        f"{who}: {gone} rows without a quaternion.": gone,
        f"{who}: {dark} rows miss a spot.": dark,
        f"{who}: the quaternion changes its sign {flips} times, which is harmless.": flips,
    }
    return [line for line, count in lines.items() if count]


def _warn_of_rounding(quaternions: Floats, notes: list[str]) -> None:
    decimals = _decimals(quaternions)
    if decimals < _FEWEST_DECIMALS:
        cost = 3.0 * np.sqrt(2.0) * 2.0 * 10.0**-decimals / np.sqrt(12.0) * ARCSEC_PER_RAD
        text = (
            f"quaternions hold {decimals} decimals, which costs {cost:.2g} arcsec (3 sigma) of the "
            "angle"
        )
        warnings.warn(f"{text}; {_FEWEST_DECIMALS} or more would not", UserWarning, stacklevel=3)
        notes.append(Doubt(f"The {text}."))


def _decimals(values: Floats) -> int:
    known = values[np.isfinite(values)]
    return next((d for d in range(1, 15) if np.abs(known - np.round(known, d)).max() < 1e-14), 15)


def _on_clock_of(first: _Head, second: _Head, convention: QuaternionConvention, file: str) -> _Head:
    """The second head at the times of the first."""
    at, t = first.time_s, second.time_s
    if at[0] > t[-1] or t[0] > at[-1]:
        raise ValueError(
            f"{file}: the heads must overlap in time, but the first runs from {at[0]:g} to "
            f"{at[-1]:g} s and the second from {t[0]:g} to {t[-1]:g} s"
        )
    turned = interpolate_attitude(
        t, second.quaternions, at, convention=convention, max_gap_s=_SLOWEST_S
    )
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    share = ((at - t[after - 1]) / (t[after] - t[after - 1]))[:, None, None]
    moved = (1.0 - share) * second.shifts_mm[after - 1] + share * second.shifts_mm[after]
    return _Head(
        at, turned, np.where(np.isnan(turned[:, :1, None]), np.nan, moved), second.points_mm
    )
