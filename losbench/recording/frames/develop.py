"""From what a file holds to frames that can be measured: one grey plane, its numbers as the sensor
counted them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats
from losbench.imaging.detector import Detector
from losbench.recording.frames.contiguous import native
from losbench.recording.frames.protocol import Found, Source, Spans, UnreadableFrame

__all__ = ["CHANNELS", "StoredFrames", "develop", "first_readable", "left_aligned_step"]

Read = TypeVar("Read")

CHANNELS = ("red", "green", "blue")
_DTYPES = (np.uint8, np.uint16, np.float32)
_FEWEST_CODES = 16  # below, gaps that are all even may be chance
_CONVERTERS = (10, 12, 14)  # bits that cameras put into 16
_FULL = 2  # pixels of the first frame that share the end of such a converter


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredFrames:
    """`Frames` of a file or folder: a source, and how its numbers become frames.

    Attributes
    ----------
    source : Source
    stored : numpy.dtype
        What the source holds.
    first : str
        Name of the frame that all others must match.
    channel : int or None
        Which channel of colour frames; None where they are grey.
    like_grey : int
        By how much the channels of a grey frame may differ.
    star, origin_px
        What a stamp shows, and where on the detector it begins.
    left_out : (n_frames,) array of bool or None
        Frames that the file itself marks as bad.

    The others are those of `Frames`.
    """

    name: str
    source: Source
    shape: tuple[int, int]
    stored: np.dtype[Any]
    first: str
    channel: int | None = None
    like_grey: int = 0
    step: int = 1
    full_scale_dn: float | None = None
    time_s: Floats | None = None
    start: np.datetime64 | None = None
    detector: Detector | None = None
    bad: Bools | None = None
    left_out: Bools | None = None
    star: str | None = None
    origin_px: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.source.n_frames

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of what `read` returns: the stored type where the centroids take it, else float32."""
        return self.stored if self.stored in _DTYPES else np.dtype(np.float32)

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return self.source.label(k)

    def read(self, i: int, j: int, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return frames ``i`` to ``j`` (excluded) as (j - i, rows, cols)."""
        block = np.empty((j - i, *self.shape), self.dtype) if out is None else out[: j - i]
        whole = getattr(self.source, "block", None)  # where several frames come at the cost of one
        several = None if whole is None else whole(i, j)
        for k in range(i, j):
            label = self.label(k)
            raw = self.source.frame(k) if several is None else several[k - i]
            plane = _grey(raw, self.channel, self.like_grey, label)
            if plane.shape != self.shape or plane.dtype != self.stored:
                raise UnreadableFrame(
                    f"all frames must be {self.shape[0]}x{self.shape[1]} {self.stored} as "
                    f"{self.first}, but {label} is {plane.shape[0]}x{plane.shape[1]} {plane.dtype}"
                )
            block[k - i] = plane if self.step == 1 else plane // self.step
        return block

    def read_rows(self, i: int, j: int, spans: Spans, out: NDArray[Any]) -> None:
        """Fill ``out`` with the rows ``spans`` of frames ``i`` to ``j`` (excluded), one band below
        the other; the rest is not read where a frame lies in its file as it is.
        """
        some = getattr(self.source, "rows", None)
        if self.channel is not None or self.stored != self.dtype:
            some = None
        for k in range(i, j):
            if some is not None and some(k, self.shape, spans, out[k - i]):
                if self.step > 1:
                    out[k - i] //= self.step
            else:
                whole = self.read(k, k + 1)[0]
                np.concatenate([whole[first:last] for first, last in spans], out=out[k - i])


def develop(found: Found, *, channel: str | int | None = None, skip: bool = False) -> StoredFrames:
    """Look at the first frame that can be read, and settle how all are to be read."""
    source = found.source
    if source.n_frames == 0:
        raise ValueError(f"{found.name} holds no frames")
    k, raw = first_readable(source.n_frames, source.frame, skip=skip)
    label = source.label(k)
    number = None if channel is None else _channel(channel, raw, label)
    plane = _grey(raw, number, found.like_grey, label)
    if plane.dtype.kind not in "uif":
        raise UnreadableFrame(f"{label} must hold numbers, got {plane.dtype}")
    if 0 in plane.shape:
        raise UnreadableFrame(f"{label} must hold pixels, got {plane.shape[0]}x{plane.shape[1]}")
    step = left_aligned_step(plane) if plane.dtype == np.uint16 and found.bits is None else 1
    notes = list(found.notes)
    if raw.ndim == 3 and raw.shape[-1] > 1:
        notes.append(_said_of_channels(raw.shape[-1], number, found.name))
    if step > 1:
        notes.append(
            f"The numbers of {found.name} count in steps of {step} (left-aligned data): they are "
            f"divided by {step}."
        )
    return StoredFrames(
        name=found.name,
        source=source,
        shape=(plane.shape[0], plane.shape[1]),
        stored=plane.dtype,
        first=label,
        channel=number,
        like_grey=found.like_grey,
        step=step,
        full_scale_dn=None if found.calibrated else _full_scale(plane, step, found.bits),
        time_s=found.time_s,
        start=found.start,
        detector=found.detector,
        bad=found.bad,
        left_out=found.left_out,
        star=found.star,
        origin_px=found.origin_px,
        notes=tuple(notes),
    )


def first_readable(count: int, read: Callable[[int], Read], *, skip: bool) -> tuple[int, Read]:
    """Number and content of the first of ``count`` that can be read; it must be the very first,
    without ``skip``.
    """
    for k in range(count - 1):
        try:
            return k, read(k)
        except UnreadableFrame:
            if not skip:
                raise
    return count - 1, read(count - 1)


def left_aligned_step(frame: NDArray[np.uint16]) -> int:
    """Return the power of two that a frame's numbers are multiples of, apart from an offset.

    Codes that occur once do not count: they may be dead pixels.

    >>> codes = np.random.default_rng(1).integers(100, 400, (50, 50)).astype(np.uint16)
    >>> left_aligned_step(codes), left_aligned_step(codes * 16 + 7)
    (1, 16)
    """
    codes = np.flatnonzero(np.bincount(frame.reshape(-1)) > 1)
    if len(codes) < _FEWEST_CODES:
        return 1
    common = int(np.gcd.reduce(np.diff(codes)))
    return common & -common


def _full_scale(plane: NDArray[Any], step: int, bits: int | None) -> float | None:
    """Reading of a saturated pixel, found on the integers of the file."""
    if bits is not None:
        return float(2**bits - 1)
    if plane.dtype.kind == "f":
        return None
    top = int(plane.max()) // step
    if plane.dtype.itemsize > 1:
        ends = [2**b - 1 for b in _CONVERTERS if 2**b - 1 <= np.iinfo(np.uint16).max // step]
        if top in ends and (plane // step == top).sum() >= _FULL:
            return float(top)
    return float(np.iinfo(plane.dtype).max // step)


def _channel(channel: str | int, raw: NDArray[Any], label: str) -> int:
    if raw.ndim == 2:
        raise ValueError(f"channel is for colour frames, but {label} is grey")
    number = CHANNELS.index(channel) if channel in CHANNELS else channel
    count = raw.shape[-1]
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < count:
        raise ValueError(
            f"channel must be 'red', 'green' or 'blue', or a number below the {count} channels of "
            f"{label}, got {channel!r}"
        )
    return number


def _grey(raw: NDArray[Any], channel: int | None, like_grey: int, label: str) -> NDArray[Any]:
    """Return one plane (rows, cols): that channel, or the one that all channels hold."""
    raw = native(raw)
    if raw.ndim == 2:
        return raw
    if raw.ndim != 3:
        raise UnreadableFrame(f"{label} must be one grey image (rows, cols), got shape {raw.shape}")
    count = raw.shape[-1]
    if channel is not None and channel < count:
        return raw[..., channel]
    if count in (2, 4):
        if raw.size and (raw[..., -1] != raw[0, 0, -1]).any():
            raise UnreadableFrame(
                f"{label} must be one grey image (rows, cols), got a channel of transparency that "
                "is not the same everywhere: choose one with channel=0 (--channel 0)"
            )
        raw, count = raw[..., :-1], count - 1
    if count == 1:
        return raw[..., 0]
    if count == 3 and raw.dtype.kind in "uif":
        green = raw[..., 1]
        apart = np.abs(raw - green[..., None] if raw.dtype.kind == "f" else _apart(raw, green))
        if not (apart > like_grey).any():
            return green
    raise UnreadableFrame(
        f"{label} must be one grey image (rows, cols), got {count} colour channels that differ: "
        "choose one with channel='red', 'green' or 'blue' (--channel)"
    )


def _apart(raw: NDArray[Any], green: NDArray[Any]) -> NDArray[Any]:
    """Differences of unsigned numbers, which would wrap around."""
    return np.maximum(raw, green[..., None]) - np.minimum(raw, green[..., None])


def _said_of_channels(count: int, channel: int | None, name: str) -> str:
    if channel is not None:
        called = CHANNELS[channel] if channel < len(CHANNELS) and count > 2 else str(channel)
        return f"Of the {count} channels of {name} the one called {called} is measured."
    return f"The {count} channels of {name} show one grey image: it is measured."
