"""A pair's tracks, one by one: the angle's mean, its error split, and how both are told."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats
from losbench.estimation.memory import variance_sampling
from losbench.estimation.stability import split_error
from losbench.series import mark_gaps
from losbench.tables.moments import utc_after
from losbench.telemetry.read import Telemetry

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ends", "short_notes", "track_lines", "track_table"]


_SHORTEST_TRACK = 20  # samples, for an error split
_SPARSEST = 8  # steps of the clock between angles; beyond, a slow head looks like an outage


def track_lines(tracks: pd.DataFrame, zero_deg: float) -> list[str]:
    """Every track in a line, then the change from the first to the last."""
    if "mean_after_arcsec" in tracks:
        told = [_track_line(row) for _, row in tracks.iterrows()]
    else:
        told = [_plain_line(row, zero_deg) for _, row in tracks.iterrows()]
    return [*told, *_change_line(tracks)]


def track_table(angle: pd.DataFrame, read: Telemetry, window: int) -> pd.DataFrame:
    """One row per track of the angle table, see `PairReport.tracks`."""
    import pandas as pd

    rows = []
    told = [which for which in ("before", "after") if f"{which}_arcsec" in angle]
    for track, samples in angle.groupby("track"):
        time = samples["time_s"].to_numpy()
        row: dict[str, object] = {
            "track": track,
            "start": _instant(read.start, time[0]),
            "samples": len(samples),
            "missing": int(samples[f"{told[-1]}_arcsec"].isna().sum()),
        }
        for which in told:
            series = samples[f"{which}_arcsec"].to_numpy()
            known = np.count_nonzero(np.isfinite(series))
            gapped = mark_gaps(*_on_own_step(time, series))
            row[f"mean_{which}_arcsec"] = np.nanmean(series) if known else np.nan
            if len(told) == 1:
                row["std_before_arcsec"] = np.nanstd(series) if known else np.nan
            row[f"mean_{which}_sigma_arcsec"] = (
                np.sqrt(variance_sampling(gapped)[0]) if known > 1 else np.nan
            )
            row |= _split(gapped, window, which)
        rows.append(row)
    return pd.DataFrame(rows)


def _on_own_step(time: Floats, series: Floats) -> tuple[Floats, Floats]:
    """Drop the rows without an angle where they are the rule: a head that answers in every other
    row has a step of its own, and no run on that of the clock.
    """
    known = np.isfinite(series)
    if np.count_nonzero(known) < 2:
        return time, series
    steps = np.median(np.diff(time[known])) / np.median(np.diff(time))
    return (time[known], series[known]) if 1.5 < steps <= _SPARSEST else (time, series)


def _split(series: Floats, window: int, which: str) -> dict[str, object]:
    """The error split of one track's angle, NaN where the track is too short for it."""
    run = np.concatenate([[0], np.cumsum(np.isfinite(series))])
    whole = np.count_nonzero(run[window:] - run[:-window] == window)
    nothing = whole <= _least_samples(window) - window
    paper, fair = (
        None if nothing else split_error(series, window=window, unbiased=u) for u in (False, True)
    )
    row: dict[str, object] = {
        f"{name}_{which}_arcsec": np.nan if paper is None else float(getattr(paper, name))
        for name in ("total", "lsfe", "nea")
    }
    if which == "before":
        for name in ("lsfe", "nea"):
            row[f"{name}_unbiased_arcsec"] = np.nan if fair is None else float(getattr(fair, name))
            row[f"{name}_unbiased_sigma_arcsec"] = (
                np.nan if fair is None else float(getattr(fair, f"{name}_sigma"))
            )
    return row


def _least_samples(window: int) -> int:
    return max(_SHORTEST_TRACK, 2 * window)


