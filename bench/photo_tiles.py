"""Labelled photographs as pictures for training: tiles at two sizes.

    python -m bench photo-tiles --keep data/photos [--cache DIR] [--teacher FILE.onnx]

The photographs of `plugins/shelves/training/photos.json`, which stand under CC0, CC-BY, MIT and Apache-2.0, are fetched by address and digest; our
labels of them lie beside it (LabelMe: shapes in painting order, later over earlier; `ignore` does not count, `background` is none of the
classes). With `--teacher` they are completed by what a network sees at three scales: a member's sides are told from its front, and what is to be
ignored is judged where the network is sure. Each is cut into half overlapping tiles of 640x480 at its size (at most 1280 px wide) and, where it is large, at half of it.
A data set of savmap's format is written. None of the photographs of `python -m bench photos` is among them.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.baseline import Figures
from bench.photo_files import PHOTOS, photo, scaled
from bench.photos import Maps, scales
from savmap.lab.train.data.dataset import IGNORE
from savmap.vision.networks.segmenter import Segmenter

TRAINING = Path(__file__).parent.parent / "plugins" / "shelves" / "training"
CLASSES = ("upright", "beam", "upright_side", "beam_side")
VALUES = {"upright": 1, "beam": 2, "background": 0, "ignore": 255}
WIDTH, HEIGHT, HALVED_FROM, LEAST_JUDGED = 640, 480, 800, 0.25
SURE = 0.8
"""Where a teacher is less, what is to be ignored stays so."""
BLOCK = 20
Bytes = NDArray[np.uint8]
Labelled = tuple[Bytes, Bytes]


def mask_of(labels: Path, shape: tuple[int, int]) -> Bytes:
    """The mask (H, W) that a LabelMe file's shapes paint."""
    mask = np.zeros(shape, np.uint8)
    for drawn in json.loads(labels.read_text(encoding="utf-8"))["shapes"]:
        corners = np.round((np.array(drawn["points"]) - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(mask, [corners], VALUES[drawn["label"]], shift=4)
    return mask


def completed(mask: Bytes, maps: Maps) -> Bytes:
    """A mask (H, W) whose members are whole, with their sides, and with what is ignored judged where a teacher is sure; `maps`
    (1 + classes, H, W) are its probabilities."""
    seen = np.argmax(maps, axis=0).astype(np.uint8)
    result = np.where((mask == IGNORE) & (maps.max(axis=0) > SURE), seen, mask)
    for front, side in ((1, 3), (2, 4)):
        result[(mask == front) & (maps[side] > maps[front])] = side
    return result


def halved(image: Bytes, mask: Bytes) -> Labelled:
    """Both at half the size; a pixel's class is that of most of it."""
    size = (image.shape[1] // 2, image.shape[0] // 2)
    values = np.unique(mask)
    shares = [cv2.resize((mask == value).astype(np.float32), size, interpolation=cv2.INTER_AREA) for value in values]
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), values[np.argmax(shares, axis=0)]


def tiles(image: Bytes, mask: Bytes) -> Iterator[Labelled]:
    """Tiles of 640x480 that cover the picture, but for those that are hardly judged; what is beyond its border is not judged."""
    height, width = mask.shape
    for top in range(0, max(height - HEIGHT // 2, 1), HEIGHT // 2):
        for left in range(0, max(width - WIDTH // 2, 1), WIDTH // 2):
            first, begin = max(min(top, height - HEIGHT), 0), max(min(left, width - WIDTH), 0)
            place = slice(first, first + HEIGHT), slice(begin, begin + WIDTH)
            picture, known = np.full((HEIGHT, WIDTH, 3), 127, np.uint8), np.full((HEIGHT, WIDTH), 255, np.uint8)
            part = image[place]
            picture[: part.shape[0], : part.shape[1]], known[: part.shape[0], : part.shape[1]] = part, mask[place]
            if (known != 255).mean() >= LEAST_JUDGED:
                yield picture, known


def write_tiles(output: Path, cache: Path, teacher: Path | None = None) -> int:
    """Write the data set; how many tiles it has. Raises PhotoMissingError, ModelError."""
    segmenter = Segmenter(teacher, 1, providers=("cpu",)) if teacher is not None else None
    order = [0, *(segmenter.classes.index(name) + 1 for name in CLASSES)] if segmenter is not None else []
    for folder in ("images", "masks"):
        (output / folder).mkdir(parents=True, exist_ok=True)
    number = 0
    for entry in json.loads((TRAINING / "photos.json").read_text(encoding="utf-8")):
        image = scaled(photo(entry, cache))
        mask = mask_of(TRAINING / "labels" / f"{entry['name']}.json", image.shape[:2])
        if segmenter is not None:
            mask = completed(mask, scales(segmenter.probabilities, image, 0.0)[order])
        sizes = [(image, mask), halved(image, mask)] if image.shape[1] >= HALVED_FROM else [(image, mask)]
        for tile, known in (pair for size in sizes for pair in tiles(*size)):
            name = f"{entry['name'].replace('_', '-')}-{number:05d}"
            bgr = np.ascontiguousarray(tile[..., ::-1])
            cv2.imwrite(str(output / "images" / f"{name}.jpg"), bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])
            cv2.imwrite(str(output / "masks" / f"{name}.png"), known)
            number += 1
        number = (number // BLOCK + 1) * BLOCK
    header = {"format": "savmap-dataset", "version": 1, "classes": list(CLASSES), "renderer": "photographs"}
    (output / "dataset.json").write_text(json.dumps(header, indent=1) + "\n", encoding="utf-8")
    return len(list((output / "images").iterdir()))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this tool."""
    parser.add_argument("--keep", type=Path, required=True, help="the folder of the data set")
    parser.add_argument("--cache", type=Path, default=PHOTOS)
    parser.add_argument("--teacher", type=Path, help="a network of these four classes that completes labels")


def run(given: argparse.Namespace) -> Figures:
    """Write the tiles."""
    print(f"{given.keep}: {write_tiles(given.keep, given.cache, given.teacher)} tiles")
    return {}
