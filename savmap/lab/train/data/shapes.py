"""What the readers of labelling tools' sets share: labels as polygons and runs, drawn when they are needed; pictures;
checks."""

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from savmap.errors import OutputError
from savmap.files.urls import likely, on_disk
from savmap.files.validation import one_line
from savmap.lab.label.polygons import Mask, Polygon, filled
from savmap.lab.train.data.dataset import Sample, group_in
from savmap.video.image_folder import picture_size

Bytes = NDArray[np.uint8]
Model = TypeVar("Model", bound=BaseModel)
FARTHEST_PX = 1e6
"""No corner is further from its picture: no picture is as large."""
Region = Sequence[Polygon] | Mask
"""One thing: polygons (each joined to the others), or its pixels (h, w)."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """What is in a picture of `width` x `height` px: regions with the network's class (0: another thing), later ones on
    top."""

    width: int
    height: int
    regions: Sequence[tuple[int, Region]]

    def mask(self) -> Bytes:
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
            if isinstance(region, np.ndarray):
                drawn[region] = value
                continue
            for polygon in region:
                drawn[filled(polygon, self.height, self.width)] = value
        return zlib.compress(drawn.tobytes(), 1)


def polygon_of(numbers: Sequence[float], where: str) -> Polygon:
    """(n, 2) from x, y, x, y... Raises OutputError, which begins with `where`, for numbers that make no polygon."""
    if len(numbers) % 2 or len(numbers) < 6:
        raise OutputError(f"{where}: a polygon is three corners or more, x and y of each, not {len(numbers)} numbers")
    polygon = np.asarray(numbers, np.float64).reshape(-1, 2)
    if not np.isfinite(polygon).all():
        raise OutputError(f"{where}: a corner is not a finite number")
    if np.abs(polygon).max() > FARTHEST_PX:
        raise OutputError(f"{where}: a corner is more than {FARTHEST_PX:.0f} pixels away")
    return polygon


def values_of(theirs: Sequence[str], classes: Sequence[str]) -> list[int]:
    """The network's value of each class of a data set: 0 for those that it does not have."""
    return [classes.index(name) + 1 if name in classes else 0 for name in theirs]


def require_pictures(source: Path, count: int) -> None:
    """Raise OutputError for a set without pictures."""
    if count == 0:
        raise OutputError(f"{source}: names no pictures; export the set again, with its pictures")


def checked(model: type[Model], path: Path, content: object) -> Model:
    """The content as records. Raises OutputError that names the first entry which is not as it should be."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise OutputError(f"{one_line(error, model, str(path))}; save or export it again") from None


def home_of(folder: Path) -> Path:
    """The folder of a set whose labels are in `folder`, which may be an inner one."""
    return folder.parent if folder.name in {"annotations", "images"} else folder


def picture_file(path: Path, name: str) -> Path:
    """Where a picture of a set lies that `path` describes: beside it or its folder, in `images/` or in its subset's
    folder (CVAT). Raises OutputError where it is nowhere."""
    subset = path.stem.removeprefix("instances_")
    bases = (path.parent, path.parent.parent)
    folders = [base / inner for base in bases for inner in (".", "images", f"images/{subset}", subset)]
    places = [
        on_disk(folder / part)
        for relative in spellings(name)
        for part in (relative, relative.name)
        for folder in folders
    ]
    file = next(filter(Path.is_file, places), None)
    if file is None:
        near = next(filter(None, map(likely, places)), "; put the pictures there")
        raise OutputError(f"{path}: its picture {name} is neither beside it nor in images/{near}")
    return file


def spellings(name: str) -> tuple[Path, ...]:
    """A path that a file of another program's names, as it stands there, and with the backslashes of Windows taken for
    slashes."""
    return tuple(dict.fromkeys((Path(name), Path(name.replace("\\", "/")))))


def sample_in(
    folder: Path, labels: Path, picture: Path, size: tuple[int, int] | None, regions: Sequence[tuple[int, Region]]
) -> Sample:
    """A picture of the set in `folder` with what is in it; `size` (width, height) is what the file `labels` says of it,
    if anything. Raises OutputError where it is of another, or damaged."""
    shown = picture_size(picture)
    if shown is None:
        raise OutputError(f"{picture}: the picture cannot be read; save it again")
    if size is not None and size != shown:
        raise OutputError(f"{picture}: is {shown[0]}x{shown[1]}, but {labels.name} says {size[0]}x{size[1]}")
    return Sample(picture, Shapes(*shown, tuple(regions)), group_in(folder, picture), str(folder))
