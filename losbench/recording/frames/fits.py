"""FITS cubes, extensions and folders of images, found with astropy (the ``fits`` extra)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools
from losbench.logs import FrameTimes, increasing, times_from_utc
from losbench.recording.frames.develop import first_readable
from losbench.recording.frames.handles import file_size, fill, opened, plain_file
from losbench.recording.frames.protocol import (
    Found,
    UnreadableFrame,
    cut_short,
    decoding,
    fits_in,
)

__all__ = ["FITS", "FitsFiles", "FitsStack", "Plane", "hdu_list", "open_fits"]

_ENDINGS = (".fits", ".fit", ".fts")
FITS = (*(e + packed for e in _ENDINGS for packed in ("", ".gz", ".bz2", ".fz")), ".fz")
_UNCERTAINTIES = ("UNCERT", "ERR", "ERROR", "VAR", "VARIANCE", "IVAR", "WHT", "WEIGHT", "STDDEV")
_MASKS = ("DQ", "MASK", "BADPIX", "FLAGS")
_OTHER_CLOCKS = ("TT", "TDT", "ET", "TDB", "TAI", "IAT", "GPS", "TCG", "TCB")
_UTC = ("UTC", "UT", "UT1", "GMT")  # UT1 stays within 0.9 s of UTC
_SAME = {"TDT": "tt", "ET": "tt", "IAT": "tai"}
_GPS_BEHIND_TAI_S = 19.0


@dataclass(frozen=True)
class Plane:
    """Where the image of one HDU lies, and how its numbers become those that were meant.

    Attributes
    ----------
    index : int
        Number of the HDU.
    shape : tuple of int
        (rows, cols) or (frames, rows, cols).
    bitpix, bscale, bzero, blank
        As in the header; ``blank`` marks undefined pixels before scaling (FITS standard 4.4.2.5).
    offset : int or None
        Byte at which the data begin; None where they are compressed in tiles.
    date : str or None
        DATE-OBS with a time of day.
    clock : str
        TIMESYS, "" where it is not said.
    """

    index: int
    shape: tuple[int, ...]
    bitpix: int
    bscale: float
    bzero: float
    blank: int | None
    offset: int | None
    date: str | None
    clock: str

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return 1 if len(self.shape) == 2 else self.shape[0]

    @property
    def frame_bytes(self) -> int:
        """Length of one frame in the file."""
        return abs(self.bitpix) // 8 * self.shape[-1] * self.shape[-2]

    @property
    def bits(self) -> int | None:
        """Bits of the numbers, where undefined ones make floats of them."""
        if self.blank is None or self.bitpix < 0 or self.bscale != 1.0:
            return None
        return self.bitpix - (self.bzero == 0 and self.bitpix > 8)

    def frame(self, path: Path, k: int, label: str) -> NDArray[Any]:
        """Return one frame."""
        with decoding(label):
            if self.offset is None:
                section = opened(hdu_list, path)[self.index].section
                raw = np.array(section[:, :] if len(self.shape) == 2 else section[k])
            else:
                file = opened(plain_file, path)
                fits_in(label, self.frame_bytes, file_size(file))
                kind = f">{'i' if self.bitpix > 0 else 'f'}{abs(self.bitpix) // 8}"
                raw = np.empty(self.shape[-2:], ">u1" if self.bitpix == 8 else kind)
                fill(file, self.offset + k * self.frame_bytes, raw, label)
            return self._meant(raw.astype(raw.dtype.newbyteorder("="), copy=False))

    def _meant(self, raw: NDArray[Any]) -> NDArray[Any]:
        if raw.dtype.kind == "f":
            return raw if (self.bscale, self.bzero) == (1, 0) else raw * self.bscale + self.bzero
        if (self.bscale, self.bzero) == (1, 0):
            meant = raw
        elif self.bitpix == 16 and (self.bscale, self.bzero) == (1, 32768):
            meant = raw.view(np.uint16) ^ np.uint16(32768)
        else:
            wide: Any = np.float64 if self.bitpix > 16 else np.float32
            meant = raw.astype(wide) * wide(self.bscale) + wide(self.bzero)
        if self.blank is None:
            return meant
        return np.where(raw == self.blank, np.float32(np.nan), meant.astype(np.float32))


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
        planes = {plane.index: plane for plane, _ in _planes(path)}
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
        len(paths), lambda k: () if is_pixel_file(paths[k]) else _planes(paths[k]), skip=skip
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
        return (_one_image_each(paths, name, images[0].index, mask, notes, skip, own_times),)
    if len(shape) not in (2, 3) or len(paths) > 1:
        raise ValueError(
            f"{first.name} must hold one frame of a folder, or a stack (frames, rows, cols), got "
            f"{shape}"
        )
    return (_stack(first, frames, masks, notes, skip=skip, own_times=own_times),)


def hdu_list(path: Path) -> Any:
    """Open a FITS file with astropy, its numbers as they are stored."""
    try:
        from astropy.io import fits
    except ImportError:
        raise ImportError("FITS files need astropy: pip install 'losbench[fits]'") from None
    with decoding(path.name):
        packed = path.suffix.lower() in (".gz", ".bz2")
        source = os.dup(opened(plain_file, path).fileno()) if packed else None
        file = path if source is None else os.fdopen(source, "rb")
        if source is not None:
            file.seek(0)  # type: ignore[union-attr]
        return fits.open(file, memmap=False, do_not_scale_image_data=True)


def _planes(path: Path) -> tuple[tuple[Plane, str], ...]:
    """Return the images of a file with what each is: "image", "mask" or "uncertainty"."""
    hdus = opened(hdu_list, path)
    with decoding(path.name):
        from astropy.io import fits

        planes = []
        for index, hdu in enumerate(hdus):
            if not hdu.is_image or hdu.header.get("NAXIS", 0) < 2 or 0 in hdu.shape:
                continue
            header = hdu.header
            blank = header.get("BLANK", header.get("ZBLANK"))
            packed = isinstance(hdu, fits.CompImageHDU)
            plane = Plane(
                index,
                tuple(hdu.shape),
                int(header["BITPIX"]),
                float(header.get("BSCALE", 1.0)),
                float(header.get("BZERO", 0.0)),
                None if blank is None or header["BITPIX"] < 0 else int(blank),
                None if packed else int(hdu.fileinfo()["datLoc"]),
                _date(header) or _date(hdus[0].header),
                str(header.get("TIMESYS", hdus[0].header.get("TIMESYS", ""))).strip().upper(),
            )
            if packed:
                fits_in(path.name, plane.frame_bytes, path.stat().st_size)
            planes.append((plane, _role(str(header.get("EXTNAME", "")))))
        return tuple(planes)


def _role(extname: str) -> str:
    word = extname.strip().upper()
    if word in _MASKS:
        return "mask"
    return "uncertainty" if word in _UNCERTAINTIES else "image"


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
            _axis_times(path, frames[0], n_frames)
            if len(frames[0].shape) == 3
            else _times([p.date for p in frames], frames[0].clock, path.name)
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
    paths: list[Path],
    name: str,
    image: int,
    mask: int | None,
    notes: tuple[str, ...],
    skip: bool,
    own_times: bool,
) -> Found:
    folder = paths[0].parent
    names = tuple(os.path.relpath(path, folder) for path in paths)
    planes = [_plane_of_file(path, image, skip=skip) for path in paths] if own_times else []
    known = [plane for plane in planes if plane is not None]
    clocks = {plane.clock for plane in known if plane.date} or {""}
    if len(clocks) > 1:
        raise ValueError(f"{name} must keep one TIMESYS, got {', '.join(sorted(clocks))}")
    dates = [None if plane is None else plane.date for plane in planes]
    times = _times(dates, clocks.pop(), paths[0].parent.name)
    undated = [path.name for path, date in zip(paths, dates, strict=False) if date is None]
    if undated:
        missing = f"{len(undated)} of {len(dates)} files have no DATE-OBS with a time of day"
        notes = (*notes, f"{missing}, first {undated[0]}: their times are unknown.")
    first = next(iter(known), None)
    return Found(
        name=name,
        source=FitsFiles(folder, names, image, mask),
        time_s=None if times is None else times.seconds,
        start=None if times is None else times.start,
        bits=None if first is None else first.bits,
        notes=notes,
    )


def _plane_of_file(path: Path, index: int, *, skip: bool) -> Plane | None:
    try:
        planes = _planes(path)
    except UnreadableFrame:
        if not skip:
            raise
        return None
    return next((plane for plane, _ in planes if plane.index == index), None)


def _times(dates: list[str | None], clock: str, source: str) -> FrameTimes | None:
    if not any(dates):
        return None
    name = f"DATE-OBS of {source}"
    if clock not in ("", *_UTC, *_OTHER_CLOCKS):
        raise ValueError(f"TIMESYS of {source} must be a clock such as UTC, TT or TAI, got {clock}")
    return increasing(times_from_utc([d and _in_utc(d, clock) for d in dates], name), name)


def _in_utc(date: str, clock: str) -> str:
    """Return an instant of another clock as UTC."""
    if clock in ("", *_UTC):
        return date
    from astropy.time import Time, TimeDelta

    with decoding(f"DATE-OBS {date!r}"):
        scale = "tai" if clock == "GPS" else _SAME.get(clock, clock.lower())
        at = Time(date.rstrip("Z"), scale=scale)
        if clock == "GPS":
            at = at + TimeDelta(_GPS_BEHIND_TAI_S, format="sec")
        return f"{at.utc.to_value('isot', subfmt='date_hms')}Z"


def _date(header: Any) -> str | None:
    """Return DATE-OBS, with TIME-OBS where that holds the time of day; None where there is none."""
    date, time = (str(header.get(key, "")).strip() for key in ("DATE-OBS", "TIME-OBS"))
    if "T" in date:
        return date
    return f"{date}T{time}" if date and time else None


def _axis_times(path: Path, plane: Plane, n_frames: int) -> FrameTimes | None:
    """Return the times of a cube whose third axis is time in seconds."""
    with decoding(path.name):
        header = opened(hdu_list, path)[plane.index].header
        kind, unit = (str(header.get(key, "")).strip() for key in ("CTYPE3", "CUNIT3"))
        if kind.upper() != "TIME" or unit not in ("", "s"):
            return None
        steps = np.arange(n_frames) + 1.0 - float(header.get("CRPIX3", 1.0))
        step_s = float(header.get("CDELT3", 1.0))
        seconds = float(header.get("CRVAL3", 0.0)) + steps * step_s
    return increasing(FrameTimes(seconds.astype(np.float64)), f"axis 3 of {path.name}")


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
    ]
    return tuple(
        f"{first.name} holds {roles.count(role)} {what}." for role, what in said if role in roles
    )
