"""The grey-weighted centroid of a window that stays where it is (liu2026, eq. 11-12)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np

from losbench.arrays import Floats, Pixels
from losbench.imaging.common import check_fields
from losbench.imaging.protocols import Estimate, Window, Windows
from losbench.imaging.window import WindowFit, look, window_estimate

__all__ = ["Grey", "grey"]


@dataclass(frozen=True)
class Grey:
    r"""Weigh the pixels of a window that stays where it is by grey value (liu2026, eq. 11-12).

    It takes a spot of any shape, but is pulled towards the middle of its window by the light that
    the window's edge cuts off. It looks for no bad pixel and no neighbour in the image.

    Parameters
    ----------
    window : odd int or (n,) of them, pixels, optional
        Side N of the window, or of that of each spot; see `centroid` for the default.
    centre : "start" or "peak", optional
        The whole pixel on which the window stands: nearest the start, or the brightest within a
        quarter of a window of it, frame by frame. By default "peak", as in the paper.
    hot_pixel_gate : bool
        Replace pixels that stand out of their 3 x 3 median. Not for spots with a sigma below 0.9
        pixels.
    smooth : "kalman", optional
        Smooth the places over the frames with a local linear trend (liu2026, section 3.2).

    Raises
    ------
    ValueError
        If the window is even, or another field is out of range.

    Notes
    -----
    .. math:: \hat x = \sum_{ij} x_{ij}\, I_{ij} \Big/ \sum_{ij} I_{ij}

    over the window, background taken off; y alike.

    Examples
    --------
    >>> import losbench as lb
    >>> image = lb.render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> lb.centroid(image, [[20, 16]], method=lb.Grey(13)).xy.round(2).tolist()
    [[20.3, 15.8]]
    """

    window: Window | None = None
    _: KW_ONLY
    centre: str | None = None
    hot_pixel_gate: bool = False
    smooth: str | None = None

    stays: ClassVar[bool] = True
    template: ClassVar[bool] = False
    width: ClassVar[None] = None

    def __post_init__(self) -> None:
        check_fields(self)

    def measure(self, windows: Windows) -> Estimate:
        """Centroid of each window, with what its pull leaves in the error."""
        fit = grey(windows.signal, np.zeros_like(windows.start), windows.side)
        return window_estimate(windows, fit, moved=False)


def grey(pixels: Pixels, centre: Floats, window: int) -> WindowFit:
    """Centroid of a window that stays where it is (eq. 11-12); what is left is its pull,
    contraction * (centre - m).
    """
    seen = look(pixels, centre, window)
    pull = seen.contraction * (centre - seen.centroid)
    measured = np.isfinite(seen.centroid).sum(axis=1) == 2
    return WindowFit(seen.centroid, pull, np.ones(len(pixels), dtype=np.int64), measured, seen)
