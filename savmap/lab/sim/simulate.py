"""`savmap simulate`: panoramic footage of a made-up place, with everything that is true about it.

The folder gets footage.mp4, survey.json (a survey file), references.json (what a user would know without mapping),
site.yaml (a site file with these references), poses.json (the rig's path), goods.json (what stands in the rows),
passes.json (where the cart's drive is a path), scene.yaml (the scene as resolved), and for the views asked for
masks/VIEW/FRAME.png with masks/classes.json.
"""

import json
import shutil
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import OutputError, SiteError
from savmap.files.atomic import reason
from savmap.files.yaml_text import dumped
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.drive.passes import TruePass, passes_file, true_passes
from savmap.lab.sim.random_scene import classes_of
from savmap.lab.sim.render.panorama import encode, frames, view_classes
from savmap.lab.sim.render.raycast import require_ray_caster
from savmap.lab.sim.render.shade import Renderer, renderer
from savmap.lab.sim.scene.build import Built, SceneMaker, build
from savmap.lab.sim.scene.files import Scene
from savmap.types import ViewSpec
from savmap.types.progress import Monitor, SilentMonitor
from savmap.video.image_folder import write_picture


@dataclass(frozen=True)
class SimulatedFootage:
    """The files that a simulation wrote into a folder, in order of name."""

    folder: Path
    files: tuple[Path, ...]


def simulate(
    scene: Scene,
    folder: Path,
    monitor: Monitor | None = None,
    *,
    masks: Sequence[ViewSpec] = (),
    makers: Mapping[str, SceneMaker] | None = None,
    workers: int = 2,
) -> SimulatedFootage:
    """Renders a scene's footage into `folder`, all of it or nothing.

    The same scene gives the same files. `masks` are views whose classes are written for every frame; `makers` as in
    `build`. Raises SceneError, RayCasterMissingError, and OutputError where the folder cannot be written.
    """
    require_ray_caster()
    built = build(scene, makers)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as partial:
            _write(built, Path(partial), monitor or SilentMonitor(), masks, workers)
            return SimulatedFootage(folder, tuple(_moved(Path(partial), folder)))
    except OutputError as error:
        raise OutputError(str(error).replace(partial, str(folder))) from error
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({reason(error)}); choose another folder or free its space"
        ) from error


def _write(built: Built, folder: Path, monitor: Monitor, masks: Sequence[ViewSpec], workers: int) -> None:
    path = drive(built.scene.cart, built.scene.seed)
    _dump(folder / "survey.json", built.survey)
    facts = references(built, path)
    _dump(folder / "references.json", facts)
    _dump(folder / "poses.json", poses(built, path))
    _dump(folder / "goods.json", goods_file(built))
    passes = true_passes(built, path) if built.scene.cart.path else []
    if built.scene.cart.path:
        _dump(folder / "passes.json", passes_file(passes))
    resolved = dumped(built.scene.model_dump(mode="json"))
    (folder / "scene.yaml").write_text(resolved, encoding="utf-8")
    site = dumped(site_of(built, facts, passes))
    (folder / "site.yaml").write_text(site, encoding="utf-8")
    monitor.note(f"lighting {len(built.boxes)} boxes")
    scene = renderer(built)
    classes = classes_in(built)
    for spec in masks:
        _write_masks(scene, path, spec, classes, folder / "masks" / spec.name, monitor)
    if masks:
        _dump(folder / "masks" / "classes.json", {"classes": classes})
    images = monitor.each(frames(scene, path, workers), "rendering panoramas", len(path.origins))
    encode(images, built.scene.cart, folder / "footage.mp4")


