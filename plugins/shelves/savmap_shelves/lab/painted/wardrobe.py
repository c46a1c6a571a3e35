"""The textures of racks, goods and halls; and paints."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from savmap.lab.sim.paint import materials, prints
from savmap.lab.sim.paint.atlas import TILE, Texture
from savmap.lab.sim.paint.faces import Singles
from savmap.lab.sim.paint.noise import Random, texture
from savmap.lab.sim.paint.stage import Rgb
from savmap.lab.sim.paint.wardrobe import Recipes

_BANDS: tuple[tuple[Rgb, ...], ...] = (
    ((0.95, 0.75, 0.05), (0.07, 0.07, 0.07)),
    ((0.95, 0.95, 0.95), (0.8, 0.1, 0.08)),
    ((0.95, 0.75, 0.05), (0.95, 0.75, 0.05)),
)

TEXTURES: Recipes = {
    "paint": (8, lambda rng: _of(materials.worn(rng, float(rng.random())))),
    "zinc": (6, lambda rng: texture(materials.galvanised(rng), 1.0)),
    "zinc_post": (
        10,
        lambda rng: _post(rng, materials.galvanised(rng, upright=True), np.ones((TILE, TILE), np.float32)),
    ),
    "paint_post": (18, lambda rng: _post(rng, *materials.worn(rng, float(rng.random()) ** 3))),
    "zinc_flank": (4, lambda rng: _post(rng, materials.galvanised(rng, True), np.ones((TILE, TILE), np.float32), 0.5)),
    "paint_flank": (6, lambda rng: _post(rng, *materials.worn(rng, float(rng.random()) ** 3), 0.5)),
    "zinc_beam": (8, lambda rng: _beam(rng, materials.galvanised(rng), np.ones((TILE, TILE), np.float32))),
    "paint_beam": (14, lambda rng: _beam(rng, *materials.worn(rng, float(rng.random()) ** 3))),
    "carton": (56, prints.carton),
    "crate": (8, prints.crate),
    "barrel": (6, prints.barrel),
    "sack": (8, prints.sack),
    "wood": (8, materials.wood),
    "chipboard": (2, materials.chipboard),
    "floor": (6, materials.concrete),
    "plaster": (3, materials.plaster),
    "tiles": (3, materials.tiles),
    "ribbed": (5, materials.ribbed),
    "decking": (4, lambda rng: materials.ribbed(rng, upright=False)),
    "film": (8, materials.film),
    "shadow": (3, materials.shadow),
    "shine": (3, materials.shine),
    "label": (10, prints.label),
    "strip": (5, prints.strip),
    "poster": (10, prints.poster),
    "hazard": (4, lambda rng: materials.stripes(rng, _BANDS[int(rng.integers(len(_BANDS)))])),
    "cloth": (4, materials.woven),
    "plain": (1, lambda rng: texture(np.ones((TILE, TILE), np.float32))),
}


def _of(material: tuple[Singles, Singles]) -> Texture:
    return texture(*material)


def _post(rng: Random, base: Singles, share: Singles, holes: float = 0.93) -> Texture:
    """A perforated profile, about half a metre of it: relief across it, columns of holes."""
    x = np.linspace(-1, 1, TILE, dtype=np.float32)
    relief = np.ones(TILE, np.float32)
    kind = rng.random()
    if kind < 0.4:  # a groove along the middle
        edge = rng.uniform(0.2, 0.6)
        relief -= float(rng.uniform(0.1, 0.5)) * (np.abs(x) < edge)
        relief += 0.3 * np.exp(-(((np.abs(x) - edge) / 0.06) ** 2))
    elif kind < 0.7:  # rounded lips
        relief -= float(rng.uniform(0.1, 0.45)) * np.abs(x) ** 8 + 0.1 * x * rng.normal()
        relief += 0.25 * np.exp(-(((np.abs(x) - 0.85) / 0.05) ** 2)) * (rng.random() < 0.6)
    picture = base * relief[None, :, None]
    if rng.random() < holes:
        _perforate(picture, share, rng)
    if rng.random() < 0.05:
        at = int(rng.integers(0, TILE - 40))
        cv2.rectangle(picture, (30, at), (TILE - 30, at + 35), (0.93, 0.93, 0.9), -1)
        share[at : at + 36, 30 : TILE - 30] = 0
    return texture(picture, share)


def _perforate(picture: Singles, share: Singles, rng: Random) -> None:
    """Columns of teardrops, slots, round or key holes."""
    columns = int(rng.choice([1, 2, 2, 2, 3]))
    pitch = TILE / int(rng.integers(4, 13))
    shape, size = int(rng.integers(5)), rng.uniform(0.22, 0.42) * pitch
    wide = min(size, 0.16 * TILE) * rng.uniform(1.0, 2.5)
    dark = float(rng.uniform(0.02, 0.3))
    spread = rng.uniform(0.3, 0.75) * TILE
    mask = np.zeros((TILE, TILE), np.float32)
    for x in TILE / 2 + spread * (np.linspace(-0.5, 0.5, columns) if columns > 1 else np.zeros(1)):
        lean = (1 if x > TILE / 2 else -1) * 0.35 if shape == 0 else 0.0
        for y in np.arange(pitch / 2, TILE, pitch):
            _hole(mask, float(x), float(y), float(wide / 2), float(size / 2), shape, lean)
    rim = np.roll(mask, 3, axis=0) * (1 - mask)
    picture *= 1 + 0.25 * rim[..., None]
    picture *= 1 - (1 - dark) * mask[..., None]
    share *= 1 - 0.8 * mask


def _hole(mask: Singles, x: float, y: float, half_width: float, half_height: float, shape: int, lean: float) -> None:
    def at(dx: float, dy: float) -> list[int]:
        return [round(x + dx * half_width), round(y + dy * half_height)]

    axes = [max(1, round(half_width)), max(1, round(half_height))]
    if shape == 0:  # teardrop
        points = np.array([at(-1, -0.8), at(1, -0.8), at(0.4 + lean, 1.3), at(-0.4 + lean, 1.3)])
        cv2.fillConvexPoly(mask, points, 1.0, cv2.LINE_AA)
    elif shape == 1:  # slot
        cv2.rectangle(mask, at(-0.7, -1), at(0.7, 1), 1.0, -1)
    elif shape == 2:
        cv2.ellipse(mask, at(0, 0), axes, 0, 0, 360, 1.0, -1, cv2.LINE_AA)
    elif shape == 3:  # key hole
        cv2.ellipse(mask, at(0, -0.4), axes, 0, 0, 360, 1.0, -1, cv2.LINE_AA)
        cv2.rectangle(mask, at(-0.4, 0), at(0.4, 1.5), 1.0, -1)
    else:  # level slot
        cv2.rectangle(mask, at(-1.3, -0.4), at(1.3, 0.4), 1.0, -1)


def _beam(rng: Random, base: Singles, share: Singles) -> Texture:
    """A level profile: plain, stepped, open, or with a bead; edges catch light or lie in shade."""
    y = np.linspace(-1, 1, TILE, dtype=np.float32)
    relief = 1 + float(rng.normal(0, 0.1)) * y
    kind = rng.random()
    if kind < 0.25:  # open: a shaded web between two lips
        lip = float(rng.uniform(0.5, 0.85))
        relief -= float(rng.uniform(0.15, 0.6)) * (np.abs(y) < lip) * (1 - 0.3 * y)
    elif kind < 0.45:  # a step
        edge = float(rng.uniform(-0.6, 0.3))
        relief -= float(rng.uniform(0.1, 0.35)) * (y < edge)
        relief -= 0.35 * np.exp(-(((y - edge) / 0.05) ** 2))
    elif kind < 0.6:  # beads
        for edge in rng.uniform(-0.7, 0.7, 2):
            relief += float(rng.normal(0, 0.25)) * np.exp(-(((y - edge) / 0.08) ** 2))
    relief += float(rng.uniform(0, 0.35)) * np.exp(-(((y + 0.95) / 0.06) ** 2))
    relief -= float(rng.uniform(0, 0.5)) * np.exp(-(((y - 0.97) / 0.07) ** 2))
    return texture(base * np.clip(relief, 0.1, 2)[:, None, None], share)


@dataclass(frozen=True)
class Paint:
    """A member's finish: which textures, which tint (linear RGB)."""

    zinc: bool
    tint: Rgb


