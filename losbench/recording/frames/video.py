"""Video by OpenCV, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from losbench.recording.frames.handles import opened, quiet_opencv
from losbench.recording.frames.protocol import Found, UnreadableFrame, decoding, fits_in

__all__ = ["VIDEO", "VideoFrames", "open_video"]

VIDEO = (".avi", ".mp4", ".m4v", ".mov", ".mkv", ".mj2", ".mpg", ".mpeg", ".webm", ".wmv")
_LIKE_GREY = 2  # DN by which lossy colours of a grey image may differ


@dataclass(frozen=True)
class VideoFrames:
    """Frames of a video file."""

    path: Path
    n_frames: int

    def frame(self, k: int) -> NDArray[Any]:
        """Return one frame, (rows, cols, 3) as red, green, blue."""
        import cv2

        label = self.label(k)
        with decoding(label), quiet_opencv():
            video = opened(_video, self.path)
            if round(video.get(cv2.CAP_PROP_POS_FRAMES)) != k:
                video.set(cv2.CAP_PROP_POS_FRAMES, k)
            there, image = video.read()
        if not there:
            raise UnreadableFrame(f"{label} cannot be read: the video is damaged, or ends before")
        return image if image.ndim == 2 else image[..., ::-1]

    def label(self, k: int) -> str:
        """Return the name of a frame."""
        return f"frame {k} of {self.path.name}"


def open_video(path: Path) -> Found:
    """Return the frames of a video; its rate gives their times."""
    import cv2

    with decoding(path.name), quiet_opencv():
        video = opened(_video, path)
        if not video.isOpened():
            raise UnreadableFrame(f"{path.name} cannot be read: not a video, or none of OpenCV's")
        size = [video.get(of) for of in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
        fits_in(path.name, int(size[0] * size[1] * 3), path.stat().st_size)
        rate = float(video.get(cv2.CAP_PROP_FPS))
        n_frames = _count(video, path)
    if not n_frames:
        raise UnreadableFrame(f"{path.name} cannot be read: no frame of it can be decoded")
    timed = np.isfinite(rate) and 0 < rate < 1e6
    said = f"Times come from the rate of {path.name}, {rate:g} frames a second."
    return Found(
        name=path.name,
        source=VideoFrames(path, n_frames),
        time_s=np.arange(n_frames) / rate if timed else None,
        like_grey=_LIKE_GREY,
        notes=(said,) if timed else (),
    )


def _count(video: Any, path: Path) -> int:
    """Count the frames that are there: what a container says may be a guess from its length."""
    import cv2

    said = int(min(max(video.get(cv2.CAP_PROP_FRAME_COUNT), 0), 2**31))
    if 0 < said <= path.stat().st_size:
        video.set(cv2.CAP_PROP_POS_FRAMES, said - 1)
        last = video.grab() and not video.grab()
        video.set(cv2.CAP_PROP_POS_FRAMES, 0)
        if last:
            return said
    count = 0
    video.set(cv2.CAP_PROP_POS_FRAMES, 0)
    while video.grab():
        count += 1
    video.set(cv2.CAP_PROP_POS_FRAMES, 0)
    return count


def _video(path: Path) -> Any:
    import cv2

    return cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
