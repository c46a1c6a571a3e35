"""Light on all surfaces of a scene, computed once: direct light of the lamps with shadows, and a few bounces.

Every face carries a small grid of texels; a view looks its light up there, so that footage of a static scene is cheap.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from savmap.lab.sim.render.raycast import Caster, Hits
from savmap.lab.sim.render.surfaces import Indices, Singles, Surfaces
from savmap.types import Floats

_LAMPS_A_TEXEL = 6
_GATHERED = 24
_BOUNCES = 4
_CHUNK = 40_000
_LIFT_M = 0.004
_SMOOTHED_FROM = 5
_BRIGHTEST = 5.0
_BRIGHTEST_BOUNCE = 1.5


@dataclass(frozen=True, eq=False)
class Lightmap:
    """`light` (n, 3), mean near 1, in texels: those of face f begin at start[f], row by row, cells[f] (along,
    aside)."""

    start: Indices
    cells: Indices
    light: Singles

    def lookup(self, face: Indices, share: Singles) -> Singles:
        """Light (n, 3) at `share` (n, 2) in 0..1 of the lengths of faces (n,), between the texels' centres."""
        cells = self.cells.take(face, axis=0)
        count = cells.astype(np.float32)
        at = np.clip(share * count - np.float32(0.5), 0, count - 1)
        low = np.minimum(at.astype(np.int64), np.maximum(cells - 2, 0))
        part = at - low.astype(np.float32)
        first = self.start.take(face) + low[:, 1] * cells[:, 0] + low[:, 0]
        right = (cells[:, 0] > 1).astype(np.int64)
        up = np.where(cells[:, 1] > 1, cells[:, 0], 0)
        corners = [self.light.take(first + step, axis=0) for step in (0, right, up, up + right)]
        bottom, top = (_mix(left, more, part[:, :1]) for left, more in (corners[:2], corners[2:]))
        return _mix(bottom, top, part[:, 1:])


def _mix(a: Singles, b: Singles, share: Singles) -> Singles:
    return a + share * (b - a)


