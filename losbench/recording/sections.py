"""The report of a measurement, a section each: a function of what is `Told` to its HTML, and
nothing where it does not apply.

A new section is a new function in `CHAPTERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from losbench.imaging.results import SpotFlag
from losbench.made import Made
from losbench.page import QUESTIONS, Answer, Picture, most_telling, section, sentences, table
from losbench.pointing.performance import PointingMetrics
from losbench.pointing.told import Sensitivity, metrics_section, sensitivity_section
from losbench.recording.belief import Belief
from losbench.recording.measurement import Measurement
from losbench.recording.pictures import windows_px
from losbench.recording.readers import Recording
from losbench.recording.sensitivity import ABOUT, AXES, temperature_columns
from losbench.units import rad_to_arcsec

__all__ = ["CHAPTERS", "Told", "answers", "numbers"]

_WORKED, _BELIEF, _NUMBER, _CHANGE, _ = QUESTIONS
_MARKED = 0.01  # share of centroids with a flag that is worth a word on top
_FIT_BADLY = 0.10  # share of frames with a p-value below 0.05


@dataclass(frozen=True)
class Told:
    """What a report may speak of: a measurement, and what was made of it."""

    measurement: Measurement
    recording: Recording
    belief: Belief
    sensitivity: Sensitivity | None
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    made: Made = field(default_factory=Made)
    metrics: PointingMetrics | None = None


def answers(told: Told) -> list[Answer]:
    """Answer the first four questions in a line each."""
    doubts, known = _doubts(told), np.isfinite(told.measurement.xy_px).all(axis=2)
    n_frames, n_spots = known.shape
    all_known = bool(known.all())
    worked = Answer(
        "Yes" if all_known else "In part" if known.any() else "No",
        f"{int(known.sum())} of {known.size} positions measured: {n_spots} spots in {n_frames} "
        "frames.",
        "good" if all_known else "care" if known.any() else "bad",
    )
    believed = (
        Answer("With care", most_telling(doubts), "care")
        if doubts
        else Answer("Yes", "The data themselves speak against none of it.", "good")
    )
    changes = _changes(told)
    return [
        worked,
        believed,
        _number(told),
        Answer(_counted(len(changes)), changes[0] if changes else ""),
    ]


def _counted(n: int) -> str:
    return "Nothing known" if n == 0 else f"{n} thing{'s' * (n > 1)}"


def _number(told: Told) -> Answer:
    if told.sensitivity is not None:
        found = told.sensitivity.numbers()
        sizes = {AXES[axis]: each["arcsec_per_degC"] for axis, each in found.items()}
        known = {
            AXES[axis]: abs(each["arcsec_per_degC"])
            for axis, each in found.items()
            if np.prod(each["interval_95_arcsec_per_degC"]) > 0
            and each["lag_state"] != "not identifiable"
        }
        first = max(known or sizes, key=lambda axis: abs(sizes[axis]))
        low, high = next(
            each["interval_95_arcsec_per_degC"]
            for axis, each in found.items()
            if AXES[axis] == first
        )
        others = ", ".join(
            f"{sizes[axis]:+.3g} about {axis}" + " (not told from none)" * (axis not in known)
            for axis in sizes
            if axis != first
        )
        return Answer(
            f"{sizes[first]:+.3g} arcsec/degC",
            f"about {first} (95 %: {low:+.3g} to {high:+.3g}); {others}.",
        )
    if told.measurement.attitude is not None:
        axes = numbers(told)["angles"]
        widest = max(axes, key=lambda axis: axis["peak_to_valley_arcsec"])
        others = ", ".join(
            f"{axis['peak_to_valley_arcsec']:.3g} about {axis['axis']} (± "
            f"{axis['one_sigma_of_a_frame_arcsec']:.2g})"
            for axis in axes
            if axis is not widest
        )
        return Answer(
            f"{widest['peak_to_valley_arcsec']:.3g} arcsec",
            f"peak to valley about {widest['axis']}, the largest of three axes, where one frame "
            f"is known to ± {widest['one_sigma_of_a_frame_arcsec']:.2g} (1 sigma); {others}.",
        )
    span = np.nanmax(told.measurement.shifts_px, axis=0) - np.nanmin(
        told.measurement.shifts_px, axis=0
    )
    spot, i = np.unravel_index(int(np.nanargmax(span)), span.shape)
    return Answer(f"{span[spot, i]:.4g} px", f"peak to valley of spot {spot + 1} along {'xy'[i]}.")


def _doubts(told: Told) -> list[str]:
    """What speaks against the numbers, a sentence each."""
    belief = told.belief
    of_scatter = belief.sentences()[0]
    untested = of_scatter.endswith("too few frames to tell.")
    lines = [] if untested or of_scatter.endswith(": as predicted.") else [of_scatter]
    if any(survey.doubts for survey in told.measurement.surveys):
        lines.append("The frames contradict the detector.")
    untold = _untold(told)
    if untold:
        lines.append(f"About {', '.join(untold)} the lag, and so the sensitivity, is not told.")
    marked = np.count_nonzero(told.measurement.flags) / belief.n_centroids
    if marked > _MARKED:
        lines.append(f"{100 * marked:.0f} % of the centroids carry a flag.")
    p_value = np.array([]) if belief.p_value is None else _known(belief.p_value[:, None])
    if p_value.size and np.mean(p_value < 0.05) > _FIT_BADLY + 2 / np.sqrt(p_value.size):
        lines.append("The spots do not move as a camera that only turns would move them.")
    slope = belief.slope
    if slope is not None and abs(slope.value - 1.0) > 3.0 * slope.error:
        lines.append("Two centroids disagree about the drift.")
    return [*lines, of_scatter] if untested else lines


def _untold(told: Told) -> list[str]:
    """Axes whose lag behind the temperature the record does not tell."""
    states = [] if told.sensitivity is None else told.sensitivity.lag_state
    return [AXES[a] for a, state in zip(AXES, states, strict=False) if state == "not identifiable"]


def _changes(told: Told) -> list[str]:
    """What would change the numbers, the most telling first."""
    measurement, fit, lines = told.measurement, told.sensitivity, []
    if fit is not None:
        untold = _untold(told)
        if untold:
            lines.append(
                f"A longer record: about {', '.join(untold)} it does not tell how far the angle "
                "lags behind the temperature, and the sensitivity depends on that."
            )
        sensors = len(temperature_columns(measurement.table))
        if sensors > 1:
            lines.append(
                f"Another sensor: the sensitivity is to {fit.column}, the first of {sensors}."
            )
    elif measurement.attitude is not None:
        lines.append("Temperatures that move: without them there is no sensitivity.")
    if measurement.attitude is None:
        lines.append("A camera: with its focal length the shifts become angles.")
    if told.recording.detector is None:
        lines.append("A detector's gain and noise: the predicted errors would be those of it.")
    elif any(survey.doubts for survey in measurement.surveys):
        lines.append("The detector's true gain and noise: the predicted errors rest on them.")
    if measurement.xy_px.shape[1] == 2 and measurement.attitude is not None:
        lines.append("A third spot: two cannot tell which of them is bad.")
    return lines


def numbers(told: Told) -> dict[str, list[dict[str, Any]]]:
    """Return what the page's tables of spots, angles and temperatures hold, as report.json has
    it.
    """
    frame, attitude = told.measurement.table, told.measurement.attitude
    seen = np.logical_and.reduce(np.isfinite(told.measurement.xy_px), axis=2)
    marked = np.count_nonzero(told.measurement.flags, axis=0)
    sides = windows_px(told.measurement)
    spots = [
        {
            "spot": n + 1,
            "reference_x_px": x,
            "reference_y_px": y,
            "window_px": sides[n],
            "frames_measured": int(seen[:, n].sum()),
            "frames_flagged": int(marked[n]),
        }
        for n, (x, y) in enumerate(told.measurement.reference_px.round(4).tolist())
    ]
    angles = []
    if attitude is not None:
        arcsec = rad_to_arcsec(attitude.angles)
        sigma = rad_to_arcsec(np.sqrt(np.diagonal(attitude.cov, axis1=-2, axis2=-1)))
        angles = [
            {
                "axis": name,
                "rms_about_mean_arcsec": float(np.nanstd(arcsec[:, i])),
                "peak_to_valley_arcsec": float(np.ptp(_known(arcsec)[:, i])),
                "one_sigma_of_a_frame_arcsec": float(np.nanmedian(sigma[:, i])),
            }
            for i, name in enumerate(AXES.values())
        ]
    temperatures = [
        {
            "sensor": name.removesuffix("_degC"),
            "lowest_degC": float(frame[name].min()),
            "highest_degC": float(frame[name].max()),
            "frames_with_a_reading": int(frame[name].notna().sum()),
        }
        for name in temperature_columns(frame)
    ]
    return {"spots": spots, "angles": angles, "temperatures": temperatures}


def spots(told: Told) -> str:
    """Where each spot is, how often it was seen and how often it carries a flag."""
    rows = [
        [
            each["spot"],
            f"{each['reference_x_px']:.3f}",
            f"{each['reference_y_px']:.3f}",
            "" if each["window_px"] is None else each["window_px"],
            each["frames_measured"],
            each["frames_flagged"],
        ]
        for each in numbers(told)["spots"]
    ]
    heads = [
        "spot",
        "reference x (px)",
        "reference y (px)",
        "window (px)",
        "frames measured",
        "frames flagged",
    ]
    return section(
        "Spots",
        table(heads, rows, caption=f"Spots, in {len(told.measurement.table)} frames"),
        _drawn(told, "frame"),
    )


def notes(told: Told) -> str:
    """What was noticed."""
    return section("What was noticed", sentences(told.measurement.notes))


def against(told: Told) -> str:
    """All that speaks against the numbers."""
    return section("What speaks against it", sentences(_doubts(told)))


def scatter(told: Told) -> str:
    """Scatter against predicted error, of each coordinate."""
    heads = ["coordinate", "scatter (mpx)", "predicted (mpx)", "ratio", "error of the ratio"]
    rows = [
        [
            name,
            *(f"{1e3 * px:.3g}" for px in row[:2]),
            *("" if np.isnan(ratio) else f"{ratio:.2f}" for ratio in row[2:]),
        ]
        for name, *row in told.belief.to_frame().itertuples()
    ]
    return section(
        "Scatter against predicted error",
        sentences(told.belief.sentences()),
        table(heads, rows, caption="From frame to frame, and as predicted, in 1/1000 of a pixel"),
    )


def flags(told: Told) -> str:
    """The flags that any centroid carries, with what they mean."""
    rows = [
        [name, count, SpotFlag[name].sentence.replace("``", "")]
        for name, count in told.belief.flags.items()
    ]
    heads = ["flag", "centroids", "meaning"]
    return section("Flags", table(heads, rows, caption=f"Of {told.belief.n_centroids} centroids"))


def leftover(told: Told) -> str:
    """What the angles leave of the shifts."""
    return section("Residuals", _drawn(told, "leftover"))


def sensitivity(told: Told) -> str:
    """Sensitivity of each axis to the first temperature, and whether to trust it."""
    if told.sensitivity is None:
        return ""
    drawn = (_drawn(told, name) for name in ("compensated", "angles-over-temperature"))
    return sensitivity_section(told.sensitivity, *drawn)


def metrics(told: Told) -> str:
    """Pointing metrics of each axis."""
    if told.metrics is None:
        return ""
    return metrics_section(told.metrics, ABOUT, _drawn(told, "metrics"))


def angles(told: Told) -> str:
    """The angles' size and error."""
    heads = [
        "axis",
        "rms about the mean (arcsec)",
        "peak to valley (arcsec)",
        "one-sigma error of a frame (arcsec)",
    ]
    rows = [list(each.values()) for each in numbers(told)["angles"]]
    return section("Angles", table(heads, rows, caption="Over all frames"), _drawn(told, "angles"))


def shifts(told: Told) -> str:
    """The shifts of each spot."""
    return section("Shifts", _drawn(told, "shifts"))


def temperatures(told: Told) -> str:
    """What the sensors said."""
    heads = ["sensor", "lowest (degC)", "highest (degC)", "frames with a reading"]
    rows = [list(each.values()) for each in numbers(told)["temperatures"]]
    return section(
        "Temperatures",
        table(heads, rows, caption="At the frames"),
        _drawn(told, "temperature"),
    )


def changes(told: Told) -> str:
    """What would change the numbers."""
    return section("What to try next", sentences(_changes(told)))


CHAPTERS: dict[str, list[Callable[[Told], str]]] = {
    _WORKED: [spots, notes],
    _BELIEF: [against, scatter, flags, leftover],
    _NUMBER: [sensitivity, metrics, angles, shifts, temperatures],
    _CHANGE: [changes],
}


def _drawn(told: Told, name: str) -> str:
    return told.pictures[name].html() if name in told.pictures else ""


def _known(values: np.ndarray) -> np.ndarray:
    """Rows without a NaN."""
    return values[np.isfinite(values).all(axis=1)]
