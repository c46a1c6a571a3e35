"""Footage of a photo row: hall, lamps and drive are simulated, and each frame is cast once for all lights.

Lights: in colour, in grey, at a third of the light. Nothing stands before the face, so that only the face and what is near it is
cast pixel by pixel.
"""

import json
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import yaml
from photo_faces import PhotoRow, Picture

from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.lab.scenes import Exposure, Material, RowSize, SceneParts, span
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.render.panorama import linear_bands
from savmap.lab.sim.render.shade import Renderer, compressed, developed, metered, renderer
from savmap.lab.sim.render.surfaces import Singles
from savmap.lab.sim.scene.build import Built, build
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import poses, references, site_of
from savmap.types import Bools, Floats

LIGHTS = ("colour", "grey", "dim")
ROW = "A"
_AISLE_M = 1.7
_DIM = 1 / 3
_METERING_HEIGHT = 64
_COARSE = 2
_CENTRE = ((0.0, 0.0),)
_CORNERS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
_ENCODING = {"crf": "18", "preset": "fast"}


@dataclass(frozen=True)
class Size:
    """How much footage: frames, and their width in px."""

    frames: int
    width: int


def make_footage(row: PhotoRow, name: str, folders: Mapping[str, Path], size: Size) -> None:
    """Write footage.mp4, site.yaml, survey.json and poses.json of a row into the folder of each light."""
    built = build(scene_of(row, name, size), {"shelves": lambda *_: parts_of(row)})
    path = drive(built.scene.cart, built.scene.seed)
    with ExitStack() as stack:
        videos = {light: stack.enter_context(_Video(folders[light], size)) for light in LIGHTS}
        for shown in _frames(renderer(built), path, row.size):
            for light, picture in shown.items():
                videos[light].write(picture)
    for folder in folders.values():
        _write_files(built, path, folder)


def parts_of(row: PhotoRow) -> SceneParts:
    """The scene's part that a photo row is: one box with the picture on its front."""
    length, height = row.size
    linear = ((row.picture.reshape(-1, 3).mean(axis=0) / 255) ** 2.2).tolist()
    front = span((0.0, length), (0.0, height), (-0.05, 0.0), Material((linear[0], linear[1], linear[2])))
    box = replace(front, face_labels={"+z": "photo"}, prints={"+z": row.picture})
    lowest = {"values": [round(beams[0][0], 4) for beams in row.beams], "sigma": 0.002}
    whole = {"value": round(length, 4), "sigma": 0.003}
    between = ["upright 1 / left", f"upright {len(row.posts)} / right"]
    return SceneParts(
        [box],
        {ROW: {"uprights": row.posts, "sections": [{"beams": beams} for beams in row.beams]}},
        sizes={ROW: RowSize(length, height)},
        references={ROW: {"lowest_beam_bottom_height_m": lowest, "first_to_last_upright_outer_edges_m": whole}},
        site_rows={
            ROW: {
                "references": {"lengths": [{"between": between, **whole}]},
                "plugins": {"shelves": {"lowest_beam_bottom_height_m": lowest}},
            }
        },
    )


def scene_of(row: PhotoRow, name: str, size: Size) -> Scene:
    """Hall, lamps and drive around a photo row, by its name."""
    length, height = row.size
    rng = np.random.default_rng([*name.encode(), 7])
    mast = float(np.clip(height * rng.uniform(0.45, 0.6), 1.4, 3.0))
    aisle = max(_AISLE_M, 0.64 * max(mast, height - mast))
    yaw, pitch, roll = rng.uniform([-180, -5, -5], [180, 5, 5]).tolist()
    cart = {"start": [-0.8, aisle], "end": [length + 0.8, aisle], "height": mast, "yaw": yaw, "pitch": pitch}
    cart |= {"roll": roll, "frames": size.frames, "width": size.width, "fps": 6.0}
    top = max(height + 1.5, 6.0)
    content = {
        "seed": int(rng.integers(1 << 30)),
        "hall": {"x": [-7.0, length + 8.0], "z": [-4.0, 2 * aisle + 2.5], "height": top, "pipes": 1},
        "goods": {"density": 0.0},
        "look": {"ambient": 0.3},
        "cart": cart,
        "rows": {ROW: {}},
        "structures": {"shelves": {}, "lights": {"lines": [{"z": aisle, "height": top - 0.5, "pitch": 3.2}]}},
    }
    return parse_scene(content, name)


