"""What the engine and the methods of centroiding hand each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Bools, Floats, Indices, Ints, Pixels
from losbench.imaging.noise import PixelNoise

__all__ = ["CentroidFields", "CentroidMethod", "Estimate", "Window", "Windows"]


Window: TypeAlias = int | tuple[int, ...]  # the side of one, or of the window of each spot


@dataclass(frozen=True)
class Windows:
    """M windows to be weighed, all of one call.

    Parameters
    ----------
    signal : (M, S, S) array, DN
        Without background; S is the window's side and a margin of one pixel around it.
    side : int, pixels
    start : (M, 2) array, pixels
        Where each spot is thought to be, counted from the middle of its window.
    middle : (M, 2) array of int, pixels
        Which pixel of its frame each window was cut around.
    noise : PixelNoise
    width : (M, 2) array, pixels
        Sigma of each spot along x and y; NaN unless the method has a template that needs it.
    kept : (M, S, S) array or None
        0 for a pixel that was not read or is saturated, else 1; None where all are kept, and always
        unless the method has a template.
    leave : float, pixels
        How far a spot may go from the middle of its window before that is cut anew.
    healed : (M, S, S) array or None, DN
        The signal with bad pixels replaced, where some stand out of windows without a template.
    spot : (M,) array of int or None
        Which spot of the call each is; None: all are one.
    """

    signal: Pixels
    side: int
    start: Floats
    middle: Indices
    noise: PixelNoise
    width: Floats
    kept: Pixels | None = None
    leave: float = 1.0
    healed: Pixels | None = None
    spot: Indices | None = None

    @cached_property
    def inner(self) -> Pixels:
        """Signal without the margin, in a row: made once."""
        return np.ascontiguousarray(self.signal[:, 1:-1, 1:-1])

    def of(self, some: NDArray[Any] | slice) -> Windows:
        """Return some of the windows."""
        return Windows(
            self.signal[some],
            self.side,
            self.start[some],
            self.middle[some],
            self.noise.of(some),
            self.width[some],
            None if self.kept is None else self.kept[some],
            self.leave,
            None if self.healed is None else self.healed[some],
            None if self.spot is None else self.spot[some],
        )


@dataclass(frozen=True)
class Estimate:
    """Centroids of M windows, counted from the middle of their stamps.

    Centroid and its error (M, 2), flux and its error (M,), evaluations, converged or not, the
    middle of the window (M, 2), whether the centroid follows its window more than the spot, whether
    a template does not fit it, and the width of that template (M, 2), if there is one. A method
    that has looked for bad pixels by itself says how many it has left out (M,); None: it has not.
    """

    centroid: Floats
    sigma: Floats
    flux: Floats
    sigma_flux: Floats
    n_iter: Ints
    converged: Bools
    middle: Floats
    slow: Bools
    misfit: Bools
    width: Floats | None = None
    n_bad: Ints | None = None


class CentroidFields(Protocol):
    """The fields of a `CentroidMethod`, which says what they mean."""

    @property
    def window(self) -> Window | None: ...  # noqa: D102
    @property
    def width(self) -> ArrayLike | None: ...  # noqa: D102
    @property
    def centre(self) -> str | None: ...  # noqa: D102
    @property
    def hot_pixel_gate(self) -> bool: ...  # noqa: D102
    @property
    def smooth(self) -> str | None: ...  # noqa: D102


@runtime_checkable
class CentroidMethod(CentroidFields, Protocol):
    """A way to find the middle of a spot: a frozen dataclass with these fields and one method.

    Attributes
    ----------
    window : int, (n,) tuple or None, pixels
        Side of the window, odd, or of that of each spot; None: chosen from the data.
    centre : "start", "peak" or None
        Where the first window stands. None: "peak" for a window that ``stays``, and in `measure`;
        else "start".
    hot_pixel_gate : bool
        Replace pixels that stand out of their 3 x 3 median before anything is weighed.
    smooth : "kalman" or None
        Smooth the places of every spot over the frames.
    stays : bool
        Whether the window stays on the pixel where it was first put.
    template : bool
        Whether a template is fitted, which goes without pixels that were not read.
    width : array or None, pixels
        Widths of the spots, where there is a template; None: found; empty: not needed.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    stays: ClassVar[bool]
    template: ClassVar[bool]

    def measure(self, windows: Windows) -> Estimate:
        """Find the middle of the spot in each of M windows, with its error."""
        ...
