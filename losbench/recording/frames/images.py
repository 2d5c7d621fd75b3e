"""Folders of PNG, BMP, PGM, JPEG and single TIFF images: one frame a file."""

from __future__ import annotations

import io
import os
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.contiguous import fill_rows
from losbench.recording.frames.handles import quiet_opencv
from losbench.recording.frames.plainpages import only_page
from losbench.recording.frames.protocol import (
    Found,
    Spans,
    UnreadableFrame,
    decoding,
    fits_in,
    quietly,
)
from losbench.recording.frames.tiff import TIFF, facts, single_page

__all__ = ["IMAGES", "ImageFiles", "open_images"]

_LOSSY = (".jpg", ".jpeg")
_PNG = b"\x89PNG\r\n\x1a\n"
_GREY = 0  # colour type of a PNG
_PGM_HEADER = re.compile(rb"#[^\n]*")
IMAGES = (".png", ".bmp", ".pgm", ".pnm", *_LOSSY, *TIFF)


@dataclass(frozen=True, eq=False)
class ImageFiles:
    """One image a file: names in one folder, in the order of the frames."""

    folder: Path
    names: tuple[str, ...]

    @property
    def n_frames(self) -> int:
        """Number of files."""
        return len(self.names)

    def frame(self, k: int) -> NDArray[Any]:
        """Return the image of one file."""
        path, label = self.folder / self.names[k], self.label(k)
        if path.suffix.lower() in TIFF:
            return single_page(path, label)
        return _decoded(path, label)

    def rows(self, k: int, shape: tuple[int, int], spans: Spans, out: NDArray[Any]) -> bool:
        """Fill some rows of a TIFF that lies in its file as it is; return whether it does."""
        path, label = self.folder / self.names[k], self.label(k)
        if path.suffix.lower() not in TIFF:
            return False
        with decoding(label), path.open("rb", buffering=0) as file:
            plain = only_page(file)
            if plain is None or not plain.holds(shape, out.dtype):
                return False
            fill_rows(file, plain.offset, spans, out, plain.dtype, label)
        return True

    def label(self, k: int) -> str:
        """Return the name of a file."""
        return Path(self.names[k]).name


def open_images(paths: list[Path], name: str) -> Found:
    """Return image files as frames."""
    folder = paths[0].parent
    source = ImageFiles(folder, tuple(os.path.relpath(path, folder) for path in paths))
    kind = paths[0].suffix.lower()
    bits, _, notes = facts(paths[0]) if kind in TIFF else (None, None, ())
    lossy = 2 if kind in _LOSSY else 0
    return Found(name=name, source=source, bits=bits, like_grey=lossy, notes=notes)


def _decoded(path: Path, label: str) -> NDArray[Any]:
    import cv2

    with decoding(label):
        data = path.read_bytes()
    fits_in(label, _claimed(data, label), len(data))
    if not _whole(data):
        raise UnreadableFrame(f"{label} cannot be read: not an image, or cut short")
    with decoding(label), quiet_opencv():
        frame = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if frame is None:
        raise UnreadableFrame(f"{label} cannot be read: not an image, or cut short")
    if frame.ndim == 3:  # OpenCV puts blue first
        return frame[..., [2, 1, 0, 3][: frame.shape[-1]]]
    with decoding(label):
        stretched = _stretched(data, label)
    return frame if stretched == 1 else frame // stretched


def _stretched(data: bytes, label: str) -> int:
    """Return by how much OpenCV stretches numbers of fewer than eight bits to fill them."""
    if data.startswith(_PNG) and data[24] < 8 and data[25] == _GREY:
        return int(255 // (2 ** data[24] - 1))
    if data.startswith(b"P2") and int(_PGM_HEADER.sub(b" ", data[2:]).split()[2]) < 255:
        raise UnreadableFrame(f"{label} cannot be read: a PGM in text must have 8 or 16 bits")
    return 1


def _whole(data: bytes) -> bool:
    """Whether a JPEG has its end, and a PNG all its chunks, with the checksums that they state.

    Decoders fill up with grey what is missing, and take memory by the length that a chunk claims.
    """
    if data.startswith(b"\xff\xd8"):
        return b"\xff\xd9" in data[-1024:]
    if not data.startswith(_PNG):
        return True
    at, kind = len(_PNG), b""
    while kind != b"IEND" and at + 12 <= len(data):
        end = at + 12 + int.from_bytes(data[at : at + 4], "big")
        kind = data[at + 4 : at + 8]
        if zlib.crc32(data[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            return False
        at = end
    return kind == b"IEND"


def _claimed(data: bytes, label: str) -> int:
    """Return how many bytes a header claims at most; Pillow reads no pixel to say so."""
    from PIL import Image, UnidentifiedImageError

    try:
        with decoding(label), quietly(), Image.open(io.BytesIO(data)) as header:
            return header.width * header.height * (1 if header.mode in ("1", "L", "P") else 8)
    except UnreadableFrame as error:
        if isinstance(error.__cause__, UnidentifiedImageError):
            raise UnreadableFrame(f"{label} cannot be read: not an image, or cut short") from None
        if isinstance(error.__cause__, Image.DecompressionBombError):
            most = 2 * (Image.MAX_IMAGE_PIXELS or 0)
            raise UnreadableFrame(
                f"{label} cannot be read: its header claims more than {most:_} pixels"
            ) from None
        raise
