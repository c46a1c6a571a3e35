"""Pictures of racks and their masks, each from its number alone."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from savmap.lab.sim.dataset import HEIGHT, WIDTH, Sample
from savmap.lab.sim.paint.develop import developed
from savmap.lab.sim.paint.faces import Faces
from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.raster import Camera, camera_at
from savmap.lab.sim.paint.shade import Painted, painted
from savmap.lab.sim.paint.stage import Stage
from savmap.lab.sim.paint.wardrobe import Wardrobe, wardrobe_of
from savmap_shelves.lab.painted import clutter
from savmap_shelves.lab.painted.goods import Room, Storage, fill_opening, random_storage
from savmap_shelves.lab.painted.hall import Hall, build_hall, lamps, lighting, reflections
from savmap_shelves.lab.painted.racks import SIDES, Bay, Row, build_row, random_row, random_style
from savmap_shelves.lab.painted.wardrobe import TEXTURES

CLASSES = ("upright", "beam", "upright_side", "beam_side")

_BLOCK = 100
"""Pictures that share a wardrobe."""
_DETAIL_M = 11.0
_BARE_SHARE = 0.1
_TRIES = 3
_ALIKE = ("carton", "crate", "sack", "barrel", "plain", "cloth", "wood", "plaster", "ribbed")


@dataclass(frozen=True)
class View:
    """Where a picture is taken from: metres, degrees; yaw 0 looks straight at the first row."""

    x: float
    height: float
    distance: float
    yaw: float
    pitch: float
    roll: float
    hfov: float

    def camera(self) -> Camera:
        """The camera in the world."""
        origin = np.array([self.x, self.height, self.distance])
        return camera_at(origin, self.yaw, self.pitch, self.roll, self.hfov)


@lru_cache(maxsize=2)
def _wardrobe(seed: int, block: int) -> Wardrobe:
    return wardrobe_of(np.random.default_rng([seed, block, 1]), TEXTURES)


def picture(seed: int, index: int) -> Sample:
    """The picture of a number, RGB (480, 640, 3), and its mask; the same seed and number give the same."""
    rng = np.random.default_rng([seed, index, 2])
    clothes = _wardrobe(seed, index // _BLOCK)
    bare = rng.random() < _BARE_SHARE
    for _ in range(_TRIES):
        result = _attempt(Stage(rng, SIDES), clothes, bare)
        if bare or np.isin(result.mask, (1, 2)).mean() > rng.uniform(0.01, 0.07):
            break
    return developed(result.linear, rng), result.mask


def _attempt(stage: Stage, clothes: Wardrobe, bare: bool) -> Painted:
    """A place and a view of it, in linear light."""
    rng = stage.rng
    kind = "bare" if bare else str(rng.choice(["part", "row", "aisle"], p=[0.28, 0.47, 0.25]))
    view = random_view(rng, kind)
    hall = _hall(rng, view)
    build_hall(stage, clothes, hall)
    places = lamps(stage, clothes, hall)
    if not bare:
        _racks(stage, clothes, view, kind)
    _clutter(stage, clothes, view, int(rng.integers(3, 10)) if bare else int(rng.integers(0, 3)))
    if rng.random() < 0.4:
        reflections(stage, clothes, places, view.camera().origin)
    light = lighting(rng, places, hall.height)
    haze = float(rng.uniform(0.002, 0.04)) if rng.random() < 0.25 else 0.0
    faces = stage.faces()
    if rng.random() < 0.18:
        faces = _alike(faces, clothes, rng)
    return painted(faces, clothes.atlas, light, view.camera(), (WIDTH, HEIGHT), len(CLASSES), haze)


def _alike(faces: Faces, clothes: Wardrobe, rng: Random) -> Faces:
    """Goods and walls of some textures take nearly the paint of a labelled member: weak contrast, false members."""
    members = np.flatnonzero((faces.label == 1) | (faces.label == 2))
    if not len(members):
        return faces
    tint = faces.tint[members[int(rng.integers(len(members)))]]
    tiles = [tile for kind in _ALIKE for tile in clothes.kinds[kind]]
    chosen = np.isin(faces.tile, rng.choice(tiles, len(tiles) // 2, replace=False)) & (faces.label == 0)
    jitter = np.exp(rng.normal(0, 0.25, (len(faces.tile), 1)))
    return replace(faces, tint=np.where(chosen[:, None], tint * jitter, faces.tint))


def random_view(rng: Random, kind: str) -> View:
    """A view before the first row, whose face is z = 0: of a part of a bay, of a row, or along an aisle."""
    side = float(rng.choice([-1, 1]))
    height = float(np.clip(rng.normal(1.7, 0.7), 0.5, 4.0))
    roll = float(np.clip(rng.normal(0, 2.5), -8, 8))
    pitch = float(np.clip(rng.normal(2, 8), -30, 35))
    if rng.random() < 0.12:
        pitch = float(rng.uniform(10, 38))
    if kind == "part":
        yaw = side * abs(float(rng.normal(0, 28)))
        return View(0.0, height, float(rng.uniform(0.9, 2.8)), yaw, pitch, roll, float(rng.uniform(40, 90)))
    if kind == "aisle":
        yaw = side * float(rng.uniform(45, 88))
        return View(0.0, height, float(rng.uniform(0.8, 3.0)), yaw, pitch * 0.6, roll, float(rng.uniform(45, 110)))
    yaw = side * float(rng.uniform(0, 70))
    return View(0.0, height, float(rng.uniform(1.8, 7.0)), yaw, pitch * 0.7, roll, float(rng.uniform(38, 100)))


def _hall(rng: Random, view: View) -> Hall:
    reach = float(rng.uniform(9, 45))
    front = view.distance + float(rng.uniform(1.5, 15))
    back = float(rng.uniform(1.3, 5)) if rng.random() < 0.5 else float(rng.uniform(3, 20))
    return Hall(-reach, reach, -back, front, float(rng.uniform(3.2, 13)))


def _racks(stage: Stage, clothes: Wardrobe, view: View, kind: str) -> None:
    """The row before the camera, perhaps one behind it back to back, one across the aisle, others farther on."""
    rng = stage.rng
    small = bool(rng.random() < 0.35)
    style = random_style(rng, clothes, small)
    storage = random_storage(rng, small)
    ahead = view.distance * math.tan(math.radians(np.clip(view.yaw, -70, 70)))
    count = int(rng.integers(1, 4)) if rng.random() < 0.15 else int(rng.integers(4, 15))
    row = random_row(rng, style, small, count)
    start = ahead - row.length * float(rng.uniform(0.25, 0.75))
    if kind == "aisle":
        start = -float(rng.uniform(0, 4)) if view.yaw > 0 else float(rng.uniform(0, 4)) - row.length
    _one_row(stage, clothes, row, storage, (start, 0.0, 0.0), 0.0, view)
    if rng.random() < 0.5:
        behind = (start + row.length, 0.0, -2 * style.depth - float(rng.uniform(0.1, 0.4)))
        _one_row(stage, clothes, random_row(rng, style, small, count), storage, behind, 180.0, view, labelled=False)
    if kind == "aisle" or rng.random() < 0.15:
        across = view.distance + float(rng.uniform(0.7, 3.0))
        other = style if rng.random() < 0.7 else random_style(rng, clothes, small)
        _one_row(
            stage,
            clothes,
            random_row(rng, other, small, count),
            storage,
            (start + row.length, 0.0, across),
            180.0,
            view,
        )
    if rng.random() < 0.2:
        beyond = start + row.length + float(rng.uniform(0.5, 4))
        other = random_style(rng, clothes, small)
        _one_row(stage, clothes, random_row(rng, other, small, 3), storage, (beyond, 0.0, 0.0), 0.0, view)


def _one_row(
    stage: Stage,
    clothes: Wardrobe,
    row: Row,
    storage: Storage,
    at: tuple[float, float, float],
    turned: float,
    view: View,
    labelled: bool = True,
) -> None:
    eye = np.array([view.x, view.height, view.distance])
    with stage.frame(at, turned):
        middles = {bay: stage.place((bay.left + bay.width / 2, 1.5, 0.0)) for bay in row.bays}

        def near(bay: Bay) -> bool:
            return bool(np.linalg.norm(middles[bay] - eye) < _DETAIL_M)

        def fill(bay: Bay, bottom: float, top: float, depth: float) -> None:
            inner = row.style.post_width / 2
            room = Room(bay.width - 2 * inner, top - bottom, depth, near(bay))
            fill_opening(stage, clothes, storage, bay.left + inner, bottom, room)

        build_row(stage, row, clothes, fill, labelled, near)


def _clutter(stage: Stage, clothes: Wardrobe, view: View, count: int) -> None:
    """Things in the aisle, most of them beside the middle of the view."""
    rng = stage.rng
    for _ in range(count):
        build = clutter.THINGS[int(rng.integers(len(clutter.THINGS)))]
        away = float(rng.uniform(2.2, 10.0))
        bearing = math.radians(view.yaw + float(rng.uniform(-0.6, 0.6)) * view.hfov)
        x, z = view.x + away * math.sin(bearing), view.distance - away * math.cos(bearing)
        with stage.frame((x, 0.0, z), float(rng.uniform(-180, 180))):
            build(stage, clothes)