@dataclass(frozen=True, eq=False)
class _Task:
    scene: Renderer
    path: Drive
    look: Exposure
    size: tuple[float, float]

    def frame(self, index: int) -> dict[str, Picture]:
        """A frame in each light."""
        settings = self.scene.built.scene
        linear = self.linear(index, settings.cart.width // 2)
        rng = np.random.default_rng([settings.seed, 9, index])
        colour = developed(linear, self.look, None, rng)
        grey = np.repeat(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
        darker = self.look.model_copy(update={"exposure": self.look.exposure * _DIM})
        return {"colour": colour, "grey": grey.astype(np.uint8), "dim": developed(linear, darker, None, rng)}

    def linear(self, index: int, height: int) -> Singles:
        """A frame's radiance (height, 2 height, 3): the hall coarsely, the face and what is near it pixel by pixel, its border
        by four rays a pixel."""
        origin, turn = self.path.origins[index], self.path.world_from_rig[index]
        coarse = np.concatenate(list(linear_bands(self.scene, origin, turn, height // _COARSE)))
        linear = cv2.resize(coarse, (2 * height, height), interpolation=cv2.INTER_LINEAR)
        u, v = np.meshgrid(np.arange(2.0 * height), np.arange(float(height)))
        pixels = np.stack([u, v], axis=-1)
        face = self._on_face(origin, rays_from_panorama_pixels(pixels.reshape(-1, 2), height) @ turn.T)
        near, border = _around(face.reshape(height, 2 * height))
        for chosen, steps in ((near, _CENTRE), (border, _CORNERS)):
            parts = [self._seen(origin, turn, pixels[chosen] + step, height) for step in steps]
            linear[chosen] = np.mean(parts, axis=0)
        return np.asarray(linear, np.float32)

    def _on_face(self, origin: Floats, rays: Floats) -> Bools:
        """Which rays (n, 3) meet the face."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -origin[2] / rays[:, 2]
            x, y = (origin[axis] + distance * rays[:, axis] for axis in (0, 1))
            hit: Bools = (distance > 0) & (x > 0) & (x < self.size[0]) & (y > 0) & (y < self.size[1])
        return hit

    def _seen(self, origin: Floats, turn: Floats, pixels: Floats, height: int) -> Singles:
        rays = rays_from_panorama_pixels(pixels, height) @ turn.T
        return compressed(self.scene.radiance(origin, rays, np.pi / height)[0])


def _around(face: Bools) -> tuple[Bools, Bools]:
    """The pixels (h, w) of a face in a panorama or near it, and those of its border."""
    wide = 3 * _COARSE
    mask = np.pad(face.astype(np.uint8), ((0, 0), (wide, wide)), mode="wrap")
    near, outer = (cv2.dilate(mask, np.ones((size, size), np.uint8)) for size in (2 * wide + 1, 3))
    inner = cv2.erode(mask, np.ones((3, 3), np.uint8))
    return near[:, wide:-wide] > 0, (outer - inner)[:, wide:-wide] > 0


_prepared: list[_Task] = []


def _frames(scene: Renderer, path: Drive, size: tuple[float, float], workers: int = 2) -> Iterator[dict[str, Picture]]:
    """The drive's frames in each light, in order."""
    look = scene.built.scene.look
    task = _Task(scene, path, look, size)
    task = replace(task, look=metered(look, task.linear(len(path.origins) // 2, _METERING_HEIGHT)))
    cv2.setNumThreads(1)  # a forked process waits for threads that it does not have
    with ProcessPoolExecutor(workers, initializer=_prepare, initargs=(task,)) as pool:
        pending: deque[Future[dict[str, Picture]]] = deque()
        for index in range(len(path.origins)):
            pending.append(pool.submit(_frame, index))
            if len(pending) > workers:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()


def _prepare(task: _Task) -> None:
    _prepared[:] = [task]


def _frame(index: int) -> dict[str, Picture]:
    return _prepared[0].frame(index)


class _Video:
    """footage.mp4 in a folder, frame by frame; a film that breaks off is left with another name."""

    def __init__(self, folder: Path, size: Size) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "footage.mp4"
        self._container = av.open(str(folder / "partial.mp4"), "w")
        self._stream = self._container.add_stream("libx264", rate=Fraction(6), options=_ENCODING)
        self._stream.width, self._stream.height, self._stream.pix_fmt = size.width, size.width // 2, "yuv420p"

    def __enter__(self) -> "_Video":
        return self

    def write(self, picture: Picture) -> None:
        """Append a frame."""
        self._container.mux(self._stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))

    def __exit__(self, kind: object, *_: object) -> None:
        self._container.mux(self._stream.encode())
        self._container.close()
        if kind is None:
            self._path.with_name("partial.mp4").replace(self._path)


def _write_files(built: Built, path: Drive, folder: Path) -> None:
    known = references(built, path)
    site: dict[str, Any] = {**site_of(built, known), "plugins": {"shelves": {}}}
    for name, content in (("survey", built.survey), ("references", known), ("poses", poses(built, path))):
        (folder / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    plain = json.loads(json.dumps(site))
    (folder / "site.yaml").write_text(yaml.safe_dump(plain, sort_keys=False), encoding="utf-8")
