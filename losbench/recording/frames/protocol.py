"""What frames are to the rest: a number of images of one shape, read a block at a time."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats
from losbench.imaging.detector import Detector

__all__ = [
    "Found",
    "Frames",
    "Source",
    "Spans",
    "UnreadableFrame",
    "cut_short",
    "decoding",
    "fits_in",
    "marked",
    "quietly",
]

Spans = Sequence[tuple[int, int]]  # rows of a frame: first, and last (excluded)

_FILTERS = threading.RLock()
_SMALL = 64 * 2**20  # bytes of a frame that any file may claim
_MOST_PACKED = 1100  # Deflate packs 1032 to one, and no camera's noise comes near


class UnreadableFrame(ValueError):
    """A frame that could not be read, or that does not match the others: one line that names it.

    >>> raise UnreadableFrame("frame-3.png cannot be read: not an image, or cut short")
    Traceback (most recent call last):
    losbench.recording.frames.protocol.UnreadableFrame: frame-3.png cannot be read: ...
    """


class Frames(Protocol):
    """What `read_recording` reads from; a reader of your own (`register_reader`) returns one.

    A frozen dataclass without open files, so that it pickles and another process can read. Frames
    may also have ``notes`` (tuple of str), ``left_out`` ((n_frames,) array of bool: what the file
    itself marks as bad), ``label(k)``, the name of a frame, and ``read_rows(i, j, spans, out)``,
    which fills ``out`` with some rows of frames where that costs less than all.

    Attributes
    ----------
    name : str
        What is shown: the name of a file or folder.
    shape : (rows, cols)
    dtype : numpy.dtype
        uint8, uint16 or float32, in native order.
    n_frames : int
    time_s : (n_frames,) array or None
        Seconds since ``start``, NaN where unknown.
    start : numpy.datetime64 or None
        UTC, where it is known.
    detector : Detector or None
        Gain and read noise where the files tell.
    bad : (rows, cols) array of bool or None
        Pixels that are dead or undefined in every frame.
    step : int
        What the numbers of the file were divided by: 16 for left-aligned 12 bit.
    full_scale_dn : float or None
        Reading of a saturated pixel.
    """

    @property
    def name(self) -> str: ...  # noqa: D102 - documented above, as those that follow
    @property
    def shape(self) -> tuple[int, int]: ...  # noqa: D102
    @property
    def dtype(self) -> np.dtype[Any]: ...  # noqa: D102
    @property
    def n_frames(self) -> int: ...  # noqa: D102
    @property
    def time_s(self) -> Floats | None: ...  # noqa: D102
    @property
    def start(self) -> np.datetime64 | None: ...  # noqa: D102
    @property
    def detector(self) -> Detector | None: ...  # noqa: D102
    @property
    def bad(self) -> Bools | None: ...  # noqa: D102
    @property
    def step(self) -> int: ...  # noqa: D102
    @property
    def full_scale_dn(self) -> float | None: ...  # noqa: D102

    def read(self, i: int, j: int, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return frames ``i`` to ``j`` (excluded) as (j - i, rows, cols), in ``out`` if given.

        Raises `UnreadableFrame` for the first of them that cannot be read.
        """
        ...


class Source(Protocol):
    """Where the frames of one format lie, and how one comes from there: a small frozen dataclass.

    ``frame(k)`` is (rows, cols), or (rows, cols, channels), with the numbers of the file.
    """

    @property
    def n_frames(self) -> int: ...  # noqa: D102
    def frame(self, k: int) -> NDArray[Any]: ...  # noqa: D102
    def label(self, k: int) -> str: ...  # noqa: D102


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """What one format tells of its frames; `develop` makes `Frames` of it."""

    name: str
    source: Source
    time_s: Floats | None = None
    start: np.datetime64 | None = None
    detector: Detector | None = None
    bad: Bools | None = None
    left_out: Bools | None = None
    bits: int | None = None  # of the converter, where the file tells
    calibrated: bool = False  # units of light, which have no full scale
    like_grey: int = 0  # by how much channels may differ that are one: 2 after lossy compression
    star: str | None = None
    origin_px: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()


@contextmanager
def decoding(label: str) -> Iterator[None]:
    """Turn what a decoder raises into an `UnreadableFrame` that names the frame or file."""
    try:
        with np.errstate(all="ignore"):
            yield
    except (UnreadableFrame, ImportError):
        raise
    # Decoders of other projects raise anything over damaged bytes: KeyError, struct.error,
    # tokenize.TokenError, zlib.error, cv2.error ... Only their calls stand inside `decoding`.
    except Exception as error:
        raise UnreadableFrame(f"{label} cannot be read: {_in_one_line(error)}") from error


@contextmanager
def quietly() -> Iterator[None]:
    """Leave out the warnings of readers that warn of what is an error, or a note, here.

    One thread at a time: filters of warnings belong to the process, and two threads that change
    them at once would leave them changed.
    """
    with _FILTERS, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _in_one_line(error: Exception) -> str:
    said = str(error.args[0]) if error.args and isinstance(error.args[0], str) else str(error)
    said = " ".join(said.split())[:200]
    if isinstance(error, KeyError) and " " not in said:
        return f"{said} is missing"
    return said or type(error).__name__


def marked(name: str, mask: NDArray[Any]) -> Bools:
    """Return which pixels a mask marks: by what is not 0, and not by NaN."""
    if np.isnan(mask).any():
        raise ValueError(f"{name} must mark pixels by what is not 0, got NaN")
    return np.asarray(mask != 0)


def fits_in(label: str, claimed: int, held: int) -> None:
    """Raise if a header claims a frame of more bytes than a file of ``held`` bytes can hold.

    >>> fits_in("a.png", 2_000_000_000, 251)
    Traceback (most recent call last):
    losbench.recording.frames.protocol.UnreadableFrame: a.png cannot be read: its header claims ...
    """
    if claimed > max(_SMALL, _MOST_PACKED * held):
        raise UnreadableFrame(
            f"{label} cannot be read: its header claims {claimed:_} bytes of image, which a file "
            f"of {held:_} bytes cannot hold"
        )


def cut_short(
    name: str, claimed: int, there: int, *, skip: bool, unit: str = "frame"
) -> tuple[int, tuple[str, ...]]:
    """Return how many frames to use of a file that holds fewer than its header claims, and a note;
    raise unless what is unreadable may be skipped.

    >>> cut_short("a.ser", 100, 60, skip=True)
    (60, ('a.ser is cut short after frame 60 of 100: what came after is lost.',))
    """
    if claimed <= there:
        return claimed, ()
    said = f"{name} is cut short after {unit} {there} of {claimed}"
    if not skip or there < 1:
        hint = ": skip what is unreadable to use those" if there else ""
        raise UnreadableFrame(f"{said}{hint}")
    return there, (f"{said}: what came after is lost.",)
