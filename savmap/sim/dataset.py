"""Labelled pictures of random scenes for training networks: `python -m savmap.sim.dataset --count 100 --seed 1 -o DIR`.

DIR/images/NAME.jpg, DIR/masks/NAME.png (0 background, k for classes[k - 1], 255 not to be judged) and DIR/dataset.json.
Structures of other plugins: `--plugin NAME --classes upright,beam,light,THING`, where the module `savmap_NAME.scene` says by
`random_section(rng, site)` what of them a random place has. `--kind floor` looks down at the floor before the rows.
"""

import argparse
import importlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from savmap.errors import OutputError, ending_in_one_line
from savmap.files.atomic import read_json, write_text
from savmap.geometry.pinhole import focal_px
from savmap.sim.build import build
from savmap.sim.camera import CameraSample, Kind, sample_camera, view_rays
from savmap.sim.primitives import Floats
from savmap.sim.random_scene import random_scene
from savmap.sim.raycast import Caster, Hits
from savmap.sim.scene import Look, Scene, SceneError, Site, row_frame
from savmap.sim.shade import Image, Mask, Renderer, compressed, developed, different, metered, renderer
from savmap.video.image_folder import write_picture

CLASSES = ("upright", "beam", "light", "sign")
WIDTH, HEIGHT = 640, 480
IGNORED = 255

_SUBPIXELS = ((-0.25, -0.12), (0.12, -0.25), (0.25, 0.12), (-0.12, 0.25))
_TOO_FAR_M = 14.0
_VIEWS_A_SCENE = 4
_CEILING_SHARE = 0.25


def view_mask(
    caster: Caster, camera: CameraSample, width: int = WIDTH, height: int = HEIGHT, classes: Sequence[str] = CLASSES
) -> Mask:
    """The classes (height, width) that a camera sees at its pixels' centres; 0 background, 255 too far to be judged."""
    return _mask(caster, caster.cast(camera.origin, _rays(camera, width, height)), (height, width), classes)


def _mask(caster: Caster, hits: Hits, shape: tuple[int, int], classes: Sequence[str]) -> Mask:
    labels = caster.labels(hits, classes)
    fronts = (labels > 0) & (caster.labels(hits, ("light",)) == 0)
    labels[fronts & (hits.distance > _TOO_FAR_M)] = IGNORED
    return labels.reshape(shape)


def _rays(camera: CameraSample, width: int, height: int, offset: tuple[float, float] = (0.0, 0.0)) -> Floats:
    rays = view_rays(width, height, camera.hfov_deg, offset)
    world: Floats = (rays @ camera.world_from_view.T).reshape(-1, 3)
    return world


def view_picture(
    scene: Renderer,
    camera: CameraSample,
    look: Look,
    rng: np.random.Generator,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    classes: Sequence[str] = CLASSES,
) -> tuple[Image, Mask]:
    """A camera's picture (h, w, 3) and its classes (h, w), edges smoothed by four more rays a pixel."""
    width, height = size
    pixel_rad = 1 / focal_px(camera.hfov_deg, width)
    color, hits = scene.radiance(camera.origin, _rays(camera, width, height), pixel_rad)
    color = compressed(color)
    edge = np.flatnonzero(different(hits, (height, width)))
    samples = [_rays(camera, width, height, offset)[edge] for offset in _SUBPIXELS]
    finer, _ = scene.radiance(camera.origin, np.concatenate(samples), pixel_rad / 2)
    color[edge] = compressed(finer).reshape(len(_SUBPIXELS), -1, 3).mean(0)
    linear = color.reshape(height, width, 3)
    picture = developed(linear, metered(look, linear, float(rng.uniform(0.4, 1.0))), _vignette(width, height, rng), rng)
    return picture, _mask(scene.caster, hits, (height, width), classes)


def _vignette(width: int, height: int, rng: np.random.Generator) -> Floats:
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    shade: Floats = 1 - float(rng.uniform(0, 0.3)) * (u**2 + v**2) / 2
    return shade


