"""Bad pixels and neighbours that nobody has told of, found by what a template leaves over.

Only spots whose residual asks for it are looked into: a clean round spot costs a glance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from losbench.arrays import Bools, Floats, Ints, Pixels
from losbench.imaging.columns import Templates
from losbench.imaging.neighbours import turned
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Estimate, Windows
from losbench.imaging.template import TemplateFit, fit_template
from losbench.units import SIGMA_PER_MAD

__all__ = [
    "UNEXPLAINED",
    "Looked",
    "asks",
    "filled",
    "lone_pixels",
    "look_into",
    "sure",
    "unexplained",
]


_SURE = 5.5  # errors: one false pixel in some 10 000 windows
_SURE_OF_UNKNOWN = 6.0  # where the shot noise is not known
_MODEL = 0.03  # of its light that a template may be wrong by in every pixel
_TURNED = 0.37  # pi / 2 of it, and two more to be safe, over the six errors of a difference
_POINTED = 2.5  # times the third of its 3 x 3 neighbours
_RESOLVED = 0.8  # pixels of sigma
_ROUNDS = 4
_PAIR = 2  # bad pixels may touch; more side by side are light
_FEW = 0.02  # of the pixels
_STEPS = 25
_CLOSE = 4e-3  # pixels squared: a twentieth of a pixel is near enough to judge pixels
_LINE = 22.0  # errors of the mean of a row
_LINE_SCATTERS = 4.0
_MOST = 0.15  # of a window's pixels; where more stand out, it is the shape
UNEXPLAINED = 0.3  # of the light; beyond it a template tells nothing of pixels


@dataclass(frozen=True)
class Looked:
    """Windows that were looked into: the pixels to keep and the rows and columns that were left out
    (M, S + 2, S + 2), how many pixels stood out (M,), the template fitted to the others, and
    whether it tells anything of them.
    """

    kept: Pixels
    lines: Bools
    n_bad: Ints
    fit: TemplateFit
    fits: Bools

    @property
    def sparse(self) -> Bools:
        """Whether what was left out is at most one row or column, or few pixels by themselves."""
        lines = self.lines.all(axis=2).sum(axis=1) + self.lines.all(axis=1).sum(axis=1)
        single = np.pad((self.kept == 0) & ~self.lines, ((0, 0), (1, 1), (1, 1)))
        around = sliding_window_view(single, (3, 3), axis=(1, 2)).sum(axis=(3, 4))
        clustered = (single[:, 1:-1, 1:-1] & (around > _PAIR)).any(axis=(1, 2))
        most = np.where(lines > 0, _PAIR, max(_PAIR, _FEW * self.kept[0].size))
        found: Bools = (lines <= 1) & (single.sum(axis=(1, 2)) <= most) & ~clustered
        return found

    def without(self, some: Bools) -> Looked:
        """Return it with all pixels of some windows kept, and the template that went without."""
        kept, lines = self.kept.copy(), self.lines.copy()
        kept[some], lines[some] = 1, False
        return replace(self, kept=kept, lines=lines)


def asks(windows: Windows, found: Estimate) -> Bools:
    """Whether a pixel stands out of the template, or of the light on the spot's other side (M,)."""
    share: float | Pixels
    if found.width is not None:
        pixels = windows.inner
        at = Templates.of(windows.side, found.centroid, found.width, pixels.dtype, free=False)
        light = at.light
        light *= found.flux.astype(light.dtype)[:, None, None]
        rest, share, times = pixels - light, _MODEL, 1.0
    else:
        pixels, centre = windows.signal, np.where(np.isfinite(found.centroid), found.centroid, 0.0)
        light = turned(pixels, centre)
        rest, share, times = pixels - light, _turned_share(pixels, centre, found.flux), 2.0
        np.maximum(light, pixels, out=light)
    rest *= rest
    if windows.kept is not None:
        rest *= windows.kept[:, 1:-1, 1:-1]
    # The variance of `_variance`, in few passes.
    times *= sure(windows.noise) ** 2
    light += np.abs(light)  # twice what is above zero, in half the time of a maximum
    least = (times * windows.noise.floor).astype(light.dtype)
    variance = light * (0.25 * times * share**2)
    variance += 0.5 * times * windows.noise.per_dn
    variance *= light
    variance += least[:, None, None]
    return np.asarray((rest > variance).any(axis=(1, 2)))


