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
        data = opened(_file, path)[name]
        held, item = path.stat().st_size, data.dtype.itemsize
        fits_in(path.name, math.prod(data.chunks or data.shape[1:]) * item, held)
        fits_in(path.name, math.prod(data.shape[1:]) * item, held)
        stored = max(data.id.get_storage_size(), 1)
        if math.prod(data.shape) * item > max(2**26, 1100 * stored):
            raise UnreadableFrame(
                f"{path.name} cannot be read: {name} claims shape {data.shape} but {stored:_} "
                "bytes are stored"
            )
    return Found(name=path.name, source=Hdf5Frames(path, name, stacks[name][0]))


def _stacks(file: Any) -> dict[str, tuple[int, ...]]:
    import h5py

    stacks: dict[str, tuple[int, ...]] = {}

    def look(name: str, thing: Any) -> None:
        numbers = isinstance(thing, h5py.Dataset) and thing.dtype.kind in "uif"
        if numbers and len(thing.shape or ()) in (3, 4) and 0 not in thing.shape:
            stacks[name] = tuple(map(int, thing.shape))

    file.visititems(look)
    return stacks


def _file(path: Path) -> Any:
    try:
        import h5py
    except ImportError:
        raise ImportError("HDF5 files need h5py: pip install 'losbench[hdf5]'") from None
    return h5py.File(path, "r")
