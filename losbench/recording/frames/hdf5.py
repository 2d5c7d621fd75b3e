"""HDF5 stacks, read with h5py (the ``hdf5`` extra)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.handles import opened
from losbench.recording.frames.protocol import Found, UnreadableFrame, decoding, fits_in

__all__ = ["HDF5", "Hdf5Frames", "open_hdf5"]

HDF5 = (".h5", ".hdf5", ".hdf", ".nxs", ".he5")
_MOST_LISTED = 8
_MOST_MEMBERS = 10_000
_CHECKSUM_BYTES = 4


@dataclass(frozen=True)
class Hdf5Frames:
    """Frames of one data set."""

    path: Path
    dataset: str
    n_frames: int

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame."""
        return self.block(k, k + 1)[0]

    def block(self, i: int, j: int) -> NDArray[Any]:
        """Return frames ``i`` to ``j`` (excluded): a chunk may hold many, and is unpacked once."""
        with decoding(self.label(i)):
            return np.asarray(opened(_file, self.path)[self.dataset][i:j])

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return f"frame {k} of {self.path.name}"


def open_hdf5(path: Path, dataset: str | None) -> Found:
    """Return the frames of the data set named, or of the only stack (frames, rows, cols)."""
    with decoding(path.name):
        stacks = _stacks(opened(_file, path))
    if dataset is None and len(stacks) != 1:
        listed = ", ".join(f"{name} {shape}" for name, shape in list(stacks.items())[:_MOST_LISTED])
        raise ValueError(
            f"{path.name} must hold one stack (frames, rows, cols), or dataset must name one "
            f"(--dataset), got {listed or 'none'}"
        )
    name = next(iter(stacks)) if dataset is None else dataset.strip("/")
    if name not in stacks:
        raise ValueError(
            f"dataset must be a stack (frames, rows, cols) of {path.name}, that is "
            f"{', '.join(list(stacks)[:_MOST_LISTED]) or 'none'}, got {dataset!r}"
        )
    with decoding(path.name):
        _check(path, name, opened(_file, path)[name])
    return Found(name=path.name, source=Hdf5Frames(path, name, stacks[name][0]))


def _stacks(file: Any) -> dict[str, tuple[int, ...]]:
    """Return the stacks of a file by name; links to other files are not followed."""
    import h5py

    stacks: dict[str, tuple[int, ...]] = {}
    seen: set[int] = set()
    groups = [("", file)]
    while groups:  # not visititems, which on a damaged file may never end
        above, group = groups.pop()
        for key in group:
            if not isinstance(group.get(key, getlink=True), h5py.HardLink):
                continue
            thing, name = group[key], f"{above}{key}"
            at = h5py.h5o.get_info(thing.id).addr
            if at in seen or len(seen) > _MOST_MEMBERS:
                continue
            seen.add(at)
            if isinstance(thing, h5py.Group):
                groups.append((f"{name}/", thing))
            elif isinstance(thing, h5py.Dataset) and thing.dtype.kind in "uif":
                shape = tuple(map(int, thing.shape or ()))
                if len(shape) in (3, 4) and 0 not in shape:
                    stacks[name] = shape
    return dict(sorted(stacks.items()))


def _check(path: Path, name: str, data: Any) -> None:
    """Raise if a data set claims more than its file can hold, or has chunks over which HDF5's own
    library would end the process.
    """
    held, item = path.stat().st_size, data.dtype.itemsize
    chunk = math.prod(data.chunks or data.shape[1:]) * item
    for claimed in (chunk, math.prod(data.shape[1:]) * item):
        fits_in(path.name, claimed, held)
    fits_in(f"{name} of {path.name}", math.prod(data.shape) * item, data.id.get_storage_size())
    damaged: list[Any] = []

    def look(info: Any) -> Any:
        inside = info.byte_offset >= 0 and info.byte_offset + info.size <= held
        if not inside or info.size <= _CHECKSUM_BYTES:
            damaged.append(info.chunk_offset)
        return True if damaged else None  # whatever is not None ends the walk

    if data.chunks:
        data.id.chunk_iter(look)
    if damaged:
        raise UnreadableFrame(
            f"{path.name} cannot be read: chunk {damaged[0]} of {name} is damaged"
        )


def _file(path: Path) -> Any:
    try:
        import h5py
    except ImportError:
        raise ImportError("HDF5 files need h5py: pip install 'losbench[hdf5]'") from None
    return h5py.File(path, "r")
