"""Labelled pictures of random scenes for training networks: `python -m savmap.lab.sim.dataset --count 100 --seed 1 -o
DIR`.

DIR/images/NAME.jpg, DIR/masks/NAME.png (0 background, k for classes[k - 1], 255 not to be judged) and DIR/dataset.json.
Structures of further plugins: `--plugin NAME`, whose hook `random_section` says what of them a random place has.
`--kind floor` looks down at the floor before the rows; `--kind painted` are those of the plugin's hook
`practice_picture`.
"""

import argparse
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
from savmap.lab.plugins import LabPlugin, lab_plugin
from savmap.lab.scenes import Exposure
from savmap.lab.sim.drive.views import CameraSample, Kind, sample_camera, sought_labels, view_rays
from savmap.lab.sim.random_scene import classes_of, random_scene
from savmap.lab.sim.render.raycast import Caster, Hits
from savmap.lab.sim.render.shade import Image, Mask, Renderer, antialiased, developed, metered, renderer
from savmap.lab.sim.render.surfaces import Indices
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import Scene
from savmap.plugin.manager import load_class
from savmap.types import Floats
from savmap.video.image_folder import write_picture

WIDTH, HEIGHT = 640, 480
IGNORED = 255
Sample = tuple[Image, Mask]
"""A picture (h, w, 3) RGB and its mask (h, w)."""

_TOO_FAR_M = 14.0
_VIEWS_A_SCENE = 4
_CEILING_SHARE = 0.25


def view_mask(
    caster: Caster, camera: CameraSample, classes: Sequence[str], width: int = WIDTH, height: int = HEIGHT
) -> Mask:
    """The classes (height, width) that a camera sees at its pixels' centres; 0 background, 255 too far to be judged."""
    return _mask(caster, caster.cast(camera.origin, _rays(camera, width, height)), (height, width), classes)


def _mask(caster: Caster, hits: Hits, shape: tuple[int, int], classes: Sequence[str]) -> Mask:
    """Luminous structures count at any distance."""
    labels = caster.labels(hits, classes)
    luminous = tuple({label for box in caster.boxes if box.material.emission > 0 for label in box.face_labels.values()})
    fronts = (labels > 0) & (caster.labels(hits, luminous) == 0)
    labels[fronts & (hits.distance > _TOO_FAR_M)] = IGNORED
    return labels.reshape(shape)


def _rays(camera: CameraSample, width: int, height: int, offset: tuple[float, float] = (0.0, 0.0)) -> Floats:
    rays = view_rays(width, height, camera.hfov_deg, offset)
    world: Floats = (rays @ camera.world_from_view.T).reshape(-1, 3)
    return world


