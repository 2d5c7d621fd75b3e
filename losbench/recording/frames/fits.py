"""FITS cubes, extensions and folders of images, found with astropy (the ``fits`` extra)."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools
from losbench.recording.frames.develop import first_readable
from losbench.recording.frames.fitstimes import axis_times, dated
from losbench.recording.frames.handles import file_size, opened, plain_file
from losbench.recording.frames.joined import join
from losbench.recording.frames.plane import Plane, planes_of
from losbench.recording.frames.protocol import (
    Found,
    UnreadableFrame,
    cut_short,
    decoding,
    fits_in,
)

__all__ = ["FITS", "FitsFiles", "FitsStack", "open_fits"]

_ENDINGS = (".fits", ".fit", ".fts")
FITS = (*(e + packed for e in _ENDINGS for packed in ("", ".gz", ".bz2", ".fz")), ".fz")


@dataclass(frozen=True, eq=False)
class FitsStack:
    """Frames of one file: a cube, or one frame an extension; masks of the same form, if any."""

    path: Path
    planes: tuple[Plane, ...]
    n_frames: int
    masks: tuple[Plane, ...] = ()

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame; what its mask marks is NaN."""
        at = (0, k) if len(self.planes) == 1 else (k, 0)
        image = self.planes[at[0]].frame(self.path, at[1], self.label(k))
        if not self.masks:
            return image
        return _masked(image, self.masks[at[0]].frame(self.path, at[1], self.label(k)))

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return f"frame {k} of {self.path.name}"


@dataclass(frozen=True, eq=False)
class FitsFiles:
    """One frame a file: the image, and the mask if there is one, stand in the same HDU of each."""

    folder: Path
    names: tuple[str, ...]
    image: int
    mask: int | None = None

    @property
    def n_frames(self) -> int:
        """Number of files."""
        return len(self.names)

    def frame(self, k: int) -> NDArray[Any]:
        """Return the image of one file; what its mask marks is NaN."""
        path, label = self.folder / self.names[k], self.label(k)
        with decoding(label):  # the file may be gone since
            planes = {plane.index: plane for plane, _ in planes_of(path)}
        if self.image not in planes or len(planes[self.image].shape) != 2:
            raise UnreadableFrame(f"{label} must hold one image in HDU {self.image}, as the first")
        image = planes[self.image].frame(path, 0, label)
        if self.mask not in planes:
            return image
        return _masked(image, planes[self.mask].frame(path, 0, label))

    def label(self, k: int) -> str:
        """Return the name of a file."""
        return Path(self.names[k]).name


def open_fits(paths: list[Path], name: str, *, skip: bool, own_times: bool) -> tuple[Found, ...]:
    """Open target pixel files, a folder of images with one frame each, or the images or the cube of
    one file.
    """
    from losbench.recording.frames.pixelfiles import is_pixel_file, open_pixel_files

    k, found = first_readable(
        len(paths), lambda k: () if is_pixel_file(paths[k]) else planes_of(paths[k]), skip=skip
    )
    if not found:
        if is_pixel_file(paths[k]):
            return open_pixel_files(paths, own_times=own_times)
        raise ValueError(f"{paths[k].name} holds neither an image nor a FLUX column")
    first = paths[k]
    images = [plane for plane, role in found if role == "image"]
    masks = [plane for plane, role in found if role == "mask"]
    if not images:
        raise ValueError(f"{first.name} holds neither an image nor a FLUX column")
    shape, alike = images[0].shape, {(p.shape, p.bitpix) for p in images}
    frames = images if len(alike) == 1 and len(shape) == 2 and len(paths) == 1 else images[:1]
    notes = _said_of_images(first, images, frames, single=len(paths) == 1)
    notes += _said_of_companions(first, [role for _, role in found])
    if len(paths) > 1 and len(shape) == 2:
        mask = next((m.index for m in masks if m.shape == shape), None)
        found_one = _one_image_each(
            paths, name, images[0].index, mask, skip=skip, own_times=own_times
        )
        return (replace(found_one, notes=(*notes, *found_one.notes)),)
    if len(shape) == 3 and len(paths) > 1:
        cubes = [open_fits([path], "", skip=skip, own_times=own_times)[0] for path in paths]
        return (join(cubes, name),)
    if len(shape) not in (2, 3):
        raise ValueError(
            f"{first.name} must hold one frame of a folder, or a stack (frames, rows, cols), got "
            f"{shape}"
        )
    return (_stack(first, frames, masks, notes, skip=skip, own_times=own_times),)


