"""TIFF and BigTIFF: pages by their number, stacks of one page, packed bits, white as zero."""

from __future__ import annotations

import logging
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Ints
from losbench.recording.frames.contiguous import Contiguous, fill_rows, native
from losbench.recording.frames.handles import file_size, fill, opened, plain_file, quiet_opencv
from losbench.recording.frames.packed import unpacked
from losbench.recording.frames.plainpages import only_page, plain_page
from losbench.recording.frames.protocol import (
    Found,
    Source,
    Spans,
    UnreadableFrame,
    cut_short,
    decoding,
    fits_in,
)

if TYPE_CHECKING:
    import tifffile

__all__ = ["TIFF", "Pages", "facts", "open_tiff", "single_page"]

TIFF = (".tif", ".tiff", ".btf", ".tf8")
# By magic number, classic and big: bytes before the first offset, formats of offset and count,
# bytes of an entry.
_KINDS = {42: (0, "I", "H", 12), 43: (4, "Q", "Q", 20)}
_PLAIN, _LZW = 1, 5
_MINISWHITE = 0
_COUNTS = (_MINISWHITE, 1, 2, 32803, 34892)  # black as zero, RGB, a Bayer pattern, linear raw
_JPEG = (6, 7)
_PACKED = (10, 12, 14)  # bits that are unpacked here
_HEAD_BYTES = 8  # of a classic TIFF
_DIRECTORY_BYTES = 2**12  # that are read at once
_REDUCED = 1  # in tag 254, a smaller copy of another page

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # faults come as errors


@dataclass(frozen=True, eq=False)
class Pages:
    """Pages of a TIFF by the places of their directories: the last comes as fast as the first."""

    path: Path
    offsets: Ints
    white_is_zero: bool | None = None  # what the first page says, if it can be read

    def __reduce__(self) -> tuple[Any, ...]:
        # Where pages lie at one distance from each other that says all of them in a few bytes.
        steps = zlib.compress(np.diff(self.offsets, prepend=0).tobytes(), 1)
        return _pages, (self.path, steps, self.white_is_zero)

    @property
    def n_frames(self) -> int:
        """Number of pages."""
        return len(self.offsets)

    def frame(self, k: int) -> NDArray[Any]:
        """Return the image of one page."""
        label = self.label(k)
        with decoding(label):
            file = opened(plain_file, self.path)
            plain = plain_page(file, int(self.offsets[k]))
            if plain is not None and not self.white_is_zero:
                image = np.empty(plain.shape, plain.dtype)
                fill(file, plain.offset, image, label)
                return native(image)
            page = _page(self.path, int(self.offsets[k]), k)
            said = page.photometric == _MINISWHITE if 262 in page.tags else None
            if None not in (said, self.white_is_zero) and said != self.white_is_zero:
                raise UnreadableFrame(f"{label} turns black and white against the first page")
            return _image(page, label)

    def rows(self, k: int, shape: tuple[int, int], spans: Spans, out: NDArray[Any]) -> bool:
        """Fill some rows of a page that lies in the file as it is; return whether it does."""
        label = self.label(k)
        with decoding(label):
            file = opened(plain_file, self.path)
            plain = plain_page(file, int(self.offsets[k]))
            if plain is None or self.white_is_zero or not plain.holds(shape, out.dtype):
                return False
            fill_rows(file, plain.offset, spans, out, plain.dtype, label)
        return True

    def label(self, k: int) -> str:
        """Return the name of a page."""
        return f"page {k} of {self.path.name}"


def _pages(path: Path, steps: bytes, white_is_zero: bool | None) -> Pages:
    """Return pages as they were pickled."""
    between = np.frombuffer(zlib.decompress(steps), np.int64)
    return Pages(path, np.cumsum(between), white_is_zero)


