"""Image files, TIFF stacks and NumPy stacks: how the k-th frame comes from disk."""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.stamps import UnreadableFrame

__all__ = ["image_loader", "in_natural_order", "jump_in_names", "numpy_stack", "tiff_pages"]

# By magic number, classic and big: bytes before the first offset, formats of offset and count,
# bytes of an entry.
_TIFF = {42: (0, "I", "H", 12), 43: (4, "Q", "Q", 20)}


def image_loader(files: list[Path]) -> Callable[[int], NDArray[Any]]:
    """Return what reads the k-th of these image files."""
    import cv2

    def load(k: int) -> NDArray[Any]:
        with _quiet_opencv():
            frame = cv2.imread(str(files[k]), cv2.IMREAD_UNCHANGED)
        if frame is None:
            raise UnreadableFrame(f"{files[k].name} cannot be read: not an image, or cut short")
        return frame

    return load


@dataclass(frozen=True)
class Pages:
    """Pages of a TIFF: how many there are, what reads the k-th, and what is to be said of a file
    cut short.
    """

    count: int
    load: Callable[[int], NDArray[Any]]
    notes: tuple[str, ...] = ()


def tiff_pages(source: Path, *, skip: bool) -> Pages:
    """Return the pages of a TIFF; a file cut short is an error, or ends early."""
    import cv2

    with _quiet_opencv():
        n_pages = int(cv2.imcount(str(source), cv2.IMREAD_UNCHANGED))
    if n_pages == 0:
        raise UnreadableFrame(f"{source.name} cannot be read: not a TIFF, or cut short")
    cut = f"{source.name} is cut short after page {n_pages}"
    whole = _ends_properly(source)
    if not whole and not skip:
        raise UnreadableFrame(f"{cut}: skip what is unreadable to use those")

    def load(k: int) -> NDArray[Any]:
        with _quiet_opencv():
            done, pages = cv2.imreadmulti(str(source), start=k, count=1, flags=cv2.IMREAD_UNCHANGED)
        if not done or not len(pages):
            raise UnreadableFrame(f"{source.name} page {k} cannot be read: cut short?")
        return pages[0]

    return Pages(n_pages, load, () if whole else (f"{cut}: what came after is lost.",))


def _ends_properly(source: Path) -> bool:
    """Follow a TIFF's chain of directories: OpenCV counts only those that a truncated file still
    holds.
    """
    size = source.stat().st_size
    with source.open("rb") as file:
        order = {b"II": "<", b"MM": ">"}.get(file.read(2), "")
        magic = struct.unpack(f"{order}H", file.read(2))[0] if order else 0
        if magic not in _TIFF:
            return True
        skipped, offset, count, entry = _TIFF[magic]
        file.seek(4 + skipped)
        seen: set[int] = set()
        at = struct.unpack(order + offset, file.read(struct.calcsize(offset)))[0]
        while at and at not in seen:
            seen.add(at)
            file.seek(at)
            n = struct.unpack(
                order + count,
                file.read(struct.calcsize(count)).ljust(struct.calcsize(count), b"\0"),
            )[0]
            if at + struct.calcsize(count) + n * entry + struct.calcsize(offset) > size:
                return False
            file.seek(n * entry, 1)
            at = struct.unpack(order + offset, file.read(struct.calcsize(offset)))[0]
    return True


def numpy_stack(source: Path) -> NDArray[Any]:
    """Return the frames of an .npy file, left on disk, or of an .npz archive: "frames", or its only
    stack.
    """
    if source.suffix.lower() == ".npz" and not zipfile.is_zipfile(
        source
    ):  # of which NumPy would leave a file open
        raise UnreadableFrame(f"{source.name} cannot be read: not an .npz archive, or cut short")
    try:
        loaded = np.load(source, mmap_mode="r", allow_pickle=False)
        if not isinstance(loaded, np.ndarray):
            with loaded as archive:
                stacks = [
                    name for name in archive.files if name == "frames" or archive[name].ndim == 3
                ]
                if not stacks:
                    raise ValueError("no array of it is a stack (frames, rows, cols)")
                loaded = archive["frames" if "frames" in stacks else stacks[0]]
    except (OSError, ValueError, EOFError, IndexError, zipfile.BadZipFile, zlib.error) as error:
        raise UnreadableFrame(f"{source.name} cannot be read: {error}") from None
    if loaded.ndim != 3:
        raise ValueError(
            f"{source.name} must hold a stack (frames, rows, cols), got shape {loaded.shape}"
        )
    return loaded


class _quiet_opencv:
    """OpenCV prints its complaints; here they become errors with the file's name."""

    def __enter__(self) -> None:
        import cv2

        self._level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(0)

    def __exit__(self, *_: object) -> None:
        import cv2

        cv2.utils.logging.setLogLevel(self._level)


def in_natural_order(files: list[Path]) -> list[Path]:
    """Sort by name, with numbers as numbers: frame-9 before frame-10."""
    return sorted(
        files,
        key=lambda p: [int(t) if t.isdigit() else t.lower() for t in re.split(r"(\d+)", p.name)],
    )


def jump_in_names(files: list[Path]) -> tuple[str, ...]:
    """Say where the one number that counts these files jumps over others, if it does."""
    numbers = [[int(digits) for digits in re.findall(r"\d+", file.name)] for file in files]
    if len({len(each) for each in numbers}) > 1:
        return ()
    counting = [steps for column in zip(*numbers, strict=True) if (steps := np.diff(column)).any()]
    if len(counting) != 1:
        return ()
    step = counting[0].min()
    jumps = np.flatnonzero(counting[0] > step)
    even = step > 0 and step == np.median(counting[0]) and not (counting[0] % step).any()
    if not even or not jumps.size:
        return ()
    before, after = (files[jumps[0] + k].name for k in (0, 1))
    more = f", the first of {jumps.size} jumps" if jumps.size > 1 else ""
    return (
        f"File names jump from {before} to {after}{more}: if frames are missing, a period puts "
        "later ones early.",
    )
