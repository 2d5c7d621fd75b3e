"""Target pixel files of Kepler and TESS: one stamp of the detector around each star."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Floats
from losbench.imaging.detector import Detector
from losbench.logs import FrameTimes, increasing
from losbench.recording.frames.contiguous import native
from losbench.recording.frames.handles import opened
from losbench.recording.frames.plane import hdu_list
from losbench.recording.frames.protocol import Found, UnreadableFrame, decoding, quietly

__all__ = ["PixelFile", "is_pixel_file", "open_pixel_files"]

_MARGIN = 6  # pixels around a stamp, enough for a window and its background ring


@dataclass(frozen=True)
class PixelFile:
    """The FLUX column of a target pixel file.

    It comes without background, and its stamps hardly reach beyond the star: pixels that were not
    read, and a margin around the stamp, are taken as zero, so that a window may hang over the edge.
    """

    path: Path
    n_frames: int

    def frame(self, k: int) -> NDArray[Any]:
        """Return one cadence, with its margin."""
        with decoding(self.label(k)):
            frame: NDArray[Any] = opened(_flux, self.path)[k]
            return frame

    def label(self, k: int) -> str:
        """Return the name of a cadence."""
        return f"frame {k} of {self.path.name}"


def is_pixel_file(path: Path) -> bool:
    """Whether a FITS file has a FLUX column."""
    hdus = opened(hdu_list, path)
    with decoding(path.name), quietly():
        return any("FLUX" in _columns(hdu) for hdu in hdus)


def open_pixel_files(paths: list[Path], *, own_times: bool) -> tuple[Found, ...]:
    """Open target pixel files of one observation: one stamp for each, at its place on the detector.

    A stamp's place is in the header keys 1CRV5P (column) and 2CRV5P (row); times are BKJD or BTJD
    days of the first file, turned into seconds from the first frame. Cadences without a time become
    missing times; a star is left out of those where its file's QUALITY is not zero.
    """
    opened_files = [_one(path) for path in paths]
    lengths = {one.name: one.source.n_frames for one, _ in opened_files}
    if len(set(lengths.values())) > 1:
        raise ValueError(
            f"target pixel files of one recording must have as many frames each, got {lengths}"
        )
    detector = _detector(np.concatenate([noise for _, noise in opened_files], axis=1))
    time_s = opened_files[0][0].time_s if own_times else None
    if time_s is not None:
        if not np.isfinite(time_s).any():
            raise ValueError(f"TIME of {paths[0].name} must hold at least one finite time")
        increasing(FrameTimes(time_s), f"TIME of {paths[0].name}")
    found = [replace(one, time_s=time_s, detector=detector) for one, _ in opened_files]
    marked = int(np.any([np.asarray(one.left_out) for one in found], axis=0).sum())
    quality = f"{marked} of {found[0].source.n_frames} frames"
    notes: tuple[str, ...] = (
        f"{quality} have a QUALITY that is not zero: what it marks is left out.",
    )
    stars = [one.star for one in found if one.star]
    named = f"Spot by spot, the stars are {', '.join(stars)}."
    notes = notes * (marked > 0) + (named,) * (len(found) == len(stars))
    return replace(found[0], notes=notes), *found[1:]


def _one(path: Path) -> tuple[Found, Floats]:
    """Return one file's stamp, and flux against variance of all its pixels."""
    with decoding(path.name), quietly():
        table = _table(path)
        names, flux = _columns(table), np.array(table.data["FLUX"])
        variance = np.empty((2, 0))
        if "FLUX_ERR" in names:
            variance = np.stack([flux.ravel(), np.ravel(table.data["FLUX_ERR"]) ** 2])
        if "TIME" not in names:
            raise UnreadableFrame(f"{path.name} must have a column TIME, it has {', '.join(names)}")
        days = np.array(table.data["TIME"], dtype=np.float64)
        marked = np.zeros(len(flux), bool)
        if "QUALITY" in names:
            marked = np.array(table.data["QUALITY"]) != 0
        x, y = (float(table.header.get(key, 0)) for key in ("1CRV5P", "2CRV5P"))
        star = str(opened(hdu_list, path)[0].header.get("OBJECT", "")).strip() or None
        if flux.ndim != 3 or days.shape != (len(flux),) or marked.shape != days.shape:
            raise UnreadableFrame(
                f"FLUX of {path.name} must be a stack (frames, rows, cols) with a time for each, "
                f"got shapes {flux.shape} and {days.shape}"
            )
    known = days[np.isfinite(days)]
    found = Found(
        name=path.stem,
        source=PixelFile(path, len(flux)),
        time_s=(days - known[0]) * 86400.0 if known.size else np.full(len(days), np.nan),
        left_out=marked,
        calibrated=True,
        star=star,
        origin_px=(x - _MARGIN, y - _MARGIN),
    )
    return found, variance


def _table(path: Path) -> Any:
    table = next((hdu for hdu in opened(hdu_list, path) if "FLUX" in _columns(hdu)), None)
    if table is None:
        raise UnreadableFrame(f"{path.name} is no target pixel file: it has no FLUX column")
    claimed = int(table.header["NAXIS1"]) * int(table.header["NAXIS2"])
    held = path.stat().st_size
    if claimed > held and path.suffix.lower() not in (".gz", ".bz2"):
        raise UnreadableFrame(
            f"{path.name} cannot be read: cut short, its header claims {claimed:_} bytes of table, "
            f"the file has {held:_}"
        )
    return table


def _flux(path: Path) -> NDArray[Any]:
    with quietly():
        flux = np.array(_table(path).data["FLUX"])
    return native(np.pad(np.nan_to_num(flux), [(0, 0), (_MARGIN, _MARGIN), (_MARGIN, _MARGIN)]))


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
    if not slope > 0:
        return None
    return Detector(
        gain_e_per_dn=float(1.0 / slope), read_noise_e=float(np.sqrt(max(floor, 0.0)) / slope)
    )


def _columns(hdu: Any) -> tuple[str, ...]:
    columns = getattr(hdu, "columns", None)
    return tuple(columns.names) if columns is not None else ()
