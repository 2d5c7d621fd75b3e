"""The noise of a reading from what a Gaussian leaves of a spot, where frames are too few to
compare.

What two frames differ by is noise, whatever the spot looks like. What a template leaves over is
noise only where the spot is a Gaussian: any other shape counts as noise, and is not believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.imaging.columns import Templates
from losbench.imaging.groups import Group
from losbench.imaging.noise import Gain, step_of
from losbench.imaging.protocols import Windows
from losbench.imaging.scrutiny import unexplained
from losbench.imaging.template import TemplateFit, fit_template
from losbench.imaging.widths import spot_fits

__all__ = ["template_gain"]


_ROUNDS, _STEPS = 3, 12
_SHAPE = 0.02  # of the light that a Gaussian may leave unexplained
_SURE = 3.0  # errors of the gain
_OWN = 0.7  # leverage: such a pixel is explained by itself
_FAR = 16.0  # squares of the noise: what lies further off is no noise
_CLOSE = 1e-5  # pixels squared
_COLUMNS = ((0, 0), (0, 1), (1, 0), (0, 2), (2, 0))  # the template, its slopes by place and width


def template_gain(groups: Sequence[Group], stack: NDArray[Any]) -> Gain:
    """Gain of one frame or two (F, H, W) with groups of spots; with an infinite error where the
    spots are no Gaussians, or too faint to tell it.
    """
    seen = []
    for group in groups:
        fits = spot_fits(group, stack)
        if fits.bright.any():
            seen.append((fits.windows.of(fits.bright), fits.fit.of(fits.bright)))
    per_dn, error = 0.0, np.inf
    for k in range(_ROUNDS if seen else 0):
        moment = normal = 0.0
        for n, (windows, fit) in enumerate(seen):
            noise = replace(windows.noise, per_dn=per_dn)
            part = replace(windows, start=fit.centre, width=fit.width, noise=noise)
            fitted = fit_template(part, free=True, tolerance=_CLOSE, max_iter=_STEPS)
            seen[n] = part, fitted
            left = _Left.of(part, fitted, first=k == 0)
            moment += float((left.weight * left.light * left.excess).sum())
            normal += float((left.weight * left.light**2).sum())
        per_dn, error = max(moment / max(normal, 1e-300), 0.0), max(normal, 1e-300) ** -0.5
    told = bool(seen) and per_dn > _SURE * error
    if told:
        share = [
            unexplained(replace(part, noise=replace(part.noise, per_dn=per_dn)), fit)
            for part, fit in seen
        ]
        told = float(np.median(np.concatenate(share))) < _SHAPE
    return Gain(per_dn, error, step_of(stack)) if told else Gain(0.0, np.inf, step_of(stack))


@dataclass(frozen=True)
class _Left:
    """What templates leave of the pixels (M, S) of windows: their light, by how much the square of
    what is left, corrected for leverage, exceeds the variance without light, and its weight.
    """

    light: Floats
    excess: Floats
    weight: Floats

    @classmethod
    def of(cls, windows: Windows, fit: TemplateFit, *, first: bool) -> Self:
        """In the first round the variance is hardly known yet: nothing is cut."""
        count, side = len(fit.flux), windows.side
        at = Templates.of(side, fit.centre, fit.width, np.float64, free=True)
        x, y = at.profiles[:, 0], at.profiles[:, 1]
        offset = np.broadcast_to(np.arange(side) - side // 2.0, (count, side, side))
        columns = [y[:, i, :, None] * x[:, j, None, :] for i, j in _COLUMNS]
        columns += [np.ones_like(offset), offset, offset.swapaxes(1, 2)]
        basis = np.stack(columns, axis=-1).reshape(count, side**2, len(columns))
        light = np.maximum(fit.flux[:, None] * basis[:, :, 0], 0.0)
        floor, per_dn = windows.noise.floor[:, None], windows.noise.per_dn
        variance = np.maximum(floor + per_dn * light, 1e-30)
        across = basis / np.sqrt(variance)[:, :, None]
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        across, _ = np.linalg.qr(across)
        data = windows.signal[:, 1:-1, 1:-1].reshape(count, -1) / np.sqrt(variance)
        rest = data - (across @ (across.swapaxes(1, 2) @ data[:, :, None]))[:, :, 0]
        leverage = np.einsum("msk,msk->ms", across, across)
        square = rest**2 / np.maximum(1.0 - leverage, 1e-6)
        use = (leverage < _OWN) & (first | (square < _FAR))
        weight = np.where(use, (1.0 - leverage) / (2.0 * variance**2), 0.0)
        return cls(light, square * variance - floor, weight)
