"""How good are the paths of visual odometry: their shape, the length of their steps, what is lost, and what it costs?

    python -m bench odometry [--set test] [--count 18] [--width 1024] [--every 1] [--peer] [--keep DIR]

Drives past random short rows, by turns in colour, in grey and dark; 18 of them take ten minutes of a processor, most of
these for rendering. DIR keeps the footage. `--every`: so many frames a step.

rms: of places after rotation, translation and scale, of the longest part, as a share of the way. spread: of the ratio of
steps to the true ones. lost: frames that are not in the longest part. s a frame: of a processor, to follow points and to
place the frame, without decoding. A drive is good with an rms of at most 0.3 % and nothing lost. `--peer`: pycolmap
(SIFT, sequential matching, incremental mapping with all of its frames at once) on the same whole panoramas, with its
camera EQUIRECTANGULAR. Both work with one thread, in a process of their own.
"""

import argparse
import json
import multiprocessing
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bench.baseline import Figures
from bench.seeds import SETS, is_test, seeds
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.scene.files import Scene
from savmap.lab.sim.simulate import simulate
from savmap.types import Floats, Ints, Panorama
from savmap.video.image_folder import write_picture
from savmap.video.reader import Clip, panoramas
from savmap.vision.odometry import Follower, Odometry
from savmap_shelves.lab.looks import darkened, greyed

FAMILIES: Mapping[str, Callable[[Scene, int], Scene]] = {
    "rows": lambda scene, _: scene,
    "grey rows": greyed,
    "dark rows": darkened,
}
GOOD = 0.3
"""Of the rms, % of the way."""
FEWEST = 8
"""Frames that can be compared; a path with fewer of them is 100 % off."""
STILL = 0.1
"""Steps shorter than this share of the usual one are not compared."""
PEERS_OVERLAP = 10
Cells = Mapping[str, float]
Given = TypeVar("Given")
Answer = TypeVar("Answer")
Picture = NDArray[np.uint8]
CameraOf = Callable[[int, int], tuple[str, str]]


@dataclass(frozen=True, eq=False)
class Walk:
    """Where a camera was, (n, 3), in frames of its clip with these numbers (n,), how many others are lost, and seconds of
    a processor a frame."""

    frames: Ints
    places: Floats
    lost: int = 0
    seconds: float = 0.0


def frames_of(video: Path, every: int) -> Iterator[Panorama]:
    """Every so many frames of a clip, the first one among them."""
    return islice(panoramas(Clip(video, fps=1000.0)), 0, None, every)


def followed(video: Path, every: int) -> Walk:
    """The path of savmap's odometry."""
    follower, odometry, seconds = Follower(), Odometry(), 0.0
    for panorama in frames_of(video, every):
        begun = time.thread_time()
        follower.forget(odometry.take(follower.update(panorama)))
        seconds += time.thread_time() - begun
    path = odometry.path
    kept = np.flatnonzero(path.part == path.longest)
    total = len(path.part)
    return Walk(every * kept, path.world_from_rig[kept, :3, 3], total - len(kept), seconds / total)


def peers(video: Path, every: int) -> Walk:
    """The path of pycolmap."""
    numbered = ((every * number, panorama.image) for number, panorama in enumerate(frames_of(video, every)))
    return pycolmaps(numbered, lambda width, height: ("EQUIRECTANGULAR", f"{width}, {height}"), PEERS_OVERLAP)


def pycolmaps(numbered: Iterable[tuple[int, Picture]], camera: CameraOf, overlap: int) -> Walk:
    """The path of pycolmap by numbered RGB pictures, each matched with so many before it. `camera`: model and
    parameters of pictures of a width and height."""
    import pycolmap

    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value
    pycolmap.set_random_seed(0)
    with tempfile.TemporaryDirectory() as temporary:
        folder, database = Path(temporary) / "pictures", Path(temporary) / "database.db"
        folder.mkdir()
        total, size = 0, (0, 0)
        for number, picture in numbered:
            write_picture(folder / f"{number:06d}.png", picture[..., ::-1])
            total, size = total + 1, (picture.shape[1], picture.shape[0])
        model, parameters = camera(*size)
        begun = time.process_time()
        pycolmap.extract_features(
            database,
            folder,
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options={"camera_model": model, "camera_params": parameters},
            extraction_options={"num_threads": 1},
        )
        pycolmap.match_sequential(database, {"num_threads": 1}, {"overlap": overlap, "num_threads": 1})
        models = pycolmap.incremental_mapping(database, folder, temporary, {"num_threads": 1})
        seconds = (time.process_time() - begun) / total
    images = max(models.values(), key=lambda model: model.num_reg_images()).images.values() if models else ()
    places = {int(image.name[:6]): image.projection_center() for image in images if image.has_pose}
    numbers = np.array(sorted(places), np.int64)
    return Walk(numbers, np.array([places[k] for k in numbers]).reshape(-1, 3), total - len(places), seconds)


