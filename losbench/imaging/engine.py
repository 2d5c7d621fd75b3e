"""The engine of centroiding: windows cut, background off, method applied, flags set, cut anew where
a window has moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats, Indices
from losbench.checks import integer, number
from losbench.imaging.background import Background
from losbench.imaging.cleaning import Scene, captured, look_again
from losbench.imaging.detector import Detector
from losbench.imaging.flags import Cut, judged
from losbench.imaging.hotpixels import gate_hot_pixels
from losbench.imaging.noise import Gain, peak_reading, pixel_noise, saturated, step_of
from losbench.imaging.protocols import CentroidMethod, Windows
from losbench.imaging.results import Measured, SpotFlag
from losbench.imaging.stamps import RING, cut_stamps, ring_of

__all__ = ["Engine"]


# over a half, so that a centroid near a pixel border is not cut back and forth
_OFF_CENTRE = 0.6  # pixels
_MOST_RECUTS = 10


@dataclass(frozen=True)
class Engine:
    """What holds for every spot of a call.

    Parameters
    ----------
    method : CentroidMethod
    background : Background
    window, ring : int, pixels
        Sides of the window, and of the square that the ring surrounds.
    noise : Detector or Gain
    full_scale_dn : float
        Reading of a saturated pixel.
    """

    method: CentroidMethod
    background: Background
    window: int
    ring: int
    noise: Detector | Gain
    full_scale_dn: float

    @classmethod
    def of_stack(
        cls,
        stack: NDArray[Any],
        method: CentroidMethod,
        background: Background,
        window: int,
        noise: Detector | Gain | None = None,
        full_scale_dn: float | None = None,
    ) -> Self:
        """Fit window, ring and full scale to the frames (F, H, W).

        Raises
        ------
        ValueError
            If the window does not fit into the frames, or the ring into the window.
        """
        rows, columns = stack.shape[1:]
        if window > min(rows, columns):
            raise ValueError(
                f"window of {window} x {window} pixels does not fit into frames of {rows} x "
                f"{columns} pixels"
            )
        ring = window if background.side is None else background.side
        integer("ring", ring, low=window)
        if full_scale_dn is not None:
            full_scale = number("full_scale_dn", full_scale_dn)
        elif isinstance(noise, Detector):
            full_scale = float(np.floor(noise.full_scale_dn))
        else:
            whole = stack.dtype.kind in "ui"
            full_scale = float(np.iinfo(stack.dtype).max) if whole else np.inf
        known = Gain(0.0, np.inf, step_of(stack)) if noise is None else noise
        return cls(method, background, window, ring, known, full_scale)

    def measure(
        self,
        stack: NDArray[Any],
        frame: Indices,
        middle: Indices,
        start: Floats,
        *,
        width: Floats,
        spot: Indices | None = None,
        now: Floats | None = None,
        recuts: int = _MOST_RECUTS,
    ) -> Measured:
        """Measure M spots: frame numbers (M,), whole pixels to cut around (M, 2) and starts (M, 2)
        in frame pixels.

        ``width`` (M, 2) is that of the spots, NaN where no template needs it, and ``spot`` (M,)
        their numbers. A window that leaves the middle pixel of its stamp, or comes to rest off it
        while the ring does not, is cut anew around where it is ``now``.
        """
        cut = self.cut(stack, frame, middle)
        here = (start if now is None else now) - middle
        windows = Windows(
            cut.signal, self.window, here, middle, cut.noise, width, cut.kept, spot=spot
        )
        fit = self.method.measure(windows)
        result = judged(stack.shape[1:], middle, cut, fit)
        if self.method.stays:
            return result

        moved = np.where(np.isfinite(fit.centroid), fit.centroid, 0.0)
        nearest = middle + np.rint(moved).astype(np.intp)
        strayed = np.abs(nearest - start).max(axis=1) > self.window / 2
        if strayed.any():
            result.flags[strayed] |= SpotFlag.NOT_CONVERGED
            path = start[strayed], moved[strayed] + middle[strayed]
            away = captured(stack, frame[strayed], *path, cut.noise.of(strayed))
            result.flags[np.flatnonzero(strayed)[away]] |= SpotFlag.NEIGHBOUR
        inside = ((nearest >= 0) & (nearest < stack.shape[:0:-1])).all(axis=1)
        again = (np.abs(moved).max(axis=1) > _OFF_CENTRE) & ~strayed & inside
        if not self.background.tilts:
            again &= ~fit.converged
        again &= recuts > 0
        scene = Scene(stack, frame, self.method, self.ring, self.background.tilts)
        look_again(scene, cut, windows, fit, result, ~again)
        if again.any():
            redone = self.measure(
                stack,
                frame[again],
                nearest[again],
                start[again],
                width=width[again],
                spot=None if spot is None else spot[again],
                now=moved[again] + middle[again],
                recuts=recuts - 1,
            )
            redone.n_iter[:] += result.n_iter[again]
            result.put(again, redone)
        return result

    def cut(self, stack: NDArray[Any], frame: Indices, middle: Indices) -> Cut:
        """Cut M windows, each with a margin of one pixel, around whole pixels (M, 2), and take the
        background off.
        """
        reach = self.ring // 2 + RING
        stamps = cut_stamps(stack, frame, middle, reach)
        plane = self.background.under(ring_of(stamps, self.ring), self.ring)
        gate = self.method.hot_pixel_gate
        # One pixel for the window to move in, and one more where the gate looks at neighbours.
        rim = reach - self.window // 2 - (2 if gate else 1)
        raw = np.ascontiguousarray(stamps[:, rim:-rim, rim:-rim])
        signal = plane.off(raw)
        unread = np.isnan(raw)
        missing = unread if unread.any() else None
        if missing is not None:
            signal[missing] = 0.0
        if gate:
            signal = gate_hot_pixels(signal, np.nan_to_num(plane.scatter))[:, 1:-1, 1:-1]
            raw = raw[:, 1:-1, 1:-1]
            missing = None if missing is None else missing[:, 1:-1, 1:-1]
        peak = peak_reading(raw, missing)
        full, least = saturated(raw, missing, plane.level, self.full_scale_dn)
        kept = None
        if self.method.template and (missing is not None or full.any()):
            lost = full[:, None, None] & (raw >= least)
            kept = (~lost if missing is None else ~lost & ~missing).astype(raw.dtype)
        last_digit = float(np.finfo(raw.dtype).eps) * np.abs(peak)
        noise = pixel_noise(plane, self.noise, last_digit)
        sides = self.window, self.ring
        return Cut(raw, signal, missing, kept, peak, full, plane, noise, *sides)
