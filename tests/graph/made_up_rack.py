"""Tracks of a made-up rack as a tracker would give them: exact geometry, then noise, outliers, sway and poor starts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.geometry import pinhole
from savmap.graph import (
    CameraHeight,
    KnownLength,
    Problem,
    References,
    Solution,
    SolveOptions,
    gauge,
    merge,
    published_start,
    solve,
)
from savmap.types import Floats, FrameTable, RowFacts, Track, Trajectory, ViewSpec
from savmap_shelves.constraints import GridSettings, constrain

NOMINAL = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
Setback = tuple[float, float]
VIEW = ViewSpec("face", 0.0, 0.0, 0.0, 150.0)


@dataclass(frozen=True)
class Rack:
    """Truth: upright edges (k, 2) m, beams' edges by section, (b, 2) m."""

    uprights: Floats
    beams: tuple[Floats, ...]

    @property
    def lowest(self) -> list[float]:
        return [float(section[0, 0]) for section in self.beams]


@dataclass(frozen=True)
class World:
    """A rack, true poses (n, 4, 4), the tracks, and what the program is told."""

    rack: Rack
    poses: Floats
    tracks: list[Track]
    facts: RowFacts
    rng: np.random.Generator = field(repr=False)


def rack(rng: np.random.Generator, sections: int = 4, levels: tuple[int, int] = (5, 7), bridge: int | None = 2) -> Rack:
    widths = rng.uniform(2.6, 3.8, sections)
    left = np.concatenate([[0.0], np.cumsum(widths + 0.1)])
    beams = []
    for section in range(sections):
        count = int(rng.integers(levels[0], levels[1] + 1))
        bottoms = np.sort(
            rng.uniform(0.15, 0.33)
            + np.arange(count) * (5.6 / count)
            + rng.uniform(-0.1, 0.1, count) * (np.arange(count) > 0)
        )
        beams.append(np.stack([bottoms, bottoms + 0.1], axis=1)[2 if section == bridge else 0 :])
    return Rack(np.stack([left, left + 0.0986], axis=1), tuple(beams))


def path(rng: np.random.Generator, length: float, frames: int, height: float = 3.05, distance: float = 1.5) -> Floats:
    poses = np.tile(np.eye(4), (frames, 1, 1))
    time = np.linspace(0, 1, frames)
    wave = [rng.uniform(0.02, 0.05) * np.sin(2 * np.pi * (rng.uniform(2, 6) * time + rng.uniform())) for _ in range(6)]
    poses[:, 0, 3] = length * (time + wave[0])
    poses[:, 1, 3] = height + 0.3 * wave[1] + rng.normal(0, 0.003, frames)
    poses[:, 2, 3] = distance + 3 * wave[2]
    angles = np.stack([0.5 * wave[3], wave[4], 0.5 * wave[5]], axis=1)
    poses[:, :3, :3] = NOMINAL @ Rotation.from_rotvec(angles).as_matrix()
    return poses


def world(
    seed: int = 0,
    sections: int = 4,
    frames: int = 100,
    noise_px: float = 0.7,
    outliers: float = 0.0,
    misses: float = 0.2,
    levels: tuple[int, int] = (5, 7),
    bridge: int | None = 2,
    setback_m: float = 0.0,
) -> World:
    """A rack seen from a swaying camera. Edges' and corners' noise is drawn line by line, as a detector's is."""
    rng = np.random.default_rng(seed)
    truth = rack(rng, sections, levels, bridge)
    poses = path(rng, float(truth.uprights[-1, 1]), frames)
    table = FrameTable(np.arange(frames) / 7.0, ("one",) * frames)
    facts = RowFacts("A", table, {VIEW.name: VIEW}, {"one": 1})
    seen: dict[str, list[tuple[int, Floats, Floats]]] = {}
    places: dict[str, tuple[str, dict[str, int | str]]] = {}
    for frame, pose in enumerate(poses):
        for name, label, place, pixel, covariance in _seen(truth, pose, noise_px, misses, setback_m, rng):
            if rng.random() < outliers:
                pixel = pixel + rng.normal(0, 30, 2)
            places[name] = label, place
            seen.setdefault(name, []).append((frame, pixel, covariance))
    tracks = [_track(name, *places[name], seen[name]) for name in sorted(seen) if len(seen[name]) > 2]
    return World(truth, poses, tracks, facts, rng)


def _track(name: str, label: str, place: dict[str, int | str], seen: Sequence[tuple[int, Floats, Floats]]) -> Track:
    frames, pixels, covariances = zip(*seen, strict=True)
    return Track(
        name, label, place, np.array(frames), (VIEW.name,) * len(seen), np.array(pixels), np.array(covariances)
    )


Sighting = tuple[str, str, dict[str, int | str], Floats, Floats]


