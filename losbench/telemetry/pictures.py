"""Pictures of a star-camera pair's telemetry: the angle between the heads, and their drift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats
from losbench.pointing.starcamera import CorrectedPair

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["angle_figure", "drift_figure", "leftover_figure"]

_MANY = 3000  # points of a line, beyond which it is drawn as an image


def angle_figure(angle: pd.DataFrame, *, zero_deg: float | None = None) -> Figure:
    """Each track in a panel, at most six of them, the angle before and, where there is one, after
    correction on one scale; they count from ``zero_deg``, or from the design angle.
    """
    from matplotlib.figure import Figure

    from losbench.figures import COLOURS

    tracks = [samples for _, samples in angle.groupby("track")]
    shown = tracks[:: -(-len(tracks) // 6)]
    fig = Figure(figsize=(max(2.6 + 2.6 * len(shown), 8.0), 3.6))
    axes = np.atleast_1d(fig.subplots(1, len(shown), sharey=True))
    lines = {"before": ("uncorrected", "vermilion"), "after": ("corrected", "blue")}
    for axis, samples in zip(axes, shown, strict=True):
        time = samples["time_s"] - samples["time_s"].iloc[0]
        for which, (label, colour) in lines.items():
            if f"{which}_arcsec" in samples:
                axis.plot(
                    time,
                    samples[f"{which}_arcsec"],
                    lw=0.7,
                    color=COLOURS[colour],
                    label=label,
                    rasterized=len(time) > _MANY,
                )
        axis.set_title(f"track {samples['track'].iloc[0]}")
        axis.set_xlabel("time in track (s)")
    zero = "design" if zero_deg is None else f"{zero_deg:.4f} deg"
    axes[0].set_ylabel(f"angle less {zero} (arcsec)")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return fig


def drift_figure(angle: pd.DataFrame, heads: Sequence[int]) -> Figure:
    """Each component of the drift in a panel on its own scale, both heads, the tracks side by side
    without gaps.
    """
    series = {
        f"drift about {name} (arcsec)": [
            angle[f"drift_{head}_{name}_arcsec"].to_numpy()[:, None] for head in heads
        ]
        for name in "xyz"
    }
    return _along_tracks(angle, series, heads)


def leftover_figure(angle: pd.DataFrame, pair: CorrectedPair, heads: Sequence[int]) -> Figure:
    """What a pure turn leaves of the shifts of both heads' spots, the tracks side by side without
    gaps.
    """
    series = {
        f"left along {name} (µm)": [1e3 * fit.residuals[..., i] for fit in pair.fits]
        for i, name in enumerate("xy")
    }
    return _along_tracks(angle, series, heads)


def _along_tracks(
    angle: pd.DataFrame, series: Mapping[str, list[Floats]], heads: Sequence[int]
) -> Figure:
    """A panel for each series, of both heads (n, lines)."""
    from matplotlib.figure import Figure

    from losbench.figures import COLOURS

    place = _places(angle)
    spans = place.groupby(angle["track"]).agg(["min", "max"])
    fig = Figure(figsize=(9.0, 2.0 * len(series) + 0.4))
    axes = fig.subplots(len(series), 1, sharex=True)
    for axis, (label, both) in zip(axes, series.items(), strict=True):
        for head, values, colour in zip(heads, both, ("orange", "purple"), strict=True):
            named = [f"head {head}", *["_"] * (values.shape[1] - 1)]
            axis.plot(
                place,
                values,
                ".",
                ms=1.5,
                alpha=0.5,
                color=COLOURS[colour],
                label=named,
                rasterized=len(place) > _MANY,
            )
        for before, after in zip(spans["max"].iloc[:-1], spans["min"].iloc[1:], strict=True):
            axis.axvline((before + after) / 2, color=COLOURS["black"], lw=0.6)
        axis.set_ylabel(label)
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