def _turned_share(pixels: Pixels, centre: Floats, flux: Floats) -> Pixels:
    """Part of the light (M, 1, 1) by which the other side of a spot may be wrong between pixels: of
    a Gaussian that holds so much of its flux in its middle pixel, 1 / (4 sigma^2) at most.
    """
    half = pixels.shape[1] // 2
    x, y = np.rint(centre).astype(np.intp).clip(-half, half).T + half
    with np.errstate(divide="ignore", invalid="ignore"):
        held = np.nan_to_num(pixels[np.arange(len(x)), y, x] / flux)
    share = np.clip(_TURNED * held, _MODEL, 1.0)
    return share.astype(pixels.dtype)[:, None, None]


def filled(windows: Windows, looked: Looked) -> Pixels:
    """Signal (M, S, S) with masked pixels as the template has them, and as much over it as there
    is on the other side of the spot, where that is kept.
    """
    model, centre = _model(windows, looked.fit, 1), looked.fit.centre
    over = turned((windows.signal - model) * looked.kept, centre)
    over *= turned(looked.kept, centre) > 0.99
    return np.where(looked.kept > 0, windows.signal, model + over)


def look_into(windows: Windows, *, moves: bool = False) -> Looked:
    """Mask the pixels that stand out of a template, in up to four rounds.

    A pixel stands out by 5.5 errors, and half as much as the worst, from the median of what its
    3 x 3 neighbours leave over: a wrong shape leaves the same over in all of them. So does a row or
    a column whose median does, and a few pixels side by side that lack half of their light. Where
    that is more than 15 % of a window, it is the shape. A window that ``moves`` counts what stands
    out of its margin too, which it shares in.
    """
    first = np.ones_like(windows.signal) if windows.kept is None else windows.kept
    kept, lines = first.copy(), np.zeros(first.shape, dtype=bool)
    # The width of the call first: a free one would shrink onto a pixel brighter than the spot.
    width = np.where(np.isfinite(windows.width), windows.width, windows.side / 6.0)
    windows = replace(windows, width=width)
    fit = fit_template(replace(windows, kept=kept), tolerance=_CLOSE, max_iter=_STEPS)
    looking = np.arange(len(kept))
    for k in range(_ROUNDS):
        rest = _rest(windows.of(looking), fit.of(looking)) * first[looking]
        much = (np.abs(rest * kept[looking]) > _SURE).any(axis=(1, 2))
        looking, rest = looking[much], rest[much]
        if not looking.size:
            break
        line = _lines(rest) & ~lines[looking]
        single = lone_pixels(rest * kept[looking])
        if k:  # a width that is not fitted yet lacks light all around
            single |= dead_pixels(windows.of(looking), fit.of(looking)) & (rest < -_SURE)
        single &= ~line.any(axis=(1, 2), keepdims=True)
        new = (line | single) & (kept[looking] > 0)
        lines[looking] |= line
        kept[looking] *= ~new
        part = windows.of(looking)
        clean = replace(part, kept=kept[looking])
        freed = fit_template(clean, free=True, tolerance=_CLOSE, max_iter=_STEPS)
        fit.put(looking, freed)
        if k:  # after the first round the width alone is new, and lets more stand out
            looking = looking[new.any(axis=(1, 2))]
    if not windows.noise.per_dn:
        doubtful = (first > kept) & ~lines & ~_beyond_shot_noise(windows, fit, kept)
        kept[doubtful] = first[doubtful]
    inner = np.s_[:, :, :] if moves else np.s_[:, 1:-1, 1:-1]
    singles = ((first > kept) & ~lines)[inner].mean(axis=(1, 2))
    fits: Bools = fit.converged & (unexplained(windows, fit, kept) <= UNEXPLAINED)
    shape = ~fits | (singles > _MOST)
    kept[shape], lines[shape] = first[shape], False
    n_bad = ((first > kept)[inner]).sum(axis=(1, 2), dtype=np.int64)
    return Looked(kept, lines, n_bad, fit, fits)


def unexplained(windows: Windows, fit: TemplateFit, kept: Pixels | None = None) -> Floats:
    """Share of the light of M windows that a template does not explain and noise does not either:
    the root of max(sum r^2 - sum V, 0) over sum m^2.
    """
    pixels = windows.inner
    weight = 1.0 if kept is None else kept[:, 1:-1, 1:-1]
    model = _model(windows, fit, 0)
    variance = _variance(model, windows.noise, 0.0)
    excess = (((pixels - model) ** 2 - variance) * weight).sum(axis=(1, 2), dtype=np.float64)
    light = (model**2 * weight).sum(axis=(1, 2), dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.sqrt(np.maximum(excess, 0.0) / light), nan=np.inf)


def sure(noise: PixelNoise) -> float:
    """Errors by which a pixel stands out."""
    return _SURE if noise.per_dn else _SURE_OF_UNKNOWN


