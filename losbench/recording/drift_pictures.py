"""Pictures of a star-camera pair's telemetry: the angle between the heads, and their drift."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["angle_figure", "drift_figure"]


def angle_figure(angle: pd.DataFrame) -> Figure:
    """Each track in a panel, the angle before and after correction on one scale."""
    tracks = [samples for _, samples in angle.groupby("track")]
    shown = tracks[:: max(1, -(-len(tracks) // 6))]
    fig, axes = _side_by_side(len(shown))
    for axis, samples in zip(axes, shown, strict=True):
        time = samples["time_s"] - samples["time_s"].iloc[0]
        axis.plot(time, samples["before_arcsec"], lw=0.7, label="as measured")
        axis.plot(time, samples["after_arcsec"], lw=0.7, label="corrected")
        axis.set_title(f"track {samples['track'].iloc[0]}")
        axis.set_xlabel("time in track (s)")
    axes[0].set_ylabel("angle less design (arcsec)")
    axes[0].legend()
    return fig


def drift_figure(angle: pd.DataFrame) -> Figure:
    """Each head in a panel, the drift about its three axes over time."""
    fig, axes = _side_by_side(2)
    time = angle["time_s"] - angle["time_s"].iloc[0]
    days = time.iloc[-1] > 172800.0
    time = time / (86400.0 if days else 1.0)
    for k, axis in enumerate(axes):
        for name in "xyz":
            axis.plot(time, angle[f"drift_{k + 1}_{name}_arcsec"], ".", ms=1.5, label=name)
        axis.set_title(f"head {k + 1}")
        axis.set_xlabel("time since first row (days)" if days else "time since first row (s)")
    axes[0].set_ylabel("drift (arcsec)")
    axes[0].legend(markerscale=6, title="about")
    return fig


def _side_by_side(n: int) -> tuple[Figure, list[Any]]:
    from matplotlib.figure import Figure

    fig = Figure(figsize=(2.6 + 2.6 * n, 3.6))
    return fig, list(np.atleast_1d(fig.subplots(1, n, sharey=True)))
