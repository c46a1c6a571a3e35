"""`savmap simulate`: panoramic footage of a made-up place, with everything that is true about it.

The folder gets footage.mp4, survey.json (a survey file), references.json (what a user would know without mapping),
site.yaml (a site file with these references),
poses.json (the rig's path), passes.json (where the cart's drive is a path), scene.yaml (the scene as resolved), and for the views
asked for masks/VIEW/FRAME.png with masks/classes.json.
"""

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from savmap.errors import OutputError
from savmap.files.atomic import reason
from savmap.sim.build import Built, build
from savmap.sim.camera import Drive, drive
from savmap.sim.dataset import CLASSES
from savmap.sim.footage import encode, frames
from savmap.sim.panorama import view_classes
from savmap.sim.passes import passes_file, true_passes
from savmap.sim.scene import Scene, SceneMaker
from savmap.sim.shade import Renderer, renderer
from savmap.sim.site import site_of
from savmap.sim.truth import poses, references
from savmap.types import ViewSpec
from savmap.types.progress import Monitor, SilentMonitor
from savmap.video.image_folder import write_picture


def simulate(
    scene: Scene,
    folder: Path,
    monitor: Monitor | None = None,
    *,
    masks: Sequence[ViewSpec] = (),
    makers: Mapping[str, SceneMaker] | None = None,
    workers: int = 2,
) -> list[Path]:
    """Renders a scene's footage into `folder`, all of it or nothing, and returns what was written.

    The same scene gives the same files. `masks` are views whose classes are written for every frame; `makers` as in
    `build`. Raises SceneError, RayCasterMissingError, and OutputError where the folder cannot be written.
    """
    built = build(scene, makers)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as partial:
            _write(built, Path(partial), monitor or SilentMonitor(), masks, workers)
            return _moved(Path(partial), folder)
    except OutputError as error:
        raise OutputError(str(error).replace(partial, str(folder))) from error
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({reason(error)}); choose another folder or free its space"
        ) from error


def _write(built: Built, folder: Path, monitor: Monitor, masks: Sequence[ViewSpec], workers: int) -> None:
    path = drive(built.scene.cart, built.scene.seed)
    _dump(folder / "survey.json", built.survey)
    known = references(built, path)
    _dump(folder / "references.json", known)
    _dump(folder / "poses.json", poses(built, path))
    passes = true_passes(built, path) if built.scene.cart.path else []
    if built.scene.cart.path:
        _dump(folder / "passes.json", passes_file(passes))
    resolved = yaml.safe_dump(built.scene.model_dump(mode="json"), sort_keys=False)
    (folder / "scene.yaml").write_text(resolved, encoding="utf-8")
    site = yaml.safe_dump(site_of(built.scene, known, passes), sort_keys=False)
    (folder / "site.yaml").write_text(site, encoding="utf-8")
    monitor.note(f"lighting {len(built.boxes)} boxes")
    scene = renderer(built)
    classes = classes_of(built)
    for spec in masks:
        _write_masks(scene, path, spec, classes, folder / "masks" / spec.name)
    if masks:
        _dump(folder / "masks" / "classes.json", {"classes": classes})
    images = monitor.each(frames(scene, path, workers), "rendering panoramas", len(path.origins))
    encode(images, built.scene.cart, folder / "footage.mp4")


def _dump(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def classes_of(built: Built) -> list[str]:
    """What the masks' values 1, 2, ... mean: savmap's own classes, then those of other plugins' structures, by name."""
    labels = {label for box in built.boxes for label in box.face_labels.values()}
    return [*CLASSES, *sorted(labels - set(CLASSES))]


def _write_masks(scene: Renderer, path: Drive, spec: ViewSpec, classes: Sequence[str], folder: Path) -> None:
    folder.mkdir(parents=True)
    for index, (origin, turn) in enumerate(zip(path.origins, path.world_from_rig, strict=True)):
        write_picture(folder / f"{index:06d}.png", view_classes(scene, origin, turn, spec, classes))


def _moved(partial: Path, folder: Path) -> list[Path]:
    """Puts the finished files in place; others in the folder are left alone."""
    folder.mkdir(exist_ok=True)
    for item in partial.iterdir():
        old = folder / item.name
        if old.is_dir():
            shutil.rmtree(old)
    return sorted(item.replace(folder / item.name) for item in list(partial.iterdir()))
