"""Pictures of a star-camera pair's telemetry: the angle between the heads, and their drift."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["angle_figure", "drift_figure"]


def angle_figure(angle: pd.DataFrame, *, zero_deg: float | None = None) -> Figure:
    """Each track in a panel, at most six of them, the angle before and, where there is one, after
    correction on one scale; they count from ``zero_deg``, or from the design angle.
    """
    from matplotlib.figure import Figure

    from losbench.figures import COLOURS

    tracks = [samples for _, samples in angle.groupby("track")]
    shown = tracks[:: -(-len(tracks) // 6)]
    fig = Figure(figsize=(2.6 + 2.6 * len(shown), 3.6))
    axes = np.atleast_1d(fig.subplots(1, len(shown), sharey=True))
    for axis, samples in zip(axes, shown, strict=True):
        time = samples["time_s"] - samples["time_s"].iloc[0]
        axis.plot(
            time, samples["before_arcsec"], lw=0.7, color=COLOURS["vermilion"], label="uncorrected"
        )
        if "after_arcsec" in samples:
            corrected = samples["after_arcsec"]
            axis.plot(time, corrected, lw=0.7, color=COLOURS["blue"], label="corrected")
        axis.set_title(f"track {samples['track'].iloc[0]}")
        axis.set_xlabel("time in track (s)")
    zero = "design" if zero_deg is None else f"{zero_deg:.4f} deg"
    axes[0].set_ylabel(f"angle less {zero} (arcsec)")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return fig


def drift_figure(angle: pd.DataFrame) -> Figure:
    """Each component of the drift in a panel on its own scale, both heads, the tracks side by side
    without gaps.
    """
    from matplotlib.figure import Figure

    from losbench.figures import COLOURS

    place = _places(angle)
    spans = place.groupby(angle["track"]).agg(["min", "max"])
    fig = Figure(figsize=(9.0, 6.4))
    axes = fig.subplots(3, 1, sharex=True)
    for axis, name in zip(axes, "xyz", strict=True):
        for head, colour in ((1, "orange"), (2, "purple")):
            drift = angle[f"drift_{head}_{name}_arcsec"]
            axis.plot(
                place, drift, ".", ms=1.5, alpha=0.5, color=COLOURS[colour], label=f"head {head}"
            )
        for before, after in zip(spans["max"].iloc[:-1], spans["min"].iloc[1:], strict=True):
            axis.axvline((before + after) / 2, color=COLOURS["black"], lw=0.6)
        axis.set_ylabel(f"drift about {name} (arcsec)")
        axis.margins(x=0.01)
        axis.grid(visible=len(spans) == 1, axis="x")
    fig.legend(
        *axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, markerscale=6
    )
    if len(spans) == 1:
        axes[-1].set_xlabel("time in track (s)")
        return fig
    labelled = spans.iloc[:: -(-len(spans) // 10)]
    names = [f"track {track}\n{last - first:.0f} s" for track, first, last in labelled.itertuples()]
    axes[-1].set_xticks(labelled.mean(axis=1), names)
    axes[-1].set_xlabel("time, the gaps between tracks cut out")
    return fig


def _places(angle: pd.DataFrame) -> pd.Series:
    """Seconds within the tracks, laid end to end with a twentieth of a mean track between them."""
    time = angle.groupby("track")["time_s"]
    length = time.max() - time.min()
    between = 0.05 * length.mean() or 1.0
    start = (length + between).cumsum() - (length + between)
    return angle["time_s"] - time.transform("min") + angle["track"].map(start)
