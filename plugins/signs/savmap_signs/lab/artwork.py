"""What is printed on a made-up sign: its text, its border and its code, as a picture."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Picture = NDArray[np.uint8]
Code = Literal["none", "qr", "tag36h11"]
Rgb8 = tuple[int, int, int]

PX_A_METRE = 1600
FONTS = ("DejaVuSans-Bold", "DejaVuSans", "DejaVuSansMono-Bold", "DejaVuSerif-Bold", "STIXGeneralBol")


def artwork(
    text: str, size_m: tuple[float, float], paper: Rgb8, ink: Rgb8, font: str, border: bool, code: Code, content: str
) -> Picture:
    """A sign (h, w, 3) sRGB of `size_m` (width, height); `text` may have several lines. A code stands at its right end,
    black on white; `content` is what a QR code says, or the number of a tag."""
    width, height = (max(int(side * PX_A_METRE), 24) for side in size_m)
    picture = Image.new("RGB", (width, height), paper)
    edge = max(int(0.035 * height), 1)
    draw = ImageDraw.Draw(picture)
    if border:
        draw.rectangle((edge, edge, width - 1 - edge, height - 1 - edge), outline=ink, width=edge)
    room = [3 * edge, 3 * edge, width - 3 * edge, height - 3 * edge]
    if code != "none":
        side = room[3] - room[1]
        place = (room[2] - side, room[1]) if text else ((width - side) // 2, room[1])
        picture.paste(Image.fromarray(_code(code, content, side)), place)
        room[2] -= side + 2 * edge
    if text:
        _write(draw, text.split("\n"), room, ink, font)
    return np.asarray(picture, dtype=np.uint8)


def _write(draw: ImageDraw.ImageDraw, lines: Sequence[str], room: Sequence[int], ink: Rgb8, font: str) -> None:
    """Lines of one size, as large as the room (left, top, right, bottom) allows, in its middle."""
    width, height = room[2] - room[0], (room[3] - room[1]) // len(lines)
    sample = _font(font, 100)
    longest = max(sample.getlength(line) for line in lines)
    size = max(int(100 * min(width / longest, height / 118)), 4)
    for number, line in enumerate(lines):
        middle = ((room[0] + room[2]) / 2, room[1] + (number + 0.5) * height)
        draw.text(middle, line, ink, _font(font, size), anchor="mm")


@lru_cache
def _font(name: str, size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{name}.ttf"), size)


def _code(kind: Code, content: str, side: int) -> Picture:
    if kind == "qr":
        cells = np.asarray(cv2.QRCodeEncoder.create().encode(content), np.uint8)
    else:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
        cells = np.pad(cv2.aruco.generateImageMarker(dictionary, int(content), 8), 1, constant_values=255)
    large = cv2.resize(cells, (side, side), interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.cvtColor(large, cv2.COLOR_GRAY2RGB), np.uint8)
