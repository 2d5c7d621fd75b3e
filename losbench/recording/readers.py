"""The one door for recordings: frames from disk with their times, and what they are calibrated
with.

A `Recording` is one or more `Stamp`s seen at the same times. An ordinary camera's recording has one
stamp, the whole frame; a folder of target pixel files has one stamp for each star, each with its
place on the detector.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from losbench.checks import choice, positive
from losbench.imaging.detector import Detector
from losbench.logs import FrameTimes, increasing, read_times
from losbench.recording.calibration import Calibrated, Calibration, calibrated
from losbench.recording.frames.door import How, Origin, find_frames
from losbench.recording.frames.names import jump_in_names, times_in_names
from losbench.recording.frames.protocol import Frames
from losbench.recording.stamps import Stamp

__all__ = ["Recording", "read_recording"]


@dataclass(frozen=True)
class Recording:
    """Frames that wait on disk, with their times; made by `read_recording`.

    It pickles, so that another process can be given one: no file is open in it.

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
        Gain and read noise, as given or where the files tell, as the errors in target pixel files
        do.
    skip_unreadable : bool
        Whether an unreadable frame becomes a gap in the series or an error.
    notes : tuple of str
        What was noticed when the files were opened.

    Examples
    --------
    >>> recording = read_recording(np.zeros((3, 20, 30), np.uint16))
    >>> block = recording.stamps[0].read(0, 2, skip=False)
    >>> block.frames.shape, block.good.tolist()
    ((2, 20, 30), [True, True])
    """

    source: Path
    n_frames: int
    stamps: tuple[Stamp, ...]
    times: FrameTimes | None = None
    detector: Detector | None = None
    skip_unreadable: bool = False
    notes: tuple[str, ...] = ()

    @property
    def full_scale_dn(self) -> float:
        """Reading of a saturated pixel: what the numbers of the file say, or a detector that was
        given if that comes first. The largest float32 where neither says anything.
        """
        frames = self.stamps[0].frames
        ends = [stamp.frames.full_scale_dn for stamp in self.stamps]
        given = self.detector is not None and self.detector is not frames.detector
        if given and self.detector is not None and not isinstance(frames, Calibrated):
            ends.append(float(np.floor(self.detector.full_scale_dn)))
        most = float(np.finfo(np.float32).max)
        return min([float(end) for end in ends if end is not None], default=most)

    def label(self, k: int) -> str:
        """Return the name of a frame: its file, and which of that."""
        return self.stamps[0].label(k)


def read_recording(
    path: Origin,
    *,
    times: str | Path | FrameTimes | None = None,
    period_s: float | None = None,
    start: str | None = None,
    name_times: str | None = None,
    utc_offset: float | str | None = None,
    on_unreadable: str = "stop",
    channel: str | int | None = None,
    dataset: str | None = None,
    detector: Detector | None = None,
    dark: Origin | None = None,
    flat: Origin | None = None,
    bad_pixels: Origin | None = None,
    roi: tuple[int, int, int, int] | None = None,
) -> Recording:
    """Open a recording without loading its frames.

    Parameters
    ----------
    path : str, Path, list of them, or array
        A folder of images (PNG, TIFF, BMP, PGM or JPEG), a pattern such as ``frames/a-*.png``, or
        several files, in natural order of their names; a multi-page TIFF, an .npy or .npz stack (F,
        rows, cols), a FITS cube, a target pixel file, or a folder of FITS images or target pixel
        files; an HDF5, SER or video file; raw frames described by a TOML file (`RawLayout`'s keys);
        an array (F, rows, cols); or what a reader of your own takes (`register_reader`).
    times : path or FrameTimes, optional
        CSV with the frames' times, one row a frame: ``time_s`` (seconds) or ``time`` (a date with a
        time); or such times as `read_times` has read them.
    period_s : float, optional
        Time between frames in seconds, if there is no such file. Times that files bring give way to
        either.
    start : str, optional
        ISO 8601 UTC time of the first frame, with ``period_s``.
    name_times : str, optional
        Pattern of the times in the files' names, as ``"%Y%m%d_%H%M%S"``; taken as UTC unless it
        holds %z, or ``utc_offset`` says otherwise.
    utc_offset : float or str, optional
        Hours of those times east of UTC, or their zone as "Europe/Berlin".
    on_unreadable : "stop" or "skip"
        What a broken frame, or one of another size, does: stop with its name, or leave a gap in the
        series.
    channel : "red", "green", "blue" or int, optional
        Which channel of colour frames; those that are grey need none.
    dataset : str, optional
        Which data set of an HDF5 file, if it holds several stacks.
    detector : Detector, optional
        Gain, read noise and offset, before what the files tell.
    dark, flat : path or array, optional
        What is taken off and divided by, pixel by pixel: (frame - dark) / flat. Several frames are
        averaged; the flat, already less its own dark, is scaled to a mean of one. With a dark, the
        detector's offset is gone.
    bad_pixels : path or array, optional
        Mask, not zero where a pixel is bad; or places (x, y), as an array (n, 2) or a CSV. They are
        NaN in what is read.
    roi : (x, y, columns, rows), optional
        The part of the frames to read; positions stay those of the detector.

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
    skip = choice("on_unreadable", on_unreadable, ("stop", "skip")) == "skip"
    if period_s is not None:
        positive("period_s", period_s)
    if sum(given is not None for given in (times, period_s, name_times)) > 1:
        raise ValueError(
            "times and period_s exclude each other, and name_times both: give the frames' times, "
            "or the time between them, or where their names hold it"
        )
    own = times is None and period_s is None and name_times is None
    how = How(skip=skip, channel=channel, dataset=dataset, own_times=own)
    calibration = Calibration(dark=dark, flat=flat, bad_pixels=bad_pixels, roi=roi)
    found = find_frames(path, how)
    notes = tuple(note for frames in found for note in getattr(frames, "notes", ()))
    if calibration:
        if len(found) > 1:
            raise ValueError("dark, flat, bad_pixels and roi are for whole frames, not for stamps")
        frames = calibrated(found[0], calibration, detector)
        x, y = frames.corner
        stamps: tuple[Stamp, ...] = (Stamp("frame", frames, (x, y), found[0].shape),)
        notes = frames.notes
        if dark is not None and detector is not None:
            detector = replace(detector, offset_dn=0.0)
    else:
        stamps = tuple(_stamp(frames, len(found)) for frames in found)
    first = found[0]
    if name_times is None:
        if utc_offset is not None:
            raise ValueError("utc_offset goes with name_times: times of a CSV are read by its own")
        clock, said = _clock(first, times, period_s, start)
    else:
        clock, said = _clock_of_names(first, name_times, utc_offset)
    return Recording(
        source=Path("memory") if isinstance(path, np.ndarray) else _shown(path),
        n_frames=first.n_frames,
        stamps=stamps,
        times=clock,
        detector=first.detector if detector is None else detector,
        skip_unreadable=skip,
        notes=(*notes, *said),
    )


