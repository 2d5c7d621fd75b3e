"""The report of telemetry, a section each: a function of what is `Told` to its HTML, and nothing
where it does not apply.

A new section is a new function in `CHAPTERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from losbench.made import Made
from losbench.page import QUESTIONS, Answer, Doubt, Picture, most_telling, section, sentences, table
from losbench.pointing.told import (
    compensated_figure,
    metrics_figure,
    metrics_section,
    sensitivity_section,
)
from losbench.telemetry.conventions import evidence
from losbench.telemetry.pictures import angle_figure, drift_figure, leftover_figure
from losbench.telemetry.pointing import names_of
from losbench.telemetry.report import PairReport, all_tracks
from losbench.telemetry.tracks import track_lines

__all__ = ["CHAPTERS", "Told", "answers", "pictures_of"]

_WORKED, _BELIEF, _NUMBER, _CHANGE, _ = QUESTIONS
_MISSING = 0.05  # share of samples without an angle that is worth a word on top
_MOST_TRACKS = 40  # in a table of the page; tracks.csv has all


@dataclass(frozen=True)
class Told:
    """What a report may speak of: every pair, and its pictures by the name of their files."""

    pairs: tuple[PairReport, ...]
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    made: Made = field(default_factory=Made)

    def named(self) -> Iterator[tuple[str, str, PairReport]]:
        """Each pair with what its headings end with, and its files' names begin with."""
        for pair in self.pairs:
            several = f", heads {pair.heads[0]} and {pair.heads[1]}" * (len(self.pairs) > 1)
            yield several, f"{pair.heads[0]}-{pair.heads[1]}-" * bool(several), pair


def answers(told: Told) -> list[Answer]:
    """Answer the first four questions in a line each."""
    known, every = _counted(told)
    doubts = [note for pair in told.pairs for note in pair.notes if isinstance(note, Doubt)]
    missing = 1.0 - known / every
    worked = Answer(
        "Yes" if missing <= _MISSING else "In part" if known else "No",
        f"{known} of {every} samples have an angle between the heads.",
        "good" if missing <= _MISSING else "care" if known else "bad",
    )
    believed = (
        Answer("With care", most_telling(doubts), "care")
        if doubts
        else Answer("Yes", f"Nothing speaks against it. {_steadiest(told.pairs[0])}", "good")
    )
    lines = _changes(told)
    count = f"{len(lines)} thing{'s' * (len(lines) > 1)}" if lines else "Nothing known"
    return [worked, believed, _number(told.pairs[0]), Answer(count, lines[0] if lines else "")]


def pictures_of(report: PairReport, first: PairReport) -> dict[str, Picture]:
    """Draw a pair's pictures, by the name of their file."""
    several = f", heads {report.heads[0]} and {report.heads[1]}" if first.others else ""
    drawn = {
        "angle": Picture(
            f"Angle between the heads{several}",
            "Each track beside the next, on one scale.",
            angle_figure(report.angle, zero_deg=None if report.designed else report.zero_deg),
        )
    }
    if report.pair is not None:
        drawn["drift"] = Picture(
            f"Drift of each head{several}",
            "The turn that the reference spots tell of, tracks laid end to end.",
            drift_figure(report.angle, report.heads),
        )
        drawn["leftover"] = Picture(
            f"What a turn leaves of the spots' shifts{several}",
            "Shift less that of a head that only turns, on the detector.",
            leftover_figure(report.angle, report.pair, report.heads),
        )
    if report.metrics is not None:
        drawn["metrics"] = Picture(
            f"Pointing metrics of the angle{several}",
            "How far it is off, moves and shakes within a window, with 95 % intervals.",
            metrics_figure(report.metrics, names_of(report.angle)),
        )
    if report.sensitivity is not None:
        drawn["compensated"] = Picture(
            f"Angle compensated for temperature{several}",
            "Measured and predicted by the temperature, and what that leaves over.",
            compensated_figure(
                report.sensitivity,
                report.angle,
                report.angle["time_s"].to_numpy(),
                "time (s)",
            ),
        )
    return drawn


def _counted(told: Told) -> tuple[int, int]:
    known = sum(int(pair.angle["before_arcsec"].notna().sum()) for pair in told.pairs)
    return known, sum(len(pair.angle) for pair in told.pairs)


def _steadiest(report: PairReport) -> str:
    """How much steadier the angle is than by the next convention."""
    pair = report.telemetry.pair
    found = evidence(pair.quaternions, tuple(pair.boresight))
    named = next(each for each in found if each.convention == pair.convention)
    others = min(each.scatter_arcsec for each in found if each is not named)
    return (
        f"By the convention named the angle scatters by {named.scatter_arcsec:.2g} arcsec, by any "
        f"other by {others:.2g} or more."
    )


def _number(report: PairReport) -> Answer:
    angle = report.zero_deg + report.angle["before_arcsec"].mean() / 3600.0
    line = track_lines(report.tracks, report.zero_deg)[-1]
    said = line if line.startswith("track") and " to " in line else ""
    spread = report.angle["before_arcsec"].std(ddof=0)
    first = f"between heads {report.heads[0]} and {report.heads[1]}, standard deviation "
    sigma = report.tracks["mean_before_sigma_arcsec"].iloc[0] if len(report.tracks) == 1 else 0.0
    error = f"; the mean is known to ± {sigma:.2g} arcsec (1 sigma)" if sigma > 0 else ""
    return Answer(f"{angle:.5f} deg", f"{first}{spread:.3g} arcsec{error}. {said}".strip())


