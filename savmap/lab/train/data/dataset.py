"""Labelled pictures on disk: reading, checking, mapping of classes, splitting into training and validation.

Sets of other tools are read by `sets`.

A data set is a folder with `images/NAME.jpg` (or .png), `masks/NAME.png` (uint8: 0 background, k = classes[k-1], 255
not to be judged) and `dataset.json` (`{"format": "savmap-dataset", "version": 1, "classes": [...], "renderer":
"..."}`).
"""

import hashlib
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import OutputError
from savmap.files.atomic import read_json, sha256

WIDTH, HEIGHT = 640, 480
"""Size of the views that networks are trained on and shown, px."""

IGNORE = 255
"""Mask value of pixels that are neither trained on nor measured."""

GROUP_SIZE = 20
"""How many pictures that follow one another in number are kept together by `split`."""

Bytes = NDArray[np.uint8]
NO_MAPPING: Mapping[str, str] = {}
SUFFIXES = {".jpg", ".jpeg", ".png"}
MOST_CLASSES = 254
_ADDED_BY_TOOLS = re.compile(r"^(?=[0-9]*[a-f])[0-9a-f]{8}-|[._](?:jpe?g|png|bmp|webp)\.rf\.[0-9A-Za-z]+$")
"""What Label Studio puts before a picture's name, and Roboflow behind it."""


class Labels(Protocol):
    """The labels of a picture's pixels."""

    def mask(self) -> Bytes:
        """(H, W): 0 background, k the k-th class of the network, 255 ignore. Raises OutputError."""

    @property
    def digest(self) -> str:
        """A digest of what the mask is made from; other labels have another. Raises OutputError."""


@dataclass(frozen=True, eq=False)
class MaskFile:
    """A mask in a picture file. `lookup` (256,) uint8 turns its values into the network's."""

    path: Path
    lookup: Bytes

    def mask(self) -> Bytes:
        values = cv2.imread(str(self.path), cv2.IMREAD_UNCHANGED)
        if values is None:
            raise OutputError(f"{self.path}: the mask cannot be read; render or label this picture again")
        if values.ndim != 2 or values.dtype != np.uint8:
            raise OutputError(
                f"{self.path}: a mask has one channel of 8 bits, the numbers of classes; save it without colours"
            )
        mapped: Bytes = self.lookup[values]
        return mapped

    @property
    def digest(self) -> str:
        return sha256(self.path) + self.lookup.tobytes().hex()


@dataclass(frozen=True, eq=False)
class Sample:
    """One labelled picture: its file, its labels, the scene it belongs to and the data set's name."""

    image: Path
    labels: Labels
    group: str
    origin: str

    @cached_property
    def image_digest(self) -> str:
        """A digest of the picture's file; copies share it. Raises OutputError."""
        return sha256(self.image)

    def load(self) -> tuple[Bytes, Bytes]:
        """Picture (480, 640, 3) RGB and mask (480, 640): 0 background, k the k-th class of the network, 255 ignore.
        Pictures of other sizes are scaled to fit, and what is left over is ignored. Raises OutputError."""
        picture = cv2.imread(str(self.image), cv2.IMREAD_COLOR)
        if picture is None:
            raise OutputError(f"{self.image}: the picture cannot be read; render or save it again")
        mask = self.labels.mask()
        if picture.shape[:2] != mask.shape:
            theirs, ours = (f"{size[1]}x{size[0]}" for size in (mask.shape, picture.shape))
            raise OutputError(
                f"{self.image}: is {ours}, but was labelled as {theirs}; use the picture that was labelled"
            )
        return letterboxed(np.ascontiguousarray(picture[:, :, ::-1], dtype=np.uint8), mask)