def alone(method: Callable[[Path, Given], Answer], video: Path, given: Given) -> Answer:
    """What a method gives, a path, in a process of its own with one thread."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), one_thread) as pool:
        return pool.submit(method, video, given).result()


def one_thread() -> None:
    """From now on, OpenCV and NumPy have one."""
    cv2.setNumThreads(1)
    threadpool_limits(1, "blas")


def walks(video: Path, given: argparse.Namespace) -> dict[str, Walk]:
    """The paths of a clip that the arguments ask for, by what they are called."""
    methods = {"savmap": followed} | ({"pycolmap": peers} if given.peer else {})
    return {
        name if step == 1 else f"{name}, every {step}": alone(method, video, step)
        for step in given.every
        for name, method in methods.items()
    }


def true_walk(poses: Path) -> Walk:
    """The camera's places in a `poses.json` of `savmap simulate`."""
    content = json.loads(poses.read_text(encoding="utf-8"))
    places = np.array([frame["world_from_rig"] for frame in content["frames"]])[:, :3, 3]
    return Walk(np.arange(len(places)), places)


def score(walk: Walk, measure: Walk) -> Cells:
    """A path beside another one, in whose unit it is brought."""
    shared, a, b = np.intersect1d(walk.frames, measure.frames, assume_unique=True, return_indices=True)
    figures = {"lost": walk.lost, "s a frame": walk.seconds}
    if len(shared) < FEWEST:
        return {"length": 0.0, "rms %": 100.0, "spread %": 100.0, **figures}
    true, fitted = measure.places[b], brought(walk.places[a], measure.places[b])
    true_steps, steps = (np.linalg.norm(np.diff(places, axis=0), axis=1) for places in (true, fitted))
    length = float(true_steps.sum())
    gaps = np.diff(shared)
    compared = (gaps == gaps.min()) & (true_steps > STILL * np.median(true_steps))
    return {
        "length": length,
        "rms %": 100 * float(np.sqrt(np.square(fitted - true).sum(axis=1).mean())) / length,
        "spread %": 100 * float((steps[compared] / true_steps[compared]).std()),
        **figures,
    }


def brought(places: Floats, onto: Floats) -> Floats:
    """Places (n, 3) after the rotation, translation and scale that bring them nearest to others (Umeyama 1991)."""
    middle, goal = places.mean(axis=0), onto.mean(axis=0)
    left, sizes, right = np.linalg.svd((onto - goal).T @ (places - middle))
    signs = np.array([1.0, 1.0, np.linalg.det(left @ right)])
    scale = float(sizes @ signs) / float(np.square(places - middle).sum())
    result: Floats = goal + scale * (places - middle) @ (left * signs @ right).T
    return result


def totals(scores: Sequence[Cells]) -> Cells:
    """Figures over all drives."""
    rms, lost, spread, seconds = (
        np.array([cells[key] for cells in scores]) for key in ("rms %", "lost", "spread %", "s a frame")
    )
    return {
        "drives": len(scores),
        "good %": 100 * float(((rms <= GOOD) & (lost == 0)).mean()),
        "median %": float(np.median(rms)),
        "95 of 100 %": float(np.percentile(rms, 95)),
        "worst %": float(rms.max()),
        "spread %": float(np.median(spread)),
        "lost": int(lost.sum()),
        "s a frame": float(seconds.mean()),
    }


def drives(given: argparse.Namespace, base: Path) -> Iterator[tuple[str, int, Path]]:
    """Family, seed and folder of the footage of each drive, made unless it exists; the families take turns."""
    sets = [[(family, seed) for seed in seeds(family, given.set)] for family in FAMILIES]
    for family, seed in islice(filter(None, chain.from_iterable(zip_longest(*sets))), given.count):
        folder = base / f"{family.replace(' ', '-')}-{seed}-{given.width}"
        if not (folder / "footage.mp4").is_file():
            simulate(FAMILIES[family](random_row(seed, given.frames, given.width), seed), folder)
        yield family, seed, folder


def text(cells: Cells) -> str:
    """A line of figures."""
    return ", ".join(f"{key} {value:.3g}" for key, value in cells.items())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="test", help="of seeds; drives of `test` are totals only")
    parser.add_argument("--count", type=int, default=18, help="of drives")
    parser.add_argument("--frames", type=int, default=40, help="of a drive")
    parser.add_argument("--width", type=int, default=1024, help="of a drive's panoramas, pixels")
    parser.add_argument(
        "--every", type=int, nargs="+", default=[1], help="take every so many frames; several: one after another"
    )
    parser.add_argument("--peer", action="store_true", help="also pycolmap's path (extra `validators`)")


def run(given: argparse.Namespace) -> Figures:
    """Totals over simulated drives; a line for each that may be shown."""
    scores = defaultdict[str, list[Cells]](list)
    for family, seed, folder in drives(given, given.keep):
        true = true_walk(folder / "poses.json")
        for name, walk in walks(folder / "footage.mp4", given).items():
            scores[name].append(cells := score(walk, true))
            if not is_test(family, seed):
                print(f"{family} {seed}, {name}: {text(cells)}", flush=True)
    return {name: totals(scores[name]) for name in sorted(scores)}
