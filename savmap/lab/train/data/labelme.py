"""Folders of LabelMe's files: a JSON file for each picture, with what was drawn in it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import BaseModel, Field

from savmap.errors import OutputError
from savmap.lab.label.polygons import Polygon
from savmap.lab.train.data.dataset import NO_MAPPING, Dataset, Sample, require_classes
from savmap.lab.train.data.shapes import checked, home_of, picture_file, polygon_of, sample_in, values_of

RENDERER = "labelled (LabelMe)"


class Shape(BaseModel):
    """An entry of `shapes`: corners (x, y) px, (0, 0) the picture's upper left one."""

    label: str
    points: list[tuple[float, float]]
    kind: str | None = Field(None, alias="shape_type")


class Drawn(BaseModel):
    """The entries of a file that are read; others are ignored."""

    picture: str = Field(alias="imagePath")
    shapes: list[Shape]
    width: int | None = Field(None, alias="imageWidth")
    height: int | None = Field(None, alias="imageHeight")

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the picture, if they are given."""
        return (self.width, self.height) if self.width and self.height else None


def is_labelme(content: object) -> bool:
    """Whether a JSON file's content is LabelMe's."""
    return isinstance(content, dict) and {"shapes", "imagePath"} <= set(content)


def read_labelme(
    folder: Path, contents: Mapping[Path, object], classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING
) -> Dataset:
    """The set of the files of a folder (`contents`, as parsed). Raises OutputError with one line for what is wrong with
    it."""
    files = {path: checked(Drawn, path, content) for path, content in contents.items()}
    theirs = sorted({mapping.get(shape.label, shape.label) for drawn in files.values() for shape in drawn.shapes})
    require_classes(folder, theirs, classes)
    values = dict(zip(theirs, values_of(theirs, classes), strict=True))
    samples: dict[Path, Sample] = {}
    for path, drawn in files.items():
        regions = [
            (values[mapping.get(shape.label, shape.label)], [outline_of(shape, f"{path}: shapes[{index}]")])
            for index, shape in enumerate(drawn.shapes)
        ]
        picture = picture_file(path, drawn.picture)
        if picture in samples:
            raise OutputError(f"{path}: {picture.name} is labelled in another file too; leave one of them out")
        samples[picture] = sample_in(home_of(folder), path, picture, drawn.size, regions)
    return Dataset(home_of(folder), RENDERER, tuple(samples[picture] for picture in sorted(samples)))


def outline_of(shape: Shape, where: str) -> Polygon:
    """The corners (n, 2) of what was drawn. Raises OutputError, which begins with `where`, for what has no inside."""
    if shape.kind not in {None, "polygon", "rectangle", "oriented_rectangle"}:
        raise OutputError(f"{where}: is a {shape.kind}; draw polygons or rectangles")
    if shape.kind == "rectangle" and len(shape.points) == 2:
        (left, top), (right, bottom) = shape.points
        return polygon_of([left, top, right, top, right, bottom, left, bottom], where)
    return polygon_of([number for point in shape.points for number in point], where)
