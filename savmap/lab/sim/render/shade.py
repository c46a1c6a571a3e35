"""Pictures of a built scene: rays are cast, painted and lit; more rays are cast where neighbouring pixels differ."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.lab.scenes import Exposure
from savmap.lab.sim.render.lightmap import Lightmap, bake
from savmap.lab.sim.render.raycast import Caster, Hits
from savmap.lab.sim.render.surfaces import Indices, Singles, Surfaces, surfaces_of
from savmap.lab.sim.scene.build import Built
from savmap.types import Floats

Image = NDArray[np.uint8]
Mask = NDArray[np.uint8]

_SUBPIXELS = ((-0.25, -0.12), (0.12, -0.25), (0.25, 0.12), (-0.12, 0.25))
_WHITE_AT = 0.62
_GREY = 0.4


@dataclass(frozen=True, eq=False)
class Renderer:
    """A scene made ready for many pictures."""

    built: Built
    caster: Caster
    surfaces: Surfaces
    lightmap: Lightmap

    def radiance(self, origin: Floats, rays: Floats, pixel_rad: float) -> tuple[Singles, Hits]:
        """Linear RGB (n, 3) along unit rays (n, 3) of the world, a pixel being `pixel_rad` wide; and what they hit."""
        hits = self.caster.cast(origin, rays)
        color = self._seen(hits, rays, pixel_rad)
        mirror = np.flatnonzero((hits.box >= 0) & (self.surfaces.gloss[hits.box] > 0))
        if len(mirror):
            color[mirror] += self._mirrored(hits, rays, mirror, pixel_rad)
        return color, hits

    def _seen(self, hits: Hits, rays: Floats, pixel_rad: float) -> Singles:
        face: Indices = np.where(hits.box >= 0, hits.box * 6 + hits.face, 0)
        place = self.surfaces.place(face, hits.point.astype(np.float32))
        facing = np.maximum(abs(np.einsum("ij,ij->i", hits.normal, rays)), 0.15)
        footprint = (np.where(hits.box >= 0, hits.distance, 0) * pixel_rad / facing).astype(np.float32)
        light = self.lightmap.lookup(face, place / self.surfaces.lengths.take(face, axis=0))
        color = self.surfaces.albedo(face, place, footprint) * light
        glow = self.surfaces.emission.take(hits.box, mode="wrap")
        lamp = glow > 0
        color[lamp] = glow[lamp, None] * self.surfaces.color[hits.box[lamp]]
        color[hits.box < 0] = 0
        return color

    def _mirrored(self, hits: Hits, rays: Floats, chosen: Indices, pixel_rad: float) -> Singles:
        normal, ray = hits.normal[chosen], rays[chosen]
        cosine = -np.einsum("ij,ij->i", normal, ray)
        reflected = ray + 2 * cosine[:, None] * normal
        seen = self._seen(self.caster.cast(hits.point[chosen] + 0.002 * normal, reflected), reflected, 4 * pixel_rad)
        gloss = self.surfaces.gloss[hits.box[chosen]]
        share = gloss + (1 - gloss) * np.clip(1 - cosine, 0, 1) ** 5
        strength: Singles = ((0.5 * share)[:, None] * np.minimum(seen, 3.0)).astype(np.float32)
        return strength


def renderer(built: Built) -> Renderer:
    """A scene's renderer: its rays and its light. Raises RayCasterMissing."""
    caster, surfaces = Caster(built.boxes), surfaces_of(built.boxes)
    appearance = built.scene.look
    light = bake(
        caster, surfaces, appearance.texel, appearance.ambient, np.array(appearance.light_color), built.scene.seed
    )
    return Renderer(built, caster, surfaces, light)


def antialiased(
    scene: Renderer,
    origin: Floats,
    rays_of: Callable[[tuple[float, float], Indices], Floats],
    shape: tuple[int, int],
    pixel_rad: float,
    inside: slice = slice(None),
    wrap: bool = False,
) -> tuple[Singles, Hits]:
    """Bounded radiance (h, w, 3), edges smoothed by four more rays a pixel, and what the pixels' centres hit.

    `rays_of` gives the world rays (n, 3) of pixels (n,), moved by an offset in pixels; only the rows `inside` are
    smoothed.
    """
    pixels = np.arange(shape[0] * shape[1])
    color, hits = scene.radiance(origin, rays_of((0.0, 0.0), pixels), pixel_rad)
    color = compressed(color)
    edge = np.zeros(shape, dtype=bool)
    edge[inside] = different(hits, shape, wrap)[inside]
    chosen = np.flatnonzero(edge)
    finer, _ = scene.radiance(origin, np.concatenate([rays_of(step, chosen) for step in _SUBPIXELS]), pixel_rad / 2)
    color[chosen] = compressed(finer).reshape(len(_SUBPIXELS), -1, 3).mean(0)
    return color.reshape(*shape, 3), hits


def different(hits: Hits, shape: tuple[int, int], wrap: bool = False) -> NDArray[np.bool_]:
    """Pixels (h, w) next to one that shows another face of another box; `wrap` joins the left and right borders."""
    face = (hits.box * 6 + hits.face).reshape(shape)
    edge = np.zeros(shape, dtype=bool)
    across = face[:, 1:] != face[:, :-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    down = face[1:] != face[:-1]
    edge[1:] |= down
    edge[:-1] |= down
    if wrap:
        seam = face[:, 0] != face[:, -1]
        edge[:, 0] |= seam
        edge[:, -1] |= seam
    return edge


def developed(linear: Singles, appearance: Exposure, vignette: Floats | None, rng: np.random.Generator) -> Image:
    """An RGB picture (h, w, 3) from linear radiance: white balance, exposure, vignette (h, w), film curve, noise."""
    exposed = linear * (np.array(appearance.white_balance) * appearance.exposure * _WHITE_AT).astype(np.float32)
    if vignette is not None:
        exposed *= vignette[..., None].astype(np.float32)
    shown = np.clip(exposed, 0, None) ** np.float32(appearance.contrast)
    knee = np.where(shown < 0.6, shown, 1 - 0.4 * np.exp(-(shown - 0.6) / 0.4))
    encoded = np.where(knee < 0.0031, 12.92 * knee, 1.055 * np.maximum(knee, 1e-6) ** (1 / 2.4) - 0.055)
    if appearance.noise > 0:
        encoded = encoded + appearance.noise * rng.standard_normal(encoded.shape, dtype=np.float32)
    return np.clip(255 * encoded + 0.5, 0, 255).astype(np.uint8)


def metered(appearance: Exposure, linear: Singles, strength: float = 1.0) -> Exposure:
    """The look as a camera would expose it that sees `linear`: at strength 1 its mean becomes a mid grey."""
    grey = max(float(np.minimum(linear, 1.5).mean()), 0.02)
    return appearance.model_copy(update={"exposure": appearance.exposure * (_GREY / grey) ** strength})


def compressed(linear: Singles) -> Singles:
    """Radiance bounded before samples are averaged, so that a lamp's bright edge stays smooth."""
    bounded: Singles = np.minimum(linear, np.float32(4.0))
    return bounded
