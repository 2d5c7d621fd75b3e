"""A recording measured in chunks that ask nothing of each other: by whom, and what is kept of it.

Every chunk rests on the survey and its own frames alone, and goes through them in blocks that begin
at the same frames whatever the chunk: the bytes are the same however the work is split.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from losbench.imaging.background import Background
from losbench.parts import Parts, kept_parts
from losbench.recording.effort import Effort, with_effort
from losbench.recording.follow import measured
from losbench.recording.frames.protocol import UnreadableFrame
from losbench.recording.readers import Recording
from losbench.recording.run import Run
from losbench.recording.survey import Survey
from losbench.recording.track import Track
from losbench.spread import spread

__all__ = ["Job", "tracked"]

_BLOCK, _BLOCK_BYTES = 32, 2**27  # frames in memory at a time: so many, or as many as fit


@dataclass(frozen=True, eq=False)
class Job:
    """What is asked of every worker: ``job(first, last)`` measures these frames."""

    recording: Recording
    surveys: tuple[Survey, ...]
    background: Background

    @property
    def block(self) -> int:
        """Frames that are measured together."""
        frames = [stamp.frames for stamp in self.recording.stamps]
        most = max(each.dtype.itemsize * int(np.prod(each.shape)) for each in frames)
        return min(_BLOCK, max(1, _BLOCK_BYTES // most))

    def for_workers(self) -> Job:
        """Return it without what measuring asks nothing of, to be sent."""
        return replace(self, recording=replace(self.recording, times=None, notes=()))

    def __call__(self, first: int, last: int) -> Track:
        """Measure frames ``first`` to ``last`` (excluded), in pixels of the detector."""
        tracks = []
        for stamp, survey in zip(self.recording.stamps, self.surveys, strict=True):
            see = partial(measured, self.recording, stamp, survey, self.background)
            blocks = [see(k, min(k + self.block, last)) for k in range(first, last, self.block)]
            track = Track.one_after_another(blocks)
            tracks.append(replace(track, xy=track.xy + np.array(stamp.origin_px)))
        return Track.side_by_side(tracks)


def tracked(job: Job, run: Run) -> Track:
    """Measure all frames of a recording.

    Raises
    ------
    Exception
        What a chunk raised, with a note that names its frames.
    OSError
        If a part cannot be written; those before it stay.
    ValueError, FileExistsError, BlockingIOError
        If the folder of parts belongs to another run.
    """
    n, chunk = job.recording.n_frames, -(-run.chunk // job.block) * job.block
    chunks = [(first, min(first + chunk, n)) for first in range(0, n, chunk)]
    recipe = _recipe(job, chunk) if run.out is not None else {}
    with (
        kept_parts(run.out, recipe, resume=run.resume) as parts,
        tqdm(total=n, unit="frame", delay=2, disable=not run.progress) as bar,
    ):
        done = {first: track for first, track in _kept(parts, chunks) if track is not None}
        bar.update(sum(len(track.xy) for track in done.values()))
        missing = [each for each in chunks if each[0] not in done]
        work = partial(with_effort, job.for_workers())
        results = spread(work, missing, executor=run.executor, named=_frames_named)
        spent = Effort(0, 0)
        try:
            for (first, last), (track, effort) in zip(missing, results, strict=True):
                _keep(parts, first, track)
                done[first] = track
                spent = spent.and_then(effort)
                bar.set_postfix_str(str(spent), refresh=False)
                bar.update(last - first)
        except UnreadableFrame as error:
            if run.executor is None:
                raise
            # Raised here, by a check: the frames of a worker's pool say nothing of that.
            raise error.with_traceback(None) from error.__cause__
    return Track.one_after_another([done[first] for first, _ in chunks])


def _frames_named(first: int, last: int) -> str:
    return f"frames {first} to {last - 1}"


def _kept(parts: Parts, chunks: list[tuple[int, int]]) -> Iterator[tuple[int, Track | None]]:
    for first, last in chunks:
        held = parts.read(_file(first))
        track = None
        if held is not None and held.keys() == {"xy", "sigma", "flags", "skipped", "why"}:
            why = dict(zip(held.pop("skipped").tolist(), held.pop("why").tolist(), strict=True))
            track = Track(held["xy"], held["sigma"], held["flags"], why)
        yield first, track if track is not None and len(track.xy) == last - first else None


def _keep(parts: Parts, first: int, track: Track) -> None:
    parts.write(
        _file(first),
        {
            "xy": track.xy,
            "sigma": track.sigma,
            "flags": track.flags,
            "skipped": np.array(list(track.skipped), dtype=np.int64),
            "why": np.array(list(track.skipped.values()), dtype=np.str_),
        },
    )


def _file(first: int) -> str:
    return f"part-{first:09d}"


def _recipe(job: Job, chunk: int) -> dict[str, Any]:
    """What parts depend on: a run with another is refused, and told what has changed."""
    recording = job.recording
    method = job.surveys[0].method
    chosen = {each.name: str(getattr(method, each.name)) for each in fields(method)}
    return {
        "source": recording.source.name,
        "frames": recording.n_frames,
        "files": _files(recording),
        "pixels": _digest([stamp.frames for stamp in recording.stamps]),
        "spots": sum(len(survey.start) for survey in job.surveys),
        "centroid": type(method).__name__,
        **chosen,
        "background": str(job.background),
        "detector": str(recording.detector),
        "unreadable": "skip" if recording.skip_unreadable else "stop",
        "survey": _digest(job.surveys),
        "chunk": chunk,
    }


def _files(recording: Recording) -> str:
    """Sizes and times of the files that are read, as far as paths tell."""
    frames = [stamp.frames for stamp in recording.stamps]
    there = sorted(set(_paths(frames)) or set(_paths(recording.source)))
    stats = [path.stat() for path in there]
    each = [(str(path), s.st_size, s.st_mtime_ns) for path, s in zip(there, stats, strict=True)]
    latest = max((s.st_mtime_ns for s in stats), default=0)
    size = sum(s.st_size for s in stats)
    return f"{len(stats)} of {size} bytes, changed {latest}, together {_digest(each)}"


def _paths(thing: Any) -> Iterator[Path]:
    """Files that a record names, or of a folder all."""
    if isinstance(thing, Path):
        yield from filter(Path.is_file, thing.iterdir() if thing.is_dir() else [thing])
    elif isinstance(thing, list | tuple):
        for each in thing:
            yield from _paths(each)
    elif is_dataclass(thing) and not isinstance(thing, type):
        held = {each.name: getattr(thing, each.name) for each in fields(thing)}
        if held.keys() >= {"folder", "names"}:
            yield from _paths([held["folder"] / name for name in held["names"]])
        else:
            yield from _paths(list(held.values()))


def _digest(thing: Any) -> str:
    """A short name for everything that a record holds, arrays to the last bit."""
    found = hashlib.sha256()
    for piece in _pieces(thing):
        found.update(piece)
    return found.hexdigest()[:16]


def _pieces(thing: Any) -> Iterator[bytes | memoryview]:
    if isinstance(thing, np.ndarray):
        array: NDArray[Any] = np.ascontiguousarray(thing)
        yield f"{array.dtype}{array.shape}".encode()
        yield array.reshape(-1).view(np.uint8).data
    elif is_dataclass(thing) and not isinstance(thing, type):
        yield type(thing).__name__.encode()
        for each in fields(thing):
            yield from _pieces(getattr(thing, each.name))
    elif isinstance(thing, list | tuple):
        for each in thing:
            yield from _pieces(each)
    elif not callable(thing):
        yield repr(thing).encode()
