"""Frames from disk, a block at a time: image folders, TIFF stacks, NumPy stacks, FITS cubes and
target pixel files.

A `Recording` is one or more `Stamp`s seen at the same times. An ordinary camera's recording has one
stamp, the whole frame; a folder of target pixel files has one stamp for each star, each with its
place on the detector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from losbench.checks import choice, positive
from losbench.imaging.detector import Detector
from losbench.logs import FrameTimes, read_times
from losbench.recording.files import (
    image_loader,
    in_natural_order,
    jump_in_names,
    numpy_stack,
    tiff_pages,
)
from losbench.recording.stamps import Stamp, UnreadableFrame, as_frame, first_readable

if TYPE_CHECKING:
    from losbench.recording.fits import Contents

__all__ = ["Recording", "read_recording"]

_IMAGES = (".png", ".tif", ".tiff")
_FITS = (".fits", ".fit", ".fits.gz")


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
    notes : tuple of str
        What was noticed when the files were opened.

    Examples
    --------
    >>> frames = np.zeros((3, 20, 30), np.uint16)
    >>> recording = Recording(
    ...     Path("memory"), 3, (Stamp("frame", (20, 30), (0.0, 0.0), lambda k: frames[k]),)
    ... )
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
    notes: tuple[str, ...] = ()


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
        A folder of PNG or TIFF frames (8 or 16 bit, in natural order of their names), a multi-page
        TIFF, an .npy or .npz stack (F, rows, cols), a FITS cube, a target pixel file, or a folder
        of FITS images or target pixel files.
    times : path, optional
        CSV with the frames' times, one row a frame: ``time_s`` (seconds) or ``time`` (ISO 8601,
        UTC).
    period_s : float, optional
        Time between frames in seconds, if there is no such file. Times that FITS files bring give
        way to either.
    start : str, optional
        ISO 8601 UTC time of the first frame, with ``period_s``.
    on_unreadable : "stop" or "skip"
        What a broken frame, or one of another size, does: stop with its name, or leave a gap in the
        series.

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
        raise FileNotFoundError(
            f"no recording at {source}: expected a folder of frames, or a TIFF, NumPy or FITS file"
        )
    choice("on_unreadable", on_unreadable, ("stop", "skip"))
    if period_s is not None:
        positive("period_s", period_s)
        if times is not None:
            raise ValueError(
                "times and period_s exclude each other: give the frames' times or the time between "
                "them"
            )
    clock = "file" if times is not None else "own" if period_s is None else "period"
    recording = _open(source, skip=on_unreadable == "skip", clock=clock)
    if recording.times is None or start is not None:
        recording = replace(
            recording, times=read_times(times, recording.n_frames, period_s=period_s, start=start)
        )
    return replace(recording, skip_unreadable=on_unreadable == "skip")


def _open(source: Path, *, skip: bool, clock: str) -> Recording:
    """Open a source; ``clock`` says whether times come from a file, from a period, or from the
    source's own headers.
    """
    if source.is_dir():
        files = in_natural_order(
            [p for p in source.iterdir() if p.is_file() and not p.name.startswith(".")]
        )
        images = [p for p in files if p.suffix.lower() in _IMAGES]
        if images:
            found = _stack(
                source, len(images), image_loader(images), lambda k: images[k].name, skip=skip
            )
            return replace(found, notes=() if clock == "file" else jump_in_names(images))
        pixel_files = [p for p in files if p.name.lower().endswith(_FITS)]
        if pixel_files:
            from losbench.recording.fits import open_fits

            return _from_fits(source, open_fits(pixel_files, skip=skip, clock=clock))
        raise ValueError(
            f"{source} holds no frames: expected PNG, TIFF or FITS files, got {len(files)} other "
            "files"
        )
    suffix = source.suffix.lower()
    if suffix in (".tif", ".tiff"):
        pages = tiff_pages(source, skip=skip)
        return replace(_stack(source, pages.count, pages.load, skip=skip), notes=pages.notes)
    if suffix in (".npy", ".npz"):
        cube = numpy_stack(source)
        return _stack(source, len(cube), lambda k: np.asarray(cube[k]), skip=skip)
    if source.name.lower().endswith(_FITS):
        from losbench.recording.fits import open_fits

        return _from_fits(source, open_fits([source], skip=skip, clock=clock))
    raise ValueError(
        f"{source.name} is no recording: expected .tif, .npy, .npz or .fits, or a folder of frames"
    )


def _from_fits(source: Path, found: Contents) -> Recording:
    return Recording(
        source, found.n_frames, found.stamps, found.times, found.detector, notes=found.notes
    )


def _stack(
    source: Path,
    n_frames: int,
    load: Callable[[int], NDArray[Any]],
    label: Callable[[int], str] = "frame {}".format,
    *,
    skip: bool,
) -> Recording:
    if n_frames == 0:
        raise ValueError(f"{source.name} holds no frames")
    k, first = first_readable(n_frames, lambda k: as_frame(load(k), label(k)), skip=skip)
    name = label(k)

    def checked(k: int) -> NDArray[Any]:
        frame = as_frame(load(k), label(k))
        if frame.shape != first.shape or frame.dtype != first.dtype:
            raise UnreadableFrame(
                f"all frames must be {_described(first)} as {name}, but {label(k)} is "
                f"{_described(frame)}"
            )
        return frame

    return Recording(source, n_frames, (Stamp("frame", first.shape, (0.0, 0.0), checked),))


def _described(frame: NDArray[Any]) -> str:
    return f"{frame.shape[0]}x{frame.shape[1]} {frame.dtype}"
