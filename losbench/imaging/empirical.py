"""The centroid of a spot by its own shape, which the frames themselves have shown."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar

import numpy as np

from losbench.arrays import Floats, Indices, Ints, Pixels
from losbench.checks import integer, number
from losbench.imaging.columns import Drawing
from losbench.imaging.common import as_window, check_fields
from losbench.imaging.eiwa import EIWA
from losbench.imaging.leftover import bad_pixels, unlike
from losbench.imaging.protocols import Estimate, Window, Windows
from losbench.imaging.shapefit import drawing
from losbench.imaging.splines import SpotShape, spline_count
from losbench.imaging.template import Draw, TemplateFit, fit_template

__all__ = ["Empirical"]


_NEAR = EIWA(tolerance=0.02, max_iter=10)  # what the splines begin with
_ROUNDS = 3


@dataclass(frozen=True)
class Empirical:
    """Fit place and flux of the spot's own shape, each pixel weighted by its own noise.

    For spots that are no Gaussians: defocused, ring-shaped, comatic, in two lobes. The shape is
    made of up to 64 frames in which a spot stands out: cubic splines, with places and light fitted
    beside them, from those of `EIWA`. With ten frames or more it comes within a tenth of the
    Cramer-Rao bound.

    Parameters
    ----------
    shape : SpotShape or (n,) tuple of them, optional
        Of all spots, or of each; None in it for one that has none, and gets no centroid. By default
        that of a spot's own windows, where there are ten that show it, and for the others of a call
        one of all their windows of one size. `Centroids.method` has what was made; in `measure`, it
        is made once for the recording.
    window : odd int or (n,) of them, pixels, optional
        Side N of the window, or of that of each spot, up to 121; by default that of the shape, else
        see `centroid`.
    tolerance : float, pixels
        A fit is done when the square of a step, which is about what it leaves, is shorter.
    max_iter : int
        Steps before it counts as not converged.
    centre, hot_pixel_gate, smooth
        As for `EIWA`.

    Raises
    ------
    ValueError
        If the window is even, or not that of the shape, or another field is out of range.

    Notes
    -----
    The origin of a shape is a convention: the mean of the places that `EIWA` finds in the frames
    that made it. So places hold up to a constant, which no drift, no shift and no angle to another
    frame of the recording knows; it is not in the error. That is the information in the window, the
    error of the background plane, and what the shape does not know of itself at that part of a
    pixel. A spot that is not like its shape, by 3 % of its light and five errors, carries MISFIT:
    it has changed, or another is near. So does one that stands further off than the frames tell
    that made its shape, by 0.02 pixels and three standard deviations of the places in
    them, by the part of the pixel: spots that stood still do not show what lies between pixels.
    And so does one that is too sharp, whose light changes within 0.8 pixels (1.6 in windows of more
    than 61): a Gaussian below a sigma of 0.75, a ring with a line below 0.5.

    Examples
    --------
    >>> import losbench as lb
    >>> xy = [20, 16] + np.random.default_rng(1).uniform(-0.5, 0.5, (30, 1, 2))
    >>> frames = lb.render_spots(xy, 1e4, 2.0, (40, 50))
    >>> found = lb.centroid(frames, [[20, 16]], method=lb.Empirical(window=13))
    >>> bool(np.abs(found.xy - xy).max() < 1e-3), found.method.shape[0].frames
    (True, 30)
    """

    shape: SpotShape | tuple[SpotShape | None, ...] | None = None
    _: KW_ONLY
    window: Window | None = None
    tolerance: float = 2.5e-4
    max_iter: int = 50
    centre: str | None = None
    hot_pixel_gate: bool = False
    smooth: str | None = None

    stays: ClassVar[bool] = False
    template: ClassVar[bool] = True
    width: ClassVar[tuple[()]] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        number("tolerance", self.tolerance, low=1e-12)
        integer("max_iter", self.max_iter, low=1)
        shapes = self.shape if isinstance(self.shape, tuple) else (self.shape,)
        if not all(each is None or isinstance(each, SpotShape) for each in shapes):
            raise ValueError(
                "shape must be a SpotShape, or a tuple of one for each spot, as `Centroids.method` "
                f"has them, got {self.shape!r}"
            )
        made = [each.side for each in shapes if each is not None]
        if made and self.window is None and len(made) == len(shapes):
            object.__setattr__(self, "window", as_window(made if len(made) > 1 else made[0]))

    def measure(self, windows: Windows) -> Estimate:
        """Fit flux and place of each window's shape, without the pixels that stand out of it.

        The error is that of the information, and of the shape. A fit that leaves the middle pixel
        by more than a pixel stops there, not converged.
        """
        kinds, which = self._shapes(windows)
        nothing = np.zeros((spline_count(windows.side),) * 2)
        splines = np.stack([nothing if each is None else each.coefficients for each in kinds])
        splines = splines.astype(windows.signal.dtype)
        draw = drawing(windows.side, splines, which, windows.signal.dtype)
        *_, near = _NEAR.steps(windows)
        known = np.isfinite(near.centroid).all(axis=1, keepdims=True)
        fit = self._fit(replace(windows, start=np.where(known, near.centroid, windows.start)), draw)
        fit, light, kept, n_bad = self._without_bad_pixels(windows, fit, draw)
        own = np.array([0.0 if each is None else each.own for each in kinds])
        misfit = unlike(windows, light, kept, own[which])
        error = np.zeros_like(fit.centre)
        for k, kind in enumerate(kinds):
            if kind is not None:
                those = which == k
                error[those] = kind.error_at(fit.centre[those])
                misfit[those] |= kind.beyond(fit.centre[those])
        estimate = fit.estimate(windows, misfit)
        return replace(estimate, sigma=np.hypot(estimate.sigma, error), n_bad=n_bad)

    def _shapes(self, windows: Windows) -> tuple[list[SpotShape | None], Indices]:
        """The shapes that M windows need, and which of them each does, (M,)."""
        one = np.zeros(len(windows.start), np.intp)
        if not isinstance(self.shape, tuple):
            return [self.shape], one
        spots, of = np.unique(one if windows.spot is None else windows.spot, return_inverse=True)
        each = [self.shape[k] for k in spots.tolist()]
        kinds = list(dict.fromkeys(each))
        return kinds, np.array([kinds.index(kind) for kind in each], np.intp)[of]

    def _fit(self, windows: Windows, draw: Draw) -> TemplateFit:
        return fit_template(windows, tolerance=self.tolerance, max_iter=self.max_iter, draw=draw)

    def _without_bad_pixels(
        self, windows: Windows, fit: TemplateFit, draw: Draw
    ) -> tuple[TemplateFit, Pixels, Pixels | None, Ints]:
        """Fits anew, in up to three rounds, without the pixels that stand out; the light (M, S, S)
        that they hold, which pixels were kept, and how many were left out.
        """
        first = None if windows.kept is None else windows.kept[:, 1:-1, 1:-1]
        count, kept, n_bad = len(fit.flux), first, np.zeros(len(fit.flux), np.int64)
        light = _light(fit, draw, np.arange(count))
        looking = np.arange(count)
        for _ in range(_ROUNDS):
            seen = None if kept is None else kept[looking]
            bad = bad_pixels(windows.of(looking), light[looking], seen)
            some = bad.any(axis=(1, 2))
            looking, bad = looking[some], bad[some]
            if not looking.size:
                break
            kept = np.ones_like(light) if kept is None else kept.copy()
            kept[looking] *= ~bad
            n_bad[looking] += bad.sum(axis=(1, 2))
            part = replace(
                windows.of(looking),
                start=fit.centre[looking],
                kept=np.pad(kept[looking], ((0, 0), (1, 1), (1, 1))),
            )
            fit.put(looking, self._fit(part, _some(draw, looking)))
            light[looking] = _light(fit.of(looking), draw, looking)
        return fit, light, kept, n_bad


def _some(draw: Draw, some: Indices) -> Draw:
    """Draws some of the windows."""

    def drawn(part: Indices | slice, centre: Floats) -> Drawing:
        return draw(some[part], centre)

    return drawn


def _light(fit: TemplateFit, draw: Draw, some: Indices) -> Pixels:
    light = draw(some, fit.centre).light
    return np.asarray(light * np.nan_to_num(fit.flux).astype(light.dtype)[:, None, None])
