"""The contact sheet: the recording's timeline with its turns, then a line for each pass with three of its pictures."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from savmap.apps.split.records import DetectedPass
from savmap.errors import OutputError
from savmap.types import Floats
from savmap.video.clip import Image

THUMB_WIDTH = 400
_TEXT_WIDTH, _TIMELINE_HEIGHT, _LINE_HEIGHT = 320, 240, 208
_MARKED = {"left": (0.12, 0.38), "right": (0.62, 0.88)}
_GREEN, _AMBER, _INK, _GRID, _BLUE = "#2f9e44", "#e8590c", "#212529", "#e9ecef", "#12355b"


def picture_stamps(detected: DetectedPass) -> tuple[float, float, float]:
    """The times of a pass's pictures: start, middle, end."""
    return detected.start_s, (detected.start_s + detected.end_s) / 2, detected.end_s


def contact_sheet(
    passes: Sequence[DetectedPass], pictures: Sequence[Image], stamps_s: Floats, headings_deg: Floats
) -> bytes:
    """PNG file of the timeline (headings (n,) degrees at times (n,)) above a line for each pass.

    `pictures` are three panoramas a pass, THUMB_WIDTH wide. They are turned so that the direction of travel is in the
    middle; a green bar marks the sides with structure.
    """
    width, height = _TEXT_WIDTH + 3 * THUMB_WIDTH, _TIMELINE_HEIGHT + _LINE_HEIGHT * len(passes)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)

    def area(left: int, top: int, wide: int, high: int) -> Axes:
        return figure.add_axes((left / width, 1 - (top + high) / height, wide / width, high / height))

    timeline = area(80, 24, width - 100, _TIMELINE_HEIGHT - 74)
    timeline.plot(stamps_s / 60, headings_deg, color=_BLUE, linewidth=1.2)
    timeline.set(xlabel="minutes", ylabel="direction of travel, deg")
    timeline.grid(color=_GRID)
    timeline.margins(x=0)
    for number, detected in enumerate(passes):
        color = _GREEN if detected.confidence >= 0.5 else _AMBER
        timeline.axvspan(detected.start_s / 60, detected.end_s / 60, color=color, alpha=0.25, linewidth=0)
        middle, across = (detected.start_s + detected.end_s) / 120, timeline.get_xaxis_transform()
        timeline.text(middle, 1.01, str(number + 1), transform=across, ha="center", fontsize=8)
        top = _TIMELINE_HEIGHT + _LINE_HEIGHT * number
        words, ink = _words(number + 1, detected), _INK if detected.confidence >= 0.5 else _AMBER
        figure.text(12 / width, 1 - (top + 12) / height, words, va="top", color=ink, fontsize=11, linespacing=1.5)
        for k, stamp_s in enumerate(picture_stamps(detected)):
            thumb = area(_TEXT_WIDTH + k * THUMB_WIDTH, top, THUMB_WIDTH, THUMB_WIDTH // 2)
            picture = pictures[3 * number + k]
            thumb.imshow(np.roll(picture, -round(detected.way_deg / 360 * picture.shape[1]), axis=1), aspect="auto")
            thumb.axis("off")
            outline = [withStroke(linewidth=3, foreground="black")]
            thumb.text(6, 16, clock(stamp_s), color="white", fontsize=9, path_effects=outline)
            for side in detected.sides:
                first, last = (share * THUMB_WIDTH for share in _MARKED[side])
                thumb.plot((first, last), (THUMB_WIDTH / 2 + 4,) * 2, color=_GREEN, linewidth=3, clip_on=False)
            thumb.set(xlim=(0, THUMB_WIDTH), ylim=(THUMB_WIDTH / 2, 0))
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def check_picture(path: Path) -> None:
    """Raise OutputError unless the path ends with .png."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"{path}: the contact sheet is written as .png")


def _words(number: int, detected: DetectedPass) -> str:
    stood = [f"stood {detected.stood_s:.0f} s"] if detected.stood_s >= 1 else []
    return "\n".join(
        [
            f"pass {number}",
            f"{clock(detected.start_s)} to {clock(detected.end_s)}",
            f"heading {detected.heading_deg:+.0f} deg",
            f"structure: {' and '.join(detected.sides) or 'none'}",
            f"confidence {detected.confidence:.2f}",
            *stood,
        ]
    )


def clock(stamp_s: float) -> str:
    """Minutes, seconds and tenths."""
    tenths = round(stamp_s * 10)
    return f"{tenths // 600}:{tenths % 600 / 10:04.1f}"
