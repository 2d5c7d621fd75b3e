"""A matplotlib figure that answers at once: what stands still is drawn once and kept, what moves is
drawn over it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterable, Sequence
from functools import cache
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import is_color_like, to_rgb, to_rgba
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats
from losbench.figures import use_style

__all__ = ["Picture", "round_up", "style"]

_WIDEST = "−0.025"
_DPI = 100
_INK, _PAPER, _LINES = "#E0E0E0", "#111111", "#3A3A3A"
_COLOURED = ("color", "markerfacecolor", "markeredgecolor", "facecolor", "edgecolor")
_SHARPEST_DPI = 2 * _DPI  # twice as fine costs 17 ms to draw and code, three times 38
_KEPT = 24  # drawings of axes, of which only the inked pixels are kept
_AFTER_HEADER = 33  # bytes of signature and IHDR chunk


@cache
def style(*, light: bool = True) -> Any:
    """Return the settings of `losbench.figures.use_style`, without making them the user's; on a
    dark page, with light ink.
    """
    with mpl.rc_context():
        use_style()
        settings: dict[str, Any] = {
            key: value for key, value in mpl.rcParams.items() if not key.startswith("backend")
        }
    if not light:
        inked = ("text", "xtick", "ytick")
        settings |= {f"{name}.color": _INK for name in inked}
        settings |= {"axes.labelcolor": _INK, "axes.edgecolor": _INK, "grid.color": _LINES}
        settings |= {"figure.facecolor": _PAPER, "axes.facecolor": _PAPER}
    # A title that need not look for room above the axis saves a fifth of a full drawing.
    return settings | {"axes.titley": 1.0}


class Picture:
    """A figure drawn on Agg and coded as PNG.

    Parameters
    ----------
    figure : Figure
        Complete, with the limits of its axes set.
    moving : iterable of artists
        What changes from one picture to the next. Anything else is drawn anew only when the limits
        of its axes change.
    fixed : collection of axes
        Those whose y limits never change, and need room for no wider numbers than theirs.
    light : bool
        Whether it lies on a light page; on a dark one what is black becomes light, and only that:
        turning all colours round would make negatives of images.
    """

    def __init__(
        self,
        figure: Figure,
        moving: Iterable[Artist],
        *,
        fixed: Collection[Axes] = (),
        light: bool = True,
    ) -> None:
        self._figure, self._style = figure, style(light=light)
        if not light:
            _lighten(figure)
        self._canvas: Any = FigureCanvasAgg(figure)
        self._moving = sorted(moving, key=lambda artist: artist.get_zorder())
        for artist in self._moving:
            artist.set_animated(True)
        with mpl.rc_context(self._style):
            _lay_out(figure, [axes for axes in figure.axes if axes not in fixed])
        self._inked: dict[Any, tuple[NDArray[np.int32], NDArray[np.uint8]]] = {}
        self._limits: list[Any] = []

    def resize(self, width_px: float) -> None:
        """Draw so many pixels wide from now on, the same figure."""
        wanted = width_px / self._figure.get_figwidth()
        dpi = float(np.clip(wanted, _DPI / 4, _SHARPEST_DPI))
        if dpi != self._figure.dpi:
            self._figure.set_dpi(dpi)
            self._canvas = FigureCanvasAgg(self._figure)
            self._inked, self._limits = {}, []

    def place(self, axes: Axes, x: float, y: float) -> Floats:
        """Where a point of the axes is in the picture: shares (2,) from the left and the top."""
        share = self._figure.transFigure.inverted().transform(axes.transData.transform((x, y)))
        return np.array([share[0], 1.0 - share[1]])

    def point(self, axes: Axes, left: float, top: float) -> Floats:
        """Return the point (2,) of the axes at a place in the picture, within their limits."""
        shown = self._figure.transFigure.transform((left, 1.0 - top))
        ends = np.sort([axes.get_xlim(), axes.get_ylim()], axis=1)
        return np.clip(axes.transData.inverted().transform(shown), ends[:, 0], ends[:, 1])

    def png(self, description: str) -> bytes:
        """Draw what moves, and axes whose limits have changed; return the picture, which carries
        its description.
        """
        import cv2

        limits = [(axes, axes.get_xlim(), axes.get_ylim()) for axes in self._figure.axes]
        if limits != self._limits:
            with mpl.rc_context(self._style):
                self._still = self._stood_still(limits)
            self._limits = limits
        pixels = np.asarray(self._canvas.buffer_rgba())
        pixels[:] = self._still
        for artist in self._moving:
            self._figure.draw_artist(artist)
        picture = cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGR)
        # Areas of one colour: unfiltered rows code six times faster than filtered ones, and
        # smaller.
        coding = [
            cv2.IMWRITE_PNG_COMPRESSION,
            1,
            cv2.IMWRITE_PNG_FILTER,
            cv2.IMWRITE_PNG_FILTER_NONE,
        ]
        return _described(bytes(cv2.imencode(".png", picture, coding)[1]), description)

    def _stood_still(self, limits: Sequence[Any]) -> NDArray[np.uint8]:
        """Pixels of all that does not move; of axes with limits that they had before, as then."""
        for axes in self._figure.axes:
            axes.set_visible(False)
        self._canvas.draw()
        for axes in self._figure.axes:
            axes.set_visible(True)
        pixels: NDArray[np.uint8] = np.asarray(self._canvas.buffer_rgba())
        empty, still = pixels.copy(), pixels.copy()
        for key in limits:
            if key not in self._inked:
                pixels[:] = empty
                self._figure.draw_artist(key[0])
                where = np.flatnonzero((pixels != empty).any(axis=2)).astype(np.int32)
                self._inked[key] = where, pixels.reshape(-1, 4)[where]
            where, ink = self._inked[key]
            still.reshape(-1, 4)[where] = ink
        while len(self._inked) > _KEPT:
            del self._inked[next(iter(self._inked))]
        return still


def _lighten(figure: Figure) -> None:
    """Give light ink to lines, markers, texts, patches and collections that are black by their own
    choice.
    """
    for artist in figure.findobj():
        for name in _COLOURED:
            if hasattr(artist, f"get_{name}") and hasattr(artist, f"set_{name}"):
                colour = getattr(artist, f"get_{name}")()
                black = is_color_like(colour) and to_rgba(colour)[:3] == (0.0, 0.0, 0.0)
                if black and to_rgba(colour)[3]:
                    getattr(artist, f"set_{name}")((*to_rgb(_INK), to_rgba(colour)[3]))


def _lay_out(figure: Figure, roomy: Sequence[Axes]) -> None:
    """Give axes and labels their places once, with room for wide numbers where numbers may become
    wide.

    Axes that shift would hide what a slider does, and looking for places takes a third of a
    drawing.
    """
    formatters = [axes.yaxis.get_major_formatter() for axes in roomy]
    for axes in roomy:
        axes.yaxis.set_major_formatter(_WIDEST)
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 0.98, 1.0))
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes, formatter in zip(roomy, formatters, strict=True):
        axes.yaxis.set_major_formatter(formatter)
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            place = axis.label.get_transform().transform(axis.label.get_position())
            axis.set_label_coords(*axes.transAxes.inverted().transform(place))


def _described(png: bytes, text: str) -> bytes:
    """Put an international text chunk (PNG specification, 11.3.3.4) behind the header: which values
    are shown here.
    """
    chunk = b"iTXtDescription\0\0\0\0\0" + text.encode()
    framed = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return png[:_AFTER_HEADER] + framed + png[_AFTER_HEADER:]


def round_up(values: ArrayLike, *, least: float = 0.0) -> float:
    """Return the smallest of 1, 2, 3, 5, 10, 20 ... that no finite absolute value exceeds: limits
    that rarely change.

    >>> round_up([0.3, -1.7]), round_up(51.0), round_up([], least=0.1)
    (2.0, 100.0, 0.1)
    """
    finite = np.abs(np.asarray(values, dtype=np.float64))
    largest = max(finite[np.isfinite(finite)].max(initial=0.0), least)
    if largest == 0.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(largest))
    return float(
        next(
            step * decade
            for step in (1.0, 2.0, 3.0, 5.0, 10.0)
            if step * decade >= largest * (1.0 - 1e-12)
        )
    )
