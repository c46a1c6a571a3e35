"""Equirectangular pictures of a built scene, the classes that views cut from them would see, and a drive's video."""

import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

import av
import cv2
import numpy as np

from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.lab.scenes import Exposure
from savmap.lab.sim.drive.cart import Drive
from savmap.lab.sim.render.shade import Image, Mask, Renderer, antialiased, developed, metered
from savmap.lab.sim.render.surfaces import Indices, Singles
from savmap.lab.sim.scene.files import Cart
from savmap.types import Floats, ViewSpec
from savmap.video.container import local_name

Made = TypeVar("Made")

_BAND_PIXELS = 250_000
_METERING_HEIGHT = 64
_QUALITY = {"crf": "18", "preset": "fast"}


def panorama(
    scene: Renderer,
    origin: Floats,
    world_from_rig: Floats,
    height: int,
    appearance: Exposure,
    seed: Sequence[int] = (0,),
) -> Image:
    """The panorama (height, 2 height, 3) RGB of a rig at `origin` (3,) m; `seed` fixes its noise."""
    rng = np.random.default_rng(list(seed))
    bands = linear_bands(scene, origin, world_from_rig, height)
    return np.concatenate([developed(band, appearance, None, rng) for band in bands])


def linear_bands(scene: Renderer, origin: Floats, world_from_rig: Floats, height: int) -> Iterator[Singles]:
    """The panorama's linear radiance, a few rows at a time from the top (rows, 2 height, 3): memory stays bounded."""
    rows = max(2, _BAND_PIXELS // (2 * height))
    for top in range(0, height, rows):
        yield _band(scene, origin, world_from_rig, height, (top, min(top + rows, height)))


def _band(scene: Renderer, origin: Floats, world_from_rig: Floats, height: int, rows: tuple[int, int]) -> Singles:
    """The rows `rows`, seen with their neighbours so that edges between bands are found."""
    first, last = max(rows[0] - 1, 0), min(rows[1] + 1, height)
    u, v = np.meshgrid(np.arange(2 * height), np.arange(first, last))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float64)

    def rays_of(offset: tuple[float, float], chosen: Indices) -> Floats:
        world: Floats = rays_from_panorama_pixels(pixels[chosen] + offset, height) @ world_from_rig.T
        return world

    inside = slice(rows[0] - first, rows[1] - first)
    band, _ = antialiased(scene, origin, rays_of, (last - first, 2 * height), np.pi / height, inside, wrap=True)
    return band[inside]


def view_classes(
    scene: Renderer, origin: Floats, world_from_rig: Floats, spec: ViewSpec, classes: Sequence[str]
) -> Mask:
    """The classes (height, width) a view sees at its pixels' centres: 0 background, k for classes[k - 1]."""
    u, v = np.meshgrid(np.arange(spec.width), np.arange(spec.height))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float64)
    hits = scene.caster.cast(origin, spec.rig_rays(pixels) @ world_from_rig.T)
    return scene.caster.labels(hits, classes).reshape(spec.height, spec.width)


@dataclass(frozen=True, eq=False)
class _Task:
    scene: Renderer
    path: Drive
    appearance: Exposure

    def frame(self, index: int) -> Image:
        scene = self.scene.built.scene
        origin, turn = self.path.origins[index], self.path.world_from_rig[index]
        return panorama(self.scene, origin, turn, scene.cart.width // 2, self.appearance, (scene.seed, 9, index))


_prepared: list[Callable[[int], Any]] = []


def frames(scene: Renderer, path: Drive, workers: int) -> Iterator[Image]:
    """The drive's panoramas (width / 2, width, 3) RGB in order, at most a few of them in memory at a time."""
    yield from in_order(_Task(scene, path, _exposed(scene, path)).frame, len(path.origins), workers)


def in_order(work: Callable[[int], Made], count: int, workers: int) -> Iterator[Made]:
    """What processes make of the numbers from 0 to `count`, in order, a few ahead."""
    with _one_opencv_thread(), ProcessPoolExecutor(workers, initializer=_prepare, initargs=(work,)) as pool:
        pending: deque[Future[Made]] = deque()
        try:
            for index in range(count):
                pending.append(pool.submit(_done, index))
                if len(pending) > 2 * workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)  # whoever is interrupted does not wait for frames that nobody wants


@contextmanager
def _one_opencv_thread() -> Iterator[None]:
    """While this lasts, OpenCV works in the calling thread alone: a forked process that inherits its pool would wait
    for threads that it does not have."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def encode(images: Iterable[Image], cart: Cart, path: Path) -> None:
    """Writes an H.264 video of panoramas of the cart's size and rate; along a path with a key frame a second, as
    cameras do."""
    options = _QUALITY if cart.path is None else {**_QUALITY, "g": str(max(1, round(cart.fps)))}
    with av.open(local_name(path), "w") as container:
        rate = Fraction(cart.fps).limit_denominator(1001)
        stream = container.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height = cart.width, cart.width // 2
        stream.pix_fmt = "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())


def _exposed(scene: Renderer, path: Drive) -> Exposure:
    """The clip's one exposure, as metered half way along the drive."""
    middle = len(path.origins) // 2
    bands = linear_bands(scene, path.origins[middle], path.world_from_rig[middle], _METERING_HEIGHT)
    return metered(scene.built.scene.look, np.concatenate(list(bands)))


def _prepare(work: Callable[[int], Any]) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # what the program does then is not for its workers
    _prepared[:] = [work]


def _done(index: int) -> Any:
    return _prepared[0](index)