def short_notes(tracks: pd.DataFrame, window: int) -> list[str]:
    """Say which split is printed, and how many tracks are too short or too full of gaps for one."""
    last = "total_after_arcsec" if "total_after_arcsec" in tracks else "total_before_arcsec"
    short = int(tracks[last].isna().sum())
    which = (
        "LSFE and NEA are three sigma before correction, unbiased: LSFE is what a mean over "
        f"{window} samples keeps, less its share of the noise. The paper's own forms are the "
        "columns lsfe_before_arcsec and nea_before_arcsec of tracks.csv."
    )
    told = [which] if short < len(tracks) else []
    return told + [
        f"{short} of {len(tracks)} tracks have fewer than {_least_samples(window)} angles, or too "
        f"few runs of {window} without a gap: no split."
    ] * (short > 0)


def _plain_line(row: pd.Series, zero_deg: float) -> str:
    line = f"track {row['track']} at {row['start']}: angle "
    if np.isnan(row["mean_before_arcsec"]):
        return line + "missing"
    line += (
        f"{zero_deg + row['mean_before_arcsec'] / 3600.0:.6f} deg, standard deviation "
        f"{row['std_before_arcsec']:.3g} arcsec ({row['samples'] - row['missing']} angles); "
    )
    if np.isnan(row["total_before_arcsec"]):
        return line + "no split"
    return line + f"3 sigma total {row['total_before_arcsec']:.3f} arcsec, {_told_split(row)}"


def _track_line(row: pd.Series) -> str:
    line = (
        f"track {row['track']} at {row['start']}: angle "
        f"{_said(row['mean_before_arcsec'], '+.3f', ' arcsec from design')}, "
        f"corrected {_said(row['mean_after_arcsec'])} ({row['samples'] - row['missing']} angles); "
    )
    if np.isnan(row["total_before_arcsec"]):
        return line + "no split"
    return line + (
        f"3 sigma total {row['total_before_arcsec']:.3f} -> "
        f"{_said(row['total_after_arcsec'], '.3f')}, {_told_split(row)}"
    )


def _told_split(row: pd.Series) -> str:
    return (
        f"LSFE {row['lsfe_unbiased_arcsec']:.3f} +- {row['lsfe_unbiased_sigma_arcsec']:.3f}, NEA "
        f"{row['nea_unbiased_arcsec']:.3f} +- {row['nea_unbiased_sigma_arcsec']:.3f}"
    )


def ends(tracks: pd.DataFrame, *columns: str) -> tuple[pd.Series, pd.Series] | None:
    """The first and the last track that have these columns; None if there are no two."""
    known = tracks.dropna(subset=list(columns))
    return (known.iloc[0], known.iloc[-1]) if len(known) > 1 else None


def _change_line(tracks: pd.DataFrame) -> list[str]:
    """The change from the first to the last track that has both angles, else of the uncorrected one
    alone.
    """
    plain = "mean_after_arcsec" not in tracks
    found = None if plain else ends(tracks, "mean_before_arcsec", "mean_after_arcsec")
    found = found or ends(tracks, "mean_before_arcsec")
    if found is None:
        return []
    first, last = found
    if plain:
        raw = _said(last["mean_before_arcsec"] - first["mean_before_arcsec"])
        return [f"track {first['track']} to {last['track']}: angle changed by {raw} arcsec"]
    raw, corrected = (
        _said(last[f"mean_{which}_arcsec"] - first[f"mean_{which}_arcsec"])
        for which in ("before", "after")
    )
    return [
        f"track {first['track']} to {last['track']}: angle changed by {raw} arcsec, corrected "
        f"{corrected}"
    ]


def _said(value: float, form: str = "+.3f", unit: str = "") -> str:
    return "missing" if np.isnan(value) else format(value, form) + unit


def _instant(start: np.datetime64 | None, seconds: float) -> str:
    if start is None:
        return f"{seconds:.10g} s"
    moment = utc_after(start, np.array([seconds]))[0]
    return f"{moment.astype('datetime64[ms]')}Z"
