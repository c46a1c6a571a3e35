"""From a scene file to boxes: the plugins' structures, the building and the goods put together, with the survey."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from savmap.lab.plugins import lab_plugin
from savmap.lab.scenes import (
    Box,
    Corner,
    Distractor,
    Front,
    Goods,
    Hall,
    RowFrame,
    SceneError,
    SceneParts,
    Site,
)
from savmap.lab.sim.scene.files import Scene, row_frame
from savmap.lab.sim.scene.goods import extents, fill, in_world
from savmap.lab.sim.scene.hall import hall_boxes
from savmap.types import Floats

_FRONT_M = 0.05
_STICKER_M = 0.005
_WITHOUT: Mapping[Distractor, tuple[str, Mapping[str, object]]] = {
    "goods": ("goods", {"density": 0.0}),
    "debris": ("goods", {"debris": 0.0}),
    "aisle_marking": ("hall", {"aisle_marking": False}),
    "pipes": ("hall", {"pipes": 0}),
    "skylights": ("hall", {"skylights": 0}),
    "windows": ("hall", {"windows": 0}),
}


class SceneMaker(Protocol):
    """The signature of a plugin's `scene` hook."""

    def __call__(self, section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts: ...


@dataclass(frozen=True, eq=False)
class Built:
    """A scene ready to be rendered. `survey` is a survey file's content, `aisle_z` the z range of the camera's aisle,
    `parts` what each plugin built, `site` what a further plugin would be told, `goods` the lowest and highest corners
    (n, 2, 3) m of what stands on the supports of each mapped row, in the row's frame."""

    scene: Scene
    boxes: list[Box]
    survey: dict[str, Any]
    frames: Mapping[str, RowFrame]
    aisle_z: tuple[float, float]
    parts: Mapping[str, SceneParts]
    site: Site
    goods: Mapping[str, Floats]

    def labels(self, luminous: bool) -> set[str]:
        """The classes of the labelled boxes that shine, or of those that do not."""
        labelled = (box for box in self.boxes if (box.material.emission > 0) == luminous)
        return {label for box in labelled for label in box.face_labels.values()}


def build(scene: Scene, makers: Mapping[str, SceneMaker] | None = None) -> Built:
    """All boxes and the survey of a scene; the same scene gives the same boxes.

    `makers` are the plugins' `scene` functions by the name their section has under `structures`; the default asks the
    installed plugin. Plugins are asked in the order of the file, and each gets to know what those before it have built.
    Raises SceneError for a structure that no plugin builds.
    """
    frames = {name: row_frame(place) for name, place in scene.rows.items()}
    aisle_z = _aisle(scene)
    site = Site(scene.hall, scene.goods, scene.look, frames, aisle=abs(aisle_z[1] - aisle_z[0]))
    parts: dict[str, SceneParts] = {}
    for name, section in scene.structures.items():
        make = (makers or {}).get(name) or _maker(name)
        parts[name] = make(section, np.random.default_rng([scene.seed, 2, *name.encode()]), site)
        site = _with_part(site, parts[name])
    rng = np.random.default_rng([scene.seed, 1])
    hall, goods = _thinned(scene, parts)
    boxes = [box for part in parts.values() for box in _boxes_of(part)] + hall_boxes(hall, goods, rng)
    filled = list(fill([support for part in parts.values() for support in part.supports], goods, rng))
    boxes += [in_world(support, box) for support, box in filled]
    standing = {name: extents(filled, frame) for name, frame in frames.items() if frame.mapped}
    return Built(scene, boxes, _survey(parts, frames), frames, aisle_z, parts, site, standing)


def _maker(name: str) -> SceneMaker:
    plugin = lab_plugin(name)
    if plugin is None or not plugin.has("scene"):
        raise SceneError(
            f"structures.{name}: no installed plugin of that name builds scenes (hook `scene`, group `savmap.lab`)"
        )
    return plugin.scene


def _boxes_of(part: SceneParts) -> Iterator[Box]:
    yield from part.boxes
    yield from (replace(box, face_labels={}) for box in part.distractors)


def _with_part(site: Site, part: SceneParts) -> Site:
    """The site as the next plugin gets it, with what this part has built."""
    fronts = {name: (*site.fronts.get(name, ()), *_fronts(part, frame)) for name, frame in site.frames.items()}
    return replace(site, sizes={**site.sizes, **part.sizes}, fronts=fronts)


def _thinned(scene: Scene, parts: Mapping[str, SceneParts]) -> tuple[Hall, Goods]:
    """Building and goods without what the plugins ask to leave out."""
    changes: dict[str, dict[str, object]] = {"hall": {}, "goods": {}}
    for distractor in {distractor for part in parts.values() for distractor in part.without}:
        where, change = _WITHOUT[distractor]
        changes[where] |= change
    return scene.hall.model_copy(update=changes["hall"]), scene.goods.model_copy(update=changes["goods"])


def _survey(parts: Mapping[str, SceneParts], frames: Mapping[str, RowFrame]) -> dict[str, Any]:
    rows: dict[str, dict[str, Any]] = {name: {} for name, frame in frames.items() if frame.mapped}
    for part in parts.values():
        for name, entries in part.survey.items():
            rows[name].update(entries)
    return {"format": "savmap-survey", "version": 1, "units": "m", "rows": rows}


def _aisle(scene: Scene) -> tuple[float, float]:
    faces = {place.facing: place.z for place in scene.rows.values() if place.mapped}
    return faces.get("+z", scene.hall.z[0]), faces.get("-z", scene.hall.z[1])


def mapped_rows(built: Built) -> list[str]:
    """The names of the rows with labelled fronts. Raises SceneError where there is none."""
    names = [name for name, frame in built.frames.items() if frame.mapped and row_fronts(built, name)]
    if not names:
        raise SceneError("the scene has no mapped row with labelled structures; see `rows` and `structures`")
    return names


def face_size(built: Built, name: str) -> tuple[float, float]:
    """How far the labelled fronts of a row reach along its x axis and up, in metres."""
    fronts = row_fronts(built, name)
    return max(front.high[0] for front in fronts), max(front.high[1] for front in fronts)


def row_fronts(built: Built, name: str) -> list[Front]:
    """The labelled structures in a row's face."""
    return list(built.site.fronts.get(name, ()))


def _fronts(part: SceneParts, frame: RowFrame) -> Iterator[Front]:
    for box in part.boxes:
        if set(box.face_labels) == {"+z"} and box.size[2] > _STICKER_M:
            center, half = frame.to_row(box.center), box.size / 2
            if abs(center[2] + half[2]) < _FRONT_M:
                yield Front(box.face_labels["+z"], _corner(center - half), _corner(center + half))


def _corner(point: np.ndarray[Any, np.dtype[np.float64]]) -> Corner:
    return float(point[0]), float(point[1]), float(point[2])
