"""The drift of a pair of star cameras taken out of its telemetry: ``losbench drift``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import NDArray

from losbench.__about__ import __version__
from losbench.arrays import Floats, Ints
from losbench.checks import integer
from losbench.outputs import Claim, claim
from losbench.pointing.starcamera import (
    CorrectedPair,
    PairTelemetry,
    QuaternionConvention,
    boresight_angle,
    correct_pair,
)
from losbench.series import split_tracks
from losbench.tables.dialect import Dialect, DialectOptions
from losbench.tables.moments import utc_after
from losbench.telemetry.columns import TelemetryFormat
from losbench.telemetry.notes import (
    change_notes,
    clock_notes,
    head_notes,
    missing_notes,
    slow_notes,
)
from losbench.telemetry.read import Telemetry, read_telemetry
from losbench.telemetry.tracks import short_notes, track_lines, track_table
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PairReport", "correct_telemetry"]


_WRITTEN = ("angle.csv", "tracks.csv", "angle.png", "report.txt", "corrected.csv", "drift.png")
_SHORTEST_STEP_S = 1e-3  # no star camera is faster


@dataclass(frozen=True)
class PairReport:
    """What the telemetry of a pair says.

    Attributes
    ----------
    telemetry, pair : Telemetry, CorrectedPair
        What went in, and what the chain made of it; None for the latter where no spots tell of a
        drift.
    zero_deg, designed : float, bool
        The angle that others are counted from, and whether it is that of the design or the median.
    angle : DataFrame
        One row per sample: time_s, track, angle before and after less ``zero_deg``, drift of both
        heads, arcsec; without spots only before.
    tracks : DataFrame
        One row per track: means with their one-sigma errors, and total, LSFE and NEA before and
        after (3 sigma; the paper's and unbiased forms with one-sigma uncertainties). NaN
        where the track cannot tell.
    notes : tuple of str
        What the reader must know, a line each.
    """

    telemetry: Telemetry
    pair: CorrectedPair | None
    zero_deg: float
    designed: bool
    angle: pd.DataFrame
    tracks: pd.DataFrame
    notes: tuple[str, ...]

    def summary(self) -> str:
        """Return the report as text: every track in a line, then the notes."""
        return "\n".join([*track_lines(self.tracks, self.zero_deg), *self.notes])

    def write(self, results: Claim) -> None:
        """Write ``angle.csv``, ``tracks.csv``, ``angle.png``, ``report.txt``, ``report.json``, and
        with spots ``corrected.csv`` and ``drift.png``.
        """
        from losbench.figures import png, styled
        from losbench.telemetry.pictures import angle_figure, drift_figure

        time = self.telemetry.pair.time_s
        order = "xyzw" if self.telemetry.pair.convention.scalar == "last" else "wxyz"
        angle = self.angle.assign(time_s=np.char.mod("%.6f", time))
        tables = {"angle.csv": (angle, "%.9g")}
        if self.pair is not None:
            corrected = _corrected_table(time, self.pair.quaternions, order)
            tables["corrected.csv"] = (corrected, "%.12f")
        if self.telemetry.start is not None:
            for table, _ in tables.values():
                table.insert(0, "time", _utc(self.telemetry.start, time))
        tables["tracks.csv"] = (self.tracks, "%.9g")
        files: dict[str, str | bytes] = {
            name: table.to_csv(index=False, lineterminator="\n", float_format=digits)
            for name, (table, digits) in tables.items()
        }
        files["report.txt"] = self.summary() + "\n"
        with styled():
            files["angle.png"] = png(
                angle_figure(self.angle, zero_deg=None if self.designed else self.zero_deg)
            )
            if self.pair is not None:
                files["drift.png"] = png(drift_figure(self.angle))
        for name, content in files.items():
            results.write(name, content)
        results.publish({"losbench": __version__, "notes": list(self.notes)})


def correct_telemetry(
    telemetry: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    columns: str | Path | None = None,
    convention: QuaternionConvention | None = None,
    heads: tuple[int, int] = (1, 2),
    smooth_s: float | None = None,
    window: int = 5,
    track_gap_s: float = 60.0,
    max_gap_s: float = 10.0,
    force: bool = False,
    **options: Unpack[DialectOptions],
) -> PairReport:
    """Judge the angle between two heads, corrected for their drift where spots tell of it, and
    write what came of it to a folder.

    Stellar aberration must be out of the quaternions already (`remove_aberration`): it turns heads
    that look different ways by different angles.

    Parameters
    ----------
    telemetry : path, or a sequence of paths
        CSV file with times, quaternions of the heads and positions of their reference spots, if
        there are any; or a file for each head.
    out : path
        Folder to write to, see :meth:`PairReport.write`.
    columns : path, optional
        TOML file with the names and conventions (`TelemetryFormat`); by default the first CSV
        file's name ending in .toml.
    convention : QuaternionConvention, optional
        In place of the one that the TOML file names, or does not.
    heads : two numbers
        Which two, of more than two.
    smooth_s : float, optional
        Low-pass the drift over so many seconds before it corrects.
    window : int
        Samples of the sliding mean that splits LSFE from NEA.
    track_gap_s : float
        A longer gap begins a new track.
    max_gap_s : float
        Drifts are interpolated between spots that were seen no farther apart than this.
    force : bool
        Write into a folder that is not empty.
    **options
        How the CSV file is written, where it leaves it open: as for `read_temperature_log`.

    Returns
    -------
    PairReport
        With a table of one row per sample, and the corrected quaternions as (2, n, 4) arrays.

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
    with claim(out, inputs=[*sources, described], writes=_WRITTEN, force=force) as results:
        form = _described(sources, described)
        if convention is not None:
            form = replace(form, scalar=convention.scalar, direction=convention.direction)
        read = read_telemetry(sources, form, heads=heads, dialect=Dialect(**options))
        track = split_tracks(read.pair.time_s, gap_s=track_gap_s)
        _check_steps(read.pair.time_s, track, sources[0].name, track_gap_s)
        designed = form.design_angle_deg if heads == (1, 2) else None
        report = _judged(
            read,
            track,
            designed,
            window,
            sigma_mm=None if form.spot_sigma_um is None else form.spot_sigma_um * 1e-3,
            smooth_s=smooth_s,
            max_gap_s=max_gap_s,
        )
        report.write(results)
    return report


def _judged(
    read: Telemetry, track: Ints, designed_deg: float | None, window: int, **how: float | None
) -> PairReport:
    """Correct where there are spots, and judge the angle; ``how`` is that of `correct_pair`."""
    pair = correct_pair(read.pair, **how) if read.pair.points_mm.size else None  # type: ignore[arg-type]
    before = _angle(read.pair) if pair is None else pair.before_rad
    zero = float(np.degrees(np.nanmedian(before))) if designed_deg is None else designed_deg
    angle = _angle_table(read, before, pair, zero, track)
    tracks = track_table(angle, read, window)
    drift_notes = []
    if pair is not None:
        drift_notes = head_notes(pair, **how)  # type: ignore[arg-type]
        drift_notes += change_notes(tracks)
    notes = (
        *read.notes,
        *short_notes(tracks, window),
        *drift_notes,
        *slow_notes(tracks),
        *clock_notes(read, angle),
        *missing_notes(spots=pair is not None, designed=designed_deg is not None, zero_deg=zero),
    )
    return PairReport(read, pair, zero, designed_deg is not None, angle, tracks, notes)


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
    read: Telemetry, before_rad: Floats, pair: CorrectedPair | None, zero_deg: float, track: Ints
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
            f"drift_{k + 1}_{axis}_arcsec": drift[k, :, i]
            for k in range(2)
            for i, axis in enumerate("xyz")
        }
    return pd.DataFrame(columns)


def _utc(start: np.datetime64, time_s: Floats) -> NDArray[np.str_]:
    moments = utc_after(start, np.rint(1e6 * time_s) * 1e-6) + np.timedelta64(500, "ns")
    return np.char.add(moments.astype("datetime64[us]").astype(str), "Z")


def _corrected_table(time_s: Floats, quaternions: Floats, order: str) -> pd.DataFrame:
    import pandas as pd

    columns = {
        f"q{k + 1}_{axis}": quaternions[k, :, i] for k in range(2) for i, axis in enumerate(order)
    }
    return pd.DataFrame({"time_s": time_s} | columns)
