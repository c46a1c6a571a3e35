"""Orthophotos as files: a JPEG that says in its comment where it lies, and the same beside it as JSON, as a world file,
and as GDAL has it."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from pydantic import BaseModel, ConfigDict, PositiveFloat, PositiveInt

from savmap.errors import OutputError, visible
from savmap.files.atomic import file_name, read_json, reason, write_bytes, write_text
from savmap.files.validation import checked
from savmap.types import Orthophoto

Triple = tuple[float, float, float]
COMMENT = b"\xff\xfe"


class OrthophotoFile(BaseModel):
    """Where a row's orthophoto lies: the lower left corner of the picture `origin_m` and the unit vectors along its
    sides in the row's frame, and the transform from (column, row, 1), whole at pixels' centres, to metres right of the
    corner, above it, and 1."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["savmap-orthophoto"] = "savmap-orthophoto"
    version: Literal[1] = 1
    row: str
    picture: str
    width: PositiveInt
    height: PositiveInt
    mm_per_pixel: PositiveFloat
    origin_m: Triple
    right: Triple
    up: Triple
    face_from_pixel: tuple[Triple, Triple, Triple]


def orthophoto_files(row: str, folder: Path) -> tuple[Path, Path, Path, Path]:
    """The names of a row's picture and of what is said of it: as JSON, as a world file, and as GDAL has it."""
    picture = folder / f"face-{file_name(row)}.jpg"
    return (
        picture,
        picture.with_suffix(".json"),
        picture.with_suffix(".jgw"),
        picture.with_name(f"{picture.name}.aux.xml"),
    )


def write_orthophoto(row: str, photo: Orthophoto, folder: Path) -> Path:
    """Write a row's orthophoto and what is said of it; the picture's path. Raises OutputError."""
    picture, said, world, gdal = orthophoto_files(row, folder)
    text = _said(row, photo, picture.name).model_dump_json()
    ascii_text = json.dumps(json.loads(text))
    write_bytes(picture, with_comment(photo.picture.tobytes(), ascii_text.encode()))
    write_text(said, json.dumps(json.loads(text), indent=1, ensure_ascii=False) + "\n")
    write_text(world, world_file(photo))
    write_text(gdal, gdal_text(row, photo))
    return picture


def read_orthophotos(rows: Iterable[str], folder: Path) -> dict[str, Orthophoto]:
    """The orthophotos in a folder of those rows that have one there. Raises OutputError for one that cannot be read."""
    photos = {}
    for row in rows:
        picture, said, *_ = orthophoto_files(row, folder)
        if picture.is_file() and said.is_file():
            photos[row] = _read(picture, said)
    return photos


def world_file(photo: Orthophoto) -> str:
    """The picture in its face's plane, as a world file: metres along `right` and `up`, counted from the row's origin,
    of a pixel's sides and of the upper left pixel's centre."""
    left, top = _upper_left(photo)
    half = photo.pixel_m / 2
    numbers = (photo.pixel_m, 0.0, 0.0, -photo.pixel_m, left + half, top - half)
    return "".join(f"{number:.9f}\n" for number in numbers)


def gdal_text(row: str, photo: Orthophoto) -> str:
    """The same for GDAL (`.aux.xml`): a local plane in metres, which is no place on Earth, the picture in it, and
    what the plane is."""
    left, top = _upper_left(photo)
    dataset = Element("PAMDataset")
    plane = f"row {visible(row)}, plane of its face"
    quoted = plane.replace('"', "'")
    SubElement(dataset, "SRS").text = f'LOCAL_CS["{quoted}",UNIT["metre",1],AXIS["right",EAST],AXIS["up",NORTH]]'
    numbers = (left, photo.pixel_m, 0.0, top, 0.0, -photo.pixel_m)
    SubElement(dataset, "GeoTransform").text = ", ".join(f"{number:.9f}" for number in numbers)
    metadata = SubElement(dataset, "Metadata")
    said = {"row": visible(row), "origin_m": photo.origin, "right": photo.right, "up": photo.up}
    for key, value in said.items():
        text = value if isinstance(value, str) else " ".join(f"{number:.9f}" for number in value)
        SubElement(metadata, "MDI", key=f"savmap_{key}").text = text
    indent(dataset)
    return tostring(dataset, encoding="unicode") + "\n"


def _upper_left(photo: Orthophoto) -> tuple[float, float]:
    """The picture's upper left corner in the plane of its face: metres along `right` and `up` from the row's origin."""
    left, bottom = float(photo.origin @ photo.right), float(photo.origin @ photo.up)
    return left, bottom + photo.height * photo.pixel_m


def with_comment(jpeg: bytes, comment: bytes) -> bytes:
    """A JPEG with a comment (a segment COM after its start)."""
    return jpeg[:2] + COMMENT + (len(comment) + 2).to_bytes(2, "big") + comment + jpeg[2:]


def _said(row: str, photo: Orthophoto, name: str) -> OrthophotoFile:
    vectors = {"origin_m": photo.origin, "right": photo.right, "up": photo.up, "face_from_pixel": photo.face_from_pixel}
    numbers = {key: (np.round(np.asarray(value, np.float64), 9) + 0.0).tolist() for key, value in vectors.items()}
    size = {"width": photo.width, "height": photo.height, "mm_per_pixel": round(1000 * photo.pixel_m, 6)}
    return OrthophotoFile.model_validate({"row": row, "picture": name, **size, **numbers})


def _read(picture: Path, said: Path) -> Orthophoto:
    file = checked(OrthophotoFile, read_json(said), str(said))
    try:
        content = np.frombuffer(picture.read_bytes(), np.uint8)
    except OSError as error:
        raise OutputError(f"{picture}: cannot be read ({reason(error)})") from error
    origin, right, up = (np.array(values) for values in (file.origin_m, file.right, file.up))
    return Orthophoto(origin, right, up, file.mm_per_pixel / 1000, file.width, file.height, content)
