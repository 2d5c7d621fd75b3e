"""What centroiding returns: a place, its error, and what may be wrong with it, for every spot of
every frame.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntFlag
from textwrap import indent, wrap
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats, Ints
from losbench.display import html_table, with_error
from losbench.imaging.detector import Detector
from losbench.imaging.noise import Gain

if TYPE_CHECKING:
    import pandas as pd

    from losbench.imaging.protocols import CentroidMethod

__all__ = ["Centroids", "Measured", "SpotFlag", "flag_counts", "flag_names"]


class SpotFlag(IntFlag):
    """What may be wrong with a centroid; 0 is a spot without reproach.

    Each bit has its ``sentence``, and ``keeps_xy`` says whether there still is a centroid.

    >>> SpotFlag(10)
    <SpotFlag.EDGE|NEIGHBOUR: 10>
    >>> SpotFlag.TOO_FAINT.sentence, SpotFlag.TOO_FAINT.keeps_xy
    ('The flux is below five times its error.', False)
    """

    sentence: str
    keeps_xy: bool

    def __new__(cls, bit: int, sentence: str = "", keeps_xy: bool = True) -> Self:
        """Make a bit with its sentence."""
        flag = int.__new__(cls, bit)
        flag._value_, flag.sentence, flag.keeps_xy = bit, sentence, keeps_xy
        return flag

    NOT_CONVERGED = (
        1,
        "``max_iter`` was reached, or the window ended more than half its side from the start.",
    )
    EDGE = (
        2,
        "The window, or the ring, reaches beyond the frame; no centroid if the window does.",
    )
    SATURATED = (
        4,
        "A pixel at full scale, or more pixels share the maximum than the top of a spot would.",
    )
    NEIGHBOUR = (
        8,
        "Another start lies within six sigma, that is one window, or light of another spot shows.",
    )
    TOO_FAINT = 16, "The flux is below five times its error.", False
    SLOW = (
        32,
        "Contraction above 0.85: the centroid follows its window, and hardly the spot.",
    )
    MISSING = 64, "No start within the frame, or a pixel of the window was not read.", False
    MISFIT = (
        128,
        "Template and window, or their middles, differ by a tenth in light, or a template of the "
        "frames by 3 % or where it is not known: wrong width or shape.",
    )
    RING = (
        256,
        "The spot's own light lies in the ring and tilts the plane: give a larger ring.",
    )
    BAD_PIXEL = (
        512,
        "Pixels were not read, or stand out of a fit: left out, or replaced under a moving window.",
    )
    LOWER_BOUND = (
        1024,
        "No detector, and frames that do not tell: the error leaves out the spot's shot noise.",
    )
    FOUND_AGAIN = (
        2048,
        "The spot was not where the recording led to expect it, and was found elsewhere.",
    )
    CLIPPED = (
        4096,
        "Black is clipped around the spot: its level is too high, the error may be too large.",
    )

    @classmethod
    def table(cls) -> str:
        """Return name, bit and sentence of every flag, a line or two each."""
        rows = []
        for flag in cls:
            end = "" if flag.keeps_xy else " There is no centroid then."
            text = "\n".join(wrap(f"{flag.sentence}{end}", 78))
            rows.append(f"{flag.name} = {flag.value}\n{indent(text, '    ')}")
        return "\n".join(rows)


SpotFlag.__doc__ = f"{SpotFlag.__doc__}\n{indent(SpotFlag.table(), '    ')}\n    "


def flag_names(bits: int) -> str:
    """Names of the flags in a bit field, with bars between them.

    >>> flag_names(10), flag_names(0)
    ('EDGE|NEIGHBOUR', '')
    """
    return SpotFlag(bits).name or ""


def flag_counts(flags: Ints) -> str:
    """How many of many bit fields carry each flag, by name; empty where none does.

    >>> flag_counts(np.array([0, 2, 10]))
    'flags of 3 centroids: EDGE 2, NEIGHBOUR 1'
    """
    counts = ((flag.name, int(np.count_nonzero(flags & flag))) for flag in SpotFlag)
    said = ", ".join(f"{name} {count}" for name, count in counts if count)
    return f"flags of {flags.size} centroids: {said}" if said else ""


@dataclass(frozen=True)
class Measured:
    """Spots that were measured: xy and sigma_xy (..., 2) in frame pixels, the others (...)."""

    xy: Floats
    sigma_xy: Floats
    flux: Floats
    background: Floats
    n_iter: Ints
    flags: Ints
    n_bad: Ints

    @classmethod
    def nothing(cls, shape: tuple[int, ...]) -> Self:
        """Return results of which none has been measured yet."""
        places, values = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
        n_iter = np.zeros(shape, dtype=np.int64)
        flags = np.full(shape, int(SpotFlag.MISSING), dtype=np.int64)
        return cls(places, places.copy(), values, values.copy(), n_iter, flags, n_iter.copy())

    def put(self, where: NDArray[Any] | tuple[NDArray[Any], ...], part: Measured) -> None:
        """Replace what is ``where`` by a part."""
        self.xy[where], self.sigma_xy[where] = part.xy, part.sigma_xy
        self.flux[where], self.background[where] = part.flux, part.background
        self.n_iter[where], self.flags[where] = part.n_iter, part.flags
        self.n_bad[where] = part.n_bad

    def of(self, some: NDArray[Any] | int) -> Measured:
        """Return some of them."""
        return Measured(*(getattr(self, field.name)[some] for field in fields(self)))


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
    window : int or (n,) array of int, pixels
        Side of the window that was used, or of that of each spot where they differ.
    width_px : (n, 2) array or None
        Sigma of each spot's template along x and y, as given or found; None for the methods that
        have no template.
    n_bad : (F, n) array of int or None
        Pixels of the window that were not read or stood out of the fit.
    method : CentroidMethod or None
        What measured them, as given or chosen.
    reason : str
        Why it was chosen, where `AutoCentroid` did.
    noise : Detector or Gain
        What the predicted errors rest on, as given or found.
    """

    xy: Floats
    sigma_xy: Floats
    flux: Floats
    background: Floats
    n_iter: Ints
    flags: Ints
    window: int | Ints
    width_px: Floats | None = None
    n_bad: Ints | None = None
    method: CentroidMethod | None = None
    reason: str = ""
    noise: Detector | Gain | None = None

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas table with one row per frame and spot, and the flags in words."""
        import pandas as pd

        shape = self.flux.shape if self.flux.ndim == 2 else (1, *self.flux.shape)
        frame, spot = np.indices(shape)
        xy, sigma = self.xy.reshape(-1, 2), self.sigma_xy.reshape(-1, 2)
        words = {bits: flag_names(bits) for bits in np.unique(self.flags).tolist()}
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

    def _repr_html_(self) -> str:
        """Return the first spots of the first frame, and how many of all carry which flag."""
        frames, count = np.atleast_2d(self.flux).shape
        xy, sigma = self.xy.reshape(-1, 2), self.sigma_xy.reshape(-1, 2)
        rows = (
            [
                spot,
                with_error(xy[spot, 0], sigma[spot, 0]),
                with_error(xy[spot, 1], sigma[spot, 1]),
                f"{self.flux.ravel()[spot]:.4g}",
                flag_names(int(self.flags.ravel()[spot])),
            ]
            for spot in range(count)
        )
        which = "" if frames == 1 else "; frame 0"
        low, high = np.min(self.window), np.max(self.window)
        window = f"window {low}" if low == high else f"windows {low} to {high}"
        return html_table(
            f"{count} spots in {frames} frames, {window} px{which}",
            ["spot", "x (px)", "y (px)", "flux (DN)", "flags"],
            rows,
            count=count,
            note=flag_counts(self.flags),
        )
