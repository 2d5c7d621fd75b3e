"""What the telemetry of heads says, as text and on disk: tables, pictures, a page to hand on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.made import Made, head_of
from losbench.outputs import Claim
from losbench.page import Picture, page, replies_to_dict
from losbench.pointing.performance import PointingMetrics
from losbench.pointing.starcamera import CorrectedPair
from losbench.pointing.told import Sensitivity, metric_numbers, metric_sentences, table_of
from losbench.tables.moments import utc_after
from losbench.telemetry.pointing import names_of
from losbench.telemetry.read import Telemetry
from losbench.telemetry.tracks import track_lines

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["WRITTEN", "PairReport", "write_pairs"]

_OF_A_PAIR = (
    "angle.csv",
    "angle.png",
    "corrected.csv",
    "drift.png",
    "leftover.png",
    "metrics.csv",
    "metrics.png",
    "sensitivity.csv",
    "compensated.png",
)
_PAIRS = list(combinations(range(1, 5), 2))
WRITTEN = (
    "report.html",
    "report.txt",
    "tracks.csv",
    *_OF_A_PAIR,
    *(f"corrected-{head}.aem" for head in range(1, 5)),
    *(f"{j}-{k}-{name}" for j, k in _PAIRS for name in _OF_A_PAIR),
)


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
        after (3 sigma; the paper's and unbiased forms with one-sigma uncertainties). NaN where the
        track cannot tell.
    notes : tuple of str
        What the reader must know, a line each.
    heads : two numbers
        Which two they are.
    others : tuple of PairReport
        The other pairs, where there are more than two heads.
    metrics : PointingMetrics or None
        Of the angle before and after, over windows that split LSFE from NEA; None where samples are
        too few.
    sensitivity : Sensitivity or None
        Of the same to the first temperature; None without one that moves.
    """

    telemetry: Telemetry
    pair: CorrectedPair | None
    zero_deg: float
    designed: bool
    angle: pd.DataFrame
    tracks: pd.DataFrame
    notes: tuple[str, ...]
    heads: tuple[int, int] = (1, 2)
    others: tuple[PairReport, ...] = ()
    metrics: PointingMetrics | None = None
    sensitivity: Sensitivity | None = None

    def summary(self) -> str:
        """Return the report as text: every track in a line, then the notes; of several pairs one
        after the other.
        """
        lines = []
        for each in (self, *self.others):
            title = [f"Heads {each.heads[0]} and {each.heads[1]}:"] if self.others else []
            lines += [*title, *track_lines(each.tracks, each.zero_deg), *each.notes]
            names = names_of(each.angle)
            if each.metrics is not None:
                lines += [*metric_sentences(each.metrics, names), *each.metrics.notes]
            if each.sensitivity is not None:
                lines += [*each.sensitivity.sentences(), *each.sensitivity.notes()]
        return "\n".join(lines)


def write_pairs(report: PairReport, results: Claim, *, made: Made) -> None:
    """Write the tables, pictures and page of a pair, and of the others; ``report.json`` is for
    `Claim.publish`.

    Tables and pictures of several pairs have the heads in front of their names.
    """
    from losbench.figures import styled
    from losbench.telemetry.sections import CHAPTERS, Told, answers, pictures_of

    pairs = (report, *report.others)
    drawn: dict[str, Picture] = {}
    with styled():
        for each in pairs:
            before = prefix(each, report)
            for name, table in _tables(each).items():
                results.write(f"{before}{name}", table)
            drawn |= {f"{before}{name}": p for name, p in pictures_of(each, report).items()}
        results.write("tracks.csv", _as_csv(all_tracks(report), "%.9g"))
        results.write("report.txt", report.summary() + "\n")
        told = Told(pairs, drawn, made)
        replies = answers(told)
        results.write(
            "report.html",
            page(
                "Heads " + " and ".join(sorted({str(h) for each in pairs for h in each.heads})),
                f"{len(report.angle)} samples: {', '.join(each.name for each in made.inputs[:-1])}",
                replies,
                {question: [say(told) for say in parts] for question, parts in CHAPTERS.items()},
                made=made,
                files=[*results.written, *(f"{name}.png" for name in drawn), "report.json"],
            ),
        )
        for name, picture in drawn.items():
            results.write(f"{name}.png", picture.png())
    results.publish(
        {
            **head_of("telemetry", made),
            "answers": replies_to_dict(replies),
            "pairs": [_numbers(each) for each in pairs],
        }
    )