def random_place(seed: int, plugins: Sequence[str] = ()) -> Scene:
    """A random scene with what other plugins' structures it has. Raises SceneError for a plugin that makes up none."""
    scene = random_scene(seed)
    site = Site(scene.hall, scene.goods, scene.look, {name: row_frame(place) for name, place in scene.rows.items()})
    sections = {}
    for name in plugins:
        try:
            make = importlib.import_module(f"savmap_{name}.scene").random_section
        except (ImportError, AttributeError) as error:
            raise SceneError(
                f"--plugin {name}: no module savmap_{name}.scene with a function random_section"
            ) from error
        sections[name] = make(np.random.default_rng([seed, 79, *name.encode()]), site)
    return scene.model_copy(update={"structures": {**scene.structures, **sections}})


def samples(
    seed: int,
    count: int,
    kind: Kind | Literal["mixed"],
    classes: Sequence[str] = CLASSES,
    scene_of: Callable[[int], Scene] = random_scene,
) -> Iterator[tuple[str, Image, Mask]]:
    """`count` named pictures with masks, of the scenes that `scene_of` makes of seeds; the same seed gives the same."""
    for index in range(0, count, _VIEWS_A_SCENE):
        rng = np.random.default_rng([seed, index])
        built = build(scene_of(seed * 1_000_003 + index))
        scene = renderer(built)
        for view in range(index, min(index + _VIEWS_A_SCENE, count)):
            ceiling = rng.random() < _CEILING_SHARE
            wanted: Kind = kind if kind != "mixed" else "ceiling" if ceiling else "shelf"
            camera = _worthwhile(scene, wanted, rng, classes)
            yield f"{wanted}-{seed}-{view:05d}", *view_picture(scene, camera, built.scene.look, rng, classes=classes)


def _worthwhile(
    scene: Renderer, kind: Kind, rng: np.random.Generator, classes: Sequence[str] = CLASSES
) -> CameraSample:
    """A camera that sees something labelled and is not inside or right at a box; nearly always, after a few tries."""
    looked_for = {"ceiling": ("light",), "floor": [name for name in classes if name not in CLASSES] or classes}
    for _ in range(8):
        camera = sample_camera(scene.built, rng, kind)
        hits = scene.caster.cast(camera.origin, _rays(camera, 64, 48))
        wanted = scene.caster.labels(hits, looked_for.get(kind, ("upright", "beam"))) > 0
        clear = wanted.mean() > 0.005 and (hits.distance < 0.3).mean() < 0.05
        if clear or rng.random() < 0.05:
            break
    return camera


def write(
    folder: Path,
    seed: int,
    count: int,
    kind: Kind | Literal["mixed"],
    classes: Sequence[str] = CLASSES,
    scene_of: Callable[[int], Scene] = random_scene,
) -> None:
    """Writes a labelled data set; see `write_samples`."""
    write_samples(folder, classes, "savmap.sim, ray cast", samples(seed, count, kind, classes, scene_of))


def write_samples(
    folder: Path, classes: Sequence[str], renderer: str, pictures: Iterable[tuple[str, Image, Mask]]
) -> None:
    """Writes named pictures (h, w, 3) RGB and masks (h, w) as a labelled data set; others that are there already are kept.

    Raises OutputError where they are labelled with other classes, or something cannot be written."""
    header = folder / "dataset.json"
    there = read_json(header) if header.is_file() else {"classes": list(classes)}
    if not isinstance(there, dict) or there.get("classes") != list(classes):
        raise OutputError(f"{header}: is of pictures with other classes; choose another -o, or give the same --classes")
    about = {"format": "savmap-dataset", "version": 1, "classes": list(classes), "renderer": renderer}
    write_text(header, json.dumps(about, indent=1) + "\n")
    for name, picture, mask in pictures:
        write_picture(folder / "masks" / f"{name}.png", mask)
        bgr = np.ascontiguousarray(picture[..., ::-1])
        write_picture(folder / "images" / f"{name}.jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, 95))


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="labelled pictures of random scenes")
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--kind", choices=("shelf", "face", "ceiling", "floor", "mixed"), default="mixed")
    parser.add_argument("--classes", default=",".join(CLASSES), help="the classes to label, in the masks' order")
    parser.add_argument("--plugin", action="append", default=[], help="whose structures to add; may be repeated")
    options = parser.parse_args(arguments)
    if options.seed < 0 or options.count < 1:
        parser.error("--seed is 0 or more, --count 1 or more")
    with ending_in_one_line():
        scene_of = partial(random_place, plugins=options.plugin)
        write(options.output, options.seed, options.count, options.kind, options.classes.split(","), scene_of)


if __name__ == "__main__":
    main()
