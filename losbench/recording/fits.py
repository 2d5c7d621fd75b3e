"""FITS cubes and target pixel files, read with astropy (the ``fits`` extra)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.imaging.detector import Detector
from losbench.logs import FrameTimes, increasing, times_from_utc
from losbench.recording.files import jump_in_names
from losbench.recording.stamps import Stamp, UnreadableFrame, as_frame, first_readable

__all__ = ["Contents", "open_fits", "open_pixel_files"]

_MARGIN = 6  # pixels around a stamp, enough for a window and its background ring


@dataclass(frozen=True)
class Contents:
    """What FITS files hold: frames, stamps, times, the noise that their own errors describe, and
    what was noticed.
    """

    n_frames: int
    stamps: tuple[Stamp, ...]
    times: FrameTimes | None = None
    detector: Detector | None = None
    notes: tuple[str, ...] = ()


def open_fits(paths: list[Path], *, skip: bool, clock: str) -> Contents:
    """Open target pixel files, a folder of images with one frame each, or the images or the cube of
    one file.

    The files' own times are read where ``clock`` is "own".
    """
    k, opened = first_readable(len(paths), lambda k: _hdus(paths[k]), skip=skip)
    first = paths[k]
    with opened as hdus:
        if any("FLUX" in _columns(hdu) for hdu in hdus):
            return open_pixel_files(paths, clock=clock)
        images = [
            i for i, hdu in enumerate(hdus) if hdu.is_image and hdu.header.get("NAXIS", 0) >= 2
        ]
        if not images:
            raise ValueError(f"{first.name} holds neither an image nor a FLUX column")
        which, header = images[0], hdus[images[0]].header.copy()
        shape: tuple[int, ...] = hdus[which].shape
        alike = {(hdus[i].shape, hdus[i].header["BITPIX"]) for i in images} == {
            (shape, header["BITPIX"])
        }
        dates = [_date(hdus[i].header) for i in images]
    each = "is measured" if len(paths) == 1 else "of each file is measured"
    others = (
        (f"{first.name} holds {len(images)} images: only the first {each}.",)
        if len(images) > 1
        else ()
    )
    if len(shape) == 2 and len(paths) == 1:
        if alike and len(images) > 1:
            others = (f"The {len(images)} images of {first.name} are taken as frames.",)
        dates = dates if clock == "own" else []
        return _extensions(
            first, images if alike else images[:1], (shape[0], shape[1]), dates, others
        )
    if len(shape) == 2:
        return _one_image_each(
            paths, which, (shape[0], shape[1]), skip=skip, clock=clock, notes=others
        )
    if len(shape) != 3 or len(paths) > 1:
        raise ValueError(
            f"{first.name} must hold one frame of a folder, or a stack (frames, rows, cols), got "
            f"{shape}"
        )
    stamp = Stamp(
        "frame",
        shape[1:],
        (0.0, 0.0),
        lambda k: _section(first, which, k, f"frame {k} of {first.name}"),
    )
    times = _axis_times(header, shape[0], first.name) if clock == "own" else None
    return Contents(shape[0], (stamp,), times, notes=others)


def _extensions(
    path: Path,
    images: list[int],
    shape: tuple[int, int],
    dates: list[str | None],
    notes: tuple[str, ...],
) -> Contents:
    """Take images of one file as frames."""
    stamp = Stamp(
        "frame",
        shape,
        (0.0, 0.0),
        lambda k: _section(path, images[k], None, f"frame {k} of {path.name}"),
    )
    return Contents(len(images), (stamp,), _times(dates[: len(images)], path.name), None, notes)


def _one_image_each(
    paths: list[Path],
    which: int,
    shape: tuple[int, int],
    *,
    skip: bool,
    clock: str,
    notes: tuple[str, ...],
) -> Contents:
    def load(k: int) -> NDArray[Any]:
        frame = _section(paths[k], which, None, paths[k].name)
        if frame.shape != shape:
            raise UnreadableFrame(
                f"all frames must be {shape} as the first, but {paths[k].name} is {frame.shape}"
            )
        return frame

    dates = [_date_of_file(path, which, skip=skip) for path in paths] if clock == "own" else []
    times = _times(dates, paths[0].parent.name)
    if times is None and clock != "file":
        notes = (*notes, *jump_in_names(paths))
    undated = [path.name for path, date in zip(paths, dates, strict=False) if date is None]
    if undated:
        missing = f"{len(undated)} of {len(dates)} files have no DATE-OBS with a time of day"
        notes = (*notes, f"{missing}, first {undated[0]}: their times are unknown.")
    return Contents(len(paths), (Stamp("frame", shape, (0.0, 0.0), load),), times, None, notes)


def _times(dates: list[str | None], source: str) -> FrameTimes | None:
    name = f"DATE-OBS of {source}"
    return increasing(times_from_utc(dates, name), name) if any(dates) else None


def _date_of_file(path: Path, which: int, *, skip: bool) -> str | None:
    """Return the instant that the image's header tells, or else the file's first."""
    try:
        with _hdus(path) as hdus:
            return next(
                (
                    date
                    for hdu in (*hdus[which : which + 1], hdus[0])
                    if (date := _date(hdu.header))
                ),
                None,
            )
    except UnreadableFrame:
        if not skip:
            raise
        return None


def _date(header: Any) -> str | None:
    """Return DATE-OBS, with TIME-OBS where that holds the time of day; None where there is none."""
    date, time = (str(header.get(key, "")).strip() for key in ("DATE-OBS", "TIME-OBS"))
    if "T" in date:
        return date
    return f"{date}T{time}" if date and time else None


def _section(path: Path, which: int, k: int | None, name: str) -> NDArray[Any]:
    """Read one frame and no more."""
    with _hdus(path) as hdus:
        try:
            section = hdus[which].section
            frame = np.array(section[:, :] if k is None else section[k])
        except (OSError, ValueError, IndexError, TypeError, AttributeError) as error:
            raise UnreadableFrame(f"{name} cannot be read: {error}") from None
    return as_frame(frame.astype(frame.dtype.newbyteorder("="), copy=False), name)


def _axis_times(header: Any, n_frames: int, name: str) -> FrameTimes | None:
    """Return the times of a cube whose third axis is time in seconds."""
    if (
        str(header.get("CTYPE3", "")).strip().upper() != "TIME"
        or header.get("CUNIT3", "s").strip() != "s"
    ):
        return None
    steps = np.arange(n_frames) + 1.0 - header.get("CRPIX3", 1.0)
    return increasing(
        FrameTimes(header.get("CRVAL3", 0.0) + steps * header.get("CDELT3", 1.0)),
        f"axis 3 of {name}",
    )


def open_pixel_files(paths: list[Path], *, clock: str) -> Contents:
    """Open target pixel files of one observation: one stamp for each, at its place on the detector.

    A stamp's place is in the header keys 1CRV5P (column) and 2CRV5P (row); times are BKJD or BTJD
    days of the first file, turned into seconds from the first frame. Cadences without a time become
    missing times. FLUX comes without background, and its stamps hardly reach beyond the star:
    pixels that were not read, and a margin around the stamp, are taken as zero, so that a window
    may hang over the edge.
    """
    stamps, days, variances = [], [], []
    for path in paths:
        with _hdus(path) as hdus:
            table = next((hdu for hdu in hdus if "FLUX" in _columns(hdu)), None)
            if table is None:
                raise ValueError(f"{path.name} is no target pixel file: it has no FLUX column")
            flux = np.array(table.data["FLUX"])
            if "FLUX_ERR" in _columns(table):
                variances.append(np.stack([flux.ravel(), np.ravel(table.data["FLUX_ERR"]) ** 2]))
            days.append(np.array(table.data["TIME"], dtype=np.float64))
            origin = (float(table.header.get("1CRV5P", 0)), float(table.header.get("2CRV5P", 0)))
        if flux.ndim != 3:
            raise ValueError(
                f"FLUX of {path.name} must be a stack (frames, rows, cols), got shape {flux.shape}"
            )
        framed = np.pad(np.nan_to_num(flux), [(0, 0), (_MARGIN, _MARGIN), (_MARGIN, _MARGIN)])
        corner = (origin[0] - _MARGIN, origin[1] - _MARGIN)
        stamps.append(Stamp(path.stem, framed.shape[1:], corner, _loader(framed, path.name)))
    lengths = {path.name: len(day) for path, day in zip(paths, days, strict=True)}
    if len(set(lengths.values())) > 1:
        raise ValueError(
            f"target pixel files of one recording must have as many frames each, got {lengths}"
        )
    detector = _detector(np.concatenate(variances or [np.empty((2, 0))], axis=1))
    times = _seconds(days[0], f"TIME of {paths[0].name}") if clock == "own" else None
    return Contents(len(days[0]), tuple(stamps), times, detector)


def _seconds(days: Floats, name: str) -> FrameTimes:
    known = days[np.isfinite(days)]
    if not known.size:
        raise ValueError(f"{name} must hold at least one finite time")
    return increasing(FrameTimes((days - known[0]) * 86400.0), name)


def _detector(flux_and_variance: NDArray[Any]) -> Detector | None:
    """Return the detector whose noise the files' own errors describe: variance = flux / gain + read
    noise.
    """
    flux, variance = flux_and_variance[:, np.isfinite(flux_and_variance).all(axis=0)].astype(
        np.float64
    )
    if flux.size < 2:
        return None
    (slope, floor), *_ = np.linalg.lstsq(np.stack([flux, np.ones_like(flux)], axis=-1), variance)
    if slope <= 0:
        return None
    return Detector(
        gain_e_per_dn=float(1.0 / slope), read_noise_e=float(np.sqrt(max(floor, 0.0)) / slope)
    )


def _loader(cube: NDArray[Any], name: str) -> Callable[[int], NDArray[Any]]:
    frames = cube.astype(cube.dtype.newbyteorder("="), copy=False)
    return lambda k: as_frame(frames[k], f"frame {k} of {name}")


def _columns(hdu: Any) -> tuple[str, ...]:
    columns = getattr(hdu, "columns", None)
    return tuple(columns.names) if columns is not None else ()


def _hdus(path: Path) -> Any:
    try:
        from astropy.io import fits
    except ImportError:
        raise ImportError("FITS files need astropy: pip install 'losbench[fits]'") from None
    try:
        return fits.open(path, memmap=False)
    except OSError as error:
        raise UnreadableFrame(f"{path.name} cannot be read: {error}") from None