def _seen(
    truth: Rack, pose: Floats, noise: float, misses: float, setback: float, rng: np.random.Generator
) -> Iterator[Sighting]:
    """Uprights within the frame with both edges, and the beams' corners on them."""
    lines: dict[tuple[int, str], float] = {}
    for number, edges in enumerate(truth.uprights, 1):
        if rng.random() < misses:
            continue
        for side, x in zip(("left", "right"), edges, strict=True):
            top, bottom = _project(pose, np.array([[x, 6.2, 0], [x, 0.0, 0]]))
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
                    place: dict[str, int | str] = {"section": section, "beam": beam, "side": side, "edge": edge}
                    yield (
                        f"section {section} / beam {beam} / {edge} {side}",
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


def _project(pose: Floats, points: Floats) -> Floats:
    local = (points - pose[:3, 3]) @ pose[:3, :3] @ VIEW.rig_from_view
    return pinhole.project(local, VIEW.camera)


def _corner(pose: Floats, x: float, y: float, setback: float) -> tuple[Floats, Floats, Floats]:
    """Where the upright's edge, seen on the face, crosses the beam's edge, which lies behind it; and their directions."""
    depth = pose[2, 3]
    return _with_axes(pose, np.array([x, pose[1, 3] + (y - pose[1, 3]) * depth / (depth + setback), 0.0]))


def _with_axes(pose: Floats, point: Floats) -> tuple[Floats, Floats, Floats]:
    step = 1e-4
    pixel, right, up = _project(pose, point + step * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    return pixel, (right - pixel) / np.linalg.norm(right - pixel), (up - pixel) / np.linalg.norm(up - pixel)


def begin(
    made: World, speed: float = 1.0, height: float = 0.0, distance: float = 1.0, attitude_deg: float = 0.5
) -> Trajectory:
    """The published start, off by a factor in speed and distance, by metres in height, and by degrees in attitude."""
    rng = np.random.default_rng(99)
    turns = Rotation.from_rotvec(np.radians(attitude_deg) * rng.normal(0, 1, (len(made.poses), 3))).as_matrix()
    length = float(np.ptp(made.poses[:, 0, 3])) * speed
    middle = made.poses[:, :3, 3].mean(axis=0)
    return published_start(
        made.facts, made.poses[:, :3, :3] @ turns, length, float(middle[1]) + height, float(middle[2]) * distance
    )


def references(
    made: World, camera: bool = True, length: bool = True, rng: np.random.Generator | None = None
) -> References:
    """Camera height +- 2 cm and the row's length +- 3 mm: exact, or, with `rng`, off by that much."""
    off_height, off_length = rng.normal(0, [0.02, 0.003]) if rng else (0.0, 0.0)
    height, span = float(made.poses[:, 1, 3].mean()) + off_height, float(made.rack.uprights[-1, 1]) + off_length
    return References(
        (CameraHeight(height, 0.02),) if camera else (),
        (KnownLength("upright 1 / left", f"upright {len(made.rack.uprights)} / right", span, 0.003),) if length else (),
    )


def problem(
    made: World,
    start: Trajectory,
    given: References | None = None,
    heights: bool = True,
    setback: Setback = (0.0, 0.01),
) -> Problem:
    settings = GridSettings(made.rack.lowest if heights else None, 0.002, *setback)
    own = constrain(made.tracks, made.facts, start, settings=settings)
    return merge(gauge(made.facts, start, given or references(made)), own)


def without_frames(made: World, blind: set[int]) -> World:
    """The same world, but nothing was seen in some frames."""
    tracks = []
    for track in made.tracks:
        kept = np.array([frame not in blind for frame in track.frames.tolist()])
        views = tuple(view for view, keep in zip(track.views, kept, strict=True) if keep)
        tracks.append(
            replace(
                track,
                frames=track.frames[kept],
                views=views,
                pixels=track.pixels[kept],
                covariances=track.covariances[kept],
            )
        )
    return replace(made, tracks=tracks)


def solved(
    made: World,
    start: Trajectory | None = None,
    given: References | None = None,
    options: SolveOptions | None = None,
    heights: bool = True,
    setback: Setback = (0.0, 0.01),
) -> Solution:
    return solve(problem(made, start or begin(made), given, heights, setback), options)


def errors(made: World, solution: Solution) -> tuple[Floats, Floats, Floats, Floats]:
    """Errors m along x (columns) and in height (rows), and their standard deviations."""
    off, sigma = {"x": [], "y": []}, {"x": [], "y": []}
    for name, landmark in solution.of("shelves").items():
        words = name.replace(" /", "").split()
        if words[0] == "upright" and words[3] == "top":
            truth, axis = made.rack.uprights[int(words[1]) - 1, ("left", "right").index(words[2])], 0
        elif words[0] == "section" and words[-1] == "left":
            truth, axis = made.rack.beams[int(words[1]) - 1][int(words[3]) - 1, ("lower", "upper").index(words[4])], 1
        else:
            continue
        off["xy"[axis]].append(landmark.position[axis] - truth)
        sigma["xy"[axis]].append(np.sqrt(landmark.covariance[axis, axis]))
    return np.array(off["x"]), np.array(off["y"]), np.array(sigma["x"]), np.array(sigma["y"])
