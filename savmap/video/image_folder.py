"""Folders of pictures as videos, and single pictures read and written."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Pillow

from savmap.errors import VideoError
from savmap.files.atomic import write_bytes
from savmap.video.clip import DecodeReport, Image, Picture, Source, VideoInfo, require_memory

SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"}
JPEG_START, JPEG_SCAN, JPEG_END = b"\xff\xd8", b"\xff\xda", b"\xff\xd9"
ORIENTATION, LYING = 0x0112, range(5, 9)
"""The tag of EXIF, and its values that exchange width and height."""
MOST_BYTES, HEADER_BYTES = 16, 1 << 24


def picture_paths(folder: Path) -> list[Path]:
    """The folder's pictures, sorted by name."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())


def probe_folder(folder: Path, fps: float) -> VideoInfo:
    """Size of the first sound picture, and the length of the folder at `fps`. Raises VideoError for no pictures."""
    paths = picture_paths(folder)
    if not paths:
        raise VideoError(f"{folder}: the folder holds no pictures ({', '.join(sorted(SUFFIXES))})")
    size = next((size for path in paths if (size := picture_size(path)) is not None), None)
    if size is None:
        raise VideoError(f"{folder}: none of the {len(paths)} pictures can be read: they are damaged, or far too large")
    return VideoInfo(folder, *size, "images", "rgb24", fps, len(paths) / fps)


def picture_size(path: Path) -> tuple[int, int] | None:
    """Width and height of a picture as it is to be shown, turned as its EXIF data say; None where its header, or a
    PNG's check sum, is damaged."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Pillow.open(path) as picture:
                width, height = picture.size  # of a TIFF, Pillow has turned it already
                exif = Pillow.Exif()
                exif.load(picture.info.get("exif", b""))
                picture.verify()
                return (height, width) if exif.get(ORIENTATION) in LYING else (width, height)
    except Exception:  # Pillow's readers raise errors of many types for damaged headers
        return None


def read_picture(path: Path, size: tuple[int, int]) -> Image | None:
    """RGB picture (H, W, 3), turned as its EXIF data say, or None where the file is damaged or not of this width and
    height."""
    if picture_size(path) != size or path.stat().st_size > MOST_BYTES * size[0] * size[1] + HEADER_BYTES:
        return None
    try:
        data = path.read_bytes()
        if data.startswith(JPEG_START) and is_cut_off(data):
            return None
        with _silent_opencv():
            bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except (cv2.error, OSError):
        return None
    return None if bgr is None else np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def is_cut_off(jpeg: bytes) -> bool:
    """Whether a JPEG's pixels lack the marker of their end, whatever a camera wrote behind it. It cannot stand within
    them, but does in previews, which are segments before them (ITU-T T.81, annex B)."""
    at = len(JPEG_START)
    while jpeg[at : at + 1] == JPEG_START[:1] and jpeg[at : at + 2] != JPEG_SCAN:
        at += 1 if jpeg[at + 1 : at + 2] == JPEG_START[:1] else 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
    return jpeg.find(JPEG_END, at) < 0


@contextmanager
def _silent_opencv() -> Iterator[None]:
    """Without OpenCV's messages about damaged pictures."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def write_picture(path: Path, bgr: Image, flags: Sequence[int] = ()) -> None:
    """Write a picture (H, W, 3) BGR or (H, W), whole or not at all, as its suffix says. Raises OutputError."""
    write_bytes(path, cv2.imencode(path.suffix, bgr, list(flags))[1].tobytes())


def read_folder(info: VideoInfo, start_s: float, end_s: float, report: DecodeReport) -> Source:
    """The pictures from start_s up to end_s; unreadable ones and those of another size are counted when they are
    read."""
    for index, path in enumerate(picture_paths(info.path)):
        stamp = index / info.rate_fps
        if start_s - 1e-6 <= stamp < end_s - 1e-6:
            report.whole_until_s = report.whole_until_s if report.skipped else stamp
            yield stamp, partial(_read, path, info, report)


def read_at(info: VideoInfo, stamps_s: list[float]) -> Iterator[tuple[float, Picture]]:
    """The first good picture at or after each time (ascending)."""
    for wanted in stamps_s:
        frames = read_folder(info, wanted, np.inf, DecodeReport())
        yield from next(([(stamp, image)] for stamp, read in frames if (image := read()) is not None), [])


def _read(path: Path, info: VideoInfo, report: DecodeReport) -> Image | None:
    image = read_picture(path, (info.width, info.height))
    is_good = image is not None and image.shape == (info.height, info.width, 3)
    report.decoded += is_good
    report.skipped += not is_good
    if not is_good:
        require_memory(info.width, info.height)
    return image if is_good else None
