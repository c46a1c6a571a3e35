"""Colours of what a picture sees, in one pass over its pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.lab.sim.paint.atlas import LEVELS, TILE, Atlas
from savmap.lab.sim.paint.faces import Faces, Lighting, Singles, lit
from savmap.lab.sim.paint.raster import NOTHING, Camera, Seen, facing, filled, outlines_in_view, rasterise
from savmap.lab.sim.paint.stage import IGNORED

SUPERSAMPLING = 1.5
THINNEST_PX = 3.0
"""Labelled members that look thinner are not to be judged."""

_BAND = 48
_LIT_GAMMA = 2.0


@dataclass(frozen=True)
class Painted:
    """A picture in linear light and its classes."""

    linear: Singles  # (h, w, 3)
    mask: NDArray[np.uint8]  # (h, w)


def painted(
    faces: Faces,
    atlas: Atlas,
    lighting: Lighting,
    camera: Camera,
    size: tuple[int, int],
    classes: int,
    haze: float = 0.0,
) -> Painted:
    """A picture (width, height) of faces with its mask: a pixel belongs to what covers most of it.

    `haze`: the share of light that air takes on a metre, and replaces by the picture's mean."""
    fine = round(size[0] * SUPERSAMPLING), round(size[1] * SUPERSAMPLING)
    kept = faces.chosen(facing(faces, camera))
    seen = rasterise(kept, camera, fine)
    light = lit(kept, lighting, camera.origin)
    linear = coloured(kept, atlas, seen, light)
    _draw_veils(linear, kept, atlas, seen, light)
    if haze > 0:
        clear = np.exp(-np.float32(haze) / np.maximum(seen.nearness, 1e-3))[..., None]
        linear = clear * linear + (1 - clear) * linear.mean(axis=(0, 1))
    small = np.asarray(cv2.resize(linear, size, interpolation=cv2.INTER_AREA), np.float32)
    return Painted(small, mask_of(kept, seen, size, classes))


def coloured(faces: Faces, atlas: Atlas, seen: Seen, light: Singles) -> Singles:
    """Linear colours (h, w, 3) of the seen faces; black where there is none."""
    table = _table(faces, atlas, seen, light)
    height, width = seen.faces.shape
    linear = np.empty((height, width, 3), np.float32)
    x = np.arange(width, dtype=np.float32)
    for top in range(0, height, _BAND):
        rows = slice(top, min(top + _BAND, height))
        y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None]
        linear[rows] = _band(table, atlas, seen, rows, x, y)
    linear[seen.faces == NOTHING] = 0
    return linear


def _table(faces: Faces, atlas: Atlas, seen: Seen, light: Singles) -> Singles:
    """What a pixel needs of its face, (18, N)."""
    left, top = atlas.corner(faces.tile)
    extents = np.stack([np.linalg.norm(faces.u, axis=1), np.linalg.norm(faces.v, axis=1)], axis=1)
    texels = (TILE * np.abs(faces.texture[:, :2]) / np.maximum(extents, 1e-6)).max(axis=1)
    focal = seen.camera.pixels(seen.faces.shape[1], seen.faces.shape[0])[0]
    columns = [*seen.planes[:, 0].T, *seen.planes[:, 1].T, *light.T, *faces.texture.T, left, top]
    columns += [np.log2(np.maximum(texels / focal, 1e-9)), *faces.tint.T]
    return np.stack(columns).astype(np.float32)


