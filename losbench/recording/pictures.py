"""Pictures of a measurement: the frame with its spots, shifts, angles, temperatures, leftovers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.pointing import told
from losbench.pointing.told import Sensitivity
from losbench.recording.measurement import Measurement
from losbench.recording.readers import Recording
from losbench.recording.sensitivity import AXES, temperature_columns
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "angles_figure",
    "compensated_figure",
    "frame_figure",
    "leftover_figure",
    "over_temperature_figure",
    "shifts_figure",
    "temperature_figure",
    "windows_px",
]

_MANY = 3000  # points of a line, beyond which it is drawn as an image
_CUTS, _COLUMNS = 12, 6  # spots that are shown near to, and how many of them beside each other
_LINES = (".-", "x--", "^:", "s-.")  # of spots beyond the number of colours
_NEAR_PX = 12  # half a side of these, where the window is not known


def frame_figure(measurement: Measurement, recording: Recording) -> Figure:
    """The first frame that shows every spot, with their numbers, and each of the first twelve near
    to, with its window.
    """
    from matplotlib.figure import Figure

    k = int(np.argmax(np.isfinite(measurement.xy_px).all(axis=(1, 2))))
    xy = measurement.xy_px[k]
    pixels = [stamp.read(k, k + 1, skip=True).frames[0] for stamp in recording.stamps]
    origins = [np.array(stamp.origin_px, dtype=float) for stamp in recording.stamps]
    whole, shown = len(pixels) == 1, min(len(xy), _CUTS)
    n_rows = -(-shown // _COLUMNS)
    columns = -(-shown // n_rows)
    side = 8.0 / max(columns, 3)
    heights = [side] * n_rows
    if whole:
        heights.insert(0, min(8.0 * pixels[0].shape[0] / pixels[0].shape[1], 9.0))
    fig = Figure(figsize=(8.0, sum(heights) + 0.4))
    grid = fig.add_gridspec(len(heights), columns, height_ratios=heights)
    if whole:
        axis = fig.add_subplot(grid[0, :])
        _image(axis, pixels[0], origins[0])
        axis.set_title(f"frame {k}: {recording.label(k)}", parse_math=False)
        _marks(axis, xy, radius=0.02 * max(pixels[0].shape))
    for spot, window in enumerate(windows_px(measurement)[:shown]):
        axis = fig.add_subplot(grid[whole + spot // columns, spot % columns])
        stamp = 0 if whole else spot
        near = (pixels[stamp], origins[stamp])
        _image(axis, *(_near(*near, xy[spot], window) if whole else near))
        axis.plot(*xy[spot], "+", ms=11, mew=1.2, color="#D55E00")
        if window is not None:
            _square(axis, np.rint(xy[spot]), window)
        axis.set_title(f"spot {spot + 1}", fontsize=9)
        axis.tick_params(labelsize=7)
    return fig


def windows_px(measurement: Measurement) -> list[int | None]:
    """Side of each spot's window, None where it is not known."""
    surveys, count = measurement.surveys, measurement.xy_px.shape[1]
    sides = [survey.method.window for survey in surveys] or [None]
    each = [np.broadcast_to(np.asarray(side), count if len(sides) == 1 else 1) for side in sides]
    return list(np.concatenate(each).tolist())


def shifts_figure(measurement: Measurement) -> Figure:
    """Shifts of every spot along x and y."""
    along, label = _abscissa(measurement)
    fig, axes = _one_below_another(2, label)
    for axis, i, name in zip(axes, range(2), "xy", strict=True):
        _by_spot(axis, along, measurement.shifts_px[..., i])
        axis.set_ylabel(f"shift along {name} (px)")
    axes[0].legend(ncols=4)
    return fig


def leftover_figure(measurement: Measurement) -> Figure:
    """What the angles of a measurement that has them leave of every spot's shift."""
    along, label = _abscissa(measurement)
    fig, axes = _one_below_another(2, label)
    if measurement.attitude is not None:
        for axis, i, name in zip(axes, range(2), "xy", strict=True):
            _by_spot(axis, along, 1e3 * measurement.attitude.residuals[..., i])
            axis.set_ylabel(f"left along {name} (µm)")
    axes[0].legend(ncols=4)
    return fig


def angles_figure(measurement: Measurement) -> Figure:
    """The angle about each axis, with its one-sigma error."""
    along, label = _abscissa(measurement)
    fig, axes = _one_below_another(3, label)
    for axis, name in zip(axes, AXES, strict=True):
        angle = measurement.table[f"{name}_arcsec"].to_numpy()
        sigma = measurement.table[f"sigma_{name}_arcsec"].to_numpy()
        many = len(along) > _MANY
        axis.fill_between(
            along,
            angle - sigma,
            angle + sigma,
            alpha=0.25,
            lw=0,
            label="one sigma",
            rasterized=many,
        )
        axis.plot(along, angle, lw=1.0, rasterized=many)
        axis.set_ylabel(f"about {AXES[name]} (arcsec)")
    axes[0].legend()
    return fig