def open_tiff(path: Path, *, skip: bool) -> Found:
    """Return the pages of a TIFF, or the frames of its only page."""
    with decoding(path.name):
        chain = _directories(path)
    directories = chain.places
    if not len(directories):
        raise UnreadableFrame(f"{path.name} cannot be read: not a TIFF, or cut short")
    bits, white, notes = facts(path, int(directories[0]))
    source: Source = Pages(path, directories, white)
    said: tuple[str, ...] = ()
    if not chain.whole:
        said = (f"{path.name} is cut short after page {len(directories)}",)
        if not skip:
            raise UnreadableFrame(f"{said[0]}: skip what is unreadable to use those")
        said = (f"{said[0]}: what came after is lost.",)
    elif len(directories) == 1 and not chain.reduced:
        source, said = _stack_of_one_page(path, skip=skip) or (source, said)
    if chain.reduced:
        said += (f"{path.name} holds {chain.reduced} smaller copies of pages: they are left out.",)
    return Found(name=path.name, source=source, bits=bits, notes=(*said, *notes))


def facts(path: Path, at: int | None = None) -> tuple[int | None, bool | None, tuple[str, ...]]:
    """Bits of the numbers, where they are no whole bytes, whether zero is white, and what is to be
    said of the first page, whose directory lies at byte ``at``, or is looked for.

    Whether that page can be read is for whoever reads it.
    """
    try:
        with decoding(path.name):
            page = _page(path, int(_directories(path).places[0]) if at is None else at, 0)
            bits = page.bitspersample if page.bitspersample % 8 else None
            turned = f"In {path.name} zero is white: its numbers are turned."
            white = page.photometric == _MINISWHITE if 262 in page.tags else None
            return bits, white, (turned,) if white else ()
    except UnreadableFrame:
        return None, None, ()


def single_page(path: Path, label: str) -> NDArray[Any]:
    """Return the image of a file that must have one page."""
    with decoding(label):
        with path.open("rb", buffering=0) as file:
            plain = only_page(file)
            if plain is not None:
                image = np.empty(plain.shape, plain.dtype)
                fill(file, plain.offset, image, label)
                return native(image)
        directories = _directories(path).places
    if not len(directories):
        raise UnreadableFrame(f"{label} cannot be read: not an image, or cut short")
    if len(directories) > 1:
        raise UnreadableFrame(
            f"{label} must be one image as the first file, but has {len(directories)} pages"
        )
    with decoding(label):
        return _image(_page(path, int(directories[0]), 0), label)


@dataclass(frozen=True, eq=False)
class Chain:
    """Where the directories of pages lie, whether the last one is there whole, and how many more
    are of smaller copies.
    """

    places: Ints
    whole: bool
    reduced: int = 0


def _directories(path: Path) -> Chain:
    """Follow the chain of directories."""
    size = path.stat().st_size
    with path.open("rb") as file:
        order = {b"II": "<", b"MM": ">"}.get(file.read(2), "")
        magic = _number(file, f"{order}H") if order else 0
        if magic not in _KINDS:
            return Chain(np.empty(0, np.int64), whole=True)
        skipped, offset, count, entry = _KINDS[magic]
        file.seek(4 + skipped)
        # Number of entries, then the first of them up to its value; what follows ends it all.
        begin, end = struct.Struct(f"{order}{count}HH{offset}"), struct.Struct(order + offset)
        least, fixed = begin.size + 4, struct.calcsize(count) + end.size
        pages: list[int] = []
        seen: dict[int, None] = {}
        whole, at, length = True, _number(file, order + offset), least
        while at and at not in seen:
            file.seek(min(at, size))
            head = file.read(length).ljust(least, b"\0")
            n, tag, kind, _ = begin.unpack_from(head)
            needed = fixed + n * entry
            if at + needed > size:
                whole = False
                break
            value = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", head, begin.size)[0]
            if not n or tag != 254 or not value & _REDUCED:
                pages.append(at)
            seen[at] = None
            if needed > len(head):  # the next ones will be as long
                file.seek(at + needed - end.size)
                head, length = file.read(end.size), min(needed, _DIRECTORY_BYTES)
                at = end.unpack(head)[0]
            else:
                at = end.unpack_from(head, needed - end.size)[0]
    places = np.array(pages or list(seen), np.int64)
    return Chain(places, whole, len(seen) - len(places))


