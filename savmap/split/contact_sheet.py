"""The contact sheet: the recording's timeline with its turns, then a line for each pass with three of its pictures."""

import io
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from savmap.errors import OutputError
from savmap.files.atomic import write_bytes
from savmap.split.records import DetectedPass
from savmap.types import Floats
from savmap.video.clip import Image

THUMB_WIDTH = 400
_TEXT_WIDTH = 320
_BAR = 8
_MARKED = {"left": (0.12, 0.38), "right": (0.62, 0.88)}
_GREEN, _AMBER, _INK = (47, 158, 68), (232, 89, 12), (33, 37, 41)


def picture_stamps(detected: DetectedPass) -> tuple[float, float, float]:
    """The times of a pass's pictures: start, middle, end."""
    return detected.start_s, (detected.start_s + detected.end_s) / 2, detected.end_s


def contact_sheet(
    passes: Sequence[DetectedPass], pictures: Sequence[Image], stamps_s: Floats, headings_deg: Floats
) -> Image:
    """RGB picture of the timeline (headings (n,) degrees at times (n,)) above a line for each pass.

    `pictures` are three panoramas a pass, THUMB_WIDTH wide. They are turned so that the direction of travel is in the
    middle; a green bar marks the sides with structure.
    """
    width = _TEXT_WIDTH + 3 * THUMB_WIDTH
    lines = [
        _line(number, detected, pictures[3 * number - 3 : 3 * number])
        for number, detected in enumerate(passes, start=1)
    ]
    return np.vstack([_timeline(passes, stamps_s, headings_deg, width), *lines])


def check_picture(path: Path) -> None:
    """Raise OutputError unless the path ends with .png."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"{path}: the contact sheet is written as .png")


def write_picture(image: Image, path: Path) -> None:
    """Write an RGB picture as PNG, whole or not at all. Raises OutputError."""
    _, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    write_bytes(path, data.tobytes())


def _line(number: int, detected: DetectedPass, pictures: Sequence[Image]) -> Image:
    text = np.full((THUMB_WIDTH // 2 + _BAR, _TEXT_WIDTH, 3), 255, np.uint8)
    color = _INK if detected.confidence >= 0.5 else _AMBER
    lines = [
        f"pass {number}",
        f"{clock(detected.start_s)} to {clock(detected.end_s)}",
        f"heading {detected.heading_deg:+.0f} deg",
        f"structure: {' and '.join(detected.sides) or 'none'}",
        f"confidence {detected.confidence:.2f}",
        *([f"stood {detected.stood_s:.0f} s"] if detected.stood_s >= 1 else []),
    ]
    for row, words in enumerate(lines):
        size = 0.6 if row == 0 else 0.5
        cv2.putText(text, words, (12, 26 + 24 * row), cv2.FONT_HERSHEY_SIMPLEX, size, color, 1, cv2.LINE_AA)
    stamps = picture_stamps(detected)
    thumbs = [_thumb(picture, detected, stamp) for picture, stamp in zip(pictures, stamps, strict=True)]
    return np.hstack([text, *thumbs])


def _thumb(picture: Image, detected: DetectedPass, stamp_s: float) -> Image:
    turned = np.roll(picture, -round(detected.way_deg / 360 * picture.shape[1]), axis=1)
    thumb = np.full((THUMB_WIDTH // 2 + _BAR, THUMB_WIDTH, 3), 255, np.uint8)
    thumb[:-_BAR] = turned
    for side in detected.sides:
        first, last = (round(share * THUMB_WIDTH) for share in _MARKED[side])
        thumb[-_BAR + 2 : -2, first:last] = _GREEN
    cv2.putText(thumb, clock(stamp_s), (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(thumb, clock(stamp_s), (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return thumb


def _timeline(passes: Sequence[DetectedPass], stamps_s: Floats, headings_deg: Floats, width: int) -> Image:
    figure = Figure(figsize=(width / 100, 2.4), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for number, detected in enumerate(passes, start=1):
        color = "#2f9e44" if detected.confidence >= 0.5 else "#e8590c"
        axes.axvspan(detected.start_s / 60, detected.end_s / 60, color=color, alpha=0.25, linewidth=0)
        middle, across = (detected.start_s + detected.end_s) / 120, axes.get_xaxis_transform()
        axes.text(middle, 1.01, str(number), transform=across, ha="center", fontsize=8)
    axes.plot(stamps_s / 60, headings_deg, color="#12355b", linewidth=1.2)
    axes.set_xlabel("minutes")
    axes.set_ylabel("direction of travel, deg")
    axes.grid(color="#e9ecef")
    axes.margins(x=0)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    drawn = cv2.imdecode(np.frombuffer(stream.getvalue(), np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(np.asarray(drawn), cv2.COLOR_BGR2RGB), np.uint8)


def clock(stamp_s: float) -> str:
    """Minutes, seconds and tenths."""
    tenths = round(stamp_s * 10)
    return f"{tenths // 600}:{tenths % 600 / 10:04.1f}"