def view_picture(
    scene: Renderer,
    camera: CameraSample,
    appearance: Exposure,
    rng: np.random.Generator,
    classes: Sequence[str],
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> tuple[Image, Mask]:
    """A camera's picture (h, w, 3) and its classes (h, w), edges smoothed by four more rays a pixel."""
    width, height = size
    pixel_rad = 1 / focal_px(camera.hfov_deg, width)

    def rays_of(offset: tuple[float, float], chosen: Indices) -> Floats:
        return _rays(camera, width, height, offset)[chosen]

    linear, hits = antialiased(scene, camera.origin, rays_of, (height, width), pixel_rad)
    picture = developed(
        linear, metered(appearance, linear, float(rng.uniform(0.4, 1.0))), _vignette(width, height, rng), rng
    )
    return picture, _mask(scene.caster, hits, (height, width), classes)


def _vignette(width: int, height: int, rng: np.random.Generator) -> Floats:
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    shade: Floats = 1 - float(rng.uniform(0, 0.3)) * (u**2 + v**2) / 2
    return shade


def samples(
    seed: int,
    count: int,
    kind: Kind | Literal["mixed"],
    classes: Sequence[str] | None = None,
    scene_of: Callable[[int], Scene] = random_scene,
    views: int = _VIEWS_A_SCENE,
) -> Iterator[tuple[str, Image, Mask]]:
    """`count` named pictures with masks, `views` of each of the scenes that `scene_of` makes of seeds; the same seed
    gives the same.

    `classes`: the default are those of the scenes' plugins.
    """
    for index in range(0, count, views):
        rng = np.random.default_rng([seed, index])
        built = build(scene_of(seed * 1_000_003 + index))
        scene = renderer(built)
        labelled = classes_of(built.scene) if classes is None else classes
        for view in range(index, min(index + views, count)):
            ceiling = rng.random() < _CEILING_SHARE
            wanted: Kind = kind if kind != "mixed" else "ceiling" if ceiling else "row"
            camera = _worthwhile(scene, wanted, rng)
            yield f"{wanted}-{seed}-{view:05d}", *view_picture(scene, camera, built.scene.look, rng, labelled)


def _worthwhile(scene: Renderer, kind: Kind, rng: np.random.Generator) -> CameraSample:
    """A camera that sees something labelled and is not inside or right at a box; nearly always, after a few tries."""
    sought = sorted(sought_labels(scene.built, kind))
    for _ in range(8):
        camera = sample_camera(scene.built, rng, kind)
        hits = scene.caster.cast(camera.origin, _rays(camera, 64, 48))
        seen = scene.caster.labels(hits, sought) > 0
        clear = seen.mean() > 0.005 and (hits.distance < 0.3).mean() < 0.05
        if clear or rng.random() < 0.05:
            break
    return camera


def write(
    folder: Path,
    seed: int,
    count: int,
    kind: Kind | Literal["mixed"],
    classes: Sequence[str] | None = None,
    scene_of: Callable[[int], Scene] = random_scene,
) -> None:
    """Writes a labelled data set; see `samples` and `write_samples`."""
    labelled = classes_of(scene_of(seed)) if classes is None else classes
    write_samples(folder, labelled, "savmap.lab.sim, ray cast", samples(seed, count, kind, labelled, scene_of))


def write_samples(
    folder: Path, classes: Sequence[str], renderer: str, pictures: Iterable[tuple[str, Image, Mask]]
) -> None:
    """Writes named pictures (h, w, 3) RGB and masks (h, w) as a labelled data set; others that are there already are
    kept.

    Raises OutputError where they are labelled with other classes, or something cannot be written."""
    header = folder / "dataset.json"
    existing = read_json(header) if header.is_file() else {"classes": list(classes)}
    if not isinstance(existing, dict) or existing.get("classes") != list(classes):
        raise OutputError(f"{header}: is of pictures with other classes; choose another -o, or give the same --classes")
    about = {"format": "savmap-dataset", "version": 1, "classes": list(classes), "renderer": renderer}
    write_text(header, json.dumps(about, indent=1) + "\n")
    for name, picture, mask in pictures:
        write_picture(folder / "masks" / f"{name}.png", mask)
        bgr = np.ascontiguousarray(picture[..., ::-1])
        write_picture(folder / "images" / f"{name}.jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, 95))


def write_series(
    folder: Path, classes: Sequence[str], renderer: str, names: Sequence[str], make: Callable[[int], Sample]
) -> None:
    """Writes the pictures of a series that a folder lacks, so that a run that was stopped goes on; `make` gives the
    k-th. Raises OutputError as `write_samples`."""
    missing = (k for k, name in enumerate(names) if not (folder / "images" / f"{name}.jpg").is_file())
    write_samples(folder, classes, renderer, ((names[k], *make(k)) for k in missing))


def write_practice(folder: Path, plugin: LabPlugin, classes: Sequence[str], seed: int, count: int) -> None:
    """Writes the pictures that a plugin's hook `practice_picture` paints, as far as a folder lacks them. `classes`:
    those of its network, unless it says them itself. Raises PluginFailedError, and OutputError as `write_samples`."""
    names = [f"practice-{seed}-{index:06d}" for index in range(count)]
    write_series(folder, plugin.network_classes or classes, "practice", names, partial(plugin.practice_picture, seed))


def series_options(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options of a parser, with those of every data set: `count`, `seed` and `output`. Exits where they are out of
    range."""
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    if options.seed < 0 or options.count < 1:
        parser.error("--seed is 0 or more, --count 1 or more")
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="labelled pictures of random scenes")
    parser.add_argument(
        "--kind", choices=("row", "face", "close", "ceiling", "floor", "mixed", "painted"), default="mixed"
    )
    parser.add_argument("--classes", help="the classes to label, in the masks' order; default: the plugins'")
    parser.add_argument("--plugin", action="append", default=[], help="whose structures to add; may be repeated")
    options = series_options(parser, arguments)
    with ending_in_one_line():
        if options.kind == "painted":
            lab = lab_plugin(options.plugin[0]) if len(options.plugin) == 1 else None
            if lab is None or not lab.has("practice_picture"):
                parser.error("--kind painted goes with one --plugin, which has the hook `practice_picture`")
            cv2.setNumThreads(1)
            write_practice(options.output, lab, load_class(lab.name).classes, options.seed, options.count)
            return
        scene_of = partial(random_scene, plugins=options.plugin)
        classes = options.classes.split(",") if options.classes else None
        write(options.output, options.seed, options.count, options.kind, classes, scene_of)


if __name__ == "__main__":
    main()
