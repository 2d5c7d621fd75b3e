"""Frames from disk, a block at a time: image folders, TIFF stacks, NumPy stacks, FITS cubes and target pixel files.

A `Recording` is one or more `Stamp`s seen at the same times. An ordinary camera's recording has one stamp, the whole
frame; a folder of target pixel files has one stamp for each star, each with its place on the detector.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.checks import choice, positive
from losbench.imaging.detector import Detector
from losbench.recording.times import FrameTimes, read_times

if TYPE_CHECKING:
    from losbench.recording.fits import Contents

__all__ = ["Recording", "Stamp", "UnreadableFrame", "read_recording"]

_IMAGES = (".png", ".tif", ".tiff")
_FITS = (".fits", ".fit", ".fits.gz")
_DTYPES = (np.uint8, np.uint16, np.float32)


class UnreadableFrame(ValueError):
    """A frame that could not be read, or that does not match the others; the message names it."""


@dataclass(frozen=True)
class Stamp:
    """One rectangle of the detector through all frames, read on demand.

    Attributes
    ----------
    name : str
        What the stamp shows: "frame", or the name of its file.
    shape : (rows, cols)
        Its size in pixels.
    origin_px : (x, y)
        Detector position of its first pixel.
    load : callable
        ``load(k)`` returns frame ``k`` as a (rows, cols) array or raises `UnreadableFrame`.
    """

    name: str
    shape: tuple[int, int]
    origin_px: tuple[float, float]
    load: Callable[[int], NDArray[Any]]

    def read(self, first: int, last: int, *, skip: bool) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Return frames ``first`` to ``last`` (excluded) and which of them could be read; others are zero."""
        frames: list[NDArray[Any] | None] = []
        for k in range(first, last):
            try:
                frames.append(self.load(k))
            except UnreadableFrame:
                if not skip:
                    raise
                frames.append(None)
        good = np.array([frame is not None for frame in frames])
        dtype = next((frame.dtype for frame in frames if frame is not None), np.dtype(np.uint16))
        stack = np.zeros((len(frames), *self.shape), dtype=dtype)
        for row, frame in zip(stack, frames, strict=True):
            if frame is not None:
                row[...] = frame
        return stack, good


@dataclass(frozen=True)
class Recording:
    """Frames that wait on disk, with their times; made by `read_recording`.

    Attributes
    ----------
    source : Path
        The file or folder.
    n_frames : int
        Number of frames, unreadable ones included.
    stamps : tuple of Stamp
        One for whole frames, one for each star of a folder of target pixel files.
    times : FrameTimes or None
        Seconds, and UTC where known; None if nothing gives them.
    detector : Detector or None
        Gain and read noise where the files tell, as the errors in target pixel files do.
    skip_unreadable : bool
        Whether an unreadable frame becomes a gap in the series or an error.

    Examples
    --------
    >>> frames = np.zeros((3, 20, 30), np.uint16)
    >>> recording = Recording(Path("memory"), 3, (Stamp("frame", (20, 30), (0.0, 0.0), lambda k: frames[k]),))
    >>> stack, readable = recording.stamps[0].read(0, 2, skip=False)
    >>> stack.shape, readable.tolist()
    ((2, 20, 30), [True, True])
    """

    source: Path
    n_frames: int
    stamps: tuple[Stamp, ...]
    times: FrameTimes | None = None
    detector: Detector | None = None
    skip_unreadable: bool = False


def read_recording(
    path: str | Path,
    *,
    times: str | Path | None = None,
    period_s: float | None = None,
    start: str | None = None,
    on_unreadable: str = "stop",
) -> Recording:
    """Open a recording without loading its frames.

    Parameters
    ----------
    path : str or Path
        A folder of PNG or TIFF frames (8 or 16 bit, in natural order of their names), a multi-page TIFF, an .npy or
        .npz stack (F, rows, cols), a FITS cube, a target pixel file, or a folder of target pixel files.
    times : path, optional
        CSV with the frames' times, one row a frame: ``time_s`` (seconds) or ``time`` (ISO 8601, UTC).
    period_s : float, optional
        Time between frames in seconds, if there is no such file. Times in FITS files win over both.
    start : str, optional
        ISO 8601 UTC time of the first frame, with ``period_s``.
    on_unreadable : "stop" or "skip"
        What a broken frame, or one of another size, does: stop with its name, or leave a gap in the series.

    Returns
    -------
    Recording
        ``times`` is None where nothing gave them.

    Raises
    ------
    FileNotFoundError
        If ``path`` does not exist.
    UnreadableFrame
        If the first frame cannot be read.
    ValueError
        If ``path`` holds no frames, an option is wrong, or the times do not match the frames.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(folder + "/stack.npy", np.zeros((3, 20, 30), np.uint16))
    ...     recording = read_recording(folder + "/stack.npy", period_s=5.0)
    >>> recording.n_frames, recording.stamps[0].shape, recording.times.seconds.tolist()
    (3, (20, 30), [0.0, 5.0, 10.0])
    """
    source = Path(path)
    if not source.exists():
        raise FileNotFoundError(f"no recording at {source}: expected a folder of frames, or a TIFF, NumPy or FITS file")
    choice("on_unreadable", on_unreadable, ("stop", "skip"))
    recording = _open(source)
    if period_s is not None:
        positive("period_s", period_s)
    if recording.times is None:
        recording = replace(recording, times=read_times(times, recording.n_frames, period_s=period_s, start=start))
    return replace(recording, skip_unreadable=on_unreadable == "skip")


