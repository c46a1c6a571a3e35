"""Labelled pictures of any kind, recognised by what is in a folder: savmap's sets, COCO, LabelMe.

The last two become `Drawing`s: of each picture, regions with their classes' names. They are read here, because no
library reads both and fits: datumaro 1.13 pins numpy 2.2, pandas, Pillow and pyarrow; supervision 0.31 reads no
LabelMe and keeps all masks in memory; pycocotools 2.0 reads run-length masks alone, and leaves memory as it was where
their runs end early.
"""

import hashlib
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from savmap.errors import OutputError
from savmap.files.atomic import read_json
from savmap.files.validation import checked
from savmap.lab.label.polygons import Mask, Polygon, filled
from savmap.lab.train.data.dataset import NO_MAPPING, Dataset, Sample, group_in, read_dataset, require_classes
from savmap.video.image_folder import picture_size

MOST_MB = 256
"""Of a file of labels, in which a picture may lie too."""
HEADER = "dataset.json"
KINDS = f"a savmap-dataset ({HEADER}), COCO instances (a JSON file) or a folder of LabelMe's files"
_BITS, _MORE, _NEGATIVE, _FIRST_CHARACTER = 0x1F, 0x20, 0x10, 48

Region = Sequence[Polygon] | Mask
"""Of one object: polygons (each joined to the others), or its pixels (h, w)."""
Reader = Callable[[Sequence[str], Mapping[str, str]], Dataset]


@dataclass(frozen=True, eq=False)
class Drawing:
    """A picture's file, its width and height if the labels say them, and its regions with their classes' names, later
    ones on top."""

    picture: Path
    size: tuple[int, int] | None
    regions: Sequence[tuple[str, Region]]


@dataclass(frozen=True, eq=False)
class Shapes:
    """The labels of a picture of `width` x `height` px: regions with the network's class (0: another), drawn when they
    are needed."""

    width: int
    height: int
    regions: Sequence[tuple[int, Region]]

    def mask(self) -> NDArray[np.uint8]:
        """(H, W): 0 background, k the k-th class of the network."""
        return np.frombuffer(zlib.decompress(self._packed), np.uint8).reshape(self.height, self.width)

    @property
    def digest(self) -> str:
        """A digest of the mask."""
        return hashlib.sha256(self._packed).hexdigest()

    @cached_property
    def _packed(self) -> bytes:
        drawn = np.zeros((self.height, self.width), np.uint8)
        for value, region in self.regions:
            for pixels in [region] if isinstance(region, np.ndarray) else [filled(p, *drawn.shape) for p in region]:
                drawn[pixels] = value
        return zlib.compress(drawn.tobytes(), 1)


def read_sets(
    sources: Sequence[Path], classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING, every: int = 1
) -> list[Dataset]:
    """Data sets with the network's classes, thinned to one picture of `every`; `mapping` gives their classes other
    names. Raises OutputError for a set that cannot be read, or is of no kind above."""
    sets = [read_set(source, classes, mapping) for source in sources]
    return [replace(dataset, samples=dataset.samples[::every]) for dataset in sets]


def samples_of(datasets: Sequence[Dataset]) -> list[Sample]:
    """The pictures of all sets. Copies of a picture belong to one scene: none is trained on while another is held
    out."""
    scenes: dict[str, str] = {}
    return [
        replace(sample, group=scenes.setdefault(sample.image_digest, sample.group))
        for dataset in datasets
        for sample in dataset.samples
    ]


