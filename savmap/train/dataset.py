"""Labelled pictures on disk: reading, checking, mapping of classes, splitting into training and validation.

A data set is a folder with `images/NAME.jpg` (or .png), `masks/NAME.png` (uint8: 0 background, k = classes[k-1], 255 not
to be judged) and `dataset.json` (`{"format": "savmap-dataset", "version": 1, "classes": [...], "renderer": "..."}`).
"""

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import OutputError

IGNORE = 255
"""Mask value of pixels that are neither trained on nor measured."""

GROUP_SIZE = 20
"""How many pictures that follow one another in number are kept together by `split`."""

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Sample:
    """One labelled picture. `lookup` (256,) uint8 turns the data set's mask values into the network's."""

    image: Path
    mask: Path
    lookup: Bytes
    group: str

    def load(self) -> tuple[Bytes, Bytes]:
        """Picture (H, W, 3) RGB and mask (H, W): 0 background, k the k-th class of the network, 255 ignore."""
        picture = cv2.imread(str(self.image), cv2.IMREAD_COLOR)
        mask = cv2.imread(str(self.mask), cv2.IMREAD_GRAYSCALE)
        if picture is None or mask is None or picture.shape[:2] != mask.shape:
            raise OutputError(
                f"{self.image}: picture and mask cannot be read or differ in size; render this data set again"
            )
        return np.ascontiguousarray(picture[:, :, ::-1], dtype=np.uint8), self.lookup[mask]


@dataclass(frozen=True)
class Dataset:
    """A checked data set folder, with what the training recipe says about it."""

    folder: Path
    renderer: str
    samples: tuple[Sample, ...]


def group_of(name: str) -> str:
    """Pictures of one scene have neighbouring numbers: the group is the name's numbers, the last one by blocks.

    >>> group_of("ceiling-7-00059"), group_of("row-7-00041")
    ('7-2', '7-2')
    """
    numbers = [int(digits) for digits in re.findall(r"\d+", name)] or [0]
    return "-".join(map(str, [*numbers[:-1], numbers[-1] // GROUP_SIZE]))


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
    try:
        header = json.loads(path.read_text(encoding="utf-8"))
        if header["format"] != "savmap-dataset" or header["version"] != 1:
            raise OutputError(f"{path}: not a savmap-dataset of version 1")
        return [str(name) for name in header["classes"]], str(header.get("renderer", "unknown"))
    except FileNotFoundError as error:
        raise OutputError(f"{folder}: no dataset.json; give the folder of a data set (see docs/training.md)") from error
    except (ValueError, KeyError, TypeError) as error:
        raise OutputError(f"{path}: malformed ({error}); expected format, version and classes") from error


def read_dataset(folder: Path, classes: Sequence[str]) -> Dataset:
    """Check a folder and list its samples, in order of name. Raises OutputError for a folder that cannot be trained on."""
    theirs, renderer = read_header(folder)
    missing = [name for name in classes if name not in theirs]
    if missing:
        raise OutputError(f"{folder}: has no class {', '.join(missing)} (it has {', '.join(theirs)})")
    lookup = class_lookup(theirs, classes)
    pictures = sorted(p for p in (folder / "images").glob("*") if p.suffix in {".jpg", ".png"})
    samples = []
    for picture in pictures:
        mask = folder / "masks" / f"{picture.stem}.png"
        if mask.exists():
            samples.append(Sample(picture, mask, lookup, f"{folder.name}/{group_of(picture.stem)}"))
    if not samples:
        raise OutputError(f"{folder}: no picture in images/ has its mask in masks/")
    return Dataset(folder, renderer, tuple(samples))


def is_validation(group: str, share: float) -> bool:
    """Whether a scene is kept from training: decided by its name alone, so that it stays so when the data set grows."""
    digest = hashlib.sha256(group.encode()).digest()
    return int.from_bytes(digest[:4], "big") / 2**32 < share


def split(samples: Sequence[Sample], share: float = 0.06) -> tuple[list[Sample], list[Sample]]:
    """(training, validation) by scene; at least one sample in each."""
    validation = [sample for sample in samples if is_validation(sample.group, share)]
    training = [sample for sample in samples if not is_validation(sample.group, share)]
    if not validation or not training:
        return list(samples[1:] or samples), list(samples[:1])
    return training, validation


def sampling_weights(samples: Sequence[Sample], empty_weight: float = 0.2) -> NDArray[np.float64]:
    """Probability (n,) of drawing each sample.

    Pictures without any class are drawn less often. A data set's share goes with the square root of its number of pictures,
    so that a small one with another look counts for more than its size.
    """
    weights = np.array([1.0 if _shows_class(sample) else empty_weight for sample in samples])
    folders = np.array([str(sample.mask.parent) for sample in samples])
    for folder in np.unique(folders):
        weights[folders == folder] /= np.sqrt(np.sum(folders == folder))
    probabilities: NDArray[np.float64] = weights / weights.sum()
    return probabilities


def _shows_class(sample: Sample) -> bool:
    mask = cv2.imread(str(sample.mask), cv2.IMREAD_GRAYSCALE)
    if mask is None:
        raise OutputError(f"{sample.mask}: cannot be read; render this data set again")
    values = np.unique(sample.lookup[mask])
    return bool(np.any((values != 0) & (values != IGNORE)))
