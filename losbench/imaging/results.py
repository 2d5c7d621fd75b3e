"""What centroiding returns: a place, its error, and what may be wrong with it, for every spot of
every frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntFlag
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats, Ints

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Centroids", "SpotFlag", "all_missing", "only_frame"]


class SpotFlag(IntFlag):
    """What may be wrong with a centroid; the docstring of `centroid` says what each bit means.

    >>> SpotFlag(10)
    <SpotFlag.EDGE|NEIGHBOUR: 10>
    """

    NOT_CONVERGED = 1
    EDGE = 2
    SATURATED = 4
    NEIGHBOUR = 8
    TOO_FAINT = 16
    SLOW = 32
    MISSING = 64
    MISFIT = 128
    RING = 256


@dataclass(frozen=True)
class Centroids:
    """Centroids of n spots in F frames; the frame axis is absent if one frame was given.

    Parameters
    ----------
    xy : (F, n, 2) array, pixels
        Centroid (x, y); NaN where there is none.
    sigma_xy : (F, n, 2) array, pixels
        Predicted one-sigma error.
    flux : (F, n) array, DN
        Without background: the sum of the window, or of the whole template.
    background : (F, n) array, DN
        Background under the centroid.
    n_iter : (F, n) array of int
        How often a window, or a template, was evaluated.
    flags : (F, n) array of int
        Bits of `SpotFlag`; 0 is a spot without reproach.
    window : int, pixels
        Side of the window that was used.
    width_px : (n, 2) array or None
        Sigma of each spot's template along x and y, as given or found; None for the methods that
        have no template.
    """

    xy: Floats
    sigma_xy: Floats
    flux: Floats
    background: Floats
    n_iter: Ints
    flags: Ints
    window: int
    width_px: Floats | None = None

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas table with one row per frame and spot, and the flags in words."""
        import pandas as pd

        shape = self.flux.shape if self.flux.ndim == 2 else (1, *self.flux.shape)
        frame, spot = np.indices(shape)
        xy, sigma = self.xy.reshape(-1, 2), self.sigma_xy.reshape(-1, 2)
        words = {
            bits: "|".join(flag.name or "" for flag in SpotFlag(bits))
            for bits in np.unique(self.flags).tolist()
        }
        columns = {
            "frame": frame.ravel(),
            "spot": spot.ravel(),
            "x": xy[:, 0],
            "y": xy[:, 1],
            "sigma_x": sigma[:, 0],
            "sigma_y": sigma[:, 1],
            "flux": self.flux.ravel(),
            "background": self.background.ravel(),
            "n_iter": self.n_iter.ravel(),
            "flags": [words[bits] for bits in self.flags.ravel().tolist()],
        }
        return pd.DataFrame(columns)


def all_missing(shape: tuple[int, ...], window: int, width_px: Floats | None) -> Centroids:
    """Results of which none has been measured yet."""

    def nothing(*axes: int) -> Floats:
        return np.full(axes, np.nan)

    flags = np.full(shape, int(SpotFlag.MISSING), dtype=np.int64)
    n_iter = np.zeros(shape, dtype=np.int64)
    places = nothing(*shape, 2), nothing(*shape, 2)
    return Centroids(*places, nothing(*shape), nothing(*shape), n_iter, flags, window, width_px)


def only_frame(result: Centroids) -> Centroids:
    """Leave the frame axis out."""
    names = ("xy", "sigma_xy", "flux", "background", "n_iter", "flags")
    return replace(result, **{name: getattr(result, name)[0] for name in names})