def read_set(source: Path, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """One data set: a folder, or the JSON file of one. Raises OutputError, also for a folder that holds
    several: labels are corrected in one of them, and the others are out of date."""
    source = _on_disk(source)
    if not source.exists():
        raise OutputError(f"{source}: no such file or folder; give {KINDS} (see docs/training.md)")
    readers = dict(_sets_in(source)) if source.is_dir() else {source: _reader_of(source)}
    if not readers:
        raise OutputError(f"{source}: no {HEADER}, nor labels of another kind; give {KINDS} (see docs/training.md)")
    if len(readers) > 1:
        names = ", ".join("LabelMe's files" if path == source else str(path) for path in readers)
        raise OutputError(
            f"{source}: holds labels of several kinds ({names}); give one of them, or move the others away"
        )
    (read,) = readers.values()
    return read(classes, mapping)


def _sets_in(folder: Path) -> Iterator[tuple[Path, Reader]]:
    """The path to give for each set in a folder, and its reader."""
    if (folder / HEADER).is_file():
        yield folder / HEADER, partial(read_dataset, folder)
    for place in (folder, folder / "annotations", folder / "images"):
        contents = {path: _json_of(path) for path in sorted(place.glob("*.json")) if path.name != HEADER}
        yield from (
            (path, partial(read_coco, path, content)) for path, content in contents.items() if _is_coco(content)
        )
        drawn = {path: content for path, content in contents.items() if is_labelme(content)}
        if drawn:
            yield place, partial(read_labelme, place, drawn)


def _reader_of(file: Path) -> Reader:
    if file.name == HEADER:
        return partial(read_dataset, file.parent)
    content = _json_of(file)
    if is_labelme(content):
        raise OutputError(f"{file}: is LabelMe's of one picture; give the folder that it is in")
    if not _is_coco(content):
        raise OutputError(f"{file}: is not COCO (an object with images, annotations and categories)")
    return partial(read_coco, file, content)


def _json_of(file: Path) -> object:
    """A JSON file's content, without the copy of the picture that LabelMe may put into it."""
    content = read_json(file, MOST_MB)
    if isinstance(content, dict):
        content.pop("imageData", None)
    return content


def _is_coco(content: object) -> bool:
    return isinstance(content, dict) and {"images", "annotations", "categories"} <= set(content)


def is_labelme(content: object) -> bool:
    """Whether a JSON file's content is LabelMe's."""
    return isinstance(content, dict) and {"shapes", "imagePath"} <= set(content)


class _CocoImage(BaseModel):
    id: int
    file_name: str
    width: int
    height: int


class _CocoRuns(BaseModel):
    counts: list[int] | str
    size: tuple[int, int]


class _CocoAnnotation(BaseModel):
    image_id: int
    category_id: int
    segmentation: list[list[float]] | _CocoRuns | None = None


class _CocoCategory(BaseModel):
    id: int
    name: str


class _Coco(BaseModel):
    images: list[_CocoImage]
    annotations: list[_CocoAnnotation]
    categories: list[_CocoCategory]


def read_coco(path: Path, content: object, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """The instances that a JSON file (`content`, as parsed) describes, as CVAT, Label Studio, Roboflow and `savmap
    label` write them. Raises OutputError with one line."""
    coco = checked(_Coco, content, str(path))
    for what, ids in (("images", [i.id for i in coco.images]), ("categories", [c.id for c in coco.categories])):
        twice = next((number for number, count in Counter(ids).items() if count > 1), None)
        if twice is not None:
            raise OutputError(f"{path}: id {twice} stands twice in {what}")
    images = {image.id: image for image in coco.images}
    names = {category.id: category.name for category in coco.categories}
    regions: dict[int, list[tuple[str, Region]]] = {number: [] for number in images}
    for index, annotation in enumerate(coco.annotations):
        where = f"{path}: annotations[{index}]"
        if annotation.image_id not in images:
            raise OutputError(f"{where}: there is no image {annotation.image_id}")
        if annotation.category_id not in names:
            raise OutputError(f"{where}: there is no category {annotation.category_id}")
        region = _coco_region(annotation, images[annotation.image_id], where)
        regions[annotation.image_id].append((names[annotation.category_id], region))
    drawings = (
        Drawing(_picture_of(path, image.file_name), (image.width, image.height), regions[number])
        for number, image in images.items()
    )
    return _dataset(path, _home_of(path.parent), "COCO", list(names.values()), drawings, classes, mapping)


def _coco_region(annotation: _CocoAnnotation, image: _CocoImage, where: str) -> Region:
    shape = annotation.segmentation
    if not shape:
        raise OutputError(f"{where}: has a box, but no outline; label outlines (polygons or masks)")
    if isinstance(shape, list):
        return [polygon_of(numbers, where) for numbers in shape]
    runs = _unpacked(shape.counts, where) if isinstance(shape.counts, str) else shape.counts
    if shape.size != (image.height, image.width) or sum(runs) != image.height * image.width or min(runs) < 0:
        raise OutputError(f"{where}: its mask does not fill its picture of {image.width}x{image.height}")
    inside = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return np.ascontiguousarray(inside.reshape(image.width, image.height).T)


def _unpacked(text: str, where: str) -> list[int]:
    """Runs from COCO's string: five bits a character, low ones first; from the fourth run on, differences to the run
    before the last. Source: rleFrString in the COCO API (cocoapi, common/maskApi.c)."""
    runs: list[int] = []
    value = shift = 0
    for code in (ord(character) - _FIRST_CHARACTER for character in text):
        if not 0 <= code < 2 * _MORE:
            raise OutputError(f"{where}: its mask is not a run-length string")
        value |= (code & _BITS) << shift
        shift += 5
        if code & _MORE:
            continue
        if code & _NEGATIVE:
            value -= 1 << shift
        runs.append(value + runs[-2] if len(runs) > 2 else value)
        value = shift = 0
    return runs


def _on_disk(path: Path) -> Path:
    """The path as the disk has it: a name that is not there is taken for one that differs in nothing but its Unicode
    normal form, as names from Macs do (u with a diaeresis, in one character or two)."""
    existing = Path(path.anchor)
    for part in path.parts[bool(path.anchor) :]:
        if not (existing / part).exists():
            names = (entry.name for entry in (existing.iterdir() if existing.is_dir() else ()))
            part = next((name for name in names if normalize("NFC", name) == normalize("NFC", part)), part)
        existing /= part
    return existing


class _LabelMeShape(BaseModel):
    label: str
    points: list[tuple[float, float]]
    kind: str | None = Field(None, alias="shape_type")


class _LabelMe(BaseModel):
    picture: str = Field(alias="imagePath")
    shapes: list[_LabelMeShape]
    width: int | None = Field(None, alias="imageWidth")
    height: int | None = Field(None, alias="imageHeight")


def read_labelme(
    folder: Path, contents: Mapping[Path, object], classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING
) -> Dataset:
    """The set of the files of a folder (`contents`, as parsed). Raises OutputError with one line."""
    drawings: dict[Path, Drawing] = {}
    for path, content in contents.items():
        drawn = checked(_LabelMe, content, str(path))
        picture = _picture_of(path, drawn.picture)
        if picture in drawings:
            raise OutputError(f"{path}: {picture.name} is labelled in another file too; leave one of them out")
        size = (drawn.width, drawn.height) if drawn.width and drawn.height else None
        regions = [
            (shape.label, [_labelme_outline(shape, f"{path}: shapes[{index}]")])
            for index, shape in enumerate(drawn.shapes)
        ]
        drawings[picture] = Drawing(picture, size, regions)
    names = sorted({label for drawing in drawings.values() for label, _ in drawing.regions})
    return _dataset(folder, _home_of(folder), "LabelMe", names, drawings.values(), classes, mapping)


def _labelme_outline(shape: _LabelMeShape, where: str) -> Polygon:
    if shape.kind not in {None, "polygon", "rectangle", "oriented_rectangle"}:
        raise OutputError(f"{where}: is a {shape.kind}; draw polygons or rectangles")
    if shape.kind == "rectangle" and len(shape.points) == 2:
        (left, top), (right, bottom) = shape.points
        return polygon_of([left, top, right, top, right, bottom, left, bottom], where)
    return polygon_of([number for point in shape.points for number in point], where)


def polygon_of(numbers: Sequence[float], where: str) -> Polygon:
    """(n, 2) from x, y, x, y... Raises OutputError, which begins with `where`, for numbers that make no polygon."""
    if len(numbers) % 2 or len(numbers) < 6:
        raise OutputError(f"{where}: a polygon is three corners or more, x and y of each, not {len(numbers)} numbers")
    polygon = np.asarray(numbers, np.float64).reshape(-1, 2)
    if not np.isfinite(polygon).all():
        raise OutputError(f"{where}: a corner is not a finite number")
    return polygon


def _dataset(
    source: Path,
    folder: Path,
    tool: str,
    names: Sequence[str],
    drawings: Iterable[Drawing],
    classes: Sequence[str],
    mapping: Mapping[str, str],
) -> Dataset:
    """The data set in `folder` that `source` describes, whose classes are called `names`."""
    ours = {name: mapping.get(name, name) for name in names}
    require_classes(source, list(ours.values()), classes)
    values = {name: classes.index(our) + 1 if our in classes else 0 for name, our in ours.items()}
    samples = []
    for drawing in drawings:
        shown = picture_size(drawing.picture)
        if shown is None:
            raise OutputError(f"{drawing.picture}: the picture cannot be read; save it again")
        if drawing.size not in (None, shown):
            sizes = " but its labels are of ".join(
                f"{width}x{height}" for width, height in (shown, drawing.size or shown)
            )
            raise OutputError(f"{drawing.picture}: is {sizes}")
        shapes = Shapes(*shown, [(values[name], region) for name, region in drawing.regions])
        samples.append(Sample(drawing.picture, shapes, group_in(folder, drawing.picture), str(folder)))
    if not samples:
        raise OutputError(f"{source}: names no pictures; export the set again, with its pictures")
    return Dataset(folder, f"labelled ({tool})", tuple(sorted(samples, key=lambda sample: sample.image)))


def _home_of(folder: Path) -> Path:
    """The folder of a set whose labels are in `folder`, which may be an inner one."""
    return folder.parent if folder.name in {"annotations", "images"} else folder


def _picture_of(path: Path, name: str) -> Path:
    """The picture `name` of the set that `path` describes: beside it, in `images/` or in its subset's folder (CVAT)."""
    subset = path.stem.removeprefix("instances_")
    inner = (".", "images", f"images/{subset}", subset)
    folders = [base / folder for base in (path.parent, path.parent.parent) for folder in inner]
    spelt = [part for relative in _spellings(name) for part in (relative, relative.name)]
    places = [_on_disk(folder / part) for part in spelt for folder in folders]
    file = next(filter(Path.is_file, places), None)
    if file is None:
        raise OutputError(f"{path}: its picture {name} is neither beside it nor in images/; put the pictures there")
    return file


def _spellings(name: str) -> tuple[Path, ...]:
    """A path that another program wrote, as it stands there, and with Windows' backslashes taken for slashes."""
    return tuple(dict.fromkeys((Path(name), Path(name.replace("\\", "/")))))
