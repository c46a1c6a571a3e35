"""Path-traced training pictures with Blender: `python -m savmap.train.blender --count 100 --seed 1 --look 2 -o DIR`.

Needs the `bpy` wheel (extra `blender`); see docs/training-pictures.md. Writes the data-set format of savmap.sim.dataset:
DIR/images/NAME.jpg, DIR/masks/NAME.png, DIR/dataset.json. Finished pictures are kept, so that a run can be resumed.
"""

import argparse
import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from savmap.errors import SavmapError, ending_in_one_line
from savmap.sim.build import Built, build
from savmap.sim.camera import CameraSample, Kind, sample_camera
from savmap.sim.dataset import write_samples
from savmap.sim.primitives import Box
from savmap.sim.random_scene import random_scene
from savmap.train.blender_camera import develop
from savmap.train.blender_dress import dress
from savmap.train.blender_lights import lines_of_lamps
from savmap.train.blender_looks import Look, Rng, draw_look
from savmap.train.blender_masks import Mask, MaskCaster
from savmap.train.blender_mesh import meshes_by_shader

CLASSES = ("upright", "beam", "light")
VIEWS_A_SCENE = 5

_FACE: Kind = get_args(Kind)[0]
_CEILING: Kind = "ceiling"
_CEILING_VIEWS = (2, 5, 9)
_FOCUS_M = 2.5

Image = NDArray[np.uint8]


class BlenderError(SavmapError):
    """The path tracer is an optional tool for training only."""


@dataclass(frozen=True)
class Quality:
    """The pictures' size in pixels, and the work that goes into them."""

    width: int = 640
    height: int = 480
    samples: int = 2
    threads: int = 2


class Studio:
    """A scene set up in Blender, of which there can be one at a time. Raises BlenderError without the bpy wheel."""

    def __init__(self, boxes: Sequence[Box], look: Look, rng: Rng, quality: Quality) -> None:
        if importlib.util.find_spec("bpy") is None:
            raise BlenderError("path-traced pictures need the bpy wheel: install the `blender` extra (Python 3.11)")
        from savmap.train import blender_scene

        self._look, self._quality, self._shoot = look, quality, blender_scene.shoot
        meshes = meshes_by_shader(dress(boxes, look.number, rng), CLASSES)
        self._caster = MaskCaster(meshes, far_label=CLASSES.index("light") + 1)
        self._width = 4 * round(quality.width / look.lens.softness / 4)
        effort = blender_scene.Effort(
            self._width, self._width * quality.height // quality.width, quality.samples, threads=quality.threads
        )
        fills = lines_of_lamps(boxes, look.light.lamp_gain, look.light.lamp_color, rng)
        blender_scene.set_up(meshes, look, fills, effort)

    def sees(self, eye: CameraSample, kind: Kind) -> bool:
        """Whether a camera sees something of its kind and does not stand in or right at a thing."""
        mask, distance = self._caster.cast(eye, 64, 48)
        wanted = mask == CLASSES.index("light") + 1 if kind == _CEILING else (mask == 1) | (mask == 2)
        return bool(wanted.mean() > 0.005 and (distance < 0.3).mean() < 0.05)

    def picture(self, eye: CameraSample, rng: Rng) -> tuple[Image, Mask]:
        """RGB (height, width, 3) and mask (height, width)."""
        size = self._quality.width, self._quality.height
        mask, _ = self._caster.cast(eye, *size)
        raw = self._shoot(eye, self._look.lens, self._width, _FOCUS_M, int(rng.integers(1 << 30)))
        return develop(raw, self._look.lens, size, rng), mask


def _camera(studio: Studio, built: Built, kind: Kind, rng: Rng) -> CameraSample:
    for _ in range(12):
        eye = sample_camera(built, rng, kind)
        if studio.sees(eye, kind):
            break
    return eye


def _name(look: int, seed: int, index: int) -> tuple[str, Kind]:
    kind: Kind = _CEILING if index % 10 in _CEILING_VIEWS else _FACE
    return f"{kind}-look{look}-{seed}-{index:05d}", kind


def samples(seed: int, indices: Sequence[int], look: int, quality: Quality) -> Iterator[tuple[str, Image, Mask]]:
    """Named pictures with masks, `indices` of the endless series that seed and look define."""
    for scene in sorted({index // VIEWS_A_SCENE for index in indices}):
        rng = np.random.default_rng([seed, look, scene])
        built = build(random_scene(seed * 1_000_003 + 500_000 + scene))
        studio = Studio(built.boxes, draw_look(look, rng), rng, quality)
        for index in (index for index in indices if index // VIEWS_A_SCENE == scene):
            own = np.random.default_rng([seed, look, scene, index])
            name, kind = _name(look, seed, index)
            yield name, *studio.picture(_camera(studio, built, kind, own), own)


def write(folder: Path, seed: int, count: int, look: int, quality: Quality) -> None:
    """Writes a labelled data set; a picture that is there already is kept, with its mask."""
    missing = [i for i in range(count) if not (folder / "images" / f"{_name(look, seed, i)[0]}.jpg").exists()]
    renderer = f"savmap.train.blender, path traced, look {look}"
    write_samples(folder, CLASSES, renderer, samples(seed, missing, look, quality))


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="path-traced, labelled pictures of random scenes")
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--look", type=int, choices=(2, 3), default=2, help="3: for measuring only, never for training")
    parser.add_argument("--samples", type=int, default=Quality.samples, help="paths a pixel, before denoising")
    parser.add_argument("--threads", type=int, default=Quality.threads)
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    with ending_in_one_line():
        quality = Quality(samples=options.samples, threads=options.threads)
        write(options.output, options.seed, options.count, options.look, quality)


if __name__ == "__main__":
    main()
