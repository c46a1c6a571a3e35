"""Labelled pictures as labelling tools read them: COCO instances (CVAT, Label Studio), and LabelMe's files.

FOLDER/images/NAME.jpg with LabelMe's NAME.json beside it, and FOLDER/coco.json.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import OutputError
from savmap.files.atomic import write_text
from savmap.lab.label.polygons import Polygon, area
from savmap.video.image_folder import write_picture

COCO, IMAGES = "coco.json", "images"
QUALITY = 95


@dataclass(frozen=True, eq=False)
class LabelledPicture:
    """A picture (h, w, 3) uint8 RGB with the polygons of each class."""

    name: str
    image: NDArray[np.uint8]
    shapes: Mapping[str, Sequence[Polygon]]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.image.shape[1], self.image.shape[0]


@dataclass(frozen=True)
class LabelledSet:
    """A set that was written: how many pictures and outlines, in both formats."""

    folder: Path
    pictures: int
    outlines: int


def require_unused(folder: Path) -> None:
    """Raise OutputError where a folder holds labels already: someone may have corrected them."""
    existing = next((name for name in (COCO, IMAGES) if (folder / name).exists()), None)
    if existing is not None:
        raise OutputError(f"{folder}: holds {existing} already, which may have been corrected; choose another -o")


def write_set(folder: Path, classes: Sequence[str], pictures: Iterable[LabelledPicture]) -> LabelledSet:
    """Write pictures and labels in both formats, each file whole; the one that names all pictures comes last.

    Raises OutputError where something cannot be written, or where labels are there already."""
    require_unused(folder)
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for picture in pictures:
        bgr = np.ascontiguousarray(picture.image[..., ::-1])
        write_picture(folder / IMAGES / f"{picture.name}.jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        write_text(folder / IMAGES / f"{picture.name}.json", labelme(picture))
        width, height = picture.size
        images.append({"id": len(images) + 1, "file_name": f"{picture.name}.jpg", "width": width, "height": height})
        annotations += coco_annotations(picture, classes, len(images), len(annotations) + 1)
    categories = [{"id": number, "name": name} for number, name in enumerate(classes, start=1)]
    whole = {"images": images, "annotations": annotations, "categories": categories}
    write_text(folder / COCO, json.dumps(whole) + "\n")
    return LabelledSet(folder, len(images), len(annotations))


def coco_annotations(
    picture: LabelledPicture, classes: Sequence[str], image: int, first: int
) -> Iterator[dict[str, Any]]:
    """An annotation for each polygon of a picture, numbered from `first`."""
    labelled = [(classes.index(name) + 1, polygon) for name in classes for polygon in picture.shapes.get(name, ())]
    for number, (category, polygon) in enumerate(labelled, start=first):
        low, high = polygon.min(axis=0), polygon.max(axis=0)
        yield {
            "id": number,
            "image_id": image,
            "category_id": category,
            "iscrowd": 0,
            "segmentation": [np.round(polygon, 2).ravel().tolist()],
            "bbox": np.round([*low, *(high - low)], 2).tolist(),
            "area": round(area(polygon), 2),
        }


def labelme(picture: LabelledPicture) -> str:
    """LabelMe's file of one picture."""
    width, height = picture.size
    shapes = [
        {"label": name, "points": np.round(polygon, 2).tolist(), "group_id": None, "shape_type": "polygon", "flags": {}}
        for name, polygons in picture.shapes.items()
        for polygon in polygons
    ]
    about: dict[str, Any] = {
        "version": "5.4.1",
        "flags": {},
        "shapes": shapes,
        "imagePath": f"{picture.name}.jpg",
        "imageData": None,
    }
    return json.dumps({**about, "imageHeight": height, "imageWidth": width}, indent=1) + "\n"
