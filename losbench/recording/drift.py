"""The drift of a pair of star cameras taken out of its telemetry: ``losbench drift``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from losbench.estimation.stability import mark_gaps, split_error
from losbench.pointing.starcamera import CorrectedPair, correct_pair, split_tracks, time_tag_offset
from losbench.recording.columns import TelemetryFormat
from losbench.recording.telemetry import Telemetry, read_telemetry
from losbench.resources import free_folder, write_whole
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PairReport", "correct_telemetry"]

Floats = NDArray[np.float64]

_SHORTEST_TRACK = 20  # samples, for an error split
_WORST_CONDITION = 1000.0  # two spots 7 arcmin apart


@dataclass(frozen=True)
class PairReport:
    """What the telemetry of a pair says.

    Attributes
    ----------
    telemetry, pair : Telemetry, CorrectedPair
        What went in, and what the chain made of it.
    angle : DataFrame
        One row per sample: time_s, track, angle before and after less the design angle, drift of both heads, arcsec.
    tracks : DataFrame
        One row per track: means, and total, LSFE and NEA before and after (3 sigma, arcsec; the paper's and unbiased
        forms with one-sigma uncertainties).
    notes : tuple of str
        What the reader must know, a line each.
    """

    telemetry: Telemetry
    pair: CorrectedPair
    angle: pd.DataFrame
    tracks: pd.DataFrame
    notes: tuple[str, ...]

    def summary(self) -> str:
        """Return the report as text: every track in a line or two, then the notes."""
        first, last = self.tracks.iloc[0], self.tracks.iloc[-1]
        lines = [
            f"track {row.track} at {row.start}: angle {row.mean_before:+.3f} arcsec from design, corrected "
            f"{row.mean_after:+.3f}; 3 sigma total {row.total_before:.3f} -> {row.total_after:.3f}, "
            f"LSFE {row.lsfe_unbiased:.3f} +- {row.lsfe_unbiased_sigma:.3f}, "
            f"NEA {row.nea_unbiased:.3f} +- {row.nea_unbiased_sigma:.3f}"
            for row in self.tracks.itertuples()
        ]
        if len(self.tracks) > 1:
            change = [last[f"mean_{which}"] - first[f"mean_{which}"] for which in ("before", "after")]
            lines.append(f"first to last track: angle changed by {change[0]:+.3f} arcsec, corrected {change[1]:+.3f}")
        return "\n".join([*lines, *self.notes])

    def write(self, folder: Path) -> None:
        """Write ``corrected.csv``, ``angle.csv``, ``tracks.csv``, ``angle.png``, ``drift.png`` and ``report.txt``."""
        from losbench.figures import png, styled
        from losbench.recording.drift_pictures import angle_figure, drift_figure

        time = self.telemetry.pair.time_s
        order = "xyzw" if self.telemetry.pair.convention.scalar == "last" else "wxyz"
        angle = self.angle.assign(time_s=np.char.mod("%.6f", time))
        files: dict[str, str | bytes] = {
            "corrected.csv": _corrected_csv(time, self.pair.quaternions, order),
            "angle.csv": angle.to_csv(index=False, lineterminator="\n", float_format="%.9g"),
            "tracks.csv": self.tracks.to_csv(index=False, lineterminator="\n", float_format="%.9g"),
            "report.txt": self.summary() + "\n",
        }
        with styled():
            files |= {"angle.png": png(angle_figure(self.angle)), "drift.png": png(drift_figure(self.angle))}
        for name, content in files.items():
            write_whole(folder / name, content)


def correct_telemetry(
    telemetry: str | Path,
    out: str | Path,
    *,
    columns: str | Path | None = None,
    smooth_s: float | None = None,
    window: int = 5,
    track_gap_s: float = 60.0,
    force: bool = False,
) -> PairReport:
    """Correct a pair's telemetry for its drift and write what came of it to a folder.

    Parameters
    ----------
    telemetry : path
        CSV file with times, quaternions of two heads and positions of their reference spots.
    out : path
        Folder to write to, see :meth:`PairReport.write`.
    columns : path, optional
        TOML file with the names and conventions (`TelemetryFormat`); by default the CSV file's name ending in .toml.
    smooth_s : float, optional
        Low-pass the drift over so many seconds before it corrects.
    window : int
        Samples of the sliding mean that splits LSFE from NEA.
    track_gap_s : float
        A longer gap begins a new track.
    force : bool
        Write into a folder that is not empty.

    Returns
    -------
    PairReport

    Raises
    ------
    FileExistsError
        If ``out`` holds anything and ``force`` is not set.
    ValueError
        If the telemetry or its description is faulty; the message names file, column and row.
    """
    source = Path(telemetry)
    folder = free_folder(out, force=force)
    described = Path(columns) if columns is not None else source.with_suffix(".toml")
    if not source.is_file():
        raise FileNotFoundError(f"no telemetry at {source}: expected a CSV file")
    if not described.is_file():
        raise FileNotFoundError(f"no description of the columns at {described}: write one, or name it with --columns")
    form = TelemetryFormat.from_toml(described)
    read = read_telemetry(source, form)
    sigma = None if form.spot_sigma_um is None else form.spot_sigma_um * 1e-3
    pair = correct_pair(read.pair, sigma_mm=sigma, smooth_s=smooth_s)
    angle = _angle_table(read, pair, form.design_angle_deg, split_tracks(read.pair.time_s, gap_s=track_gap_s))
    tracks = _track_table(angle, read, window)
    report = PairReport(
        read,
        pair,
        angle,
        tracks,
        (*read.notes, *_short_notes(tracks, window), *_drift_notes(pair, smooth_s), *_clock_notes(read, angle)),
    )
    report.write(folder)
    return report


def _angle_table(read: Telemetry, pair: CorrectedPair, design_deg: float, track: NDArray[np.int64]) -> pd.DataFrame:
    import pandas as pd

    drift = rad_to_arcsec(pair.drift)
    return pd.DataFrame(
        {
            "time_s": read.pair.time_s,
            "track": track + 1,
            "before_arcsec": rad_to_arcsec(pair.before_rad - np.radians(design_deg)),
            "after_arcsec": rad_to_arcsec(pair.after_rad - np.radians(design_deg)),
        }
        | {f"drift_{k + 1}_{axis}_arcsec": drift[k, :, i] for k in range(2) for i, axis in enumerate("xyz")}
    )


def _track_table(angle: pd.DataFrame, read: Telemetry, window: int) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for track, samples in angle.groupby("track"):
        time = samples["time_s"].to_numpy()
        row: dict[str, object] = {
            "track": track,
            "start": _instant(read.start, time[0]),
            "samples": len(samples),
            "missing": int(samples["after_arcsec"].isna().sum()),
        }
        for which in ("before", "after"):
            series = samples[f"{which}_arcsec"].to_numpy()
            row[f"mean_{which}"] = np.nanmean(series) if np.isfinite(series).any() else np.nan
            row |= _split(mark_gaps(time, series), window, which)
        rows.append(row)
    return pd.DataFrame(rows)


def _split(series: Floats, window: int, which: str) -> dict[str, object]:
    """The error split of one track's angle, NaN where the track is too short for it."""
    nothing = np.isfinite(series).sum() < _least_samples(window)
    paper, fair = (None if nothing else split_error(series, window=window, unbiased=u) for u in (False, True))
    row: dict[str, object] = {
        f"{name}_{which}": np.nan if paper is None else float(getattr(paper, name)) for name in ("total", "lsfe", "nea")
    }
    if which == "before":
        for name in ("lsfe", "nea"):
            row[f"{name}_unbiased"] = np.nan if fair is None else float(getattr(fair, name))
            row[f"{name}_unbiased_sigma"] = np.nan if fair is None else float(getattr(fair, f"{name}_sigma"))
    return row


