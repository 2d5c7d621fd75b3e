"""NumPy stacks: arrays in memory, .npy files, and members of .npz archives."""

from __future__ import annotations

import math
import tempfile
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.contiguous import Contiguous
from losbench.recording.frames.handles import file_size, opened, plain_file
from losbench.recording.frames.protocol import (
    Found,
    Source,
    UnreadableFrame,
    cut_short,
    decoding,
    fits_in,
    marked,
)

__all__ = ["InMemory", "open_array", "open_npy", "open_npz"]

_CHUNK = 2**20
_MASKS = {"mask", "masks", "bad", "bad_pixels", "badpix", "bpm", "dq", "flag", "flags"}


@dataclass(frozen=True, eq=False)
class InMemory:
    """Frames of an array (F, rows, cols) or (F, rows, cols, channels)."""

    array: NDArray[Any]
    name: str = "memory"

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.array)

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame."""
        frame: NDArray[Any] = self.array[k]
        return frame

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return f"frame {k} of {self.name}"


@dataclass(frozen=True, eq=False)
class FortranOrder:
    """Frames of an .npy file whose frames are its fastest axis: mapped, since none lies whole."""

    path: Path

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(opened(_mapped, self.path))

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame."""
        with decoding(self.label(k)):
            return np.array(opened(_mapped, self.path)[k], order="C")

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return f"frame {k} of {self.path.name}"


@dataclass(frozen=True)
class Member:
    """Opens one member of an archive, unpacked once on disk."""

    name: str

    def __call__(self, path: Path) -> BinaryIO:
        unpacked: BinaryIO = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - `opened` closes it
        try:
            with zipfile.ZipFile(path) as archive, archive.open(self.name) as member:
                while chunk := member.read(_CHUNK):
                    unpacked.write(chunk)
        except BaseException:
            unpacked.close()
            raise
        return unpacked


def open_array(array: NDArray[Any], name: str = "memory") -> Found:
    """Return an array (F, rows, cols) as frames; masked pixels become NaN."""
    given = np.asanyarray(array)
    if given.ndim not in (3, 4):
        raise ValueError(f"{name} must hold a stack (frames, rows, cols), got shape {given.shape}")
    if isinstance(given, np.ma.MaskedArray):
        of_type = np.result_type(given.dtype, np.float32)
        given = np.where(np.ma.getmaskarray(given), np.nan, given.data).astype(of_type)
    return Found(name=name, source=InMemory(given, name))


def open_npy(path: Path, *, skip: bool) -> Found:
    """Return the frames of an .npy file, left on disk."""
    with decoding(path.name):
        file = opened(plain_file, path)
        file.seek(0)
        shape, fortran, dtype, offset = _header(file)
        _check(path.name, shape, dtype)
        held = file_size(file) - offset
    _stack(path.name, shape)
    there = held // max(dtype.itemsize * _product(shape[1:]), 1)
    n_frames, notes = cut_short(path.name, shape[0], there, skip=skip and not fortran)
    source: Source = Contiguous(
        path=path, offsets=offset, n_frames=n_frames, shape=shape[1:], dtype=dtype
    )
    return Found(name=path.name, source=FortranOrder(path) if fortran else source, notes=notes)


