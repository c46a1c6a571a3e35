"""Ways to be wrong about which clip shows a row: cases for `physics.py`, whose references are right, but of another clip."""

import copy
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from physics_cases import ROW, Case, Content, Filmed
from physics_videos import read, write
from physics_ways import other_hand, without

from savmap.lab.sim.drive.cart import drive
from savmap.lab.sim.render.panorama import encode, frames
from savmap.lab.sim.render.shade import renderer
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import load_scene

ANYTHING = ("contradict", "bays were found", "no such thing", "part of the row", "the rest says", "height", "fit")


def clip_cases(row: Filmed) -> Iterator[Case]:
    """The references are right, but of another clip."""
    kinds = ("reference", "camera", "motion")

    def on_the_other_hand(row: Filmed) -> tuple[Content, Path]:
        content = copy.deepcopy(row.content)
        one = content["rows"][ROW]["passes"][0]
        one["side"] = other_hand(one["side"])
        return content, row.folder

    def first(share: float) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = content["rows"][ROW]["passes"][0]
            one["end_s"] = read(row.folder / one["video"])[-1][0] * share
            return content, row.folder

        return change

    def gap(stamped: bool) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = content["rows"][ROW]["passes"][0]
            clip = row.scratch / f"gap-{stamped}.mp4"
            write(clip, without(read(row.folder / one["video"]), stamped))
            one["video"] = str(clip)
            return content, row.folder

        return change

    yield Case("sides swapped", on_the_other_hand, ANYTHING, kinds=kinds)
    yield Case("the first half of the clip", first(1 / 2), ANYTHING, kinds=kinds)
    yield Case("the first two thirds of the clip", first(2 / 3), ANYTHING, kinds=kinds)
    yield Case("a gap, times kept", gap(stamped=True), ("frames are missing",), kinds=kinds)
    yield Case("a gap, times rewritten", gap(stamped=False), ("frames are missing", "frames seem"), kinds=kinds)


def other_clip_cases(_: Filmed) -> Iterator[Case]:
    """Clips that are not what they are given as: another row's, or filmed while the mast was moved."""
    kinds = ("reference", "camera", "motion", "support", "residuals", "repeatability", "shape")

    def another(added: bool) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = {**row.other["rows"][ROW]["passes"][0]}
            one["video"] = str(row.other_folder / one["video"])
            passes = content["rows"][ROW]["passes"]
            passes[:] = [*passes, one] if added else [one]
            return content, row.folder

        return change

    def twice(row: Filmed) -> tuple[Content, Path]:
        content = copy.deepcopy(row.content)
        content["rows"][ROW]["passes"] *= 2
        return content, row.folder

    yield Case("another row's clip", another(added=False), ANYTHING, kinds=kinds)
    yield Case(
        "another row's clip as a second pass", another(added=True), (*ANYTHING, "pass 2", "passes 1 and 2"), kinds=kinds
    )
    yield Case("the clip twice, as two passes", twice, (*ANYTHING, "pass 2"), kinds=(*kinds, "passes"))


def mast_cases(row: Filmed) -> Iterator[Case]:
    """The mast is raised half-way, and its height given as before. Of simulated rows alone."""

    def raised(metres: float) -> Callable[[Filmed], tuple[Content, Path]]:
        def change(row: Filmed) -> tuple[Content, Path]:
            content = copy.deepcopy(row.content)
            one = content["rows"][ROW]["passes"][0]
            clip = row.scratch / f"raised-{metres}.mp4"
            if not clip.is_file():
                render_raised(row.folder / "scene.yaml", metres, clip)
            one["video"] = str(clip)
            return content, row.folder

        return change

    if (row.folder / "scene.yaml").is_file():
        kinds = ("reference", "camera", "motion")
        yield Case("the mast raised by 30 cm half-way", raised(0.3), ("camera height", "height"), kinds=kinds)


def render_raised(scene: Path, metres: float, clip: Path) -> None:
    """A scene's footage, from a camera that stands so much higher from the middle on."""
    built = build(load_scene(scene))
    path = drive(built.scene.cart, built.scene.seed)
    share = np.arange(len(path.origins)) / len(path.origins)
    path.origins[:, 1] += metres * np.clip((share - 0.45) / 0.1, 0.0, 1.0)
    encode(frames(renderer(built), path, 2), built.scene.cart, clip)