def _open(source: Path) -> Recording:
    if source.is_dir():
        files = _natural([p for p in source.iterdir() if p.is_file() and not p.name.startswith(".")])
        images = [p for p in files if p.suffix.lower() in _IMAGES]
        if images:
            return _stack(source, len(images), _image_loader(images), lambda k: images[k].name)
        pixel_files = [p for p in files if p.name.lower().endswith(_FITS)]
        if pixel_files:
            from losbench.recording.fits import open_pixel_files

            return _from_fits(source, open_pixel_files(pixel_files))
        raise ValueError(f"{source} holds no frames: expected PNG, TIFF or FITS files, got {len(files)} other files")
    suffix = source.suffix.lower()
    if suffix in (".tif", ".tiff"):
        return _stack(source, *_tiff_pages(source))
    if suffix in (".npy", ".npz"):
        cube = _numpy_stack(source)
        return _stack(source, len(cube), lambda k: np.asarray(cube[k]))
    if source.name.lower().endswith(_FITS):
        from losbench.recording.fits import open_fits

        return _from_fits(source, open_fits(source))
    raise ValueError(f"{source.name} is no recording: expected .tif, .npy, .npz or .fits, or a folder of frames")


def _from_fits(source: Path, found: Contents) -> Recording:
    return Recording(source, found.n_frames, found.stamps, found.times, found.detector)


def _stack(
    source: Path,
    n_frames: int,
    load: Callable[[int], NDArray[Any]],
    label: Callable[[int], str] = "frame {}".format,
) -> Recording:
    if n_frames == 0:
        raise ValueError(f"{source.name} holds no frames")
    first = as_frame(load(0), label(0))

    def checked(k: int) -> NDArray[Any]:
        frame = as_frame(load(k), label(k))
        if frame.shape != first.shape or frame.dtype != first.dtype:
            raise UnreadableFrame(
                f"all frames must be {_described(first)} as {label(0)}, but {label(k)} is {_described(frame)}"
            )
        return frame

    return Recording(source, n_frames, (Stamp("frame", first.shape, (0.0, 0.0), checked),))


def _described(frame: NDArray[Any]) -> str:
    return f"{frame.shape[0]}x{frame.shape[1]} {frame.dtype}"


def as_frame(array: NDArray[Any], name: str) -> NDArray[Any]:
    """Return a two-dimensional frame of a type that the centroids take; other numbers become float32."""
    if array.ndim != 2:
        what = f"{array.shape[-1]} colour channels" if array.ndim == 3 else f"shape {array.shape}"
        raise UnreadableFrame(f"{name} must be one grey image (rows, cols), got {what}")
    if array.dtype.kind not in "uif":
        raise UnreadableFrame(f"{name} must hold numbers, got {array.dtype}")
    return array if array.dtype in _DTYPES else array.astype(np.float32)


def _image_loader(files: list[Path]) -> Callable[[int], NDArray[Any]]:
    import cv2

    def load(k: int) -> NDArray[Any]:
        with _quiet_opencv():
            frame = cv2.imread(str(files[k]), cv2.IMREAD_UNCHANGED)
        if frame is None:
            raise UnreadableFrame(f"{files[k].name} cannot be read: not an image, or cut short")
        return frame

    return load


def _tiff_pages(source: Path) -> tuple[int, Callable[[int], NDArray[Any]]]:
    import cv2

    with _quiet_opencv():
        n_pages = int(cv2.imcount(str(source), cv2.IMREAD_UNCHANGED))
    if n_pages == 0:
        raise UnreadableFrame(f"{source.name} cannot be read: not a TIFF, or cut short")

    def load(k: int) -> NDArray[Any]:
        with _quiet_opencv():
            done, pages = cv2.imreadmulti(str(source), start=k, count=1, flags=cv2.IMREAD_UNCHANGED)
        if not done or not len(pages):
            raise UnreadableFrame(f"{source.name} page {k} cannot be read: cut short?")
        return pages[0]

    return n_pages, load


def _numpy_stack(source: Path) -> NDArray[Any]:
    try:
        loaded = np.load(source, mmap_mode="r", allow_pickle=False)
        if not isinstance(loaded, np.ndarray):
            with loaded as archive:
                name = "frames" if "frames" in archive.files else archive.files[0]
                loaded = archive[name]
    except (OSError, ValueError, EOFError, IndexError) as error:
        raise UnreadableFrame(f"{source.name} cannot be read: {error}") from None
    if loaded.ndim != 3:
        raise ValueError(f"{source.name} must hold a stack (frames, rows, cols), got shape {loaded.shape}")
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


def _natural(files: list[Path]) -> list[Path]:
    return sorted(files, key=lambda p: [int(t) if t.isdigit() else t.lower() for t in re.split(r"(\d+)", p.name)])
