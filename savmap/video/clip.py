"""Records of footage: a part of a video, what a file holds, and how its decoding went."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from savmap.errors import VideoError
from savmap.files.urls import is_url
from savmap.geometry.cameras import Camera
from savmap.types import Planes

Image = NDArray[np.uint8]
Picture = Image | Planes
Source = Iterator[tuple[float, Callable[[], Picture | None]]]
"""Frames in order: the time in the video, and a function that returns the picture, or None if it is damaged."""

USUAL_FPS, IMAGES_FPS = 15.0, 30.0
"""The rate at which frames are sampled, and that at which a folder's pictures count as filmed."""
END_TOLERANCE_S = 0.5
SPARE = 4
"""Pictures for which there is memory still where one is damaged."""
MOST_WIDTH = 16384
MOST_PIXELS = MOST_WIDTH * (MOST_WIDTH // 2 + 64)


class CameraSource(Protocol):
    """Tells which camera took pictures of a size."""

    def camera(self, width: int, height: int) -> Camera:
        """The camera. Raises SiteError where pictures of this size cannot be its."""


@dataclass(frozen=True)
class Clip:
    """One pass: a video file or a folder of pictures (sorted by name, `images_fps` a second), the part of it from
    `start_s` up to `end_s` (None: its beginning, its end), the rate `fps` at which frames are sampled, and what
    tells the camera (None: of whole panoramas)."""

    path: Path
    start_s: float | None = None
    end_s: float | None = None
    fps: float = USUAL_FPS
    images_fps: float = IMAGES_FPS
    camera: CameraSource | None = None

    def __post_init__(self) -> None:
        if self.fps <= 0 or self.images_fps <= 0:
            raise VideoError(f"{self.path}: the rate must be above 0 frames a second")


def is_folder(path: Path) -> bool:
    """Whether footage is a folder of pictures on this machine."""
    return not is_url(path) and path.is_dir()


def too_few(clip: Clip, frames: int, what: str) -> str:
    """What to say of so many frames, with what else is to be known of a folder of pictures."""
    text = f"{clip.path}: {frames} frames in the range of {what} are too few to map from"
    if not is_folder(clip.path) or clip.fps >= clip.images_fps:
        return text
    return (
        f"{text}; a folder's pictures count as {clip.images_fps:g} a second: `fps: {clip.images_fps:g}` takes them all"
    )


@dataclass(frozen=True)
class VideoInfo:
    """What the header of a file says. `codec` is "images" for a folder."""

    path: Path
    width: int
    height: int
    codec: str
    pixel_format: str
    rate_fps: float
    duration_s: float


@dataclass
class DecodeReport:
    """Running count of one pass's frames: decoded within the range, skipped because damaged, lost or out of order
    (known when the pass has ended), used (sampled); the seconds of the range that the file turned out not to hold, and
    the longest time without a frame where it is longer than the sampling explains (else 0). `decoded_by`: how many
    frames were decoded when each of those used was. `whole_until_s`: up to where no frame was lost."""

    decoded: int = 0
    skipped: int = 0
    used: int = 0
    short_s: float = 0.0
    gap_s: float = 0.0
    decoded_by: list[int] = field(default_factory=list)
    whole_until_s: float = -np.inf

    @property
    def complete(self) -> bool:
        """Whether nothing of the range was lost."""
        return not (self.skipped or self.short_s or self.gap_s)

    def text(self) -> str:
        """One line for the log."""
        line = f"{self.decoded} frames decoded, {self.skipped} damaged frames skipped, {self.used} used"
        gap = f"; no frame for {self.gap_s:.1f} s" if self.gap_s > 0 else ""
        return line + gap + (f"; the file ends {self.short_s:.1f} s early" if self.short_s > 0 else "")


def require_memory(width: int, height: int) -> None:
    """Raise MemoryError where there is too little for a few pictures: FFmpeg and OpenCV call that damage, too."""
    np.empty((SPARE, height, width, 3), np.uint8)


def check_shape(path: Path | str, width: int, height: int, panoramic: bool = True) -> None:
    """Raise VideoError where a picture is too large to be held in memory many times, or one of a panoramic camera not
    twice as wide as high."""
    if not width or not height:
        raise VideoError(f"{path}: its pictures have no size: the file is damaged, or they are far too large")
    if panoramic and (width != 2 * height or height < 2):
        raise VideoError(
            f"{path}: pictures are {width}x{height}, not 2:1; give an equirectangular panoramic video, or name the "
            "camera for `savmap map` (docs/video.md, Other cameras)"
        )
    if width > MOST_WIDTH:
        raise VideoError(f"{path}: pictures are {width}x{height}; at most {MOST_WIDTH}x{MOST_WIDTH // 2} are read")


def usual_gap_s(rate_fps: float) -> float:
    """The longest time without a frame that sampling at this rate explains."""
    return 0.2 + 3 / rate_fps


def missing_s(last_s: float, end_s: float, rate_fps: float) -> float:
    """How much earlier than a range a file ends whose last frame was found at `last_s`; 0 where sampling explains
    it."""
    return end_s - last_s if end_s - last_s > usual_gap_s(rate_fps) else 0.0


def time_range(clip: Clip, duration_s: float) -> tuple[float, float]:
    """Start and end (s) of a clip in a video of this length. Raises VideoError where they lie outside it."""
    start = 0.0 if clip.start_s is None else clip.start_s
    end = duration_s if clip.end_s is None else clip.end_s
    if start < 0 or start >= duration_s or end > duration_s + END_TOLERANCE_S:
        raise VideoError(f"{clip.path}: {start:g} s to {end:g} s is outside the video, {duration_s:.2f} s long")
    if end <= start:
        raise VideoError(f"{clip.path}: the time range ends at {end:g} s, before its start at {start:g} s")
    return start, (np.inf if clip.end_s is None else end)
