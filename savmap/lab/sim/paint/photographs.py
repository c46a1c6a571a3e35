"""Crops of photographs as textures: any folder of pictures."""

from pathlib import Path

import cv2
import numpy as np

from savmap.lab.sim.paint.atlas import TILE, Texture
from savmap.lab.sim.paint.noise import Random
from savmap.video.image_folder import SUFFIXES

_LEAST_PX = 64


def photograph_paths(folder: Path) -> list[Path]:
    """The pictures of a folder and the folders in it, sorted by name."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())


def crop(path: Path, rng: Random) -> Texture | None:
    """A square part of a picture, turned and mirrored at random; None where it cannot be read or is tiny."""
    data = np.frombuffer(path.read_bytes(), np.uint8)
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if bgr is None or min(bgr.shape[:2]) < _LEAST_PX:
        return None
    side = int(rng.uniform(0.35, 1.0) * min(bgr.shape[:2]))
    top, left = (int(rng.integers(0, have - side + 1)) for have in bgr.shape[:2])
    part = cv2.resize(bgr[top : top + side, left : left + side], (TILE, TILE), interpolation=cv2.INTER_AREA)
    turned = np.rot90(part, int(rng.integers(4)))[:, :: int(rng.choice([-1, 1])), ::-1]
    texture: Texture = np.dstack([turned, np.full((TILE, TILE), 255, np.uint8)])
    return texture


def crops(folder: Path | None, count: int, rng: Random) -> list[Texture]:
    """Up to `count` crops of a folder's pictures, none without a folder."""
    paths = photograph_paths(folder) if folder is not None else []
    if not paths:
        return []
    chosen = rng.choice(len(paths), count, replace=count > len(paths))
    textures = [crop(paths[index], rng) for index in chosen]
    return [texture for texture in textures if texture is not None]
