"""FITS cubes and target pixel files, read with astropy (the ``fits`` extra)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.readers import Stamp, UnreadableFrame, as_frame
from losbench.recording.times import FrameTimes

__all__ = ["open_fits", "open_pixel_files"]


def open_fits(path: Path) -> tuple[int, tuple[Stamp, ...], FrameTimes | None]:
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
    return len(cube), (Stamp("frame", cube.shape[1:], (0.0, 0.0), _loader(cube, path.name)),), None


def open_pixel_files(paths: list[Path]) -> tuple[int, tuple[Stamp, ...], FrameTimes | None]:
    """Open target pixel files of one observation: one stamp for each, at its place on the detector.

    A stamp's place is in the header keys 1CRV5P (column) and 2CRV5P (row); times are BKJD or BTJD days of the first
    file, turned into seconds from the first frame. Cadences without a time become missing times.
    """
    stamps, days = [], []
    for path in paths:
        with _hdus(path) as hdus:
            table = next((hdu for hdu in hdus if "FLUX" in _columns(hdu)), None)
            if table is None:
                raise ValueError(f"{path.name} is no target pixel file: it has no FLUX column")
            flux = np.array(table.data["FLUX"])
            days.append(np.array(table.data["TIME"], dtype=np.float64))
            origin = (float(table.header.get("1CRV5P", 0)), float(table.header.get("2CRV5P", 0)))
        if flux.ndim != 3:
            raise ValueError(f"FLUX of {path.name} must be a stack (frames, rows, cols), got shape {flux.shape}")
        stamps.append(Stamp(path.stem, flux.shape[1:], origin, _loader(flux, path.name)))
    lengths = {path.name: len(day) for path, day in zip(paths, days, strict=True)}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"target pixel files of one recording must have as many frames each, got {lengths}")
    first = days[0][np.isfinite(days[0])]
    if not first.size:
        raise ValueError(f"TIME of {paths[0].name} must hold at least one finite time")
    return len(days[0]), tuple(stamps), FrameTimes((days[0] - first[0]) * 86400.0)


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
