"""Sets of COCO instances, as CVAT, Label Studio, Roboflow and `savmap label` write them.

Run-length masks are read here, not by pycocotools: where runs end before the picture does, that leaves memory as it
was.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from savmap.errors import OutputError
from savmap.lab.train.data.dataset import NO_MAPPING, Dataset, require_classes
from savmap.lab.train.data.shapes import (
    Region,
    checked,
    home_of,
    picture_file,
    polygon_of,
    require_pictures,
    sample_in,
    values_of,
)

RENDERER = "labelled (COCO)"
_BITS, _MORE, _NEGATIVE = 0x1F, 0x20, 0x10
_FIRST_CHARACTER = 48


class Picture(BaseModel):
    """An entry of `images`."""

    id: int
    file_name: str
    width: int
    height: int


class Runs(BaseModel):
    """A run-length mask; size is height and width."""

    counts: list[int] | str
    size: tuple[int, int]


class Annotation(BaseModel):
    """An entry of `annotations`."""

    image_id: int
    category_id: int
    segmentation: list[list[float]] | Runs | None = None


class Category(BaseModel):
    """An entry of `categories`."""

    id: int
    name: str


class Coco(BaseModel):
    """The entries of the file that are read; others are ignored."""

    images: list[Picture]
    annotations: list[Annotation]
    categories: list[Category]


def read_coco(path: Path, content: object, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """The set that a JSON file (`content`, as parsed) describes. Raises OutputError with one line for what is wrong
    with it."""
    coco = checked(Coco, path, content)
    require_pictures(path, len(coco.images))
    theirs = [mapping.get(category.name, category.name) for category in coco.categories]
    require_classes(path, theirs, classes)
    values = dict(zip((category.id for category in coco.categories), values_of(theirs, classes), strict=True))
    pictures = {picture.id: picture for picture in coco.images}
    for what, ids in (("images", [p.id for p in coco.images]), ("categories", [c.id for c in coco.categories])):
        twice = next((number for number, count in Counter(ids).items() if count > 1), None)
        if twice is not None:
            raise OutputError(f"{path}: id {twice} stands twice in {what}")
    regions: dict[int, list[tuple[int, Region]]] = {number: [] for number in pictures}
    for index, annotation in enumerate(coco.annotations):
        where = f"{path}: annotations[{index}]"
        if annotation.image_id not in pictures:
            raise OutputError(f"{where}: there is no image {annotation.image_id}")
        if annotation.category_id not in values:
            raise OutputError(f"{where}: there is no category {annotation.category_id}")
        region = region_of(annotation, pictures[annotation.image_id], where)
        regions[annotation.image_id].append((values[annotation.category_id], region))
    samples, folder = [], home_of(path.parent)
    for number, found in regions.items():
        picture = pictures[number]
        file = picture_file(path, picture.file_name)
        samples.append(sample_in(folder, path, file, (picture.width, picture.height), found))
    return Dataset(folder, RENDERER, tuple(sorted(samples, key=lambda sample: sample.image.name)))


def region_of(annotation: Annotation, picture: Picture, where: str) -> Region:
    """The polygons or pixels of an annotation. Raises OutputError, which begins with `where`."""
    shape = annotation.segmentation
    if not shape:
        raise OutputError(f"{where}: has a box, but no outline; label outlines (polygons or masks)")
    if isinstance(shape, list):
        return [polygon_of(numbers, where) for numbers in shape]
    if shape.size != (picture.height, picture.width):
        raise OutputError(
            f"{where}: its mask is {shape.size[1]}x{shape.size[0]}, its picture {picture.width}x{picture.height}"
        )
    try:
        runs = unpacked(shape.counts) if isinstance(shape.counts, str) else shape.counts
        return mask_of(runs, picture.height, picture.width)
    except ValueError as error:
        raise OutputError(f"{where}: {error}") from None


def unpacked(text: str) -> list[int]:
    """Runs from COCO's string: five bits a character, low ones first; from the fourth run on, differences to the one
    but last.

    Source: rleFrString in the COCO API (cocoapi, common/maskApi.c). Raises ValueError for a string that is none.
    """
    runs: list[int] = []
    value = shift = 0
    for code in (ord(character) - _FIRST_CHARACTER for character in text):
        if not 0 <= code < 2 * _MORE:
            raise ValueError("not a run-length string")
        value |= (code & _BITS) << shift
        shift += 5
        if code & _MORE:
            continue
        if code & _NEGATIVE:
            value -= 1 << shift
        runs.append(value + runs[-2] if len(runs) > 2 else value)
        value = shift = 0
    if shift:
        raise ValueError("a run-length string that breaks off")
    return runs


def mask_of(runs: Sequence[int], height: int, width: int) -> NDArray[np.bool_]:
    """(height, width) from runs down the columns, background first. Raises ValueError where they do not fill the
    picture."""
    if any(run < 0 for run in runs) or sum(runs) != height * width:
        raise ValueError(f"runs of {sum(runs)} pixels in a picture of {width}x{height}")
    values = np.arange(len(runs)) % 2 == 1
    return np.ascontiguousarray(np.repeat(values, runs).reshape(width, height).T)
