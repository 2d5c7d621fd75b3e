"""The noise of a reading from the frames themselves: photon transfer on spots that hardly move.

The variance of a pixel is floor + per_dn * signal. The floor is the scatter of the ring around a
spot. The rest shows where two frames of one spot differ: once what a shift, a change of width, of
light or of background explains is taken out of the difference, half of its square is a sample of
the variance at the signal of that pixel (Janesick, Photon Transfer, SPIE Press 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats, Indices
from losbench.checks import finite
from losbench.imaging.eiwa import EIWA
from losbench.imaging.groups import Group, in_order
from losbench.imaging.noise import Gain, Transfer, step_of
from losbench.imaging.pairs import Pairs, nearest_pairs
from losbench.imaging.places import as_stack, as_starts, evenly
from losbench.imaging.residuals import template_gain
from losbench.imaging.results import Measured, SpotFlag

__all__ = ["estimate_gain", "recording_gain"]


_FEWEST_FRAMES = 3
_FRAMES = 64
_SPOTS = 16  # the brightest
_PAIRS = 96  # windows in all: the gain to a few percent
_PIXELS = 2**18  # in all of them
_BLOCK_PIXELS = 2**15  # that are worked on at once
_ROUNDS = 3
_MANY = 48  # pairs
_EVERY = 4
_OWN = 0.7  # leverage: such a pixel is explained by itself
_SURE = 3.0  # sigma
_ALIKE = 1e-9  # of a unit diagonal
_OPEN = 2.0  # times a variance: beyond such an error, it may be anything
_BINS = 12
_FAR = 16.0  # squares of the noise: what differs by more is no noise


def estimate_gain(
    frames: ArrayLike, xy: ArrayLike, width: ArrayLike, *, full_scale_dn: float = np.inf
) -> Gain:
    """Estimate how the variance of a reading grows with the signal, from spots in three frames or
    more.

    Parameters
    ----------
    frames : (F, H, W) array, DN
    xy : (n, 2) or (F, n, 2) array, pixels
        Centroids, NaN where a spot is missing; the better they are, the closer the pairs.
    width : float or (n,) array, pixels
        Sigma of the spots, to some ten percent.
    full_scale_dn : float
        Reading of a saturated pixel.

    Returns
    -------
    Gain
        With an infinite error if there are fewer than three frames, no spot tells, or the error of
        the brightest pixel's variance is more than twice that variance.

    Raises
    ------
    ValueError
        If shapes do not match.

    Notes
    -----
    Neither offset nor read noise are needed. Each frame is paired with the one in which the spot
    lies nearest. Out of the difference of two windows are projected, weighted by the noise: a
    level, the mean window itself, a plane, the first and second central differences of the mean,
    and a Gaussian with its slopes by place and width, which hold where a spot is too sharp for
    differences. The samples of the variance, corrected for leverage, are regressed on the signal
    and on gradient squared times shift squared, which takes up what a shift leaves.

    Examples
    --------
    >>> import losbench as lb
    >>> camera = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
    >>> light = lb.render_spots([[20.3, 15.8]], 2e5, 2.0, (40, 40)) + 30.0
    >>> frames = camera.expose(np.stack([light] * 50), 1)
    >>> gain = lb.estimate_gain(frames, [[20.3, 15.8]], 2.0)
    >>> round(gain.per_dn, 1), gain.std_error < 0.05
    (0.5, True)
    """
    stack = as_stack(frames)
    places = as_starts("xy", xy, len(stack))
    widths = np.broadcast_to(finite("width", width), places.shape[1:2])
    step = step_of(stack)
    if len(stack) < _FEWEST_FRAMES:
        return Gain(0.0, np.inf, step)
    spots = _brightest(stack, places)
    sides = 2 * np.ceil(3.0 * widths).astype(int) + 1
    found = []
    for side in np.unique(sides[spots]).tolist():
        alike = spots[sides[spots] == side]
        most = min(_PAIRS // len(spots), _PIXELS // (len(spots) * side**2))
        pairing = nearest_pairs(places[:, alike], max(most, 2))
        block = max(1, _BLOCK_PIXELS // side**2)
        for part in (pairing.of(slice(k, k + block)) for k in range(0, len(pairing.spot), block)):
            spot = alike[part.spot]
            at = places[part.frames, spot[:, None]]
            cut = Pairs.compared(stack, part, at, widths[spot], side, full_scale_dn, step)
            found.append(cut)
    if not found:
        return Gain(0.0, np.inf, step)
    slope = _slope(found)
    if not _tells(slope, found):
        return Gain(0.0, np.inf, step)
    return Gain(slope.per_dn, slope.error, step, _curve(found, slope))


def recording_gain(groups: Sequence[Group], stack: NDArray[Any]) -> Gain:
    """Gain of frames (F, H, W) with groups of spots; of fewer than three by `template_gain`."""
    chosen = evenly(len(stack), _FRAMES)
    some = stack if len(chosen) == len(stack) else stack[chosen]
    near = in_order(groups, [group.at[chosen].swapaxes(0, 1) for group in groups]).swapaxes(0, 1)
    bright = _brightest(some, near)
    near = near[:, bright]
    if not near.size:
        return Gain(0.0, np.inf, step_of(stack))
    few = []
    for group in groups:
        own = np.flatnonzero(np.isin(bright, group.numbers))
        if own.size:
            few.append(replace(group, numbers=own).put(some, near[:, own]))
    if len(stack) < _FEWEST_FRAMES:
        return template_gain(few, some)
    seen, width = Measured.nothing(near.shape[:2]), np.empty(len(bright))
    for group in few:
        look = group.of(method=EIWA(group.engine.window))
        look.measure(some, np.full((len(group.numbers), 2), np.nan), seen)
        width[group.numbers] = group.engine.window / 6.0
    xy = np.where((seen.flags & SpotFlag.NOT_CONVERGED > 0)[..., None], np.nan, seen.xy)
    return estimate_gain(some, xy, width, full_scale_dn=groups[0].engine.full_scale_dn)


def _brightest(stack: NDArray[Any], places: Floats) -> Indices:
    """Spots whose middle pixel reads most, of those that three frames show, or all of fewer."""
    _, rows, columns = stack.shape
    pixel = np.rint(np.nan_to_num(places, nan=-1.0)).astype(np.intp)
    inside = ((pixel >= 0) & (pixel < (columns, rows))).all(axis=-1)
    frame, spot = np.nonzero(inside)
    x, y = pixel[inside].T
    reading = np.full(inside.shape, np.nan)
    reading[frame, spot] = stack[frame, y, x]
    seen = np.isfinite(reading).sum(axis=0)
    mean = np.where(np.isfinite(reading), reading, 0.0).sum(axis=0) / np.maximum(seen, 1)
    shown = np.flatnonzero(seen >= min(_FEWEST_FRAMES, len(stack)))
    return shown[np.argsort(-mean[shown], kind="stable")[:_SPOTS]]


@dataclass(frozen=True)
class _Samples:
    """Samples of the variance of each pixel, and their weights, (P, S)."""

    square: Floats
    weight: Floats


@dataclass(frozen=True)
class _Slope:
    """Slope of the variance over the signal, over what a shift leaves, the error of the first, and
    the samples of each spot that they were read from.
    """

    per_dn: float
    left: float
    error: float
    samples: list[_Samples]


def _slope(found: list[Pairs]) -> _Slope:
    """Regress the variance on the signal, with the weights of the last round.

    The rounds before, which only tell the weights, make do with some of many pairs.
    """
    per_dn, left, error = 0.0, 0.0, np.inf
    every = 1 if sum(len(pairs.level) for pairs in found) < _MANY else _EVERY
    few = [pairs.of(slice(None, None, every)) for pairs in found]
    for k, some in enumerate([few] * (_ROUNDS - 1) + [found]):
        normal, moment, spread = np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2))
        samples = [_samples(pairs, per_dn, left, first=k == 0) for pairs in some]
        for pairs, seen in zip(some, samples, strict=True):
            columns = np.stack([pairs.signal, pairs.shifted], axis=1)
            weighted = seen.weight[:, None] * columns
            part = weighted @ columns.swapaxes(1, 2)
            normal += part.sum(axis=0)
            spread += np.tensordot(pairs.shared, part, 1)
            moment += np.einsum("pis,ps->i", weighted, seen.square - pairs.floor)
        unit = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.pinv(normal / np.outer(unit, unit), hermitian=True)
        inverse /= np.outer(unit, unit)
        per_dn, left = (float(value) for value in inverse @ moment)
        covariance = inverse @ spread @ inverse
        # Kept only where it is sure: its slope is much like that of the signal.
        if left < _SURE * np.sqrt(covariance[1, 1]):
            per_dn, left = float(moment[0] / max(normal[0, 0], 1e-300)), 0.0
            covariance = spread / max(normal[0, 0], 1e-300) ** 2
        per_dn, error = max(per_dn, 0.0), float(np.sqrt(covariance[0, 0]))
    return _Slope(per_dn, left, error if error > 0 else np.inf, samples)


def _tells(slope: _Slope, found: list[Pairs]) -> bool:
    """Whether the variance of the brightest pixel is known to better than twice itself."""
    top = max(float((pairs.signal * pairs.use).max(initial=0.0)) for pairs in found)
    floor = float(np.median(np.concatenate([pairs.floor.ravel() for pairs in found])))
    return slope.error * top <= _OPEN * (floor + slope.per_dn * top)


def _curve(found: list[Pairs], slope: _Slope) -> Transfer:
    """Mean variance over signal, in bins of as many pixels."""
    signal, square = [], []
    for pairs, seen in zip(found, slope.samples, strict=True):
        signal.append(pairs.signal[seen.weight > 0])
        square.append((seen.square - slope.left * pairs.shifted)[seen.weight > 0])
    along, variance = np.concatenate(signal), np.concatenate(square)
    order = np.argsort(along)
    bins = [part for part in np.array_split(order, _BINS) if len(part)]
    mean = np.array([variance[part].mean() for part in bins])
    return Transfer(
        np.array([along[part].mean() for part in bins]),
        mean,
        np.array([np.sqrt(2.0 / len(part)) for part in bins]) * mean,
        float(np.median(np.concatenate([pairs.floor.ravel() for pairs in found]))),
        float(np.median(np.concatenate([pairs.level for pairs in found]))),
    )


def _samples(pairs: Pairs, per_dn: float, left: float, *, first: bool) -> _Samples:
    """Half the squares of what nothing explains of the differences, corrected for leverage.

    In the first round the variance is hardly known yet: nothing is cut, all weigh alike.
    """
    variance = pairs.floor + np.maximum(per_dn * pairs.signal, 0.0) + left * pairs.shifted
    variance = np.maximum(variance, 1e-30)
    root = np.sqrt(variance)
    columns = pairs.basis * (pairs.use / root)[:, None]
    normal = columns @ columns.swapaxes(1, 2)
    length = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    length = np.where(length > 0, length, 1.0)
    length = length[:, :, None] * length[:, None, :]
    # Two columns that are alike count as one.
    inverse = np.linalg.inv(normal / length + _ALIKE * np.eye(normal.shape[1])) / length
    across = inverse @ columns
    data = pairs.difference / root
    rest = data - (((columns @ data[..., None])[..., 0])[:, None] @ across)[:, 0]
    leverage = np.einsum("pks,pks->ps", across, columns)
    square = rest**2 / (2.0 * np.maximum(1.0 - leverage, 1e-6)) * variance
    use = pairs.use & (leverage < _OWN)
    if not first:
        use &= square < _FAR * variance
    weight = (1.0 - leverage) / (2.0 if first else 2.0 * variance**2)
    return _Samples(square, np.where(use, weight, 0.0))
