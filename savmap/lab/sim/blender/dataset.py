"""Path-traced training pictures with Blender: `python -m savmap.lab.sim.blender --count 100 --seed 1 --look 2 -o DIR`.

Needs the `bpy` wheel (extra `blender`); see docs/training-pictures.md. Writes the data-set format of
savmap.lab.sim.dataset: DIR/images/NAME.jpg, DIR/masks/NAME.png, DIR/dataset.json. Finished pictures are kept, so that a
run can be resumed.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from savmap.errors import ending_in_one_line
from savmap.lab.sim.blender.scene import BlenderScene, Image, Mask, Quality
from savmap.lab.sim.blender.style import Rng, draw_style
from savmap.lab.sim.dataset import write_samples
from savmap.lab.sim.drive.views import CameraSample, Kind, sample_camera
from savmap.lab.sim.random_scene import classes_of, random_scene
from savmap.lab.sim.scene.build import Built, build

VIEWS_A_SCENE = 5

_CEILING_VIEWS = (2, 5, 9)


def _camera(scene: BlenderScene, built: Built, kind: Kind, rng: Rng) -> CameraSample:
    for _ in range(12):
        eye = sample_camera(built, rng, kind)
        if scene.sees(eye, kind):
            break
    return eye


def _name(look: int, seed: int, index: int) -> tuple[str, Kind]:
    kind: Kind = "ceiling" if index % 10 in _CEILING_VIEWS else "row"
    return f"{kind}-look{look}-{seed}-{index:05d}", kind


def samples(seed: int, indices: Sequence[int], look: int, quality: Quality) -> Iterator[tuple[str, Image, Mask]]:
    """Named pictures with masks, `indices` of the endless series that seed and look define."""
    for number in sorted({index // VIEWS_A_SCENE for index in indices}):
        rng = np.random.default_rng([seed, look, number])
        built = build(random_scene(seed * 1_000_003 + 500_000 + number))
        scene = BlenderScene(built, classes_of(built.scene), draw_style(look, rng), rng, quality)
        for index in (index for index in indices if index // VIEWS_A_SCENE == number):
            view_rng = np.random.default_rng([seed, look, number, index])
            name, kind = _name(look, seed, index)
            yield name, *scene.picture(_camera(scene, built, kind, view_rng), view_rng)


def write(folder: Path, seed: int, count: int, look: int, quality: Quality) -> None:
    """Writes a labelled data set; a picture that is there already is kept, with its mask."""
    missing = [i for i in range(count) if not (folder / "images" / f"{_name(look, seed, i)[0]}.jpg").exists()]
    renderer = f"savmap.lab.sim.blender, path traced, look {look}"
    write_samples(folder, classes_of(random_scene(seed)), renderer, samples(seed, missing, look, quality))


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
