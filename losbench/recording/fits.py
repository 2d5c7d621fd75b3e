"""FITS cubes and target pixel files, read with astropy (the ``fits`` extra)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.imaging.detector import Detector
from losbench.recording.stamps import Stamp, UnreadableFrame, as_frame
from losbench.recording.times import FrameTimes, times_from_utc

__all__ = ["Contents", "open_fits", "open_pixel_files"]

_MARGIN = 6  # pixels around a stamp, enough for a window and its background ring


@dataclass(frozen=True)
class Contents:
    """What FITS files hold: frames, stamps, times, and the noise that their own errors describe."""

    n_frames: int
    stamps: tuple[Stamp, ...]
    times: FrameTimes | None = None
    detector: Detector | None = None


def open_fits(paths: list[Path]) -> Contents:
    """Open target pixel files, a folder of images with one frame each, or the first image or cube of one file."""
    with _hdus(paths[0]) as hdus:
        if any("FLUX" in _columns(hdu) for hdu in hdus):
            return open_pixel_files(paths)
        images = [i for i, hdu in enumerate(hdus) if hdu.is_image and hdu.header.get("NAXIS", 0) >= 2]
        if not images:
            raise ValueError(f"{paths[0].name} holds neither an image nor a FLUX column")
        which, header = images[0], hdus[images[0]].header.copy()
        shape: tuple[int, ...] = hdus[which].shape
    if len(shape) == 2:
        return _one_image_each(paths, which, (shape[0], shape[1]))
    if len(shape) != 3 or len(paths) > 1:
        raise ValueError(
            f"{paths[0].name} must hold one frame of a folder, or a stack (frames, rows, cols), got {shape}"
        )
    stamp = Stamp(
        "frame", shape[1:], (0.0, 0.0), lambda k: _section(paths[0], which, k, f"frame {k} of {paths[0].name}")
    )
    return Contents(shape[0], (stamp,), _axis_times(header, shape[0]))


def _one_image_each(paths: list[Path], which: int, shape: tuple[int, int]) -> Contents:
    def load(k: int) -> NDArray[Any]:
        frame = _section(paths[k], which, None, paths[k].name)
        if frame.shape != shape:
            raise UnreadableFrame(
                f"all frames must be {shape} as {paths[0].name}, but {paths[k].name} is {frame.shape}"
            )
        return frame

    dates: list[str] = []
    for path in paths:
        with _hdus(path) as hdus:
            dates += [hdus[which].header["DATE-OBS"]] if "DATE-OBS" in hdus[which].header else []
    times = times_from_utc(dates, f"DATE-OBS of {paths[0].parent.name}") if len(dates) == len(paths) else None
    return Contents(len(paths), (Stamp("frame", shape, (0.0, 0.0), load),), times)


def _section(path: Path, which: int, k: int | None, name: str) -> NDArray[Any]:
    """Read one frame and no more."""
    with _hdus(path) as hdus:
        try:
            section = hdus[which].section
            frame = np.array(section[:, :] if k is None else section[k])
        except (OSError, ValueError, IndexError, TypeError) as error:
            raise UnreadableFrame(f"{name} cannot be read: {error}") from None
    return as_frame(frame.astype(frame.dtype.newbyteorder("="), copy=False), name)


def _axis_times(header: Any, n_frames: int) -> FrameTimes | None:
    """Return the times of a cube whose third axis is time in seconds."""
    if str(header.get("CTYPE3", "")).strip().upper() != "TIME" or header.get("CUNIT3", "s").strip() != "s":
        return None
    steps = np.arange(n_frames) + 1.0 - header.get("CRPIX3", 1.0)
    return FrameTimes(header.get("CRVAL3", 0.0) + steps * header.get("CDELT3", 1.0))


def open_pixel_files(paths: list[Path]) -> Contents:
    """Open target pixel files of one observation: one stamp for each, at its place on the detector.

    A stamp's place is in the header keys 1CRV5P (column) and 2CRV5P (row); times are BKJD or BTJD days of the first
    file, turned into seconds from the first frame. Cadences without a time become missing times. FLUX comes without
    background, and its stamps hardly reach beyond the star: pixels that were not read, and a margin around the stamp,
    are taken as zero, so that a window may hang over the edge.
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
            raise ValueError(f"FLUX of {path.name} must be a stack (frames, rows, cols), got shape {flux.shape}")
        framed = np.pad(np.nan_to_num(flux), [(0, 0), (_MARGIN, _MARGIN), (_MARGIN, _MARGIN)])
        corner = (origin[0] - _MARGIN, origin[1] - _MARGIN)
        stamps.append(Stamp(path.stem, framed.shape[1:], corner, _loader(framed, path.name)))
    lengths = {path.name: len(day) for path, day in zip(paths, days, strict=True)}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"target pixel files of one recording must have as many frames each, got {lengths}")
    first = days[0][np.isfinite(days[0])]
    if not first.size:
        raise ValueError(f"TIME of {paths[0].name} must hold at least one finite time")
    times = FrameTimes((days[0] - first[0]) * 86400.0)
    return Contents(
        len(days[0]), tuple(stamps), times, _detector(np.concatenate(variances or [np.empty((2, 0))], axis=1))
    )


def _detector(flux_and_variance: NDArray[Any]) -> Detector | None:
    """Return the detector whose noise the files' own errors describe: variance = flux / gain + read noise."""
    flux, variance = flux_and_variance[:, np.isfinite(flux_and_variance).all(axis=0)].astype(np.float64)
    if flux.size < 2:
        return None
    (slope, floor), *_ = np.linalg.lstsq(np.stack([flux, np.ones_like(flux)], axis=-1), variance)
    if slope <= 0:
        return None
    return Detector(gain_e_per_dn=float(1.0 / slope), read_noise_e=float(np.sqrt(max(floor, 0.0)) / slope))


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