def _dump(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def classes_in(built: Built) -> list[str]:
    """What the masks' values 1, 2, ... mean: the classes of the scene's installed plugins, then those of others, by
    name."""
    installed = classes_of(built.scene)
    labels = {label for box in built.boxes for label in box.face_labels.values()}
    return [*installed, *sorted(labels - set(installed))]


def _write_masks(
    scene: Renderer, path: Drive, spec: ViewSpec, classes: Sequence[str], folder: Path, monitor: Monitor
) -> None:
    folder.mkdir(parents=True)
    places = monitor.each(
        zip(path.origins, path.world_from_rig, strict=True), f"rendering masks of {spec.name}", len(path.origins)
    )
    for index, (origin, turn) in enumerate(places):
        write_picture(folder / f"{index:06d}.png", view_classes(scene, origin, turn, spec, classes))


def _moved(partial: Path, folder: Path) -> list[Path]:
    """Puts the finished files in place; others in the folder are left alone."""
    folder.mkdir(exist_ok=True)
    for item in partial.iterdir():
        old = folder / item.name
        if old.is_dir():
            shutil.rmtree(old)
    return sorted(item.replace(folder / item.name) for item in list(partial.iterdir()))


def references(built: Built, path: Drive) -> dict[str, Any]:
    """What a user would know without mapping: camera height, rough travel, and what plugins say of each mapped row;
    with sigmas."""
    height = round(float(path.origins[:, 1].mean()), 3)
    travel = round(float(np.ptp(path.origins[:, 0])), 1)
    facts = [part.references for part in built.parts.values()]
    rows = {f"row_{name}": merged for name in built.survey["rows"] if (merged := _merged(name, facts))}
    return {
        "camera_height_m": {"value": height, "sigma": 0.02},
        "camera_travel_m": {"value": travel, "note": "roughly, from the start to the end of the clip"},
        **rows,
    }


def _merged(row: str, parts: Iterable[Mapping[str, Mapping[str, Any]]]) -> dict[str, Any]:
    """What several plugins say of a row."""
    return {key: value for part in parts for key, value in part.get(row, {}).items()}


def poses(built: Built, path: Drive) -> dict[str, Any]:
    """The rig's path as 4 by 4 matrices world_from_rig, and where each row's frame is in that world."""
    rows = {
        name: {"world_from_row": frame.world_from_row.tolist(), "origin": frame.origin.tolist()}
        for name, frame in built.frames.items()
    }
    matrices = np.tile(np.eye(4), (len(path.origins), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = path.world_from_rig, path.origins
    frames = [
        {"frame": index, "stamp_s": float(stamp), "world_from_rig": matrix.tolist()}
        for index, (stamp, matrix) in enumerate(zip(path.stamps_s, matrices, strict=True))
    ]
    return {"format": "savmap-poses", "version": 1, "units": "m", "rows": rows, "frames": frames}


def goods_file(built: Built) -> dict[str, Any]:
    """The boxes of goods in each mapped row: lowest and highest corners in the row's frame."""
    rows = {name: corners.round(4).tolist() for name, corners in built.goods.items()}
    return {"format": "savmap-goods", "version": 1, "units": "m", "rows": rows}


def site_of(built: Built, facts: Mapping[str, Any], passes: Sequence[TruePass] = ()) -> dict[str, Any]:
    """The content of site.yaml for footage.mp4: each mapped row with its references (`facts`, as in references.json).
    Along a path the rows have the time ranges of `passes`, and those that it never passes are left out."""
    scene, said = built.scene, [part.site_rows for part in built.parts.values()]
    return {
        "plugins": {name: {} for name in scene.mapped or scene.structures},
        "survey": "survey.json",
        "references": {"camera_height_m": facts["camera_height_m"], "travel_m": facts["camera_travel_m"]["value"]},
        "rows": {
            name: {"passes": row_passes, **_merged(name, said)}
            for name, row_passes in _drives(scene, passes).items()
            if name in built.survey["rows"]
        },
    }


def _drives(scene: Scene, passes: Sequence[TruePass]) -> dict[str, list[dict[str, Any]]]:
    """The passes of each row, as a site file has them."""
    if scene.cart.path is None:
        return {name: [{"video": "footage.mp4", "side": _side(scene, name)}] for name in scene.rows}
    drives: dict[str, list[dict[str, Any]]] = {}
    for true_pass in passes:
        span = {"video": "footage.mp4", "start_s": round(true_pass.start_s, 2), "end_s": round(true_pass.end_s, 2)}
        for name in (*true_pass.left, *true_pass.right):
            drives.setdefault(name, []).append({**span, "side": "left" if name in true_pass.left else "right"})
    return drives


def _side(scene: Scene, name: str) -> str:
    forwards = scene.cart.end[0] > scene.cart.start[0]
    return "left" if forwards == (scene.rows[name].facing == "+z") else "right"


def mask_view(number: int, text: str) -> ViewSpec:
    """The view that "yaw,pitch,hfov" means. Raises SiteError where it is not three angles of a possible view."""
    try:
        yaw, pitch, hfov = (float(part) for part in text.split(","))
        return ViewSpec(f"view-{number}", yaw, pitch, hfov_deg=hfov)
    except ValueError:
        raise SiteError(f"--mask {text}: give YAW,PITCH,HFOV in degrees, HFOV between 0 and 175") from None
