"""`savmap simulate`: panoramic footage of a made-up place, with everything that is true about it.

The folder holds footage.mp4, survey.json (a survey file), references.json (what a user would know without mapping),
poses.json (the rig's path), scene.yaml (the scene as resolved) and masks/VIEW/FRAME.png for the views asked for.
"""

import json
import shutil
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import cv2
import numpy as np
import yaml

from savmap.errors import OutputError
from savmap.sim.build import Built, build
from savmap.sim.camera import Drive, drive
from savmap.sim.panorama import linear_bands, panorama, view_classes
from savmap.sim.scene import Look, Scene, SceneMaker
from savmap.sim.shade import Image, Renderer, metered, renderer
from savmap.types import ViewSpec

Progress = Callable[[int, int], None]

CLASSES = ("upright", "beam", "light")
_METERING_HEIGHT = 64
_QUALITY = {"crf": "18", "preset": "fast"}

_worker: dict[str, Any] = {}


def simulate(
    scene: Scene,
    folder: Path,
    progress: Progress | None = None,
    *,
    masks: Sequence[ViewSpec] = (),
    makers: Mapping[str, SceneMaker] | None = None,
    workers: int = 2,
) -> None:
    """Renders a scene's footage into `folder`: all of it or nothing. The same scene gives the same files.

    `progress` is told frames done and frames in all; `masks` are views whose classes are written for every frame.
    Raises SceneError, RayCasterMissingError, and OutputError where the folder cannot be written.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as partial:
            _write(build(scene, makers), Path(partial), progress or _silent, masks, workers)
            _move(Path(partial), folder)
    except OSError as error:
        raise OutputError(f"{folder}: the simulated footage cannot be written: {error}") from error


def references(built: Built, path: Drive) -> dict[str, Any]:
    """What a user would know of a scene without mapping it, with sigmas: camera height, rough travel, a few lengths."""
    height = round(float(path.origins[:, 1].mean()), 3)
    travel = round(float(np.ptp(path.origins[:, 0])), 1)
    rows = {f"row_{name}": _row_references(entry) for name, entry in built.survey["rows"].items() if "uprights" in entry}
    return {
        "camera_height_m": {"value": height, "sigma": 0.02},
        "camera_travel_m": {"value": travel, "note": "roughly, from the start to the end of the clip"},
        **rows,
    }


def poses(built: Built, path: Drive) -> dict[str, Any]:
    """The rig's true path: 4 by 4 matrices world_from_rig, and where each row's frame is in that world."""
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


def _silent(done: int, of: int) -> None:
    pass


def _row_references(entry: Mapping[str, Any]) -> dict[str, Any]:
    lowest = [section["beams"][0][0] if section["beams"] else None for section in entry["sections"]]
    length = entry["uprights"][-1][1] - entry["uprights"][0][0]
    return {
        "lowest_beam_bottom_height_m": {"values": lowest, "sigma": 0.002},
        "first_to_last_upright_outer_edges_m": {"value": round(length, 4), "sigma": 0.003},
    }


def _write(built: Built, folder: Path, progress: Progress, masks: Sequence[ViewSpec], workers: int) -> None:
    path = drive(built.scene.cart, built.scene.seed)
    scene = renderer(built)
    _dump(folder / "survey.json", built.survey)
    _dump(folder / "references.json", references(built, path))
    _dump(folder / "poses.json", poses(built, path))
    resolved = yaml.safe_dump(built.scene.model_dump(mode="json"), sort_keys=False)
    (folder / "scene.yaml").write_text(resolved, encoding="utf-8")
    for spec in masks:
        _write_masks(scene, path, spec, folder / "masks" / spec.name)
    _encode(_frames(scene, path, workers, progress), built.scene, folder / "footage.mp4")


def _dump(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _write_masks(scene: Renderer, path: Drive, spec: ViewSpec, folder: Path) -> None:
    folder.mkdir(parents=True)
    for index, (origin, turn) in enumerate(zip(path.origins, path.world_from_rig, strict=True)):
        cv2.imwrite(str(folder / f"{index:06d}.png"), view_classes(scene, origin, turn, spec, CLASSES))


def _look(scene: Renderer, path: Drive) -> Look:
    """The clip's exposure, as metered half way along the drive."""
    middle = len(path.origins) // 2
    bands = linear_bands(scene, path.origins[middle], path.world_from_rig[middle], _METERING_HEIGHT)
    return metered(scene.built.scene.look, np.concatenate(list(bands)))


def _frames(scene: Renderer, path: Drive, workers: int, progress: Progress) -> Iterator[Image]:
    count = len(path.origins)
    with ProcessPoolExecutor(workers, initializer=_prepare, initargs=(scene, path, _look(scene, path))) as pool:
        pending: deque[Future[Image]] = deque()
        for index in range(count + 2 * workers):
            if index < count:
                pending.append(pool.submit(_frame, index))
            if index >= 2 * workers and pending:
                yield pending.popleft().result()
                progress(index + 1 - 2 * workers, count)


def _prepare(scene: Renderer, path: Drive, look: Look) -> None:
    _worker.update(scene=scene, path=path, look=look)


def _frame(index: int) -> Image:
    scene, path = cast(Renderer, _worker["scene"]), cast(Drive, _worker["path"])
    cart, seed = scene.built.scene.cart, scene.built.scene.seed
    turn = path.world_from_rig[index]
    return panorama(scene, path.origins[index], turn, cart.width // 2, _worker["look"], (seed, 9, index))


def _encode(frames: Iterator[Image], scene: Scene, path: Path) -> None:
    with av.open(str(path), "w") as container:
        rate = Fraction(scene.cart.fps).limit_denominator(1001)
        stream = container.add_stream("libx264", rate=rate, options=_QUALITY)
        stream.width, stream.height = scene.cart.width, scene.cart.width // 2
        stream.pix_fmt = "yuv420p"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())


def _move(partial: Path, folder: Path) -> None:
    """Puts the finished files in place; others in the folder are left alone."""
    folder.mkdir(exist_ok=True)
    for item in partial.iterdir():
        old = folder / item.name
        if old.is_dir():
            shutil.rmtree(old)
        item.replace(old)
