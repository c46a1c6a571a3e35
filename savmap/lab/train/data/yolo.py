"""Sets of YOLO segments: data.yaml, pictures in folders called images, and for each a file of polygons in labels."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pydantic import BaseModel

from savmap.errors import OutputError
from savmap.files.atomic import read_text
from savmap.files.urls import likely, on_disk
from savmap.lab.train.data.dataset import NO_MAPPING, Dataset, Sample, require_classes
from savmap.lab.train.data.shapes import Region, checked, polygon_of, require_pictures, sample_in, spellings, values_of
from savmap.video.image_folder import SUFFIXES, picture_size

RENDERER = "labelled (YOLO segments)"
_SLACK = 0.01
MOST_SHOWN = 200


class Yolo(BaseModel):
    """The entries of data.yaml that are read; others are ignored."""

    names: list[str] | dict[int, str]
    path: str = "."
    train: str | list[str] | None = None
    val: str | list[str] | None = None
    test: str | list[str] | None = None

    @property
    def places(self) -> list[str]:
        """Where pictures are, each once."""
        given = [part for part in (self.train, self.val, self.test) if part]
        return list(dict.fromkeys(place for part in given for place in ([part] if isinstance(part, str) else part)))


def read_yolo(path: Path, content: object, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """The set that a data.yaml (`content`, as parsed) describes, all its parts together. Raises OutputError with one
    line for what is wrong with it."""
    yolo = checked(Yolo, path, content)
    names = dict(enumerate(yolo.names)) if isinstance(yolo.names, list) else yolo.names
    theirs = {number: mapping.get(name, name) for number, name in names.items()}
    require_classes(path, list(theirs.values()), classes)
    values = dict(zip(theirs, values_of(list(theirs.values()), classes), strict=True))
    files = sorted({file for place in yolo.places for file in pictures_at(path, yolo.path, place)})
    require_pictures(path, len(files))
    if not any(labels_file(file).is_file() for file in files):
        raise OutputError(
            f"{path}: none of its pictures has labels (such as {labels_file(files[0])}); export the set again"
        )
    return Dataset(path.parent, RENDERER, tuple(sample_of(path, file, values) for file in files))


def pictures_at(path: Path, base: str, place: str) -> Iterator[Path]:
    """The pictures of a folder that data.yaml names, or of a list of files. Raises OutputError where there is
    neither."""
    folder, part = spellings(base)[-1], spellings(place)[-1]
    inner = Path(*part.parts[1:]) if part.parts[:1] == ("..",) else part
    tried = [on_disk(path.parent / one) for one in (folder / part, part, inner)]
    source = next((candidate for candidate in tried if _is_there(candidate)), None)
    if source is None:
        near = next(filter(None, map(likely, tried)), "")
        raise OutputError(
            f"{path}: there is no {place[:MOST_SHOWN]} beside it{near}; put the pictures there, or correct the file"
        )
    if source.is_dir():
        yield from (file for file in sorted(source.iterdir()) if file.suffix.lower() in SUFFIXES)
        return
    for line in filter(None, map(str.strip, read_text(source).splitlines())):
        places = [on_disk(source.parent / name) for name in spellings(line)]
        picture = next((place for place in places if _is_there(place) and place.is_file()), None)
        if picture is None:
            raise OutputError(f"{source}: there is no picture {line[:MOST_SHOWN]}{likely(places[-1])}")
        yield picture


def _is_there(path: Path) -> bool:
    """Whether there is such a file or folder. A name that is too long for one is none."""
    try:
        return path.exists()
    except OSError:
        return False


def labels_file(picture: Path) -> Path:
    """The file of polygons of a picture: the last folder called images on its way is called labels; or it is beside the
    picture."""
    beside = picture.with_suffix(".txt")
    parts = list(beside.parts)
    if "images" in parts:
        last = len(parts) - 1 - parts[::-1].index("images")
        parts[last] = "labels"
    elsewhere = Path(*parts)
    return beside if beside.is_file() and not elsewhere.is_file() else elsewhere


def sample_of(path: Path, picture: Path, values: Mapping[int, int]) -> Sample:
    """A picture with its polygons; none where there is no file of them. Raises OutputError."""
    labels, size = labels_file(picture), picture_size(picture)
    regions = list(regions_of(labels, size, values)) if size is not None and labels.is_file() else []
    return sample_in(path.parent, path, picture, size, regions)


def regions_of(labels: Path, size: tuple[int, int], values: Mapping[int, int]) -> Iterator[tuple[int, Region]]:
    """The polygons of a file, px, with the network's values of their classes. Raises OutputError with the line's
    number."""
    for number, line in enumerate(read_text(labels).splitlines(), start=1):
        if not line.strip():
            continue
        where = f"{labels}:{number}"
        try:
            kind, *numbers = line.split()
            label, shares = int(kind), [float(text) for text in numbers]
        except ValueError:
            raise OutputError(f"{where}: a class's number and corners are expected, not `{line[:40]}`") from None
        if label not in values:
            raise OutputError(f"{where}: data.yaml names no class {label}")
        if len(shares) == 4:
            raise OutputError(f"{where}: is a box; label outlines (YOLO segments)")
        polygon = polygon_of(shares, where)
        if polygon.min() < -_SLACK or polygon.max() > 1 + _SLACK:
            raise OutputError(f"{where}: corners are shares of width and height, 0 to 1, not {polygon.max():g}")
        yield values[label], [polygon * size]