def _number(file: BinaryIO, form: str) -> int:
    size = struct.calcsize(form)
    return int(struct.unpack(form, file.read(size).ljust(size, b"\0"))[0])


def _tiff_file(path: Path) -> tifffile.TiffFile:
    import tifffile

    return tifffile.TiffFile(path)


def _page(path: Path, offset: int, k: int) -> tifffile.TiffPage:
    import tifffile

    file = opened(_tiff_file, path)
    file.filehandle.seek(offset)
    page = tifffile.TiffPage(file, k)
    size = path.stat().st_size
    places = list(zip(page.dataoffsets, page.databytecounts, strict=False))
    # Where nothing is stored tifffile gives zeros, and what is cut short it fills up with them.
    if not places or any(not begin or not n or begin + n > size for begin, n in places):
        raise UnreadableFrame(f"page {k} of {path.name} cannot be read: cut short?")
    if sum(page.databytecounts) > size:
        raise UnreadableFrame(f"page {k} of {path.name} cannot be read: its strips overlap")
    fits_in(f"page {k} of {path.name}", int(page.nbytes), size)
    return page


def _image(page: tifffile.TiffPage, label: str) -> NDArray[Any]:
    """Return the numbers of a page, (rows, cols) or (rows, cols, channels), zero as black."""
    if 262 not in page.tags:  # tifffile would take zero as white
        raise UnreadableFrame(f"{label} cannot be read: it does not say whether zero is black")
    if page.photometric not in _COUNTS and page.compression not in _JPEG:
        raise UnreadableFrame(
            f"{label} must be one grey image (rows, cols), got colours of kind {page.photometric:d}"
        )
    if page.axes not in ("YX", "YXS", "SYX"):
        raise UnreadableFrame(f"{label} must be one image, got {page.axes} of shape {page.shape}")
    bits = page.bitspersample
    plain = page.compression == _PLAIN and page.fillorder == 1 and page.predictor == 1
    if page.axes == "YX" and plain and not page.is_tiled and bits in _PACKED:
        image = _packed_strips(page)
    elif page.compression == _LZW and _opencv_reads(page):
        image = _by_opencv(page, label)
    else:
        image = _by_tifffile(page)
    if page.axes == "SYX":
        image = np.moveaxis(image, 0, -1)
    if page.photometric == _MINISWHITE and image.dtype.kind == "u":
        image = np.array(2**bits - 1, image.dtype) - image
    return native(image)


def _opencv_reads(page: tifffile.TiffPage) -> bool:
    """Whether OpenCV gives the numbers of an LZW page as they are: grey or RGB, whole bytes."""
    samples = 1 if page.axes == "YX" else page.samplesperpixel
    kind = (page.bitspersample, page.sampleformat)
    return page.axes != "SYX" and samples in (1, 3) and kind in ((8, 1), (16, 1), (32, 3))


def _by_tifffile(page: tifffile.TiffPage) -> NDArray[Any]:
    try:
        return page.asarray(maxworkers=1)
    except (ImportError, ValueError, NotImplementedError) as error:
        if not isinstance(error, ImportError) and "imagecodecs" not in str(error):
            raise
        raise ImportError(
            f"{Path(page.parent.filename).name} is a TIFF of compression {page.compression:d} with "
            f"{page.bitspersample} bits, which needs more decoders: pip install 'losbench[tiff]'"
        ) from None