def _shown(path: Origin) -> Path:
    return Path(path) if isinstance(path, str | Path) else Path(str(path[0])).parent


def _stamp(frames: Frames, n_stamps: int) -> Stamp:
    origin = getattr(frames, "origin_px", (0.0, 0.0))
    placed = n_stamps > 1 or origin != (0.0, 0.0)
    return Stamp(frames.name if placed else "frame", frames, origin)


def _clock(
    frames: Frames,
    times: str | Path | FrameTimes | None,
    period_s: float | None,
    start: str | None,
) -> tuple[FrameTimes | None, tuple[str, ...]]:
    """Return the frames' times: those given, or the files' own."""
    names = _names(frames)
    if times is None and period_s is None and frames.time_s is not None and start is None:
        own = FrameTimes(frames.time_s, frames.start)
        return increasing(own, f"times of {frames.name}"), ()
    clock = read_times(times, frames.n_frames, period_s=period_s, start=start)
    jumps = () if names is None or times is not None else jump_in_names([Path(n) for n in names])
    return clock, jumps


def _clock_of_names(
    frames: Frames, pattern: str, utc_offset: float | str | None
) -> tuple[FrameTimes, tuple[str, ...]]:
    names = _names(frames)
    if names is None:
        raise ValueError("name_times is for files of one frame each")
    times = increasing(times_in_names(names, pattern, utc_offset), "names of the files")
    said = "Times in the files' names are taken as UTC (--name-utc-offset says otherwise)."
    return times, (said,) if times.assumed_utc else ()


def _names(frames: Frames) -> list[str] | None:
    """Return the files' names, where each file is one frame."""
    names = getattr(getattr(frames, "source", None), "names", None)
    return None if names is None else [Path(name).name for name in names]
