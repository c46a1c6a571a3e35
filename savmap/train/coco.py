"""Sets of COCO instances, as CVAT, Label Studio, Roboflow and `savmap label` write them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from savmap.errors import OutputError
from savmap.train.dataset import NO_MAPPING, Dataset, require_classes
from savmap.train.runs import mask_of, unpacked
from savmap.train.shapes import (
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
    """What is read of the file; anything else in it is passed over."""

    images: list[Picture]
    annotations: list[Annotation]
    categories: list[Category]


def read_coco(path: Path, content: object, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """The set that a JSON file (`content`, as parsed) describes. Raises OutputError with one line for what is wrong with it."""
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
        return np.asarray(mask_of(runs, picture.height, picture.width), np.bool_)
    except ValueError as error:
        raise OutputError(f"{where}: {error}") from None