def _packed_strips(page: tifffile.TiffPage) -> NDArray[Any]:
    """Unpack strips whose rows begin at whole bytes."""
    rows, columns = page.shape
    row_bytes = -(-columns * page.bitspersample // 8)
    file, image = page.parent.filehandle, np.empty((rows, columns), np.uint16)
    first = 0
    for begin, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        n = min(page.rowsperstrip, rows - first)
        file.seek(begin)
        lines = np.frombuffer(file.read(count), np.uint8)[: n * row_bytes].reshape(n, row_bytes)
        image[first : first + n] = unpacked(lines, page.bitspersample, columns, high_first=True)
        first += n
    if first < rows:
        raise UnreadableFrame(f"{page.parent.filename} holds {first} of {rows} rows")
    return image


def _by_opencv(page: tifffile.TiffPage, label: str) -> NDArray[Any]:
    """Decode LZW, which tifffile leaves to an extra, by making a file of one page for OpenCV."""
    import cv2

    data, places = _segments(page)
    order, counts = page.parent.byteorder, list(page.databytecounts)
    samples = 1 if page.axes == "YX" else page.samplesperpixel
    each = (page.bitspersample, page.sampleformat)
    tags = {256: [page.imagewidth], 257: [page.imagelength], 259: [_LZW], 317: [page.predictor]}
    tags |= {258: [each[0]] * samples, 339: [each[1]] * samples, 277: [samples]}
    tags |= {262: [1 if samples == 1 else 2]}
    if page.is_tiled:
        tags |= {322: [page.tilewidth], 323: [page.tilelength], 324: places, 325: counts}
    else:
        tags |= {273: places, 278: [page.rowsperstrip], 279: counts}
    at = _HEAD_BYTES + len(data)
    entries, beyond = b"", at + 2 + 12 * len(tags) + 4
    lists = b""
    for tag, values in sorted(tags.items()):
        packed = struct.pack(f"{order}{len(values)}I", *map(int, values))
        where = packed
        if len(values) > 1:
            where = struct.pack(f"{order}I", beyond + len(lists))
            lists += packed
        entries += struct.pack(f"{order}HHI", tag, 4, len(values)) + where
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", at)
    directory = struct.pack(f"{order}H", len(tags)) + entries + struct.pack(f"{order}I", 0)
    whole = b"".join([head, data, directory, lists])
    with quiet_opencv():
        image = cv2.imdecode(np.frombuffer(whole, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape != page.shape:
        raise UnreadableFrame(f"{label} cannot be read: its LZW data is damaged")
    return image if samples == 1 else image[..., ::-1]  # OpenCV puts blue first


def _segments(page: tifffile.TiffPage) -> tuple[bytes, list[int]]:
    """Return the strips or tiles of a page, and where each begins in a file of its own; by one read
    where they lie together.
    """
    file, begins = page.parent.filehandle, np.array(page.dataoffsets)
    counts = np.array(page.databytecounts)
    first, span = int(begins.min()), int((begins + counts).max() - begins.min())
    if span <= 2 * counts.sum():
        file.seek(first)
        return file.read(span), (begins - first + _HEAD_BYTES).tolist()
    parts = []
    for begin, count in zip(begins.tolist(), counts.tolist(), strict=True):
        file.seek(begin)
        parts.append(file.read(count))
    return b"".join(parts), (_HEAD_BYTES + np.cumsum([0, *counts[:-1]])).tolist()


def _stack_of_one_page(path: Path, *, skip: bool) -> tuple[Contiguous, tuple[str, ...]] | None:
    """Frames of a file with one directory for all, as ImageJ's above 4 GB and volumes are, and what
    is to be said of them.
    """
    with decoding(path.name):
        file = opened(_tiff_file, path)
        page, shape = file.pages.first, tuple(file.series[0].shape)
        images = int((file.imagej_metadata or {}).get("images", 1))
        if images > 1 and page.axes == "YX":  # tifffile gives up on them where some are missing
            shape = (images, *page.shape)
        if len(shape) < 3 or page.axes in ("YXS", "SYX"):
            return None
        plain = page.compression == _PLAIN and page.photometric != _MINISWHITE
        if not (page.is_contiguous and plain) or page.bitspersample % 8:
            raise UnreadableFrame(
                f"{path.name} cannot be read: {shape} in one page, but not plainly one after "
                "the other"
            )
        dtype = np.dtype(page.dtype).newbyteorder(page.parent.byteorder)
        each = dtype.itemsize * int(np.prod(shape[-2:]))
        first = int(page.dataoffsets[0])
        there = (file_size(opened(plain_file, path)) - first) // max(each, 1)
    n_frames, said = cut_short(path.name, int(np.prod(shape[:-2])), there, skip=skip)
    source = Contiguous(path=path, offsets=first, n_frames=n_frames, shape=shape[-2:], dtype=dtype)
    return source, said
