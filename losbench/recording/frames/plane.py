"""The images of a FITS file: where each lies, and how its numbers become those that were meant."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.handles import file_size, fill, opened, plain_file
from losbench.recording.frames.protocol import decoding, fits_in, quietly

__all__ = ["Plane", "hdu_list", "planes_of"]

# How extensions beside an image are called by CCDData, HST, JWST, LSST and others.
_IMAGES = ("SCI", "SCIENCE", "IMAGE")
_UNCERTAINTIES = ("UNC", "ERR", "VAR", "IVAR", "WHT", "WEIGHT", "STD", "SIGMA", "RMS", "NOISE")
_OTHERS = ("SAMP", "TIME", "AREA", "EXP", "COVERAGE", "CON", "CTX", "PSF", "BKG", "BACKGROUND")
_MASKS = ("DQ", "MASK", "BADPIX", "BPM", "FLAG")
_CALIBRATION = ("DARK", "BIAS", "FLAT", "ZERO")


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
    calibrates : bool
        Whether IMAGETYP says that it is a dark, a bias or a flat.
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
    calibrates: bool

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
        if self.bzero not in (0, 2 ** (self.bitpix - 1)):
            return None
        return self.bitpix - (self.bzero == 0 and self.bitpix > 8)

    def frame(self, path: Path, k: int, label: str) -> NDArray[Any]:
        """Return one frame."""
        with decoding(label):
            if self.offset is None:
                hdu = opened(hdu_list, path)[self.index]
                ones = (0,) * (len(hdu.shape) - len(self.shape))
                within = (np.s_[:], np.s_[:]) if len(self.shape) == 2 else (k,)
                with quietly():
                    raw = np.array(hdu.section[(*ones, *within)])
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


def hdu_list(path: Path) -> Any:
    """Open a FITS file with astropy, its numbers as they are stored."""
    try:
        from astropy.io import fits
    except ImportError:
        raise ImportError("FITS files need astropy: pip install 'losbench[fits]'") from None
    with decoding(path.name), quietly():
        packed = path.suffix.lower() in (".gz", ".bz2")
        unpacked = opened(plain_file, path).fileno() if packed else None
        file = path.open("rb") if unpacked is None else os.fdopen(os.dup(unpacked), "rb")
        try:
            file.seek(0)
            return fits.open(file, memmap=False, do_not_scale_image_data=True)
        except BaseException:  # astropy would leave it open
            file.close()
            raise


def planes_of(path: Path) -> tuple[tuple[Plane, str], ...]:
    """Return the images of a file with what each is: "image", "mask", "uncertainty" or "other"."""
    hdus = opened(hdu_list, path)
    with decoding(path.name), quietly():
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
                _without_ones(hdu.shape),
                int(header["BITPIX"]),
                float(header.get("BSCALE", 1.0)),
                float(header.get("BZERO", 0.0)),
                None if blank is None or header["BITPIX"] < 0 else int(blank),
                None if packed else int(hdu.fileinfo()["datLoc"]),
                _date(header) or _date(hdus[0].header),
                _word("TIMESYS", header, hdus[0].header),
                _word("IMAGETYP", header, hdus[0].header).startswith(_CALIBRATION),
            )
            if packed:
                fits_in(path.name, plane.frame_bytes, path.stat().st_size)
            planes.append((plane, _role(str(header.get("EXTNAME", "")))))
        if any(role == "science" for _, role in planes):  # then what has no name is none
            planes = [(plane, "other" if role == "image" else role) for plane, role in planes]
        return tuple((plane, "image" if role == "science" else role) for plane, role in planes)


def _without_ones(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return a shape without leading axes of one, which say nothing."""
    while len(shape) > 2 and shape[0] == 1:
        shape = shape[1:]
    return tuple(map(int, shape))


def _word(key: str, *headers: Any) -> str:
    return next((str(h[key]).strip().upper() for h in headers if key in h), "")


def _role(extname: str) -> str:
    word = extname.strip().upper()
    if word in _IMAGES:
        return "science"
    kinds = {"mask": _MASKS, "uncertainty": _UNCERTAINTIES, "other": _OTHERS}
    return next((role for role, words in kinds.items() if word.startswith(words)), "image")


def _date(header: Any) -> str | None:
    """Return DATE-OBS, with TIME-OBS where that holds the time of day; None where there is none."""
    date, time = (str(header.get(key, "")).strip() for key in ("DATE-OBS", "TIME-OBS"))
    if "T" in date:
        return date
    return f"{date}T{time}" if date and time else None
