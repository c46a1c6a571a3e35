"""Labelled pictures of random scenes with signs: `python -m savmap_signs.lab.pictures --count 500 --seed 1 -o DIR`.

A data set as `savmap.lab.sim.dataset` writes them; signs too small to be told are not judged.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from savmap.errors import ending_in_one_line
from savmap.geometry.pinhole import rig_from_view
from savmap.lab.sim.dataset import IGNORED, series_options, view_mask, view_picture, write_samples
from savmap.lab.sim.drive.cart import world_from_level
from savmap.lab.sim.drive.views import CameraSample, sample_camera
from savmap.lab.sim.random_scene import classes_of, random_scene
from savmap.lab.sim.render.shade import Image, Mask, Renderer, renderer
from savmap.lab.sim.scene.build import build
from savmap.vision.masks import connected_regions

PLUGIN, NAME = "signs", "sign"
VIEWS_A_SCENE = 10
ALONG_SHARE = 0.4
LEAST_PX = 40


def samples(seed: int, count: int) -> Iterator[tuple[str, Image, Mask]]:
    """`count` named pictures with masks; the same seed gives the same."""
    for index in range(0, count, VIEWS_A_SCENE):
        rng = np.random.default_rng([seed, index])
        built = build(random_scene(seed * 1_000_003 + index, [PLUGIN]))
        scene, classes = renderer(built), classes_of(built.scene)
        for view in range(index, min(index + VIEWS_A_SCENE, count)):
            picture, mask = _worthwhile(scene, rng, classes)
            yield f"plate-{seed}-{view:05d}", picture, _judged(mask, classes.index(NAME) + 1)


def _worthwhile(scene: Renderer, rng: np.random.Generator, classes: Sequence[str]) -> tuple[Image, Mask]:
    """A picture with a sign in it; nearly always, after a few tries."""
    value = classes.index(NAME) + 1
    for _ in range(10):
        camera = _camera(scene, rng)
        small = view_mask(scene.caster, camera, classes, 80, 60)
        if (small == value).sum() > 3 or rng.random() < 0.04:
            break
    return view_picture(scene, camera, scene.built.scene.look, rng, classes)


def _camera(scene: Renderer, rng: np.random.Generator) -> CameraSample:
    """Towards a face as the simulator's other pictures are, or along the aisle."""
    camera = sample_camera(scene.built, rng)
    if rng.random() > ALONG_SHARE:
        return replace(camera, hfov_deg=float(rng.uniform(70, 130)))
    heading = np.array([rng.choice([-1.0, 1.0]), 0.0, 0.0])
    turn = rig_from_view(float(rng.normal(0, 15)), float(rng.uniform(-5, 25)), float(rng.normal(0, 4)))
    return CameraSample(camera.origin, world_from_level(heading) @ turn, float(rng.uniform(60, 110)))


def _judged(mask: Mask, value: int) -> Mask:
    """The mask with signs of fewer than `LEAST_PX` pixels left unjudged."""
    regions = connected_regions((mask == value).astype(np.uint8))
    small = regions.areas < LEAST_PX
    small[0] = False
    return np.where(small[regions.labels], IGNORED, mask).astype(np.uint8)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="labelled pictures of random scenes with signs")
    options = series_options(parser, arguments)
    with ending_in_one_line():
        classes = classes_of(random_scene(options.seed, [PLUGIN]))
        write_samples(options.output, classes, "savmap.lab.sim, ray cast", samples(options.seed, options.count))


if __name__ == "__main__":
    main()