_PAINTS: Mapping[str, Rgb] = {
    "white": (0.75, 0.75, 0.72),
    "light grey": (0.45, 0.46, 0.45),
    "grey": (0.2, 0.21, 0.22),
    "dark grey": (0.07, 0.075, 0.08),
    "black": (0.018, 0.018, 0.02),
    "navy": (0.01, 0.02, 0.09),
    "blue": (0.01, 0.07, 0.35),
    "sky": (0.03, 0.2, 0.5),
    "orange": (0.78, 0.15, 0.01),
    "amber": (0.8, 0.3, 0.01),
    "yellow": (0.85, 0.5, 0.02),
    "red": (0.5, 0.02, 0.015),
    "brown": (0.18, 0.07, 0.03),
    "green": (0.01, 0.16, 0.05),
    "teal": (0.01, 0.2, 0.2),
    "beige": (0.6, 0.48, 0.3),
}
_DULL = ("white", "light grey", "grey", "dark grey", "black", "navy")
_POSTS = ("blue", "blue", "sky", "navy", "grey", "light grey", "green", "white", "yellow", "red", "beige", "orange")
_BEAMS = ("orange", "orange", "orange", "yellow", "amber", "red", "blue", "beige", "white", "green", "grey")


def paint(rng: Random, name: str | None = None) -> Paint:
    """A paint, varied; any, or any colour at all, without a name."""
    if name is None and rng.random() < 0.25:
        return Paint(False, tuple(value**2 for value in prints.vivid(rng)))  # type: ignore[arg-type]
    tint = np.array(_PAINTS[name or str(rng.choice(list(_PAINTS)))])
    faded = rng.uniform(0, 0.35) ** 2
    tint = (tint * np.exp(rng.normal(0, 0.22, 3)) * np.exp(rng.normal(0, 0.2))) * (1 - faded) + faded * 0.4
    return Paint(False, (float(tint[0]), float(tint[1]), float(tint[2])))


def zinc(rng: Random) -> Paint:
    """Galvanised metal: new and bright, or old and dark."""
    tone = float(np.exp(rng.normal(0, 0.45)))
    return Paint(True, (tone, tone, tone * float(rng.uniform(0.97, 1.06))))


def paints(rng: Random) -> tuple[Paint, Paint]:
    """Posts' and beams' paints: usual pairs, dull and galvanised ones, the same twice, any."""
    kind = rng.random()
    if kind < 0.3:
        return paint(rng, str(rng.choice(_POSTS))), paint(rng, str(rng.choice(_BEAMS)))
    if kind < 0.45:
        return zinc(rng), paint(rng, str(rng.choice(_BEAMS)))
    if kind < 0.57:
        return zinc(rng), zinc(rng)
    if kind < 0.72:
        first = paint(rng, str(rng.choice(_DULL)))
        return first, first if rng.random() < 0.6 else paint(rng, str(rng.choice(_DULL)))
    if kind < 0.85:
        first = paint(rng)
        return first, first
    return paint(rng), zinc(rng) if rng.random() < 0.15 else paint(rng)