def _stack(
    path: Path,
    frames: list[Plane],
    masks: list[Plane],
    notes: tuple[str, ...],
    *,
    skip: bool,
    own_times: bool,
) -> Found:
    """Frames of one file: its cube, or its images."""
    claimed = len(frames) if len(frames) > 1 else frames[0].n_frames
    n_frames = claimed
    if len(frames) == 1 and frames[0].offset is not None:
        with decoding(path.name):
            held = file_size(opened(plain_file, path)) - frames[0].offset
            there = held // max(frames[0].frame_bytes, 1)
        n_frames, said = cut_short(path.name, claimed, there, skip=skip)
        notes += said
    elif len(frames) == 1:
        fits_in(path.name, claimed * frames[0].frame_bytes, path.stat().st_size)
    each = [mask for mask in masks if mask.shape == frames[0].shape]
    paired = tuple(each) if len(each) == len(frames) and claimed > 1 else ()
    with decoding(path.name):
        flat = [mask for mask in masks if mask.shape == frames[0].shape[-2:]]
        bad = _bad(path, flat[0]) if flat and not paired else None
    times = None
    if own_times:
        times = (
            axis_times(path, frames[0], n_frames)
            if len(frames[0].shape) == 3
            else dated([p.date for p in frames], frames[0].clock, path.name)
        )
    return Found(
        name=path.name,
        source=FitsStack(path, tuple(frames), n_frames, paired),
        time_s=None if times is None else times.seconds,
        start=None if times is None else times.start,
        bad=bad,
        bits=frames[0].bits,
        notes=notes,
    )


def _one_image_each(
    paths: list[Path], name: str, image: int, mask: int | None, *, skip: bool, own_times: bool
) -> Found:
    """One frame a file, without those that say of themselves that they are darks or flats."""
    planes = {path: _plane_of_file(path, image, skip=skip) for path in paths}
    strangers = [p for p, plane in planes.items() if plane is not None and plane.calibrates]
    notes: tuple[str, ...] = ()
    if 0 < len(strangers) < len(paths):
        named = ", ".join(path.name for path in strangers[:3])
        more = f" and {len(strangers) - 3} more" if len(strangers) > 3 else ""
        notes = (f"{named}{more}: a dark, bias or flat by its IMAGETYP, left out.",)
        planes = {path: plane for path, plane in planes.items() if path not in strangers}
    known = [plane for plane in planes.values() if plane is not None]
    times = None
    if own_times:
        clocks = {plane.clock for plane in known if plane.date} or {""}
        if len(clocks) > 1:
            raise ValueError(f"{name} must keep one TIMESYS, got {', '.join(sorted(clocks))}")
        dates = [None if plane is None else plane.date for plane in planes.values()]
        times = dated(dates, clocks.pop(), paths[0].parent.name)
        undated = [path.name for path, date in zip(planes, dates, strict=True) if date is None]
        if undated:
            missing = f"{len(undated)} of {len(dates)} files have no DATE-OBS with a time of day"
            notes = (*notes, f"{missing}, first {undated[0]}: their times are unknown.")
    folder = paths[0].parent
    return Found(
        name=name,
        source=FitsFiles(folder, tuple(os.path.relpath(p, folder) for p in planes), image, mask),
        time_s=None if times is None else times.seconds,
        start=None if times is None else times.start,
        bits=known[0].bits if known else None,
        notes=notes,
    )


def _plane_of_file(path: Path, index: int, *, skip: bool) -> Plane | None:
    try:
        planes = planes_of(path)
    except UnreadableFrame:
        if not skip:
            raise
        return None
    return next((plane for plane, _ in planes if plane.index == index), None)


def _bad(path: Path, mask: Plane) -> Bools:
    marked: Bools = mask.frame(path, 0, f"the mask of {path.name}") != 0
    return marked


def _masked(image: NDArray[Any], mask: NDArray[Any]) -> NDArray[Any]:
    if mask.shape != image.shape:
        raise UnreadableFrame(f"a mask of {mask.shape} does not fit a frame of {image.shape}")
    return np.where(mask != 0, np.float32(np.nan), image.astype(np.float32))


def _said_of_images(
    first: Path, images: list[Plane], frames: list[Plane], *, single: bool
) -> tuple[str, ...]:
    if len(images) == 1:
        return ()
    if len(frames) > 1:
        return (f"The {len(images)} images of {first.name} are taken as frames.",)
    each = "is measured" if single else "of each file is measured"
    return (f"{first.name} holds {len(images)} images: only the first {each}.",)


def _said_of_companions(first: Path, roles: list[str]) -> tuple[str, ...]:
    said: list[tuple[str, str]] = [
        ("mask", "masks, whose pixels are left out"),
        ("uncertainty", "planes of uncertainty, which are no frames"),
        ("other", "other images, which are no frames by their names"),
    ]
    return tuple(
        f"{first.name} holds {roles.count(role)} {what}." for role, what in said if role in roles
    )