def over_temperature_figure(measurement: Measurement, fit: Sensitivity) -> Figure:
    """The angle about each axis over the temperature, and the fit."""
    table = measurement.table
    celsius = table[fit.column].to_numpy()
    lagged = any(fit.lag_s > 0)
    fig, axes = _one_below_another(3, f"{fit.column.removesuffix('_degC')} (degC)")
    for i, (axis, name) in enumerate(zip(axes, AXES, strict=True)):
        many = len(celsius) > _MANY
        axis.plot(celsius, table[f"{name}_arcsec"], ".", ms=3, label="measured", rasterized=many)
        axis.plot(
            celsius,
            rad_to_arcsec(fit.predicted[:, i]),
            lw=1.2,
            label="fit with lag" if lagged else "fit",
            rasterized=many,
        )
        axis.set_ylabel(f"about {AXES[name]} (arcsec)")
    axes[0].legend()
    return fig


def compensated_figure(measurement: Measurement, fit: Sensitivity) -> Figure:
    """Over time, each angle beside what the temperature predicts, and what that leaves over."""
    return told.compensated_figure(fit, measurement.table, *_abscissa(measurement))


def temperature_figure(measurement: Measurement) -> Figure:
    """Every sensor's temperature at the frames."""
    along, label = _abscissa(measurement)
    fig, axes = _one_below_another(1, label)
    for column in temperature_columns(measurement.table):
        name = column.removeprefix("temperature_").removesuffix("_degC")
        celsius = measurement.table[column].to_numpy()
        (line,) = axes[0].plot(along, celsius, lw=1.2, rasterized=len(along) > _MANY)
        line.set_label(name)
    axes[0].set_ylabel("temperature (degC)")
    legend = axes[0].legend(ncols=4)
    for text in legend.get_texts():
        text.set_parse_math(False)  # a sensor may be called T_$1$
    return fig


def _by_spot(axis: Axes, along: NDArray[Any], values: Floats) -> None:
    import matplotlib as mpl

    colours = len(mpl.rcParams["axes.prop_cycle"])
    for spot in range(values.shape[1]):
        axis.plot(
            along,
            values[:, spot],
            _LINES[spot // colours % len(_LINES)],  # no two spots look the same
            ms=3,
            lw=0.8,
            label=f"spot {spot + 1}",
            rasterized=len(along) > _MANY,
        )


def _near(
    image: NDArray[Any], origin: Floats, xy: Floats, window: int | None
) -> tuple[NDArray[Any], Floats]:
    """The pixels about a spot, and where their first one is."""
    reach = _NEAR_PX if window is None else window // 2 + 4
    x, y = np.rint(xy - origin).astype(int).tolist()
    left, top = max(x - reach, 0), max(y - reach, 0)
    return image[top : y + reach + 1, left : x + reach + 1], origin + np.array([left, top])


def _square(axis: Axes, centre: Floats, side: int) -> None:
    from matplotlib.patches import Rectangle

    corner = (centre[0] - side / 2, centre[1] - side / 2)
    axis.add_patch(Rectangle(corner, side, side, fill=False, lw=1.0, ec="#E69F00", ls="--"))


def _image(axis: Axes, pixels: NDArray[Any], origin: Floats) -> None:
    rows, cols = pixels.shape
    low, high = np.nanpercentile(pixels, [1.0, 99.9])
    axis.imshow(
        pixels,
        cmap="gray",
        vmin=low,
        vmax=max(high, low + 1.0),
        extent=(origin[0] - 0.5, origin[0] + cols - 0.5, origin[1] + rows - 0.5, origin[1] - 0.5),
    )
    axis.grid(visible=False)


def _marks(axis: Axes, xy: Floats, *, radius: float) -> None:
    from matplotlib.patches import Circle

    for spot, (x, y) in enumerate(xy.tolist()):
        axis.add_patch(Circle((x, y), radius, fill=False, lw=1.1, color="#E69F00"))
        axis.text(x + 1.2 * radius, y - 1.2 * radius, str(spot + 1), color="#E69F00", fontsize=9)


def _abscissa(measurement: Measurement) -> tuple[NDArray[Any], str]:
    table = measurement.table
    return (
        (table["time_s"].to_numpy(), "time (s)")
        if "time_s" in table
        else (table["frame"].to_numpy(), "frame")
    )


def _one_below_another(n: int, label: str) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    fig = Figure(figsize=(8.0, 2.0 * n + 0.6))
    axes = list(np.atleast_1d(fig.subplots(n, 1, sharex=True)))
    axes[-1].set_xlabel(label, parse_math=False)  # a sensor may be called T_$1$
    return fig, axes