def _band(table: Singles, atlas: Atlas, seen: Seen, rows: slice, x: Singles, y: Singles) -> Singles:
    which = seen.faces[rows]
    distance = 1 / np.maximum(seen.nearness[rows], 1e-6)

    def of(column: int) -> Singles:
        return np.take(table[column], which, mode="clip")

    a = np.clip((of(0) * x + of(1) * y + of(2)) * distance, 0, 1)
    b = np.clip((of(3) * x + of(4) * y + of(5)) * distance, 0, 1)
    below = of(6) + (of(7) - of(6)) * a
    light = below + (of(8) + (of(9) - of(8)) * a - below) * b
    level = np.clip(np.floor(of(16) + np.log2(distance) + 0.4), 0, LEVELS - 1).astype(np.int32)
    size = (TILE >> level).astype(np.float32)
    s = a * of(10) + of(12)
    t = (1 - b) * of(11) + of(13)
    s -= np.floor(s - 1e-4)
    t -= np.floor(t - 1e-4)
    s = np.clip(s * size - 0.5, 0, size - 1) + of(14)
    t = np.clip(t * size - 0.5, 0, size - 1) + of(15) + atlas.level_top()[level]
    texels = atlas.look_up(s, t).astype(np.float32) / 255
    share = texels[..., 3]
    linear = np.empty((*which.shape, 3), np.float32)
    for channel in range(3):
        tint = 1 + share * (of(17 + channel) - 1)
        linear[..., channel] = texels[..., channel] ** _LIT_GAMMA * tint * light
    return linear


def _draw_veils(linear: Singles, faces: Faces, atlas: Atlas, seen: Seen, light: Singles) -> None:
    """Lays translucent faces over the picture, farthest first."""
    height, width = seen.faces.shape
    if not (faces.veil > 0).any():
        return
    for outline in reversed(outlines_in_view(faces, seen.camera, (width, height), faces.veil > 0)):
        index, (left, top, right, bottom) = outline.face, outline.box
        here = slice(top, bottom), slice(left, right)
        x = np.arange(left, right, dtype=np.float32)
        y = np.arange(top, bottom, dtype=np.float32)[:, None]
        maps = seen.planes[index].astype(np.float32)
        nearness = maps[2, 0] * x + maps[2, 1] * y + maps[2, 2]
        shown = filled(outline) & (nearness > seen.nearness[here] * 0.9995)
        distance = 1 / np.maximum(nearness, 1e-6)
        s = np.clip((maps[0, 0] * x + maps[0, 1] * y + maps[0, 2]) * distance, 0, 0.999)
        t = np.clip((maps[1, 0] * x + maps[1, 1] * y + maps[1, 2]) * distance, 0, 0.999)
        corner = atlas.corner(faces.tile[index : index + 1])
        texels = atlas.look_up(s * (TILE - 1) + corner[0], (1 - t) * (TILE - 1) + corner[1]).astype(np.float32) / 255
        opacity = (texels[..., 3] * np.float32(faces.veil[index]) * shown)[..., None]
        colour = texels[..., :3] ** 2 * faces.tint[index].astype(np.float32) * max(light[index].mean(), 1e-3)
        linear[here] += opacity * (colour - linear[here])


def mask_of(faces: Faces, seen: Seen, size: tuple[int, int], classes: int) -> NDArray[np.uint8]:
    """Classes (h, w) of a picture of this size, see `covering`; 255 not to be judged."""
    labels = np.take(faces.label, seen.faces, mode="clip")
    focal = seen.camera.pixels(seen.faces.shape[1], seen.faces.shape[0])[0]
    thickness = np.take(faces.thickness.astype(np.float32), seen.faces, mode="clip")
    thin = thickness * focal * seen.nearness < THINNEST_PX * SUPERSAMPLING
    labels = np.where(thin & (labels > 0), IGNORED, labels)
    labels[seen.faces == NOTHING] = 0
    return covering(labels, [*range(1, classes + 1), IGNORED], size)


def covering(labels: NDArray[np.int32], wanted: Sequence[int], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Of fine labels (H, W), for each coarser pixel 0 where 0 covers more than half of it, else the one that covers
    most."""
    mask = np.zeros((size[1], size[0]), np.uint8)
    most, covered = np.zeros((2, size[1], size[0]), np.float32)
    for label in wanted:
        share = np.asarray(
            cv2.resize((labels == label).astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32
        )
        mask[share > most] = label
        most = np.maximum(most, share)
        covered += share
    mask[covered < 0.4999] = 0
    return mask