def letterboxed(image: Bytes, mask: Bytes) -> tuple[Bytes, Bytes]:
    """Picture (H, W, 3) and mask (H, W) scaled to fit into 640x480, shapes kept; the rest is grey, and IGNORE in the
    mask."""
    height, width = mask.shape
    if (width, height) == (WIDTH, HEIGHT):
        return image, mask
    scale = min(WIDTH / width, HEIGHT / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    values = np.unique(mask)
    shares = [cv2.resize((mask == value).astype(np.float32), size, interpolation=how) for value in values]
    picture = np.full((HEIGHT, WIDTH, 3), 127, np.uint8)
    labels = np.full((HEIGHT, WIDTH), IGNORE, np.uint8)
    left, top = (WIDTH - size[0]) // 2, (HEIGHT - size[1]) // 2
    place = slice(top, top + size[1]), slice(left, left + size[0])
    picture[place] = cv2.resize(image, size, interpolation=how)
    labels[place] = values[np.argmax(shares, axis=0)]
    return picture, labels


@dataclass(frozen=True, eq=False)
class Dataset:
    """A checked data set folder, with what the training recipe says about it."""

    folder: Path
    renderer: str
    samples: tuple[Sample, ...]


def group_of(name: str) -> str:
    """Pictures of one scene have neighbouring numbers: the group is the name's numbers, the last one by blocks, without
    what labelling tools add to a name.

    >>> group_of("ceiling-7-00059"), group_of("row-7-00041"), group_of("3f2a9c1b-row-7-00041"),
    group_of("row-7-41_jpg.rf.9b") ('7-2', '7-2', '7-2', '7-2')
    """
    numbers = [int(digits) for digits in re.findall(r"\d+", _ADDED_BY_TOOLS.sub("", name))] or [0]
    return "-".join(map(str, [*numbers[:-1], numbers[-1] // GROUP_SIZE]))


def set_name(folder: Path) -> str:
    """A set's name: that of its folder, however it was given."""
    return folder.resolve().name


def group_in(folder: Path, picture: Path) -> str:
    """The scene of a picture of the set in a folder."""
    return f"{set_name(folder)}/{group_of(picture.stem)}"


SIDE = "_side"


def class_lookup(theirs: Sequence[str], ours: Sequence[str]) -> Bytes:
    """Table (256,) from mask values of a data set to ours; classes that we do not have become background."""
    table = np.full(256, IGNORE, np.uint8)
    table[0] = 0
    for value, name in enumerate(theirs, start=1):
        table[value] = ours.index(name) + 1 if name in ours else 0
    return table


def read_header(folder: Path) -> tuple[list[str], str]:
    """Classes and renderer's name from `dataset.json`. Raises OutputError."""
    path = folder / "dataset.json"
    if not path.is_file():
        raise OutputError(f"{folder}: no dataset.json; give the folder of a data set (see docs/training.md)")
    header = read_json(path)
    if not isinstance(header, dict) or (header.get("format"), header.get("version")) != ("savmap-dataset", 1):
        raise OutputError(f"{path}: not a savmap-dataset of version 1")
    classes = header.get("classes")
    if not isinstance(classes, list) or not 0 < len(classes) <= MOST_CLASSES:
        raise OutputError(f"{path}: `classes` is a list of 1 to {MOST_CLASSES} names")
    return [str(name) for name in classes], str(header.get("renderer", "unknown"))


def require_classes(source: Path, theirs: Sequence[str], classes: Sequence[str]) -> None:
    """Raise OutputError where a data set lacks one of the network's classes. A class `NAME_side` beside `NAME` may be
    missing: few sets tell an object's sides apart, and they are background there."""
    missing = [name for name in classes if name not in theirs and name.removesuffix(SIDE) not in {*classes} - {name}]
    if missing:
        raise OutputError(
            f"{source}: has no class {', '.join(missing)} (it has {', '.join(theirs) or 'none'}); "
            f"if one goes by another name, say --class THEIRS={missing[0]}"
        )


def read_dataset(folder: Path, classes: Sequence[str], mapping: Mapping[str, str] = NO_MAPPING) -> Dataset:
    """Check a folder and list its samples, in order of name; `mapping` gives its classes other names. Raises
    OutputError for a folder that cannot be trained on."""
    theirs, renderer = read_header(folder)
    theirs = [mapping.get(name, name) for name in theirs]
    require_classes(folder, theirs, classes)
    lookup = class_lookup(theirs, classes)
    pictures = sorted(p for p in (folder / "images").glob("*") if p.suffix.lower() in SUFFIXES)
    samples = []
    for picture in pictures:
        mask = folder / "masks" / f"{picture.stem}.png"
        if mask.exists():
            samples.append(Sample(picture, MaskFile(mask, lookup), group_in(folder, picture), str(folder)))
    if not samples:
        raise OutputError(f"{folder}: no picture in images/ has its mask in masks/")
    return Dataset(folder, renderer, tuple(samples))


def is_validation(group: str, share: float) -> bool:
    """Whether a scene is kept from training: decided by its name alone, so that it stays so when the data set grows."""
    digest = hashlib.sha256(group.encode()).digest()
    return int.from_bytes(digest[:4], "big") / 2**32 < share


def split(samples: Sequence[Sample], share: float = 0.06) -> tuple[list[Sample], list[Sample]]:
    """(training, validation) by scene; at least one sample in each: a single one is in both. Too few scenes for their
    names to decide are split as by `held_out`."""
    validation = [sample for sample in samples if is_validation(sample.group, share)]
    training = [sample for sample in samples if not is_validation(sample.group, share)]
    if validation and training:
        return training, validation
    return held_out(samples, share) if len(samples) > 1 else (list(samples), list(samples))


def held_out(samples: Sequence[Sample], share: float) -> tuple[list[Sample], list[Sample]]:
    """(training, validation) by scene, for sets of a few scenes.

    Whole scenes go to validation, in an order that depends on their names alone, while they bring its pictures nearer
    to `share`; if none does, the smallest. A single scene is cut in two. Raises OutputError for fewer than two
    pictures."""
    if len(samples) < 2:
        raise OutputError(f"{len(samples)} labelled pictures are too few to train and to validate on; label more")
    sizes = Counter(sample.group for sample in samples)
    wanted = min(max(1, round(share * len(samples))), len(samples) - 1)
    if len(sizes) == 1:
        return list(samples[:-wanted]), list(samples[-wanted:])
    chosen, missing = set[str](), wanted
    for group in sorted(sizes, key=lambda group: hashlib.sha256(group.encode()).digest()):
        if sizes[group] < 2 * missing and len(chosen) < len(sizes) - 1:
            chosen.add(group)
            missing -= sizes[group]
    chosen = chosen or {min(sizes, key=lambda group: (sizes[group], group))}
    inside = [sample for sample in samples if sample.group in chosen]
    return [sample for sample in samples if sample.group not in chosen], inside


REPLAYED = 0.1
"""Which share of what is seen pictures against forgetting are: many different ones seldom keep more, and cost less,
than a few often."""


def sampling_weights(
    samples: Sequence[Sample], empty_weight: float = 0.2, replayed: Collection[str] = ()
) -> NDArray[np.float64]:
    """Probability (n,) of drawing each sample.

    Pictures without any class are drawn less often. A data set's share goes with the square root of its number of
    pictures, so that a small one with another look counts for more than its size. Those that are `replayed` against
    forgetting, by their samples' origin, have `REPLAYED` together. Raises OutputError where no picture shows any class.
    """
    showing = [_shows_class(sample) for sample in samples]
    if not any(showing):
        raise OutputError(f"none of the {len(samples)} pictures to train on shows any class; look at their labels")
    weights = np.where(showing, 1.0, empty_weight)
    folders = np.array([sample.origin for sample in samples])
    for folder in np.unique(folders):
        weights[folders == folder] /= np.sqrt(np.sum(folders == folder))
    seldom = np.isin(folders, [*replayed])
    if seldom.any() and not seldom.all():
        weights[seldom] *= REPLAYED / weights[seldom].sum()
        weights[~seldom] *= (1 - REPLAYED) / weights[~seldom].sum()
    probabilities: NDArray[np.float64] = weights / weights.sum()
    return probabilities


def _shows_class(sample: Sample) -> bool:
    values = np.unique(sample.labels.mask())
    return bool(np.any((values != 0) & (values != IGNORE)))
