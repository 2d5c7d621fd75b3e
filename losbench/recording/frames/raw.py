"""Raw frames, described by a TOML file: whole bytes, or 10, 12 and 14 bits packed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.checks import choice, integer
from losbench.parameters import from_table, read_toml
from losbench.recording.frames.contiguous import Contiguous
from losbench.recording.frames.handles import file_size, opened, plain_file
from losbench.recording.frames.packed import unpacked, unpacked_gige
from losbench.recording.frames.protocol import Found, Source, Spans, cut_short, decoding

__all__ = ["PackedFrames", "RawLayout", "open_raw"]

_WHOLE = {"mono8": 8, "mono10": 10, "mono12": 12, "mono14": 14, "mono16": 16}
_LOW_FIRST = {"mono10p": 10, "mono12p": 12, "mono14p": 14}
_GIGE = {"mono10packed": 10, "mono12packed": 12}
_PIXELS = _WHOLE | _LOW_FIRST | _GIGE


@dataclass(frozen=True, kw_only=True)
class RawLayout:
    """How frames lie in a raw file, as its TOML file says.

    Parameters
    ----------
    file : str
        Name of the raw file, beside the TOML file.
    pixels : str
        mono8; mono10, mono12, mono14, mono16 (two bytes each); mono10p, mono12p, mono14p (GenICam:
        low bits first); mono10packed, mono12packed (GigE Vision).
    shape : (rows, cols)
    header_bytes : int
        Bytes before the first frame.
    gap_bytes : int
        Bytes between frames, and perhaps after the last one.
    byte_order : "little" or "big"
        Of the pixels of two bytes.

    Examples
    --------
    >>> RawLayout(file="night.raw", pixels="mono12p", shape=(1080, 1920)).frame_bytes
    3110400
    """

    file: str
    pixels: str
    shape: tuple[int, int]
    header_bytes: int = 0
    gap_bytes: int = 0
    byte_order: str = "little"

    def __post_init__(self) -> None:
        choice("pixels", self.pixels, _PIXELS)
        choice("byte_order", self.byte_order, ("little", "big"))
        if not isinstance(self.file, str) or not self.file:
            raise ValueError(f"file must be the name of the raw file, got {self.file!r}")
        if not isinstance(self.shape, tuple | list) or len(self.shape) != 2:
            raise ValueError(f"shape must be (rows, cols), got {self.shape!r}")
        object.__setattr__(
            self, "shape", tuple(integer("shape", side, low=1, high=2**20) for side in self.shape)
        )
        integer("header_bytes", self.header_bytes, low=0)
        integer("gap_bytes", self.gap_bytes, low=0)

    @property
    def bits(self) -> int:
        """Bits of a pixel."""
        return _PIXELS[self.pixels]

    @property
    def frame_bytes(self) -> int:
        """Length of a frame in bytes."""
        count = self.shape[0] * self.shape[1]
        if self.pixels in _WHOLE:
            return count * (1 if self.bits == 8 else 2)
        return -(-count // 2) * 3 if self.pixels in _GIGE else -(-count * self.bits // 8)


@dataclass(frozen=True, eq=False)
class PackedFrames:
    """Packed frames of a raw file, which run on over the ends of their rows."""

    stored: Contiguous
    layout: RawLayout

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.stored.n_frames

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame."""
        return self._unpacked(self.stored.frame(k), self.layout.shape)

    def rows(self, k: int, shape: tuple[int, int], spans: Spans, out: NDArray[Any]) -> bool:
        """Fill some rows of a frame, if rows begin and end at whole bytes; return whether they
        do.
        """
        rows, columns = self.layout.shape
        row_bytes, over = divmod(columns * (12 if self._gige else self.layout.bits), 8)
        if over or shape != self.layout.shape:
            return False
        packed = np.empty((len(out), row_bytes), np.uint8)
        in_bytes = (rows, row_bytes)
        replace(self.stored, shape=in_bytes).rows(k, in_bytes, spans, packed)
        out[...] = self._unpacked(packed.reshape(-1), out.shape)
        return True

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return self.stored.label(k)

    @property
    def _gige(self) -> bool:
        return self.layout.pixels in _GIGE

    def _unpacked(self, line: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
        unpack = unpacked_gige if self._gige else unpacked
        return unpack(line, self.layout.bits, shape[0] * shape[1]).reshape(shape)


def open_raw(path: Path, *, skip: bool) -> Found:
    """Return the raw frames that a TOML file describes."""
    layout = from_table(RawLayout, read_toml(path), where=path.name)
    raw = path.parent / layout.file
    if not raw.is_file():
        raise FileNotFoundError(f"{path.name} describes {layout.file}, which is not beside it")
    stride = layout.frame_bytes + layout.gap_bytes
    with decoding(raw.name):
        held = max(file_size(opened(plain_file, raw)) - layout.header_bytes, 0)
    there = (held + layout.gap_bytes) // stride  # a gap after the last frame may be there or not
    n_frames, notes = cut_short(raw.name, there + (held > there * stride), there, skip=skip)
    whole = layout.pixels in _WHOLE
    order = "<" if layout.byte_order == "little" else ">"
    kind: np.dtype[Any] = np.dtype(f"{order}u2" if whole and layout.bits > 8 else "u1")
    stored = Contiguous(
        path=raw,
        offsets=layout.header_bytes,
        n_frames=n_frames,
        shape=layout.shape if whole else (layout.frame_bytes,),
        dtype=kind,
        stride=stride,
    )
    source: Source = stored if whole else PackedFrames(stored, layout)
    return Found(name=raw.name, source=source, bits=layout.bits, notes=notes)