def open_npz(path: Path) -> Found:
    """Return the frames of an .npz archive: its member "frames", or its only stack.

    The archive's own checksum of the member is tried once. Members called mask, bad_pixels, dq
    and the like mark bad pixels: of all frames by what is not 0, of each by what is True.
    """
    stacks, shapes = {}, {}
    if not zipfile.is_zipfile(path):
        raise UnreadableFrame(f"{path.name} cannot be read: not an .npz archive, or cut short")
    with decoding(path.name), zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            if name == info.filename:
                continue
            with archive.open(info) as member:
                shape, fortran, dtype, offset = _header(member)
            shapes[name] = shape, dtype.kind
            if name == "frames" or len(shape) == 3:
                stacks[name] = info, shape, fortran, dtype, offset
    if not stacks:
        raise ValueError(
            f"{path.name} cannot be read: no array of it is a stack (frames, rows, cols)"
        )
    stacks = {name: one for name, one in stacks.items() if not _is_mask(name)} or stacks
    if len(stacks) > 1 and "frames" not in stacks:
        listed = ", ".join(f"{name} {one[1]}" for name, one in stacks.items())
        raise ValueError(
            f"{path.name} must hold one stack (frames, rows, cols), or name one of them frames, "
            f"got {listed}"
        )
    name = "frames" if "frames" in stacks else next(iter(stacks))
    info, shape, fortran, dtype, offset = stacks[name]
    _stack(path.name, shape)
    masks = [
        other
        for other, (size, kind) in shapes.items()
        if other != name
        and _is_mask(other)
        and ((size == shape[1:3] and kind in "buif") or (size == shape and kind == "b"))
    ]
    left = sorted(shapes.keys() - {name, *masks})
    notes: tuple[str, ...] = (
        (f"Pixels marked by {', '.join(masks)} of {path.name} are left out.",) if masks else ()
    )
    notes += (f"Not read of {path.name}: {', '.join(left)}.",) if left else ()
    with decoding(path.name):
        _check(path.name, shape, dtype)
        if dtype.itemsize * _product(shape) > info.file_size - offset:
            raise UnreadableFrame(f"{path.name} cannot be read: {name} is cut short")
        fits_in(path.name, info.file_size, info.compress_size)
        if fortran or any(len(shapes[mask][0]) > 2 for mask in masks):
            return replace(_unpacked(path, name, masks), notes=notes)
        with np.load(path, allow_pickle=False) as members:
            bad = [marked(mask, members[mask]) for mask in masks]
        opener: Any = plain_file
        if info.compress_type == zipfile.ZIP_STORED:
            offset += _begin_of(path, info)
        else:
            opener = Member(info.filename)
            opened(opener, path)
    source = Contiguous(
        path=path, offsets=offset, n_frames=shape[0], shape=shape[1:], dtype=dtype, opener=opener
    )
    return Found(
        name=path.name, source=source, bad=np.any(bad, axis=0) if bad else None, notes=notes
    )


def _unpacked(path: Path, name: str, masks: list[str]) -> Found:
    """Frames of an archive in memory, where they are stored by columns or each has its own mask."""
    with np.load(path, allow_pickle=False) as members:
        frames = members[name]
        if masks:
            frames = np.ma.array(frames, mask=False)
        for mask in masks:
            frames[np.broadcast_to(marked(mask, members[mask]), frames.shape)] = np.ma.masked
        return open_array(frames, path.name)


def _is_mask(name: str) -> bool:
    return name.lower() in _MASKS


def _header(file: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Shape, whether in Fortran order, type, and where the data begin."""
    version = np.lib.format.read_magic(file)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, fortran, dtype = read(file)
    return shape, bool(fortran), dtype, file.tell()


def _check(name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    if dtype.hasobject or dtype.kind not in "uif":
        raise UnreadableFrame(f"{name} must hold numbers, got {dtype}")
    if any(n < 0 for n in shape):
        raise UnreadableFrame(f"{name} cannot be read: its header claims shape {shape}")


def _product(shape: tuple[int, ...]) -> int:
    return math.prod(map(int, shape))


def _stack(name: str, shape: tuple[int, ...]) -> None:
    if len(shape) not in (3, 4):
        raise ValueError(f"{name} must hold a stack (frames, rows, cols), got shape {shape}")


def _begin_of(path: Path, info: zipfile.ZipInfo) -> int:
    """Return where a stored member begins, after its checksum was found right."""
    with zipfile.ZipFile(path) as archive, archive.open(info) as member:
        while member.read(_CHUNK):  # at the end the checksum is compared
            pass
        archive.fp.seek(info.header_offset + 26)  # type: ignore[union-attr]
        name, extra = np.frombuffer(archive.fp.read(4), "<u2").tolist()  # type: ignore[union-attr]
    return info.header_offset + 30 + int(name) + int(extra)


def _mapped(path: Path) -> NDArray[Any]:
    mapped: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
    return mapped
