"""What a camera sees of a made-up rack: upright edges' ends and beams' corners in one wide view, with noise."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.geometry import pinhole
from savmap.types import Floats, ViewSpec

VIEW = ViewSpec("face", 0.0, 0.0, 0.0, 150.0)
Sighting = tuple[str, str, dict[str, int | str], Floats, Floats]


@dataclass(frozen=True)
class Rack:
    """Truth: upright edges (k, 2) m, beams' edges by bay, (b, 2) m."""

    uprights: Floats
    beams: tuple[Floats, ...]

    @property
    def lowest(self) -> list[float]:
        return [float(section[0, 0]) for section in self.beams]


def sightings(
    truth: Rack, pose: Floats, noise: float, misses: float, setback: float, rng: np.random.Generator
) -> Iterator[Sighting]:
    """Uprights within the frame with both edges, and the beams' corners on them."""
    lines: dict[tuple[int, str], float] = {}
    for number, edges in enumerate(truth.uprights, 1):
        if rng.random() < misses:
            continue
        for side, x in zip(("left", "right"), edges, strict=True):
            top, bottom = project(pose, np.array([[x, 6.2, 0], [x, 0.0, 0]]))
            if (
                not (np.isfinite(top).all() and np.isfinite(bottom).all())
                or not 2 < top[0] < 637
                or not 2 < bottom[0] < 637
            ):
                continue
            lines[number, side] = float(rng.normal(0, noise))
            yield from _edge(number, side, top, bottom, lines[number, side], noise, rng)
    for section, beams in enumerate(truth.beams, 1):
        for side, column in (("left", (section, "right")), ("right", (section + 1, "left"))):
            if column not in lines:
                continue
            x = truth.uprights[column[0] - 1, 0 if column[1] == "left" else 1]
            for beam, heights in enumerate(beams, 1):
                if rng.random() < misses:
                    continue
                for edge, y in zip(("lower", "upper"), heights, strict=True):
                    pixel, right, up = _corner(pose, float(x), float(y), setback)
                    if not (0 < pixel[0] < 639 and 0 < pixel[1] < 479):
                        continue
                    across = np.array([-up[1], up[0]])
                    shift = lines[column] / (across @ right) * right
                    over = np.array([-right[1], right[0]])
                    lift = rng.normal(0, noise) / (over @ up) * up
                    spread = (noise / (across @ right)) ** 2 * np.outer(right, right) + (
                        noise / (over @ up)
                    ) ** 2 * np.outer(up, up)
                    place: dict[str, int | str] = {"bay": section, "beam": beam, "side": side, "edge": edge}
                    yield (
                        f"bay {section} / beam {beam} / {edge} {side}",
                        "beam",
                        place,
                        pixel + shift + lift,
                        spread,
                    )


def _edge(
    number: int, side: str, top: Floats, bottom: Floats, line: float, noise: float, rng: np.random.Generator
) -> Iterator[Sighting]:
    along = (bottom - top) / np.linalg.norm(bottom - top)
    across = np.array([-along[1], along[0]])
    sign = 1.0 if across[0] > 0 else -1.0
    for end, pixel in (("top", top), ("bottom", bottom)):
        spread = noise**2 * np.outer(across, across) + 200.0**2 * np.outer(along, along)
        place: dict[str, int | str] = {"upright": number, "side": side, "end": end}
        moved = pixel + sign * line * across + along * rng.uniform(-50, 50)
        yield f"upright {number} / {side} / {end}", "upright", place, moved, spread


def project(pose: Floats, points: Floats) -> Floats:
    """Pixels of points in the view, for the pose world_from_rig."""
    local = (points - pose[:3, 3]) @ pose[:3, :3] @ VIEW.rig_from_view
    return pinhole.project(local, VIEW.camera)


def _corner(pose: Floats, x: float, y: float, setback: float) -> tuple[Floats, Floats, Floats]:
    """Where the upright's edge, seen on the face, crosses the beam's edge, which lies behind it; and their directions."""
    depth = pose[2, 3]
    return _with_axes(pose, np.array([x, pose[1, 3] + (y - pose[1, 3]) * depth / (depth + setback), 0.0]))


def _with_axes(pose: Floats, point: Floats) -> tuple[Floats, Floats, Floats]:
    step = 1e-4
    pixel, right, up = project(pose, point + step * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    return pixel, (right - pixel) / np.linalg.norm(right - pixel), (up - pixel) / np.linalg.norm(up - pixel)
