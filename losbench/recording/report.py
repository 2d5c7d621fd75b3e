"""A measurement on disk: the table, pictures, what the reader must know, and a page to hand on."""

from __future__ import annotations

from pathlib import Path

from losbench.made import Made, head_of
from losbench.outputs import Claim, into
from losbench.page import Answer, Picture, page, replies_to_dict
from losbench.pointing.performance import PointingMetrics
from losbench.pointing.told import (
    Sensitivity,
    metric_numbers,
    metric_sentences,
    metrics_figure,
    table_of,
)
from losbench.recording import pictures
from losbench.recording.measurement import Measurement
from losbench.recording.performance import metrics_of
from losbench.recording.readers import Recording
from losbench.recording.sections import CHAPTERS, Told, answers, numbers
from losbench.recording.sensitivity import ABOUT, sensitivity_of, temperature_columns

__all__ = ["WRITTEN", "write_report"]

WRITTEN = (
    "measurement.csv",
    "sensitivity.csv",
    "metrics.csv",
    "frame.png",
    "shifts.png",
    "angles.png",
    "leftover.png",
    "temperature.png",
    "angles-over-temperature.png",
    "compensated.png",
    "metrics.png",
    "report.html",
)


def write_report(
    measurement: Measurement,
    folder: Path | Claim,
    *,
    recording: Recording,
    other: Measurement | None = None,
    made: Made | None = None,
    window_s: float | None = None,
) -> list[str]:
    """Write ``measurement.csv``, pictures, ``report.html``, and ``report.json``.

    The page shows all that there is, on its own and without a network. With a camera there are
    angles, with times ``metrics.csv``, with temperatures ``sensitivity.csv`` and the angles less
    what goes with the first of them, in columns of the table.

    Parameters
    ----------
    measurement : Measurement
        With positions as an (F, n, 2) array and its table.
    folder : Path or Claim
        Made if it is not there; what an earlier run left in it is replaced in one swap.
    recording : Recording
        What was measured.
    other : Measurement, optional
        The same spots by another centroid, for `Measurement.belief`.
    made : Made, optional
        The command and its settings, for the page's last chapter.
    window_s : float, optional
        Length of the windows of the pointing metrics; a tenth of the record unless given.

    Returns
    -------
    list of str
        The report's lines, for the terminal.
    """
    from losbench.figures import styled

    table, name = measurement.table, recording.source.resolve().name
    belief, fit = measurement.belief(other), sensitivity_of(measurement)
    metrics = metrics_of(measurement, window_s)
    said = belief.sentences()
    if fit is not None:
        said += [*fit.sentences(), *fit.notes()]
        table = fit.compensated(table)
    if metrics is not None:
        said += [*metric_sentences(metrics, ABOUT), *metrics.notes]
    counted = f"{len(table)} frames, {len(measurement.reference_px)} spots: {name}"
    with styled():
        drawn = _pictures(measurement, recording, fit, metrics)
        told = Told(measurement, recording, belief, fit, drawn, made or Made(), metrics)
        replies = answers(told)
        files: dict[str, str | bytes] = {
            "report.html": _page(told, replies),
            "measurement.csv": table.to_csv(index=False, lineterminator="\n", float_format="%.9g"),
        }
        if fit is not None:
            files["sensitivity.csv"] = table_of(fit.found.table(), ABOUT)
        if metrics is not None:
            files["metrics.csv"] = table_of(metrics.table(), ABOUT)
        files |= {f"{each}.png": picture.png() for each, picture in drawn.items()}
    report = {
        **head_of("measurement", told.made),
        "source": name,
        "frames": len(table),
        "answers": replies_to_dict(replies),
        "reference_px": measurement.reference_px.round(4).tolist(),
        "notes": list(measurement.notes),
        "belief": belief.to_dict(),
        "sensitivity_to": None if fit is None else fit.column,
        "sensitivity": None if fit is None else fit.numbers(),
        "sensitivity_notes": [] if fit is None else fit.notes(),
        "pointing": None if metrics is None else metric_numbers(metrics, ABOUT),
        **numbers(told),
    }
    with into(folder, WRITTEN) as results:
        for file, content in files.items():
            results.write(file, content)
        results.publish(report)
    names = ", ".join([*files, "report.json"])
    return [counted, *measurement.notes, *said, f"Written to {results.folder}: {names}"]


def _subtitle(told: Told) -> str:
    frames, spots = told.measurement.xy_px.shape[:2]
    line = f"{frames} frames of {spots} spot{'s' * (spots > 1)}"
    seconds = told.measurement.table.get("time_s")
    if seconds is not None and seconds.notna().any():
        line += f" within {seconds.max() - seconds.min():.6g} s"
    return f"{line}, measured at {told.made.when_utc}"


def _page(told: Told, replies: list[Answer]) -> str:
    return page(
        f"Measurement of {told.recording.source.resolve().name}",
        _subtitle(told),
        replies,
        {question: [say(told) for say in parts] for question, parts in CHAPTERS.items()},
        made=told.made,
        files=[
            "measurement.csv",
            *["sensitivity.csv"] * (told.sensitivity is not None),
            *["metrics.csv"] * (told.metrics is not None),
            "report.json",
            *(f"{each}.png" for each in told.pictures),
        ],
    )


def _pictures(
    measurement: Measurement,
    recording: Recording,
    fit: Sensitivity | None,
    metrics: PointingMetrics | None,
) -> dict[str, Picture]:
    drawn = {
        "frame": Picture(
            "A frame with its spots",
            "The first frame that shows every spot, and each spot from near, in pixels of the "
            "detector; a circle finds the spot, a cross marks the centroid, a square its window.",
            pictures.frame_figure(measurement, recording),
        ),
        "shifts": Picture(
            "Shifts of the spots",
            "How far each spot moved from its reference.",
            pictures.shifts_figure(measurement),
        ),
    }
    if measurement.attitude is not None:
        drawn["angles"] = Picture(
            "Angles over time",
            "The rotation that the shifts tell of, with the one-sigma error of each frame.",
            pictures.angles_figure(measurement),
        )
        drawn["leftover"] = Picture(
            "What the angles leave of the shifts",
            "Shift less that of a camera that only turns, on the detector.",
            pictures.leftover_figure(measurement),
        )
    if temperature_columns(measurement.table):
        drawn["temperature"] = Picture(
            "Temperatures over time",
            "Every sensor, at the frames.",
            pictures.temperature_figure(measurement),
        )
    if fit is not None:
        drawn["angles-over-temperature"] = Picture(
            "Angles over temperature",
            "What was measured and what the fitted sensitivity says.",
            pictures.over_temperature_figure(measurement, fit),
        )
        drawn["compensated"] = Picture(
            "Angles compensated for temperature",
            "Measured and predicted by the temperature, and what that leaves over.",
            pictures.compensated_figure(measurement, fit),
        )
    if metrics is not None:
        drawn["metrics"] = Picture(
            "Pointing metrics",
            "How far the line of sight is off, moves and shakes within a window, with 95 % "
            "intervals.",
            metrics_figure(metrics, ABOUT),
        )
    return drawn
