"""Printed plates pasted into labelled pictures that have none: `python -m savmap_signs.lab.pasted DIR... --count 600 -o
OUT`.

Much quicker than casting rays, and of any renderer or camera: each plate is turned in space, lit as the place that it
covers, and as sharp and noisy as the picture.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import OutputError, ending_in_one_line
from savmap.geometry.pinhole import rig_from_view
from savmap.lab.sim.dataset import series_options, write_samples
from savmap.types import Floats
from savmap_signs.lab.artwork import Picture, artwork
from savmap_signs.lab.random_plates import code_of, series_style, text_of
from savmap_signs.lab.scene import CORNERS, shown

CLASSES = ("sign",)
MOST = 7
WIDTHS_PX = (16.0, 170.0)
HUNG_SHARE = 0.4


def pasted(picture: Picture, fronts: NDArray[np.bool_], rng: np.random.Generator) -> tuple[Picture, Picture]:
    """A picture (h, w, 3) RGB with some plates, and their mask (h, w); most stand on `fronts` (h, w) where there are
    any."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    style = series_style(rng)
    scale = float(np.exp(rng.uniform(*np.log(WIDTHS_PX))))
    places = np.argwhere(fronts)
    for number in range(int(rng.integers(0, MOST))):
        style = series_style(rng) if rng.random() < 0.3 else style
        on_front = len(places) and rng.random() > HUNG_SHARE
        row, column = places[rng.integers(len(places))] if on_front else rng.uniform(0, 1, 2) * mask.shape
        quad, plate = _plate(rng, style, number, scale * float(rng.uniform(0.7, 1.5)))
        picture, mask = _put(picture, mask, plate, quad + np.array([column, row]), rng)
    return picture, mask


def _plate(rng: np.random.Generator, style: dict[str, object], number: int, width: float) -> tuple[Floats, Picture]:
    """Corners (4, 2) px about a plate's middle, and its print."""
    size = 0.3, 0.3 * float(rng.uniform(0.35, 0.9))
    code = code_of(rng)
    text = text_of(rng, number) if rng.random() < 0.93 else ""
    paper, ink = (shown(style[key]) for key in ("paper", "ink"))  # type: ignore[arg-type]
    font, border = str(style["font"]), bool(style["border"])
    plate = artwork(text, size, paper, ink, font, border, code["code"], code["content"] or text or "1")
    turn = rig_from_view(float(rng.normal(0, 30)), float(rng.normal(0, 8)), float(rng.normal(0, 3)))
    flat = np.column_stack([CORNERS * size * [1, -1], np.zeros(4)]) @ turn.T
    depth = 0.3 / width * 400
    quad: Floats = 400 * flat[:, :2] / (depth + flat[:, 2:])
    return quad, plate


def _put(
    picture: Picture, mask: Picture, plate: Picture, quad: Floats, rng: np.random.Generator
) -> tuple[Picture, Picture]:
    height, width = mask.shape
    small = _shrunk(plate, quad)
    source = np.array([[0, 0], [small.shape[1], 0], small.shape[1::-1], [0, small.shape[0]]], np.float32) - 0.5
    warp = cv2.getPerspectiveTransform(source, quad.astype(np.float32))
    share = _outline(quad, (height, width))
    if share.max() < 0.5:
        return picture, mask
    drawn = cv2.warpPerspective(small, warp, (width, height), borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    around = picture[share > 0.5].astype(np.float32).mean()
    light = float(np.clip(around / 120, 0.25, 1.3)) * float(rng.uniform(0.7, 1.3))
    slope = rng.normal(0, 0.0012, 2) @ np.stack(
        [np.mgrid[:height, :width][k] - quad.mean(0)[1 - k] for k in (0, 1)]
    ).reshape(2, -1)
    lit = drawn * (light * np.clip(1 + slope, 0.5, 1.5).reshape(height, width, 1)) + rng.normal(0, 3, drawn.shape)
    blended = picture + share[..., None] * (np.clip(lit, 0, 250) - picture)
    return np.round(blended).astype(np.uint8), np.where(share > 0.5, 1, mask).astype(np.uint8)


def _shrunk(plate: Picture, quad: Floats) -> Picture:
    """The print about as fine as it will be seen."""
    sides = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
    size = max(int(1.3 * max(sides[0], sides[2])), 8), max(int(1.3 * max(sides[1], sides[3])), 6)
    return np.asarray(cv2.resize(plate, size, interpolation=cv2.INTER_AREA), np.uint8)


def _outline(quad: Floats, shape: tuple[int, int]) -> NDArray[np.float32]:
    """The share (h, w) of each pixel that a quadrilateral covers."""
    fine = np.zeros((4 * shape[0], 4 * shape[1]), np.uint8)
    cv2.fillConvexPoly(fine, np.round(4 * quad + 1.5).astype(np.int32), 255)
    return np.asarray(cv2.resize(fine, shape[::-1], interpolation=cv2.INTER_AREA) / 255, np.float32)


def pictures_of(folder: Path) -> list[Path]:
    """The pictures of a data set. Raises OutputError where there are none."""
    pictures = sorted((folder / "images").glob("*"))
    if not pictures:
        raise OutputError(f"{folder}: no pictures in its folder images; give a data set (see docs/training.md)")
    return pictures


def samples(images: Sequence[Path], count: int, seed: int) -> Iterator[tuple[str, Picture, Picture]]:
    """`count` of the pictures, in random order, with plates; named by what they were, so that a scene stays one."""
    rng = np.random.default_rng([seed, 80])
    for index in rng.permutation(len(images))[:count]:
        path = images[index]
        bgr, old = cv2.imread(str(path)), cv2.imread(str(path.parent.parent / "masks" / f"{path.stem}.png"), 0)
        if bgr is None or old is None:
            continue
        picture, mask = pasted(np.asarray(bgr[..., ::-1], np.uint8), (old > 0) & (old < 3), rng)
        yield f"pasted-{seed}-{path.parent.parent.name}-{path.stem}", picture, mask


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="plates pasted into labelled pictures that have none")
    parser.add_argument("data", type=Path, nargs="+")
    options = series_options(parser, arguments)
    with ending_in_one_line():
        images = [path for folder in options.data for path in pictures_of(folder)]
        write_samples(options.output, CLASSES, "pasted plates", samples(images, options.count, options.seed))


if __name__ == "__main__":
    main()