def prefix(report: PairReport, first: PairReport) -> str:
    """What the names of a pair's files begin with."""
    return f"{report.heads[0]}-{report.heads[1]}-" if first.others else ""


def all_tracks(report: PairReport) -> pd.DataFrame:
    """The tracks of all pairs, which are told by a column where there are several."""
    import pandas as pd

    if not report.others:
        return report.tracks
    tables = [
        each.tracks.assign(heads=f"{each.heads[0]}-{each.heads[1]}")
        for each in (report, *report.others)
    ]
    table = pd.concat(tables, ignore_index=True)
    return table[["heads", *(name for name in table if name != "heads")]]


def _numbers(report: PairReport) -> dict[str, object]:
    known = report.angle["before_arcsec"].to_numpy()
    return {
        "heads": list(report.heads),
        "convention": str(report.telemetry.pair.convention),
        "zero_deg": report.zero_deg,
        "zero_is": "design" if report.designed else "median",
        "samples": len(known),
        "samples_with_an_angle": int(np.isfinite(known).sum()),
        "tracks": report.tracks.to_dict(orient="records"),
        "pointing": None
        if report.metrics is None
        else metric_numbers(report.metrics, names_of(report.angle)),
        "sensitivity_to": None if report.sensitivity is None else report.sensitivity.column,
        "sensitivity": None if report.sensitivity is None else report.sensitivity.numbers(),
        "sensitivity_notes": [] if report.sensitivity is None else report.sensitivity.notes(),
        "notes": list(report.notes),
    }


def _tables(report: PairReport) -> dict[str, str]:
    time = report.telemetry.pair.time_s
    order = "xyzw" if report.telemetry.pair.convention.scalar == "last" else "wxyz"
    angle, names = report.angle, names_of(report.angle)
    if report.sensitivity is not None:
        angle = report.sensitivity.compensated(angle)
    tables = {"angle.csv": (angle.assign(time_s=np.char.mod("%.6f", time)), "%.9g")}
    if report.pair is not None:
        tables["corrected.csv"] = (
            _corrected_table(time, report.pair.quaternions, report.heads, order),
            "%.12f",
        )
    if report.telemetry.start is not None:
        for table, _ in tables.values():
            table.insert(0, "time", _utc(report.telemetry.start, time))
    written = {name: _as_csv(table, digits) for name, (table, digits) in tables.items()}
    if report.metrics is not None:
        written["metrics.csv"] = table_of(report.metrics.table(), names)
    if report.sensitivity is not None:
        written["sensitivity.csv"] = table_of(report.sensitivity.found.table(), names)
    return written


def _as_csv(table: pd.DataFrame, digits: str) -> str:
    return table.to_csv(index=False, lineterminator="\n", float_format=digits)


def _utc(start: np.datetime64, time_s: Floats) -> NDArray[np.str_]:
    moments = utc_after(start, np.rint(1e6 * time_s) * 1e-6) + np.timedelta64(500, "ns")
    return np.char.add(moments.astype("datetime64[us]").astype(str), "Z")


def _corrected_table(
    time_s: Floats, quaternions: Floats, heads: Sequence[int], order: str
) -> pd.DataFrame:
    import pandas as pd

    columns = {
        f"q{head}_{axis}": quaternions[k, :, i]
        for k, head in enumerate(heads)
        for i, axis in enumerate(order)
    }
    return pd.DataFrame({"time_s": time_s} | columns)
