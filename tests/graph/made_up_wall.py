"""Points on a wall and corners of stripes on the floor before it, each the matter of one made-up plugin, as a level camera sees them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from savmap.geometry.pinhole import project
from savmap.geometry.triangulate import nearest_points
from savmap.graph import (
    CameraHeight,
    Constraints,
    KeySpace,
    KnownLength,
    Problem,
    References,
    Relation,
    camera_priors,
    fixed_coordinate,
    image_measurements,
    known_length,
    merge,
    sight_lines,
)
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import Feature, Floats, FrameTable, RowFacts, Structure, Track, Trajectory, ViewPlan, ViewSpec

FRAMES = 12
LEVEL = np.diag([1.0, -1.0, -1.0])
VIEW = "one / face"
SPEC = ViewSpec("face", 0.0, hfov_deg=110.0, width=320, height=240)
WALL = np.array([[x, y, 0.0] for x in (0.0, 1.0, 2.0, 3.0, 4.0) for y in (0.5, 1.3, 2.2)])
CORNERS = np.array([[x, 0.0, z] for x in (0.5, 1.5, 2.5, 3.5) for z in (0.3, 0.6)])
NAMES = [f"stripe corner {number}" for number in range(1, len(CORNERS) + 1)]
KEYS = KeySpace("wall").keys(f"post {number}" for number in range(len(WALL)))
CAMERA_HEIGHT = CameraHeight(1.5, 0.01)
LENGTH = KnownLength(NAMES[0], NAMES[-2], 3.0, 0.002, axis="x")
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 7.0, ("one",) * FRAMES), {VIEW: SPEC}, {"one": 1})


def path(scale: float = 1.0) -> Trajectory:
    """The camera's path along x, before the wall at 2.5 m, or `scale` times as long and far."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3] = LEVEL
    poses[:, :3, 3] = np.stack([0.35 * np.arange(FRAMES), np.full(FRAMES, 1.5), np.full(FRAMES, 2.5)], axis=1)
    poses[:, [0, 2], 3] *= scale
    return Trajectory(np.arange(FRAMES), poses)


def track(name: str, point: Floats, label: str) -> Track:
    """A point (3,) m in all frames that it is seen in, with 0.1 px of noise."""
    rng = np.random.default_rng(int(1000 * np.abs(point).sum()))
    pixels = np.concatenate(
        [project((point - at)[None] @ LEVEL, SPEC.camera) for at in path().world_from_rig[:, :3, 3]]
    )
    seen = np.flatnonzero(((pixels > 0) & (pixels < [319, 239])).all(axis=1))
    noisy = pixels[seen] + rng.normal(0, 0.1, (len(seen), 2))
    return Track(name, label, {}, seen, (VIEW,) * len(seen), noisy, np.tile(0.01 * np.eye(2), (len(seen), 1, 1)))


def problem_of(
    tracks: Sequence[Track], points: Floats, relations: tuple[Relation, ...] = (), given: References | None = None
) -> Problem:
    """The problem of one plugin, `wall`, whose tracks show points (n, 3) m."""
    keys = KeySpace("wall").keys(track.name for track in tracks)
    first = dict(zip(keys, points, strict=True))
    part = Constraints("wall", keys, image_measurements(tracks, keys, FACTS.views), relations, first)
    return merge(camera_priors(FACTS, path(), given), part)


def triangulated(track: Track, start: Trajectory) -> Floats:
    """The point (3,) m nearest to a track's rays."""
    origins, rays = sight_lines(track, FACTS, start)
    nearest: Floats = nearest_points(origins, rays[None])[0]
    return nearest


class Config(BaseModel):
    """`known`: whether the plugin knows the length of its structure."""

    model_config = ConfigDict(extra="forbid")

    known: bool = False


class Wall:
    """Locates the camera, but knows no scale."""

    name, classes, model, Config = "wall", ("post",), Path(__file__), Config

    def __init__(self, config: Config) -> None:
        self.config = config

    def tracks(self) -> list[Track]:
        return [track(f"post {number}", point, "post") for number, point in enumerate(WALL)]

    def relations(self, keys: dict[str, int]) -> tuple[Relation, ...]:
        return (fixed_coordinate("x", keys["post 0"]), *(fixed_coordinate("z", key) for key in keys.values()))

    @hookimpl
    def render_views(self) -> ViewPlan:
        return ViewPlan(())

    @hookimpl
    def extract_features(self) -> list[Feature]:
        return []

    @hookimpl
    def describe(self) -> list[Structure]:
        return []

    @hookimpl
    def track(self) -> list[Track]:
        return self.tracks()

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> Constraints:
        keys = KeySpace(self.name).keys(track.name for track in tracks)
        first = {track.name: triangulated(track, start) for track in tracks}
        return Constraints(self.name, keys, image_measurements(tracks, keys, facts.views), self.relations(keys), first)


class Stripes(Wall):
    """Does not locate the camera."""

    name = "stripes"

    def tracks(self) -> list[Track]:
        return [track(name, point, "corner") for name, point in zip(NAMES, CORNERS, strict=True)]

    def relations(self, keys: dict[str, int]) -> tuple[Relation, ...]:
        length = known_length("x", keys[LENGTH.start], keys[LENGTH.end], LENGTH.value_m, LENGTH.sigma_m, "stripes")
        return (length,) if self.config.known else ()


def rooms(stripes: type[Stripes] = Stripes, known: bool = False) -> list[LoadedPlugin]:
    return [loaded_plugin("wall", Wall, Config()), loaded_plugin("stripes", stripes, Config(known=known))]


def references(*lengths: KnownLength) -> References:
    return References((CAMERA_HEIGHT,), lengths)


def renamed(length: KnownLength, end: str) -> KnownLength:
    return replace(length, end=end)
