"""From a scene file to boxes: the plugins' structures, the building and the goods put together, with the survey."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from savmap.plugin.manager import installed, open_plugin
from savmap.sim.goods import fill
from savmap.sim.hall import hall_boxes
from savmap.sim.primitives import Box
from savmap.sim.scene import RowFrame, Scene, SceneError, SceneMaker, SceneParts, Site, row_frame


@dataclass(frozen=True)
class Built:
    """A scene ready to be rendered. `survey` is a survey file's content, `aisle_z` the z range of the camera's aisle."""

    scene: Scene
    boxes: list[Box]
    survey: dict[str, Any]
    frames: Mapping[str, RowFrame]
    aisle_z: tuple[float, float]


def build(scene: Scene, makers: Mapping[str, SceneMaker] | None = None) -> Built:
    """All boxes and the survey of a scene; the same scene gives the same boxes.

    `makers` are the plugins' `scene` functions by the name their section has under `structures`; the default asks the
    installed plugin. Raises SceneError for a structure that no plugin builds.
    """
    frames = {name: row_frame(place) for name, place in scene.rows.items()}
    site = Site(scene.hall, scene.goods, scene.look, frames)
    parts = [_part(scene, name, makers or {}, site) for name in scene.structures]
    rng = np.random.default_rng([scene.seed, 1])
    boxes = [box for part in parts for box in part.boxes] + hall_boxes(scene.hall, scene.goods, rng)
    boxes += fill([support for part in parts for support in part.supports], scene.goods, rng)
    return Built(scene, boxes, _survey(parts, frames), frames, _aisle(scene))


def _part(scene: Scene, name: str, makers: Mapping[str, SceneMaker], site: Site) -> SceneParts:
    make = makers[name] if name in makers else _installed(name)
    rng = np.random.default_rng([scene.seed, 2, *name.encode()])
    return make(scene.structures[name], rng, site)


def _installed(name: str) -> SceneMaker:
    """The `scene` hook of an installed plugin, or the function of a module `savmap_NAME.scene` that is there without being installed."""
    if name in installed():
        room = open_plugin(name, {})
        return lambda section, rng, site: room.scene(section, rng, site)
    try:
        make: SceneMaker = importlib.import_module(f"savmap_{name}.scene").scene
    except ImportError as error:
        raise SceneError(f"structures.{name}: no installed plugin of that name builds scenes") from error
    return make


def _survey(parts: list[SceneParts], frames: Mapping[str, RowFrame]) -> dict[str, Any]:
    rows: dict[str, dict[str, Any]] = {name: {} for name, frame in frames.items() if frame.mapped}
    for part in parts:
        for name, entries in part.survey.items():
            rows[name].update(entries)
    return {"format": "savmap-survey", "version": 1, "units": "m", "rows": rows}


def _aisle(scene: Scene) -> tuple[float, float]:
    faces = {place.facing: place.z for place in scene.rows.values() if place.mapped}
    return faces.get("+z", scene.hall.z[0]), faces.get("-z", scene.hall.z[1])