def _least_samples(window: int) -> int:
    return max(_SHORTEST_TRACK, 2 * window)


def _short_notes(tracks: pd.DataFrame, window: int) -> list[str]:
    short = int(np.count_nonzero(tracks["samples"] - tracks["missing"] < _least_samples(window)))
    return [f"{short} of {len(tracks)} tracks have fewer than {_least_samples(window)} angles: no split."] * (short > 0)


def _instant(start: np.datetime64 | None, seconds: float) -> str:
    if start is None:
        return f"{seconds:.10g} s"
    moment = start + np.timedelta64(round(1e9 * seconds), "ns")
    return f"{moment.astype('datetime64[ms]')}Z"


def _drift_notes(pair: CorrectedPair, smooth_s: float | None) -> list[str]:
    lines = []
    for k, fit in enumerate(pair.fits):
        error = 3.0 * np.nanmedian(fit.std_error_arcsec.reshape(-1, 3), axis=0)
        lines.append(
            f"Head {k + 1}: drift known to {error[0]:.2g}, {error[1]:.2g}, {error[2]:.2g} arcsec about x, y, z "
            f"(3 sigma, one sample); condition {fit.condition:.1f}."
        )
        if fit.condition > _WORST_CONDITION:
            lines.append(f"Head {k + 1}: the spots stand so near to each other that z is lost; is spot_unit right?")
    if smooth_s is not None:
        lines.append(f"The drift is a mean over {smooth_s:g} s.")
    return lines


def _clock_notes(read: Telemetry, angle: pd.DataFrame) -> list[str]:
    """The offset between the heads' time tags, where the first track's rate tells."""
    first = (angle["track"] == 1).to_numpy()
    heads = read.pair.quaternions[:, first]
    try:
        offset = time_tag_offset(read.pair.time_s[first], *heads, convention=read.pair.convention)
    except ValueError as error:
        return [f"Time tags of the heads not compared: {error}."]
    added, error_ms = 1e3 * offset.seconds, 1e3 * offset.sigma_s
    return [
        f"The heads agree best with {added:+.1f} +- {error_ms:.1f} ms added to the second one's time tags (white noise "
        "assumed)."
    ]


def _corrected_csv(time_s: Floats, quaternions: Floats, order: str) -> str:
    import pandas as pd

    columns = {f"q{k + 1}_{axis}": quaternions[k, :, i] for k in range(2) for i, axis in enumerate(order)}
    return pd.DataFrame({"time_s": time_s} | columns).to_csv(index=False, lineterminator="\n", float_format="%.12f")
