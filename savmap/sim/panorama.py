"""Equirectangular pictures of a built scene, and the classes that any view cut from them would see."""

from collections.abc import Iterator, Sequence

import numpy as np

from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.sim.primitives import Floats
from savmap.sim.scene import Look
from savmap.sim.shade import Image, Mask, Renderer, compressed, developed, different
from savmap.sim.surfaces import Singles
from savmap.types import ViewSpec

_SUBPIXELS = ((-0.25, -0.12), (0.12, -0.25), (0.25, 0.12), (-0.12, 0.25))
_BAND_PIXELS = 250_000


def panorama(
    scene: Renderer, origin: Floats, world_from_rig: Floats, height: int, look: Look, seed: Sequence[int] = (0,)
) -> Image:
    """The panorama (height, 2 height, 3) RGB of a rig at `origin` (3,) m; `seed` fixes its noise."""
    rng = np.random.default_rng(list(seed))
    bands = linear_bands(scene, origin, world_from_rig, height)
    return np.concatenate([developed(band, look, None, rng) for band in bands])


def linear_bands(scene: Renderer, origin: Floats, world_from_rig: Floats, height: int) -> Iterator[Singles]:
    """The panorama's linear radiance, a few rows at a time from the top (rows, 2 height, 3): memory stays bounded."""
    rows = max(2, _BAND_PIXELS // (2 * height))
    for top in range(0, height, rows):
        yield _band(scene, origin, world_from_rig, height, (top, min(top + rows, height)))


def _band(scene: Renderer, origin: Floats, world_from_rig: Floats, height: int, rows: tuple[int, int]) -> Singles:
    first, last = max(rows[0] - 1, 0), min(rows[1] + 1, height)
    u, v = np.meshgrid(np.arange(2 * height), np.arange(first, last))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float64)
    color, hits = scene.radiance(origin, _rays(pixels, height, world_from_rig), np.pi / height)
    color = compressed(color)
    edge = different(hits, (last - first, 2 * height), wrap=True)
    edge[: rows[0] - first] = False
    edge[rows[1] - first :] = False
    chosen = np.flatnonzero(edge)
    finer = np.concatenate([_rays(pixels[chosen] + offset, height, world_from_rig) for offset in _SUBPIXELS])
    samples, _ = scene.radiance(origin, finer, np.pi / height / 2)
    color[chosen] = compressed(samples).reshape(len(_SUBPIXELS), -1, 3).mean(0)
    return color.reshape(last - first, 2 * height, 3)[rows[0] - first : rows[1] - first]


def _rays(pixels: Floats, height: int, world_from_rig: Floats) -> Floats:
    world: Floats = rays_from_panorama_pixels(pixels, height) @ world_from_rig.T
    return world


def view_classes(
    scene: Renderer, origin: Floats, world_from_rig: Floats, spec: ViewSpec, classes: Sequence[str]
) -> Mask:
    """The classes (height, width) a view sees at its pixels' centres: 0 background, k for classes[k - 1]."""
    u, v = np.meshgrid(np.arange(spec.width), np.arange(spec.height))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float64)
    hits = scene.caster.cast(origin, spec.rig_rays(pixels) @ world_from_rig.T)
    return scene.caster.labels(hits, classes).reshape(spec.height, spec.width)
