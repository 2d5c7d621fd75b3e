"""Pages of a TIFF that lie in the file as they are: grey, whole bytes, nothing compressed, in one
piece.

Of most cameras' files a page is that, and twenty numbers of its directory say so: its image is then
one read away. Whatever else a directory says is left to tifffile.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from losbench.recording.frames.handles import file_size

__all__ = ["PlainPage", "only_page", "plain_page"]

_FORMS = {1: "B", 3: "H", 4: "I", 16: "Q"}
_WIDTH, _LENGTH, _BITS, _COMPRESSION, _PHOTOMETRIC, _FILL_ORDER = 256, 257, 258, 259, 262, 266
_OFFSETS, _SAMPLES, _COUNTS, _PREDICTOR, _TILE_WIDTH, _FORMAT = 273, 277, 279, 317, 322, 339
_NEEDED = {_WIDTH, _LENGTH, _BITS, _PHOTOMETRIC, _OFFSETS, _COUNTS}
# What a plain page may say, and what it says by saying nothing.
_PLAIN = {_COMPRESSION: 1, _PHOTOMETRIC: 1, _FILL_ORDER: 1, _SAMPLES: 1, _PREDICTOR: 1}
_ASKED = {*_NEEDED, *_PLAIN, _TILE_WIDTH, _FORMAT}
_TYPES = {(1, 8): "u1", (1, 16): "u2", (1, 32): "u4", (3, 32): "f4", (3, 64): "f8"}
_MOST_ENTRIES = 1000


@dataclass(frozen=True)
class PlainPage:
    """Where an image (rows, cols) begins, its type as stored, and where the next directory is."""

    offset: int
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    following: int

    def holds(self, shape: tuple[int, int], dtype: np.dtype[Any]) -> bool:
        """Whether its numbers are these as they are, the order of bytes apart."""
        return self.shape == shape and self.dtype.newbyteorder("=") == dtype


def only_page(file: BinaryIO) -> PlainPage | None:
    """Return the page of a file, if there is but one and it is plain."""
    head = _bytes_at(file, 0, 16)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 16:
        return None
    big = struct.unpack_from(f"{order}H", head, 2)[0] == 43
    place = (
        struct.unpack_from(f"{order}Q", head, 8)
        if big
        else struct.unpack_from(f"{order}I", head, 4)
    )
    page = plain_page(file, place[0])
    return page if page is not None and page.following == 0 else None


def plain_page(file: BinaryIO, at: int) -> PlainPage | None:
    """Return what the directory at a byte of the file describes, or None if that is not plain."""
    head = _bytes_at(file, 0, 4)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    magic = struct.unpack(f"{order}H", head[2:])[0] if order and len(head) == 4 else 0
    if order is None or magic not in (42, 43):
        return None
    most = file_size(file)
    tags, following = _directory(file, at, order, most, big=magic == 43)
    if not tags.keys() >= _NEEDED or _TILE_WIDTH in tags:
        return None
    if any(tags.get(tag, [plain]) != [plain] for tag, plain in _PLAIN.items()):
        return None
    kind = _TYPES.get((tags.get(_FORMAT, [1])[0], tags[_BITS][0]))
    offsets, counts = np.array(tags[_OFFSETS], np.int64), np.array(tags[_COUNTS], np.int64)
    if kind is None or len(offsets) != len(counts) or len(tags[_BITS]) != 1:
        return None
    dtype, shape = np.dtype(order + kind), (tags[_LENGTH][0], tags[_WIDTH][0])
    size = shape[0] * shape[1] * dtype.itemsize
    in_one_piece = (offsets[:-1] + counts[:-1] == offsets[1:]).all() and counts.sum() == size > 0
    if not in_one_piece or offsets[0] <= 0 or offsets[0] + size > most:
        return None
    return PlainPage(int(offsets[0]), shape, dtype, following)


def _directory(
    file: BinaryIO, at: int, order: str, most: int, *, big: bool
) -> tuple[dict[int, list[int]], int]:
    """Return what a directory of a file of so many bytes says of the tags that are asked, and where
    the next one is.
    """
    head, entry, inside, form = (8, 20, 8, "Q") if big else (2, 12, 4, "I")
    count = _bytes_at(file, at, head)
    n = struct.unpack(order + ("Q" if big else "H"), count)[0] if len(count) == head else 0
    if not 0 < n <= _MOST_ENTRIES:
        return {}, -1
    data = _bytes_at(file, at + head, n * entry + inside)
    if len(data) < n * entry + inside:
        return {}, -1
    tags: dict[int, list[int]] = {}
    for begin in range(0, n * entry, entry):
        tag, kind = struct.unpack_from(f"{order}HH", data, begin)
        if tag not in _ASKED:
            continue
        values = struct.unpack_from(order + form, data, begin + 4)[0]
        value_at, size = begin + 4 + inside, values * struct.calcsize(_FORMS.get(kind, "x"))
        if kind not in _FORMS or not 0 < size <= most:
            return {}, -1
        held = data[value_at : value_at + size]
        if size > inside:
            held = _bytes_at(file, struct.unpack_from(order + form, data, value_at)[0], size)
        if len(held) < size or tag in tags:
            return {}, -1
        tags[tag] = list(struct.unpack(f"{order}{values}{_FORMS[kind]}", held))
    return tags, struct.unpack_from(order + form, data, n * entry)[0]


def _bytes_at(file: BinaryIO, offset: int, count: int) -> bytes:
    file.seek(offset)
    return file.read(count)
