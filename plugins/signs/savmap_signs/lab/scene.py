"""Signs for the simulator: plates with a text, a code or both, on racks and over the aisle, with their survey."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from savmap.lab.scenes import Box, Face, Material, Rgb, RowFrame, SceneError, SceneParts, Site, Strict, validated
from savmap.types import Floats
from savmap_signs.lab.artwork import Code, artwork

Facing = Literal["+z", "+x", "-x", "x"]
THICK_M = 0.004
CORNERS = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])


class Plate(Strict):
    """A plate of `size` (width, height) around `at` (x, y, z) of its row's frame, m. It faces out of the face (+z),
    along the aisle (+x, -x), or both ways along it (x). `content` of a code; a QR code says the text where it is
    empty."""

    row: str = "A"
    at: tuple[float, float, float]
    size: tuple[float, float] = (0.3, 0.15)
    text: str = ""
    code: Code = "none"
    content: str = ""
    facing: Facing = "+z"
    bay: int | None = None
    paper: Rgb = (0.85, 0.85, 0.82)
    ink: Rgb = (0.02, 0.02, 0.02)
    font: str = "DejaVuSans-Bold"
    border: bool = False
    hung: bool = False


class Plates(Strict):
    """The section of a scene file."""

    plates: tuple[Plate, ...] = Field(default=())


def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
    """The boxes of all plates and, for each mapped row, what a surveyor would write down of them. Raises SceneError for
    a row that the scene does not place."""
    plates = validated(Plates, section, "structures.signs").plates
    for plate in plates:
        if plate.row not in site.frames:
            raise SceneError(f"structures.signs: `rows` does not place a row {plate.row}")
    boxes = [box for plate in plates for box in _boxes(plate, site)]
    mapped = {name: frame for name, frame in site.frames.items() if frame.mapped}
    return SceneParts(boxes, {name: {"signs": _survey(plates, name, site)} for name in mapped})


def sides(plate: Plate) -> tuple[Face, ...]:
    """The faces of a plate that carry its print."""
    both: tuple[Face, ...] = ("-x", "+x")
    return both if plate.facing == "x" else (plate.facing,)


def corners(plate: Plate, face: Face) -> Floats:
    """The corners (4, 3) of a printed face, from the upper left one clockwise as one reads it, in the row's frame."""
    normal = {"+z": (0.0, 0.0, 1.0), "+x": (1.0, 0.0, 0.0), "-x": (-1.0, 0.0, 0.0)}[face]
    right = np.cross([0.0, 1.0, 0.0], normal)
    middle = np.array(plate.at) + THICK_M / 2 * np.array(normal)
    spread = CORNERS * np.array(plate.size)
    printed: Floats = middle + spread[:, :1] * right + spread[:, 1:] * np.array([0.0, 1.0, 0.0])
    return printed


def _boxes(plate: Plate, site: Site) -> Iterator[Box]:
    frame = site.frames[plate.row]
    width, height = plate.size
    size = np.array([width, height, THICK_M] if plate.facing == "+z" else [THICK_M, height, width])
    picture = artwork(
        plate.text,
        plate.size,
        shown(plate.paper),
        shown(plate.ink),
        plate.font,
        plate.border,
        plate.code,
        plate.content or plate.text,
    )
    yield Box(
        frame.to_world(np.array(plate.at)),
        size,
        Material(plate.paper),
        frame.world_from_row,
        dict.fromkeys(sides(plate), "sign") if frame.mapped else {},
        dict.fromkeys(sides(plate), picture),
    )
    if plate.hung:
        yield from _rods(plate, frame, site.hall.height)


def _rods(plate: Plate, frame: RowFrame, ceiling: float) -> Iterator[Box]:
    top = plate.at[1] + plate.size[1] / 2
    across = np.array([1.0, 0, 0] if plate.facing == "+z" else [0, 0, 1.0])
    for share in (-0.4, 0.4):
        middle = np.array(plate.at) + share * plate.size[0] * across
        middle[1] = (top + ceiling) / 2
        yield Box(frame.to_world(middle), np.array([0.008, ceiling - top, 0.008]), Material((0.3, 0.3, 0.3)))


def _survey(plates: tuple[Plate, ...], row: str, site: Site) -> list[dict[str, Any]]:
    """Signs of a row, and those that hang over the aisle before it, in the row's frame."""
    entries = []
    for plate in plates:
        if plate.row != row and not plate.hung:
            continue
        for face in sides(plate):
            world = site.frames[plate.row].to_world(corners(plate, face))
            entry: dict[str, Any] = {"corners": site.frames[row].to_row(world).round(6).tolist(), "text": plate.text}
            entry |= {"code": plate.content or plate.text} if plate.code != "none" else {}
            entry |= {"bay": plate.bay} if plate.bay is not None and plate.row == row else {}
            entries.append(entry)
    return entries


def shown(color: Rgb) -> tuple[int, int, int]:
    """Linear RGB 0..1 as sRGB 0..255."""
    linear = np.clip(np.array(color), 0, 1)
    encoded = np.where(linear < 0.0031, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    red, green, blue = np.round(255 * encoded).astype(int).tolist()
    return red, green, blue
