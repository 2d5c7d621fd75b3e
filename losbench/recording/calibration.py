"""Dark, flat, bad pixels and a region of interest: the ordinary calibration of frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.arrays import Bools, Floats
from losbench.checks import integer
from losbench.imaging.detector import Detector
from losbench.recording.frames.door import How, Origin, find_frames
from losbench.recording.frames.protocol import Frames, decoding, marked

__all__ = ["Calibrated", "Calibration", "calibrated"]

_BLOCK = 16  # frames of a dark or flat in memory at a time
_TABLES = (".csv", ".txt")


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What frames are calibrated with; `read_recording` says what each may be."""

    dark: Origin | None = None
    flat: Origin | None = None
    bad_pixels: Origin | None = None
    roi: tuple[int, int, int, int] | None = None

    def __bool__(self) -> bool:
        return any(v is not None for v in (self.dark, self.flat, self.bad_pixels, self.roi))


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibrated:
    """`Frames` less a dark, divided by a flat, cut to a region: (raw - dark) / flat, as float32.

    Attributes
    ----------
    raw : Frames
    corner : (x, y)
        First pixel of the region.
    dark, flat : (rows, cols) float32 array or None
        The flat has a mean of one.
    full_scale_dn : float or None
        What a pixel at ``raw_full_scale_dn`` reads here: all the same, and more than any other, so
        that saturation shows as before.

    The others are those of `Frames`.
    """

    raw: Frames
    corner: tuple[int, int]
    dark: NDArray[np.float32] | None
    flat: NDArray[np.float32] | None
    raw_full_scale_dn: float
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    bad: Bools | None
    full_scale_dn: float | None
    name: str
    n_frames: int
    time_s: Floats | None
    start: np.datetime64 | None
    detector: Detector | None
    step: int
    left_out: Bools | None
    notes: tuple[str, ...]

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        label = getattr(self.raw, "label", None)
        return f"frame {k} of {self.name}" if label is None else str(label(k))

    def read(self, i: int, j: int, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return frames ``i`` to ``j`` (excluded), calibrated."""
        block = np.empty((j - i, *self.shape), self.dtype) if out is None else out[: j - i]
        x, y = self.corner
        for k in range(i, j):
            raw = self.raw.read(k, k + 1)[0, y : y + self.shape[0], x : x + self.shape[1]]
            frame = raw.astype(self.dtype)
            if self.dark is not None:
                frame -= self.dark
            if self.flat is not None:
                frame /= self.flat
            if (self.dark is not None or self.flat is not None) and self.full_scale_dn is not None:
                frame[raw >= self.raw_full_scale_dn] = self.full_scale_dn
            block[k - i] = frame
        return block


def calibrated(frames: Frames, how: Calibration, detector: Detector | None) -> Calibrated:
    """Return frames with a calibration applied when they are read.

    Raises
    ------
    ValueError
        If a dark, flat or mask is not of the frames' shape, or the region not inside it.
    """
    shape = frames.shape
    dark = None if how.dark is None else _image("dark", how.dark, frames)
    flat = None if how.flat is None else _image("flat", how.flat, frames)
    bad = np.zeros(shape, bool) if frames.bad is None else frames.bad.copy()
    if how.bad_pixels is not None:
        bad |= _bad("bad_pixels", how.bad_pixels, shape)
    if dark is not None:
        bad |= ~np.isfinite(dark)
        dark = np.where(bad, 0.0, dark)
    if flat is not None:
        bad |= ~(flat > 0)
        if bad.all():
            raise ValueError("flat must be above zero, got none such pixel")
        flat = np.where(bad, 1.0, flat / flat[~bad].mean())
    x, y, columns, rows = _region(how.roi, shape)
    cut = np.s_[y : y + rows, x : x + columns]
    taken, divisor = (None if a is None else a[cut].astype(np.float32) for a in (dark, flat))
    ends = [frames.full_scale_dn, None if detector is None else np.floor(detector.full_scale_dn)]
    full = min([float(end) for end in ends if end is not None], default=np.inf)
    changed = taken is not None or divisor is not None
    top = (full - (0.0 if taken is None else taken)) / (1.0 if divisor is None else divisor)
    return Calibrated(
        raw=frames,
        corner=(x, y),
        dark=taken,
        flat=divisor,
        raw_full_scale_dn=full,
        shape=(rows, columns),
        dtype=np.dtype(np.float32) if changed else frames.dtype,
        bad=bad[cut] if bad[cut].any() else None,
        full_scale_dn=float(np.float32(np.max(top))) if np.isfinite(full) else None,
        name=frames.name,
        n_frames=frames.n_frames,
        time_s=frames.time_s,
        start=frames.start,
        detector=frames.detector,
        step=frames.step,
        left_out=getattr(frames, "left_out", None),
        notes=(*getattr(frames, "notes", ()), *_said(how, bad[cut])),
    )


def _said(how: Calibration, bad: Bools) -> tuple[str, ...]:
    named = [name for name in ("dark", "flat") if getattr(how, name) is not None]
    did = {"dark": "a dark was taken off", "flat": "they were divided by a flat"}
    said = [f"Frames are calibrated: {' and '.join(did[name] for name in named)}."] if named else []
    if bad.any():
        said.append(f"{int(bad.sum())} pixels are bad, and left out.")
    return tuple(said)


def _image(name: str, given: Origin, frames: Frames) -> Floats:
    """Return the mean of the frames given, in the numbers of ``frames``."""
    stack = given if isinstance(given, np.ndarray) else _array_file(name, given)
    if stack is not None and stack.ndim == 2:
        image = stack.astype(np.float64)
        own_step = frames.step
    else:
        found = find_frames(given if stack is None else stack, How(own_times=False))[0]
        total, own_step = np.zeros(found.shape), found.step
        for k in range(0, found.n_frames, _BLOCK):
            total += found.read(k, min(k + _BLOCK, found.n_frames)).sum(axis=0, dtype=np.float64)
        image = total / found.n_frames
    if image.shape != frames.shape:
        raise ValueError(
            f"{name} must have the shape of the frames, {frames.shape}, got {image.shape}"
        )
    # A dark of few codes does not show that it is left-aligned; the frames do.
    return image * (own_step / frames.step)


def _array_file(name: str, path: Any) -> NDArray[Any] | None:
    """Return what an .npy file holds: one image is no recording, but may well be a dark."""
    if not isinstance(path, str | Path) or Path(path).suffix.lower() != ".npy":
        return None
    if not Path(path).is_file():
        raise FileNotFoundError(f"no {name} at {path}")
    with decoding(Path(path).name):
        array: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
        if array.dtype.kind not in "uifb":
            raise TypeError(f"must hold numbers, not {array.dtype}")
    return array


def _bad(name: str, given: Any, shape: tuple[int, int]) -> Bools:
    """Return a mask (rows, cols) from one, or from places (x, y)."""
    if isinstance(given, str | Path) and Path(given).suffix.lower() in _TABLES:
        given = _places(Path(given))
    array = given if isinstance(given, np.ndarray | list | tuple) else _array_file(name, given)
    if array is None:
        mask = find_frames(given, How(own_times=False))[0].read(0, 1)[0]
    else:
        mask = np.asarray(array)
        if mask.ndim == 2 and mask.shape[1] == 2 and mask.shape != shape:
            places = mask.astype(int)
            inside = (places >= 0) & (places < np.array(shape[::-1]))
            if not inside.all() or (places != mask).any():
                raise ValueError(
                    f"{name} must be whole pixels (x, y) inside the {shape[0]}x{shape[1]} frame, "
                    f"got {mask[~inside.all(axis=1)][:1].tolist() or mask[:1].tolist()}"
                )
            mask = np.zeros(shape, bool)
            mask[places[:, 1], places[:, 0]] = True
    if mask.shape != shape:
        raise ValueError(f"{name} must have the shape of the frames, {shape}, got {mask.shape}")
    return marked(name, mask)


def _places(path: Path) -> Floats:
    """Return the pixels (x, y) that a text file lists, one a line; a header line may come first."""
    if not path.is_file():
        raise FileNotFoundError(f"no bad_pixels at {path}")
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    places = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not words or (number == 1 and words[0][:1].isalpha()):
            continue
        try:
            x, y = map(float, words)
        except ValueError:
            raise ValueError(
                f"{path.name} must list one pixel x, y a line, got {line!r} in line {number}"
            ) from None
        places.append((x, y))
    return np.array(places).reshape(-1, 2)


def _region(roi: Any, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    if roi is None:
        return 0, 0, shape[1], shape[0]
    if not isinstance(roi, tuple | list) or len(roi) != 4:
        raise ValueError(f"roi must be (x, y, columns, rows) in pixels, got {roi!r}")
    x, y, columns, rows = (integer("roi", each, low=0) for each in roi)
    if not (columns and rows) or x + columns > shape[1] or y + rows > shape[0]:
        raise ValueError(
            f"roi must lie inside the {shape[0]}x{shape[1]} frame, got x {x}, y {y}, {columns} "
            f"columns, {rows} rows"
        )
    return x, y, columns, rows