def bake(caster: Caster, surfaces: Surfaces, texel_m: float, ambient: float, color: Floats, seed: int) -> Lightmap:
    """The light of a scene. `ambient` is added light as a share of the mean, `color` (3,) tints the lamps."""
    cells = np.clip(np.round(surfaces.lengths / texel_m), 1, 96).astype(np.int64)
    texels = _texels(surfaces, cells)
    rng = np.random.default_rng([seed, 5])
    power = _direct(caster, surfaces, texels, rng)
    lamps = np.minimum(power / max(_typical(power, caster, texels.face), 1e-9), _BRIGHTEST)[:, None] * np.asarray(color)
    direct = Lightmap(texels.start, cells, lamps.astype(np.float32))
    direct = Lightmap(texels.start, cells, _smoothed(direct, direct.light))
    return _bounced(
        direct, _gather(direct, caster, surfaces, texels, rng), surfaces.mean_albedo()[texels.face // 6], ambient
    )


@dataclass(frozen=True, eq=False)
class _Texels:
    """Where light is computed: `point` (n, 3) on faces `face` (n,), the first of face f at start[f]."""

    start: Indices
    face: Indices
    point: Floats


def _texels(surfaces: Surfaces, cells: Indices) -> _Texels:
    counts = cells[:, 0] * cells[:, 1]
    start = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    face = np.repeat(np.arange(len(cells)), counts)
    index = np.arange(len(face)) - start[face]
    step = np.stack([index % cells[face, 0], index // cells[face, 0]], axis=1)
    place = (step + 0.5) / cells[face] * surfaces.lengths[face]
    point = surfaces.corner[face] + place[:, :1] * surfaces.along[face] + place[:, 1:] * surfaces.across[face]
    return _Texels(start, face, point + _LIFT_M * surfaces.normal[face])


def _typical(light: Floats, caster: Caster, face: Indices) -> float:
    labelled = np.array(["+z" in box.face_labels for box in caster.boxes])[face // 6] & (face % 6 == 5)
    lit = light[labelled & (light > 0)] if labelled.any() else light[light > 0]
    return float(lit.mean()) if len(lit) else 1.0


@dataclass(frozen=True, eq=False)
class _Lamps:
    center: Floats
    size: Floats
    flux: Floats


def _direct(caster: Caster, surfaces: Surfaces, texels: _Texels, rng: np.random.Generator) -> Floats:
    glowing = [box for box in caster.boxes if box.material.emission > 0]
    if not glowing:
        return np.ones(len(texels.point))
    size = np.array([box.size for box in glowing])
    flux = np.array([box.material.emission for box in glowing]) * size[:, 0] * size[:, 2]
    lamps = _Lamps(np.array([box.center for box in glowing]), size, flux)
    normal = surfaces.normal[texels.face].astype(np.float64)
    return np.concatenate([_lit(caster, texels.point[c], normal[c], lamps, rng) for c in _chunks(len(texels.point))])


def _chunks(count: int) -> list[Indices]:
    return np.array_split(np.arange(count), max(1, count // _CHUNK))


def _lit(caster: Caster, point: Floats, normal: Floats, lamps: _Lamps, rng: np.random.Generator) -> Floats:
    center, size, flux = lamps.center, lamps.size, lamps.flux
    _, weight = _towards(point[:, None], normal[:, None], center, flux)
    most = min(_LAMPS_A_TEXEL, len(center))
    chosen = np.argpartition(-weight, most - 1, axis=1)[:, :most]
    picked = np.take_along_axis(weight, chosen, axis=1)
    lamp = center[chosen] + rng.uniform(-0.45, 0.45, (*chosen.shape, 3)) * size[chosen]
    side = np.where(point[:, None, 1] < center[chosen, 1], -1, 1)
    lamp[..., 1] = center[chosen, 1] + side * (size[chosen, 1] / 2 + 0.01)
    offset, strength = _towards(point[:, None], normal[:, None], lamp, flux[chosen])
    distance = np.linalg.norm(offset, axis=-1)
    flat = (offset / distance[..., None]).reshape(-1, 3)
    shadow = caster.blocked(point.repeat(most, axis=0), flat, distance.ravel() - 0.02).reshape(distance.shape)
    rest = weight.sum(1) / np.maximum(picked.sum(1), 1e-12)
    total: Floats = (strength * ~shadow).sum(1) * np.minimum(rest, 3.0)
    return total


def _towards(point: Floats, normal: Floats, lamp: Floats, flux: Floats) -> tuple[Floats, Floats]:
    offset = lamp - point
    square = (offset * offset).sum(-1) + 0.02
    cosine = np.maximum((offset * normal).sum(-1), 0) / np.sqrt(square)
    below = np.maximum(offset[..., 1], 0) / np.sqrt(square)
    return offset, flux * cosine * (0.3 + 0.7 * below) / square


def _bounced(direct: Lightmap, seen: Indices, paint: Singles, ambient: float) -> Lightmap:
    open_share = (seen < 0).mean(1, keepdims=True).astype(np.float32)
    light = direct.light
    for _ in range(_BOUNCES):
        radiosity = np.concatenate([np.minimum(light * paint, _BRIGHTEST_BOUNCE), np.zeros((1, 3), np.float32)])
        bounced = _smoothed(direct, radiosity[seen].mean(1) + ambient * (0.35 + 0.65 * open_share))
        light = (direct.light + bounced).astype(np.float32)
    return Lightmap(direct.start, direct.cells, light)


def _smoothed(flat: Lightmap, light: Singles) -> Singles:
    """Light (n, 3) averaged over three by three texels of the faces that have so many."""
    smooth = light.copy()
    for face in np.flatnonzero(flat.cells.min(1) >= _SMOOTHED_FROM):
        first, (along, across) = flat.start[face], flat.cells[face]
        part = slice(first, first + along * across)
        grid = light[part].reshape(across, along, 3)
        smooth[part] = cv2.blur(grid, (3, 3), borderType=cv2.BORDER_REPLICATE).reshape(-1, 3)
    return smooth


def _gather(direct: Lightmap, caster: Caster, surfaces: Surfaces, texels: _Texels, rng: np.random.Generator) -> Indices:
    """The texels that _GATHERED cosine-distributed rays from every texel see: (n, _GATHERED), -1 for far or none."""
    texels_seen = []
    for chunk in _chunks(len(texels.point)):
        face = texels.face[chunk]
        axes = np.stack([surfaces.along[face], surfaces.across[face], surfaces.normal[face]], axis=1)
        rays = np.einsum("nki,nij->nkj", _cosine_rays(len(chunk), rng), axes).reshape(-1, 3)
        hits = caster.cast(texels.point[chunk].repeat(_GATHERED, axis=0), rays)
        texels_seen.append(_texel_of(direct, surfaces, hits).reshape(-1, _GATHERED))
    return np.concatenate(texels_seen)


def _cosine_rays(count: int, rng: np.random.Generator) -> Floats:
    index = np.arange(_GATHERED)
    turn = 2 * np.pi * (index * 0.618034 + rng.uniform(0, 1, (count, 1)))
    radius = np.sqrt((index + rng.uniform(0, 1, (count, 1))) / _GATHERED)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - radius**2)], axis=-1)


def _texel_of(flat: Lightmap, surfaces: Surfaces, hits: Hits) -> Indices:
    hit = np.where(hits.box >= 0, hits.box * 6 + hits.face, 0)
    share = surfaces.place(hit, hits.point.astype(np.float32)) / surfaces.lengths[hit]
    cells = flat.cells[hit]
    cell = np.clip((share * cells).astype(np.int64), 0, cells - 1)
    texel = flat.start[hit] + cell[:, 1] * cells[:, 0] + cell[:, 0]
    near = (hits.box >= 0) & (hits.distance < 8.0)
    return np.where(near, texel, -1)
