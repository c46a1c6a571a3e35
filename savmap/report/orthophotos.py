"""Orthophotos with the wireframe over them: a figure of the page, and an SVG file that shows the JPEG beside it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np
from markupsafe import Markup

from savmap.files.atomic import write_text
from savmap.report.row_views import drawn_in, layers
from savmap.report.scene import MM, Backdrop, Figure, Label, Layer
from savmap.report.templating import jpeg_address, rendered, resource
from savmap.types import Drawing, Floats, Orthophoto

MOST_BYTES = 130_000
"""Of a picture on the page: a report of many rows can still be sent by mail."""
MOST_WIDTH, SMALLER, JPEG_QUALITY = 1600, 0.8, 75
TENTHS = 10.0
"""Outlines are drawn to a tenth of a pixel."""


def photo_view(
    row: str,
    photo: Orthophoto,
    drawings: Sequence[Drawing],
    hints: Mapping[str, str] | None = None,
    anchor: str = "row",
) -> Figure:
    """A row's orthophoto, scaled down, in millimetres of its face, and the outlines of what is mapped."""
    left, bottom = MM * float(photo.origin @ photo.right), MM * float(photo.origin @ photo.up)
    pixel = MM * photo.pixel_m
    width, height = round(pixel * photo.width), round(pixel * photo.height)
    frame = (round(left), round(-bottom) - height, width, height)

    def projection(points: Floats) -> Floats:
        flat: Floats = pixel * photo.on_picture(points) + np.array([frame[0], frame[1]])
        return flat

    shown = mapped_in(drawings)
    return Figure(
        id=f"{anchor}-photo",
        title=f"Row {row}: orthophoto",
        description=(
            "The face of the row as all frames show it, without perspective, "
            f"{width / MM:.1f} m by {height / MM:.1f} m."
        ),
        frame=frame,
        layers=_over_photo(layers(shown, hints or {}, projection)),
        axes=("x", "y", -1),
        note=f"{MM * photo.pixel_m:g} mm a pixel in the file, fewer here",
        backdrop=Backdrop(jpeg_address(scaled_down(photo)), frame),
    )


def write_overlay(row: str, photo: Orthophoto, drawings: Sequence[Drawing], picture: Path, path: Path) -> None:
    """Write an SVG of the size of a row's orthophoto, which lies beside it as `picture`, with outlines and names of
    what is mapped, whole or not at all. Raises OutputError."""
    write_text(path, overlay_text(row, photo, drawings, picture.name))


def overlay_text(row: str, photo: Orthophoto, drawings: Sequence[Drawing], picture: str) -> str:
    """The SVG."""

    def projection(points: Floats) -> Floats:
        flat: Floats = TENTHS * photo.on_picture(points)
        return flat

    shown = mapped_in(drawings)
    frame = (0, 0, round(TENTHS * photo.width), round(TENTHS * photo.height))
    figure = Figure(
        id="face",
        title=f"Row {row}: orthophoto",
        description="",
        frame=frame,
        layers=_over_photo(layers(shown, {}, projection)),
        labels=tuple(_names(shown, projection)),
        backdrop=Backdrop(quote(picture), frame),
    )
    style = Markup(f":root {{ --u: {TENTHS:g}; }}\n" + resource("figure.css"))
    return rendered("overlay.svg.jinja", figure=figure, style=style, size=(photo.width, photo.height))


def mapped_in(drawings: Sequence[Drawing]) -> list[Drawing]:
    """What of a row's drawings lies in its face: the structure as it was mapped."""
    return [
        drawing for drawing in drawn_in(drawings, "face") if drawing.tone == "structure" and drawing.role != "survey"
    ]


def scaled_down(photo: Orthophoto) -> bytes:
    """The picture as a JPEG of at most `MOST_BYTES`."""
    image = np.asarray(cv2.imdecode(photo.picture, cv2.IMREAD_COLOR), np.uint8)
    scale = min(1.0, MOST_WIDTH / photo.width)
    while True:
        size = max(round(scale * photo.width), 1), max(round(scale * photo.height), 1)
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
        if len(content) <= MOST_BYTES or min(size) == 1:
            return content
        scale *= SMALLER


def _over_photo(drawn: Sequence[Layer]) -> tuple[Layer, ...]:
    return tuple(replace(layer, style=f"{layer.style} photo") for layer in drawn)


def _names(drawings: Sequence[Drawing], projection: Callable[[Floats], Floats]) -> list[Label]:
    """The name of each drawing at its upper left corner, inside; a caption, which is short, at its foot."""
    labels = []
    for drawing in drawings:
        points = projection(drawing.points)
        (left, top), bottom = points.min(axis=0), points[:, 1].max()
        if drawing.caption:
            labels.append(Label(round(points[:, 0].mean()), round(bottom), drawing.caption, "on-photo middle", dy=-0.5))
        elif drawing.name:
            labels.append(Label(round(left), round(top), drawing.name, "on-photo", dx=0.3, dy=1.1))
    return labels