def _model(windows: Windows, fit: TemplateFit, margin: int) -> Pixels:
    side, dtype = windows.side + 2 * margin, windows.signal.dtype
    at = Templates.of(side, fit.centre, fit.width, dtype, free=False)
    light: Pixels = at.light * fit.flux.astype(dtype)[:, None, None]
    return light


def _variance(model: Pixels, noise: PixelNoise, share: float = _MODEL) -> Pixels:
    """Variance of a pixel, and of a template that is wrong by that share of its light."""
    variance = model * model
    variance *= share**2
    if noise.per_dn:
        variance += noise.per_dn * np.maximum(model, 0.0)
    variance += noise.floor.astype(model.dtype)[:, None, None]
    return variance


def _rest(windows: Windows, fit: TemplateFit) -> Pixels:
    """What a template leaves over of window and margin, in errors."""
    model = _model(windows, fit, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = (windows.signal - model) / np.sqrt(_variance(model, windows.noise))
    return np.nan_to_num(rest, posinf=0.0, neginf=0.0)


def _beyond_shot_noise(windows: Windows, fit: TemplateFit, kept: Pixels) -> Bools:
    """Pixels that still stand out where the shot noise is not known: by the gain that the other
    pixels of the spot tell of.
    """
    model, floor = _model(windows, fit, 1), windows.noise.floor[:, None, None]
    square = (windows.signal - model) ** 2
    light = np.maximum(model, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        per_dn = ((square - floor) * light * kept).sum(axis=(1, 2), keepdims=True) / (
            light**2 * kept
        ).sum(axis=(1, 2), keepdims=True)
    shot = np.maximum(np.nan_to_num(per_dn), 0.0) * light
    return np.asarray(square > sure(windows.noise) ** 2 * (_variance(model, windows.noise) + shot))


def lone_pixels(rest: Pixels) -> Bools:
    """Pixels that stand out of their 3 x 3 neighbours, one of which may be as bad."""
    around = sliding_window_view(np.pad(rest, ((0, 0), (1, 1), (1, 1))), (3, 3), axis=(1, 2))
    ranked = np.sort(around.reshape(*rest.shape, 9), axis=-1)
    apart = np.abs(rest - ranked[..., 4])
    worst = apart[:, 1:-1, 1:-1].max(axis=(1, 2))
    # Light of another spot is less pointed: its third brightest pixel is nearly as bright.
    third = np.where(rest > 0, ranked[..., -3], -ranked[..., 2])
    found: Bools = apart > np.maximum(_SURE, 0.5 * worst)[:, None, None]
    return found & (np.abs(rest) > _POINTED * third)


def dead_pixels(windows: Windows, fit: TemplateFit) -> Bools:
    """Pixels that lack half of their light, twice as much as four of their 3 x 3 neighbours and as
    the other side of the spot: where that is wider than its pixels, no shape ends so in a few.
    """
    light = _model(windows, fit, 1)
    rest = np.minimum(windows.signal - light, 0.0)
    around = sliding_window_view(np.pad(rest, ((0, 0), (1, 1), (1, 1))), (3, 3), axis=(1, 2))
    fourth = np.sort(around.reshape(*rest.shape, 9), axis=-1)[..., -4]
    like = 2.0 * np.minimum(fourth, turned(rest, fit.centre))
    wide = fit.width.min(axis=1)[:, None, None] >= _RESOLVED
    return np.asarray((rest < -0.5 * light) & (rest < like) & wide)


def _lines(rest: Pixels) -> Bools:
    """The worst row or column whose median stands out of the others'."""
    found, inner = np.zeros(rest.shape, dtype=bool), rest[:, 1:-1, 1:-1]
    least, middle = _LINE / np.sqrt(inner.shape[1]), inner.shape[1] // 2
    for axis in (1, 2):
        medians = np.sort(inner, axis=3 - axis).take(middle, axis=3 - axis)
        apart = medians - np.sort(medians, axis=1)[:, middle, None]
        scatter = SIGMA_PER_MAD * np.sort(np.abs(apart), axis=1)[:, middle]
        worst = np.abs(apart).argmax(axis=1)
        each = np.arange(len(rest))
        height = apart[each, worst]
        out = np.abs(height) > np.maximum(least, _LINE_SCATTERS * scatter)
        # Light of another spot stands as well in the lines beside it.
        beside = np.pad(apart, ((0, 0), (1, 1)))[each[:, None], worst[:, None] + (0, 2)]
        out &= np.abs(height) > _POINTED * (np.sign(height)[:, None] * beside).max(axis=1)
        where = (
            (each[out], slice(None), worst[out] + 1) if axis == 2 else (each[out], worst[out] + 1)
        )
        found[where] = True
    return found
