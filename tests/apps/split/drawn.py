"""Panoramas of a plain made-up place: upright faces with a pattern, drawn column by column, and a cart that weaves through."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from savmap.apps.split.records import SplitResult
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.scene.files import Cart

HEIGHT_M = 2.2
RICH, BARE = 0.8, 0.05


@dataclass(frozen=True)
class Face:
    """An upright face over the floor from `start` to `end` (x, z), `top` m high, with a pattern of this contrast."""

    start: tuple[float, float]
    end: tuple[float, float]
    contrast: float = RICH
    top: float = 4.0


@dataclass(frozen=True)
class Woven:
    """A cart through three aisles with a stop in the second: the video, the drive and what was found."""

    file: Path
    path: Drive
    found: SplitResult


def block(x: tuple[float, float], z: tuple[float, float], contrast: float = RICH) -> list[Face]:
    """Four faces around a rectangle."""
    corners = [(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])]
    return [Face(a, b, contrast) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]


def aisles(count: int, length: float = 8.0, pitch: float = 4.6) -> list[Face]:
    """Rows 1.6 m deep at every `pitch` with aisles between, in a hall with bare walls."""
    faces = block((-7.0, length + 7.0), (-8.0, count * pitch + 8.0), BARE)
    for number in range(count + 1):
        faces += block((0.0, length), (number * pitch - 1.6, number * pitch))
    return faces


def weaving(count: int, length: float = 8.0, pitch: float = 4.6, **path: object) -> Cart:
    """A cart through the middle of all these aisles, that turns 3 m beyond the rows."""
    points: list[tuple[float, float]] = [(-2.0, 1.5)]
    for number in range(count):
        x = length + 3.0 if number % 2 == 0 else -3.0
        points.append((x, number * pitch + 1.5))
        points += [(x, (number + 1) * pitch + 1.5)] if number < count - 1 else []
    return cart(points, **path)


def cart(points: list[tuple[float, float]], **path: object) -> Cart:
    settings = {"points": points, "speed": 1.0, "radius": 1.4, **path}
    return Cart.model_validate({"path": settings, "fps": 8.0, "yaw": 70.0, "height": HEIGHT_M, "width": 256})


def pictures(faces: list[Face], path: Drive, width: int = 256) -> list[np.ndarray]:
    """A grey panorama (width / 2, width) a frame."""
    pattern = cv2.GaussianBlur(np.random.default_rng(4).normal(0, 1, (256, 1024)).astype(np.float32), (0, 0), 2.0)
    pattern /= pattern.std()
    return [_picture(faces, origin, turn, pattern, width) for origin, turn in zip(path.origins, path.world_from_rig, strict=True)]  # fmt: skip


def _picture(faces: list[Face], origin: np.ndarray, turn: np.ndarray, pattern: np.ndarray, width: int) -> np.ndarray:
    longitude = (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi
    rays = (np.stack([np.sin(longitude), 0 * longitude, np.cos(longitude)], axis=1) @ turn.T)[:, [0, 2]]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    latitude = np.pi / 2 - (np.arange(width // 2) + 0.5) / (width // 2) * np.pi
    image = np.repeat(np.where(latitude > 0, 170.0, 90.0)[:, None], width, axis=1)
    depth = np.full(width, np.inf)
    for number, face in enumerate(faces):
        start, along = np.array(face.start), np.subtract(face.end, face.start)
        length = np.linalg.norm(along)
        across = along / length
        offset = start - origin[[0, 2]]
        cross = rays[:, 0] * across[1] - rays[:, 1] * across[0]
        reach = (offset[0] * across[1] - offset[1] * across[0]) / np.where(np.abs(cross) < 1e-9, 1e-9, cross)
        place = reach * (rays @ across) - offset @ across
        seen = np.flatnonzero((reach > 0.05) & (reach < depth) & (place >= 0) & (place <= length))
        if not len(seen):
            continue
        depth[seen] = reach[seen]
        up = origin[1] + np.tan(latitude)[:, None] * reach[seen]
        cells = np.stack(np.broadcast_arrays(place[seen] * 20 + 37 * number, up * 20), axis=-1).astype(np.float32)
        drawn = 120 + 60 * face.contrast * cv2.remap(
            pattern, cells[..., 0] % 1023, cells[..., 1] % 255, cv2.INTER_LINEAR
        )
        image[:, seen] = np.where((up > 0) & (up < face.top), drawn, np.where(up > 0, 170.0, 90.0))
    return np.clip(image, 0, 255).astype(np.uint8)


def recording(folder: Path, faces: list[Face], one: Cart, key_every: int = 8) -> tuple[Path, Drive]:
    """A video of the drive, and the drive."""
    path = drive(one, 1)
    return filmed(folder, faces, one, path, key_every), path


def filmed(folder: Path, faces: list[Face], one: Cart, path: Drive, key_every: int = 8) -> Path:
    """A video of a path, at the cart's rate."""
    file = folder / "recording.mp4"
    with av.open(str(file), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(8), options={"g": str(key_every), "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = one.width, one.width // 2, "yuv420p"
        for image in pictures(faces, path, one.width):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray8")))
        container.mux(stream.encode())
    return file


def alongside(path: Drive, length: float = 8.0) -> list[tuple[float, float]]:
    """True passes: when the camera is between the rows' ends."""
    within = (path.origins[:, 0] >= 0) & (path.origins[:, 0] <= length)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], within, [False]]).astype(int)))
    return [(float(path.stamps_s[a]), float(path.stamps_s[b - 1])) for a, b in edges.reshape(-1, 2)]