def _changes(told: Told) -> list[str]:
    """What would change the numbers."""
    lines = []
    for pair in told.pairs:
        if pair.pair is None:
            lines.append("Reference spots: they tell which head turns, and take its drift out.")
        if not pair.designed:
            lines.append("A design angle: it would check the convention against the mounting.")
        if pair.tracks.filter(like="lsfe").isna().all(axis=None):
            lines.append(
                "Longer tracks: these are too short for a split into slow error and noise."
            )
    return list(dict.fromkeys(lines))


def samples(told: Told) -> str:
    """How many samples each track has, and how many of them have an angle."""
    rows = [
        [
            *([row["heads"]] if "heads" in row else []),
            row["track"],
            row["start"],
            row["samples"],
            row["missing"],
        ]
        for row in _tracks(told)
    ]
    heads = ["heads"] * (len(told.pairs) > 1) + ["track", "start", "samples", "without an angle"]
    return section("Tracks", table(heads, rows, caption="Samples of each track" + _cut(told)))


def notes(told: Told) -> str:
    """What was noticed."""
    return "\n".join(
        section(f"What was noticed{several}", sentences(pair.notes))
        for several, _, pair in told.named()
    )


def conventions(told: Told) -> str:
    """How steady the angle is by every convention."""
    parts = []
    for several, _, report in told.named():
        pair = report.telemetry.pair
        rows = [
            [
                str(each.convention),
                f"{each.angle_deg:.5f}",
                each.scatter_arcsec,
                "named" * (each.convention == pair.convention),
            ]
            for each in evidence(pair.quaternions, tuple(pair.boresight))
        ]
        heads = ["convention", "median angle (deg)", "scatter (arcsec)", ""]
        caption = "Half-width of the middle half of all angles, by convention"
        parts.append(section(f"Which convention{several}", table(heads, rows, caption=caption)))
    return "\n".join(parts)


def leftover(told: Told) -> str:
    """What a turn leaves of the spots' shifts."""
    return _drawn(told, "Residuals of the spots", "leftover")


def angles(told: Told) -> str:
    """The angle of each track and its split."""
    after = any("mean_after_arcsec" in row for row in _tracks(told))
    columns = {
        "mean_before_arcsec": "mean",
        "mean_before_sigma_arcsec": "its error",
        **(
            {"mean_after_arcsec": "mean corrected"}
            if after
            else {"std_before_arcsec": "standard deviation"}
        ),
        "total_before_arcsec": "total, 3 sigma",
        **({"total_after_arcsec": "total corrected"} if after else {}),
        "lsfe_unbiased_arcsec": "slow (LSFE), 3 sigma",
        "lsfe_unbiased_sigma_arcsec": "its error",
        "nea_unbiased_arcsec": "noise (NEA), 3 sigma",
        "nea_unbiased_sigma_arcsec": "its error",
    }
    rows = [
        [
            *([row["heads"]] if "heads" in row else []),
            row["track"],
            *(f"{row[name]:.3g}" if np.isfinite(row[name]) else "" for name in columns),
        ]
        for row in _tracks(told)
    ]
    zeros = "; ".join(
        f"{pair.zero_deg:.6f} deg{several}, {'the design' if pair.designed else 'the median'}"
        for several, _, pair in told.named()
    )
    heads = [*["heads"] * (len(told.pairs) > 1), "track", *columns.values()]
    caption = f"Angle less {zeros}, and its split into slow error and noise, arcsec{_cut(told)}"
    return section("Angle between the heads", table(heads, rows, caption=caption)) + _drawn(
        told, "", "angle"
    )


def metrics(told: Told) -> str:
    """Pointing metrics of each pair's angle."""
    return "\n".join(
        metrics_section(
            pair.metrics,
            names_of(pair.angle),
            told.pictures[f"{before}metrics"].html(),
            title=several,
        )
        for several, before, pair in told.named()
        if pair.metrics is not None
    )


def sensitivity(told: Told) -> str:
    """Sensitivity of each pair's angle to temperature."""
    return "\n".join(
        sensitivity_section(
            pair.sensitivity, told.pictures[f"{before}compensated"].html(), title=several
        )
        for several, before, pair in told.named()
        if pair.sensitivity is not None
    )


def drift(told: Told) -> str:
    """The drift of each head."""
    return _drawn(told, "Drift of the heads", "drift")


def changes(told: Told) -> str:
    """What would change the numbers."""
    return section("What to try next", sentences(_changes(told)))


CHAPTERS: dict[str, list[Callable[[Told], str]]] = {
    _WORKED: [samples, notes],
    _BELIEF: [conventions, leftover],
    _NUMBER: [angles, metrics, sensitivity, drift],
    _CHANGE: [changes],
}


def _tracks(told: Told) -> list[dict[str, Any]]:
    table = all_tracks(told.pairs[0]).head(_MOST_TRACKS)
    return [dict(zip(table.columns, row, strict=True)) for row in table.itertuples(index=False)]


def _cut(told: Told) -> str:
    count = sum(len(pair.tracks) for pair in told.pairs)
    return f", the first {_MOST_TRACKS} of {count}" if count > _MOST_TRACKS else ""


def _drawn(told: Told, title: str, name: str) -> str:
    parts = [
        told.pictures[f"{before}{name}"].html()
        for _, before, _ in told.named()
        if f"{before}{name}" in told.pictures
    ]
    return section(title, *parts) if title else "\n".join(parts)
