"""FITS cubes and target pixel files, read with astropy (the ``fits`` extra)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.imaging.detector import Detector
from losbench.recording.readers import Stamp, UnreadableFrame, as_frame
from losbench.recording.times import FrameTimes

__all__ = ["open_fits", "open_pixel_files"]


_MARGIN = 6  # pixels around a stamp, enough for a window and its background ring


@dataclass(frozen=True)
class Contents:
    """What FITS files hold: frames, stamps, times, and the noise that their own errors describe."""

    n_frames: int
    stamps: tuple[Stamp, ...]
    times: FrameTimes | None = None
    detector: Detector | None = None


def open_fits(path: Path) -> Contents:
    """Open one FITS file: a target pixel file, or the first image or cube in it."""
    with _hdus(path) as hdus:
        if any("FLUX" in _columns(hdu) for hdu in hdus):
            is_pixel_file = True
        else:
            is_pixel_file = False
            images = [hdu for hdu in hdus if hdu.is_image and hdu.data is not None]
            if not images:
                raise ValueError(f"{path.name} holds neither an image nor a FLUX column")
            cube = np.array(images[0].data)
    if is_pixel_file:
        return open_pixel_files([path])
    cube = cube[None] if cube.ndim == 2 else cube
    if cube.ndim != 3:
        raise ValueError(f"{path.name} must hold a stack (frames, rows, cols), got shape {cube.shape}")
    return Contents(len(cube), (Stamp("frame", cube.shape[1:], (0.0, 0.0), _loader(cube, path.name)),))


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
