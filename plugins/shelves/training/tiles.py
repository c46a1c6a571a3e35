"""Labelled photographs as training tiles: python tiles.py PHOTOS LABELS -o data/photos

LABELS holds a LabelMe file for each photograph of `photos.json` (shapes in painting order; `ignore` is not judged, `background` is none
of the classes), PHOTOS the photographs by name. Each is cut into overlapping tiles of 640x480 at its own size (at most 1280 px wide) and at
half of it, and once shown whole. A data set of savmap's own kind is written.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

CLASSES = ("upright", "beam", "upright_side", "beam_side")
VALUES = {"upright": 1, "beam": 2, "background": 0, "ignore": 255}
WIDTH, HEIGHT, WIDEST, LEAST_JUDGED = 640, 480, 1280, 0.25
Bytes = NDArray[np.uint8]


def photograph(path: Path) -> Bytes:
    """A photograph (H, W, 3) BGR, at most 1280 px wide."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SystemExit(f"{path}: cannot be read")
    if image.shape[1] > WIDEST:
        size = (WIDEST, round(image.shape[0] * WIDEST / image.shape[1]))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(image, np.uint8)


def mask_of(labels: Path, shape: tuple[int, int]) -> Bytes:
    """The mask (H, W) that a LabelMe file's shapes paint, later ones over earlier ones."""
    mask = np.zeros(shape, np.uint8)
    for drawn in json.loads(labels.read_text(encoding="utf-8"))["shapes"]:
        corners = np.round((np.array(drawn["points"]) - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(mask, [corners], VALUES[drawn["label"]], shift=4)
    return mask


def halved(image: Bytes, mask: Bytes) -> tuple[Bytes, Bytes]:
    """Both at half the size; a pixel's class is that of most of it."""
    size = (image.shape[1] // 2, image.shape[0] // 2)
    values = np.unique(mask)
    shares = [cv2.resize((mask == value).astype(np.float32), size, interpolation=cv2.INTER_AREA) for value in values]
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), values[np.argmax(shares, axis=0)]


def tiles(image: Bytes, mask: Bytes) -> Iterator[tuple[Bytes, Bytes]]:
    """Tiles of 640x480 that cover the picture, half overlapping; what is beyond its border is not judged."""
    height, width = mask.shape
    across = range(0, max(width - WIDTH // 2, 1), WIDTH // 2)
    down = range(0, max(height - HEIGHT // 2, 1), HEIGHT // 2)
    for top in down:
        for left in across:
            left_in, top_in = max(min(left, width - WIDTH), 0), max(min(top, height - HEIGHT), 0)
            part, labels = (
                image[top_in : top_in + HEIGHT, left_in : left_in + WIDTH],
                mask[top_in : top_in + HEIGHT, left_in : left_in + WIDTH],
            )
            picture, known = np.full((HEIGHT, WIDTH, 3), 127, np.uint8), np.full((HEIGHT, WIDTH), 255, np.uint8)
            picture[: part.shape[0], : part.shape[1]], known[: labels.shape[0], : labels.shape[1]] = part, labels
            if (known != 255).mean() >= LEAST_JUDGED:
                yield picture, known


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path)
    parser.add_argument("labels", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    for folder in ("images", "masks"):
        (arguments.output / folder).mkdir(parents=True, exist_ok=True)
    index = {entry["name"]: entry["file"] for entry in json.loads((arguments.photos / "index.json").read_text())}
    number = 0
    for labels in sorted(arguments.labels.glob("*.json")):
        image = photograph(arguments.photos / index[labels.stem])
        mask = mask_of(labels, image.shape[:2])
        sizes = [(image, mask), halved(image, mask)] if image.shape[1] >= 800 else [(image, mask)]
        for tile, known in (pair for size in sizes for pair in tiles(*size)):
            name = f"{labels.stem.replace('_', '-')}-{number:05d}"
            cv2.imwrite(str(arguments.output / "images" / f"{name}.jpg"), tile, [cv2.IMWRITE_JPEG_QUALITY, 95])
            cv2.imwrite(str(arguments.output / "masks" / f"{name}.png"), known)
            number += 1
        number = (number // 20 + 1) * 20
    header = {"format": "savmap-dataset", "version": 1, "classes": list(CLASSES), "renderer": "photographs"}
    (arguments.output / "dataset.json").write_text(json.dumps(header, indent=1) + "\n", encoding="utf-8")
    print(f"{arguments.output}: {len(list((arguments.output / 'images').iterdir()))} tiles")


if __name__ == "__main__":
    main()
