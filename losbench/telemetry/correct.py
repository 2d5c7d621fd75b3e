"""The drift of a pair of star cameras taken out of its telemetry: ``losbench drift``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from losbench.arrays import Floats, Ints
from losbench.checks import integer
from losbench.made import Made
from losbench.outputs import claim
from losbench.pointing.starcamera import (
    CorrectedPair,
    PairTelemetry,
    QuaternionConvention,
    boresight_angle,
    correct_pair,
)
from losbench.series import split_tracks
from losbench.tables.dialect import Dialect, DialectOptions
from losbench.telemetry.aem import AttitudeMessage
from losbench.telemetry.columns import TelemetryFormat
from losbench.telemetry.notes import (
    change_notes,
    clock_notes,
    head_notes,
    missing_notes,
    slow_notes,
)
from losbench.telemetry.pointing import metrics_of, sensitivity_of
from losbench.telemetry.read import Telemetry, read_pairs
from losbench.telemetry.report import WRITTEN, PairReport, write_pairs
from losbench.telemetry.tracks import short_notes, track_table
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PairReport", "correct_telemetry"]


_SHORTEST_STEP_S = 1e-3  # no star camera is faster


def correct_telemetry(
    telemetry: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    columns: str | Path | None = None,
    convention: QuaternionConvention | None = None,
    heads: tuple[int, int] | None = None,
    smooth_s: float | None = None,
    window: int = 5,
    track_gap_s: float = 60.0,
    max_gap_s: float = 10.0,
    message: AttitudeMessage | None = None,
    force: bool = False,
    made: Made | None = None,
    **options: Unpack[DialectOptions],
) -> PairReport:
    """Judge the angle between heads, corrected for their drift where spots tell of it, and write
    what came of it to a folder.

    Stellar aberration must be out of the quaternions already (`remove_aberration`): it turns heads
    that look different ways by different angles.

    Parameters
    ----------
    telemetry : path, or a sequence of paths
        CSV file with times, quaternions of the heads and positions of their reference spots, if
        there are any; or a file for each head.
    out : path
        Folder to write to, see `write_pairs`.
    columns : path, optional
        TOML file with the names and conventions (`TelemetryFormat`); by default the first CSV
        file's name ending in .toml.
    convention : QuaternionConvention, optional
        In place of the one that the TOML file names, or does not.
    heads : two numbers, optional
        Which two, of more than two; by default every pair of them.
    smooth_s : float, optional
        Low-pass the drift over so many seconds before it corrects.
    window : int
        Samples of the sliding mean that splits LSFE from NEA.
    track_gap_s : float
        A longer gap begins a new track.
    max_gap_s : float
        Drifts are interpolated between spots that were seen no farther apart than this.
    message : AttitudeMessage, optional
        Write the corrected attitudes of two heads as CCSDS AEM files too.
    force : bool
        Write into a folder that is not empty.
    made : Made, optional
        The command and its settings, for the report.
    **options
        How the CSV file is written, where it leaves it open: as for `read_temperature_log`.

    Returns
    -------
    PairReport
        Of the two heads, or the first two, with the others' in ``others``: a table of one row per
        sample, and the corrected quaternions as (2, n, 4) arrays.

    Raises
    ------
    FileExistsError
        If ``out`` holds anything and ``force`` is not set.
    ValueError
        If the telemetry or its description is faulty; the message names file, column and row. If
        the times are too close or too far apart to be seconds.
    """
    integer("window", window, low=3)
    sources = [Path(p) for p in ([telemetry] if isinstance(telemetry, str | Path) else telemetry)]
    described = Path(columns) if columns is not None else sources[0].with_suffix(".toml")
    inputs = [*sources, described]
    with claim(out, inputs=inputs, writes=WRITTEN, force=force) as results:
        form = _described(sources, described)
        made = made or Made.by(None, {}, inputs)
        if convention is not None:
            form = replace(form, scalar=convention.scalar, direction=convention.direction)
        pairs = [heads] if heads else list(combinations(range(1, len(form.heads) + 1), 2))
        reports = []
        for pair, read in zip(
            pairs, read_pairs(sources, form, pairs, dialect=Dialect(**options)), strict=True
        ):
            track = split_tracks(read.pair.time_s, gap_s=track_gap_s)
            _check_steps(read.pair.time_s, track, sources[0].name, track_gap_s)
            judged = _judged(
                read,
                track,
                form.design_angle_deg if pair == (1, 2) else None,
                window,
                pair,
                sigma_mm=None if form.spot_sigma_um is None else form.spot_sigma_um * 1e-3,
                smooth_s=smooth_s,
                max_gap_s=max_gap_s,
            )
            reports.append(judged)
        report = replace(reports[0], others=tuple(reports[1:]))
        if message is not None:
            for name, text in message.of(report).items():
                results.write(name, text)
        write_pairs(report, results, made=made)
    return report


def _judged(
    read: Telemetry,
    track: Ints,
    designed_deg: float | None,
    window: int,
    heads: tuple[int, int],
    **how: float | None,
) -> PairReport:
    """Correct where there are spots, and judge the angle; ``how`` is that of `correct_pair`."""
    pair = correct_pair(read.pair, **how) if read.pair.points_mm.size else None  # type: ignore[arg-type]
    before = _angle(read.pair) if pair is None else pair.before_rad
    zero = float(np.degrees(np.nanmedian(before))) if designed_deg is None else designed_deg
    angle = _angle_table(read, before, pair, zero, track, heads)
    tracks = track_table(angle, read, window)
    drift_notes = []
    if pair is not None:
        drift_notes = head_notes(pair, heads, **how)  # type: ignore[arg-type]
        drift_notes += change_notes(tracks)
    notes = (
        *read.notes,
        *short_notes(tracks, window),
        *drift_notes,
        *slow_notes(tracks),
        *clock_notes(read, angle),
        *missing_notes(spots=pair is not None, designed=designed_deg is not None, zero_deg=zero),
    )
    return PairReport(
        read,
        pair,
        zero,
        designed_deg is not None,
        angle,
        tracks,
        notes,
        heads,
        metrics=metrics_of(angle, window),
        sensitivity=sensitivity_of(angle, read.sensors),
    )


def _described(sources: Sequence[Path], described: Path) -> TelemetryFormat:
    for source in sources:
        if not source.is_file():
            raise FileNotFoundError(f"no telemetry at {source}: expected a CSV file")
    if not described.is_file():
        raise FileNotFoundError(
            f"no description of the columns at {described}: write one, or name it with --columns"
        )
    return TelemetryFormat.from_toml(described)


def _angle(pair: PairTelemetry) -> Floats:
    return boresight_angle(*pair.quaternions, convention=pair.convention, boresight=pair.boresight)


def _check_steps(time_s: Floats, track: Ints, file: str, track_gap_s: float) -> None:
    if len(time_s) < 3:
        return
    step = float(np.median(np.diff(time_s)))
    if step < _SHORTEST_STEP_S:
        raise ValueError(
            f"{file}: times must be in seconds, but the median step is {step:.3g} s; are they days?"
        )
    if 2 * (track[-1] + 1) > len(time_s):
        raise ValueError(
            f"{file}: times must be in seconds, but most samples stand more than {track_gap_s:g} s "
            "apart, the median "
            f"step is {step:.4g} s; are they milliseconds? If not, set a longer track_gap_s"
        )


def _angle_table(
    read: Telemetry,
    before_rad: Floats,
    pair: CorrectedPair | None,
    zero_deg: float,
    track: Ints,
    heads: Iterable[int],
) -> pd.DataFrame:
    import pandas as pd

    columns = {
        "time_s": read.pair.time_s,
        "track": track + 1,
        "before_arcsec": rad_to_arcsec(before_rad - np.radians(zero_deg)),
    }
    if pair is not None:
        drift = rad_to_arcsec(pair.drift)
        columns["after_arcsec"] = rad_to_arcsec(pair.after_rad - np.radians(zero_deg))
        columns |= {
            f"drift_{head}_{axis}_arcsec": drift[k, :, i]
            for k, head in enumerate(heads)
            for i, axis in enumerate("xyz")
        }
    return pd.DataFrame(columns)
