"""A folder of pictures taken as a video."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from savmap.errors import VideoError
from savmap.io.clip import DecodeReport, Image, Picture, Source, VideoInfo, check_shape

SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"}
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"


def picture_paths(folder: Path) -> list[Path]:
    """The folder's pictures, sorted by name."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())


def probe_folder(folder: Path, fps: float) -> VideoInfo:
    """Size of the first readable picture, and the length the folder has at `fps`. VideoError: none, or not 2:1."""
    paths = picture_paths(folder)
    if not paths:
        raise VideoError(f"{folder}: the folder holds no pictures ({', '.join(sorted(SUFFIXES))})")
    image = next((image for path in paths if (image := read_picture(path)) is not None), None)
    if image is None:
        raise VideoError(f"{folder}: none of the {len(paths)} pictures can be read")
    height, width = image.shape[:2]
    check_shape(folder, width, height)
    return VideoInfo(folder, width, height, "images", "rgb24", fps, len(paths) / fps)


def read_picture(path: Path) -> Image | None:
    """RGB picture (H, W, 3), or None where the file is damaged."""
    data = path.read_bytes()
    if not data or (data.startswith(JPEG_START) and JPEG_END not in data[-1024:]):
        return None
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    return None if bgr is None else np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def read_folder(info: VideoInfo, start_s: float, end_s: float, report: DecodeReport) -> Source:
    """The pictures from start_s up to end_s; those unreadable or of another size are counted when asked for."""
    for index, path in enumerate(picture_paths(info.path)):
        stamp = index / info.rate_fps
        if start_s - 1e-6 <= stamp < end_s - 1e-6:
            yield stamp, _reader(path, info, report)


def read_at(info: VideoInfo, stamps_s: list[float]) -> list[tuple[float, Picture]]:
    """The first good picture at or after each time (ascending)."""
    found: list[tuple[float, Picture]] = []
    for wanted in stamps_s:
        frames = read_folder(info, wanted, np.inf, DecodeReport())
        found.extend(next(([(stamp, image)] for stamp, read in frames if (image := read()) is not None), []))
    return found


def _reader(path: Path, info: VideoInfo, report: DecodeReport) -> Callable[[], Image | None]:
    def read() -> Image | None:
        image = read_picture(path)
        if image is None or image.shape != (info.height, info.width, 3):
            report.skipped += 1
            return None
        report.decoded += 1
        return image

    return read
