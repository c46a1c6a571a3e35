"""Pictures of ceilings and their masks, each from its number alone."""

import math
from functools import lru_cache

import numpy as np

from savmap.geometry.pinhole import rig_from_view
from savmap.lab.sim.dataset import HEIGHT, WIDTH, Sample
from savmap.lab.sim.paint.develop import developed
from savmap.lab.sim.paint.faces import Lighting
from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.raster import Camera
from savmap.lab.sim.paint.shade import painted
from savmap.lab.sim.paint.stage import Stage
from savmap.lab.sim.paint.wardrobe import Wardrobe, wardrobe_of
from savmap.types import Floats
from savmap_lights.lab.painted.hall import TEXTURES, Hall, build_hall
from savmap_lights.lab.painted.lamps import hang_lamps

CLASSES = ("light",)

_BLOCK = 100
"""Pictures that share their textures."""
_WORLD_FROM_RIG = np.diag([1.0, -1.0, -1.0])
_OVEREXPOSED, _UNLIT = 0.3, 0.04


@lru_cache(maxsize=2)
def _wardrobe(seed: int, block: int) -> Wardrobe:
    return wardrobe_of(np.random.default_rng([seed, block, 1]), TEXTURES)


def picture(seed: int, index: int) -> Sample:
    """The picture of a number, RGB (480, 640, 3), and its mask; the same seed and number give the same."""
    rng = np.random.default_rng([seed, index, 2])
    clothes, stage = _wardrobe(seed, index // _BLOCK), Stage(rng)
    hall = _hall(rng)
    build_hall(stage, clothes, hall)
    places = hang_lamps(stage, clothes, hall) if rng.random() >= _UNLIT else np.zeros((0, 3))
    result = painted(
        stage.faces(), clothes.atlas, _lighting(rng, places), random_camera(rng, hall), (WIDTH, HEIGHT), len(CLASSES)
    )
    key = float(rng.uniform(0.35, 0.9)) if rng.random() < _OVEREXPOSED else None
    return developed(result.linear, rng, key), result.mask


def _hall(rng: Random) -> Hall:
    height = float(rng.uniform(3.4, 14.0))
    under = height - float(rng.uniform(0.0, min(1.5, height - 3.2)))
    return Hall(float(rng.uniform(8, 30)), float(rng.uniform(4, 16)), height, under)


def random_camera(rng: Random, hall: Hall) -> Camera:
    """A camera that looks at the ceiling as mapping's views do, most of them straight up with the aisle level in the
    picture; others anyhow."""
    origin = np.array([0.0, float(rng.uniform(1.2, min(4.0, hall.height - 1.6))), float(rng.normal(0, 0.4))])
    hfov_deg = float(rng.uniform(60, 155))
    if rng.random() < 0.65:
        turn = rig_from_view(0.0, 90.0 + float(rng.normal(0, 4)), float(rng.normal(0, 4)) + 180 * int(rng.integers(2)))
    else:
        about_up = rig_from_view(float(rng.uniform(-180, 180)), 0.0, 0.0)
        turn = about_up @ rig_from_view(0.0, float(rng.uniform(35, 120)), float(rng.uniform(-180, 180)))
        hfov_deg = min(hfov_deg, 120.0)
    return Camera(origin, _WORLD_FROM_RIG @ turn, hfov_deg)


def _lighting(rng: Random, places: Floats) -> Lighting:
    """The lamps' own light on the roof, and light from everywhere."""
    power = np.exp(rng.uniform(math.log(0.1), math.log(12))) * rng.uniform(0.7, 1.3, len(places))
    return Lighting(places, power, float(rng.uniform(0.05, 0.9)), float(rng.uniform(0.0, 0.5)), 0.0)
