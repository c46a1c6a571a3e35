"""Panoramas of a drive, rendered by several processes in order, and their video."""

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from savmap.sim.camera import Drive
from savmap.sim.panorama import linear_bands, panorama
from savmap.sim.scene import Cart, Look
from savmap.sim.shade import Image, Renderer, metered

_METERING_HEIGHT = 64
_QUALITY = {"crf": "18", "preset": "fast"}


@dataclass(frozen=True)
class _Task:
    scene: Renderer
    path: Drive
    look: Look

    def frame(self, index: int) -> Image:
        scene = self.scene.built.scene
        origin, turn = self.path.origins[index], self.path.world_from_rig[index]
        return panorama(self.scene, origin, turn, scene.cart.width // 2, self.look, (scene.seed, 9, index))


_prepared: list[_Task] = []


def frames(scene: Renderer, path: Drive, workers: int) -> Iterator[Image]:
    """The drive's panoramas (width / 2, width, 3) RGB in order, at most a few of them in memory at a time."""
    task = _Task(scene, path, _exposed(scene, path))
    with ProcessPoolExecutor(workers, initializer=_prepare, initargs=(task,)) as pool:
        pending: deque[Future[Image]] = deque()
        for index in range(len(path.origins)):
            pending.append(pool.submit(_frame, index))
            if len(pending) > 2 * workers:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()


def encode(images: Iterable[Image], cart: Cart, path: Path) -> None:
    """Writes an H.264 video of panoramas of the cart's size and rate; along a path with a key frame a second, as cameras do."""
    options = _QUALITY if cart.path is None else {**_QUALITY, "g": str(max(1, round(cart.fps)))}
    with av.open(str(path), "w") as container:
        rate = Fraction(cart.fps).limit_denominator(1001)
        stream = container.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height = cart.width, cart.width // 2
        stream.pix_fmt = "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())


def _exposed(scene: Renderer, path: Drive) -> Look:
    """The clip's one exposure, as metered half way along the drive."""
    middle = len(path.origins) // 2
    bands = linear_bands(scene, path.origins[middle], path.world_from_rig[middle], _METERING_HEIGHT)
    return metered(scene.built.scene.look, np.concatenate(list(bands)))


def _prepare(task: _Task) -> None:
    _prepared[:] = [task]


def _frame(index: int) -> Image:
    return _prepared[0].frame(index)
