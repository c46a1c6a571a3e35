"""Are the faces on both sides of a drive found by straight edges alone, and their posts, along a path that savmap finds?

    python -m bench face-edges [--set test] [--count 18] [--frames 40] [--width 1024] [--keep DIR]

Drives as those of `bench odometry`, whose footage DIR may hold: past random short rows, by turns in colour, in grey and
dark. The path is that of visual odometry; its metre comes from the length of the drive.

plane %: planes whose depth is right to 3 %. wrong, their score: the other planes, and the mean of their scores. first %:
posts in view that score more than every other pair of their face, at their place to 10 cm; other pairs are those between
the first and the last post, farther than 20 cm from each. least, other: the middle over the faces of the least score of
a post, and of the greatest one of another pair. s a view, s a face: of a processor, to keep the edges of a frame on one
side, and to find a plane and its posts.
"""

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from bench.baseline import Figures
from bench.odometry import drives, frames_of
from bench.seeds import SETS, is_test
from savmap.types import Floats, Ints
from savmap.vision.evidence.face_edges import FaceEdges, FacePlane, FacePosts, FaceSweep, building_axes, faces_beside
from savmap.vision.odometry import Follower, Odometry, WalkedPath
from savmap.vision.view_planning import segments
from savmap.vision.views import Renderer

RIGHT = 0.03
"""Of a plane's depth."""
HERE_M, AWAY_M = 0.1, 0.2
"""From a post: a candidate at its place, and another pair."""
IN_VIEW_M = 0.2
"""Posts that are no farther beyond the ends of a drive."""
STRAIGHT = 8
"""Frames that tell the building's axes."""
EXTENDED_M = 5.0
Cells = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class TrueRow:
    """A row of a drive: the true poses of the rig in its frame (n, 4, 4), and its posts' left and right sides (m, 2)."""

    name: str
    row_from_rig: Floats
    posts: Floats

    @property
    def in_view(self) -> Floats:
        """The posts that the drive passes (k, 2)."""
        x, middle = self.row_from_rig[:, 0, 3], self.posts.mean(axis=1)
        return np.asarray(self.posts[(middle > x.min() - IN_VIEW_M) & (middle < x.max() + IN_VIEW_M)])


@dataclass(frozen=True)
class FaceScore:
    """What was found of a face: its depth in that of the truth, the mean score of its best pairs, the scores of true
    posts at their place, the greatest one of other pairs, and seconds."""

    depth: float
    score: float
    posts: tuple[float, ...]
    other: float
    view_s: float
    face_s: float

    @property
    def right(self) -> bool:
        """Whether the plane is right."""
        return abs(self.depth - 1) < RIGHT

    @property
    def first(self) -> int:
        """Posts that score more than every other pair."""
        return sum(score > self.other for score in self.posts)


def true_rows(folder: Path) -> list[TrueRow]:
    """The rows of a simulated drive."""
    content = json.loads((folder / "poses.json").read_text(encoding="utf-8"))
    survey = json.loads((folder / "survey.json").read_text(encoding="utf-8"))["rows"]
    poses = np.array([frame["world_from_rig"] for frame in content["frames"]])
    rows = list[TrueRow]()
    for name, entry in survey.items():
        world_from_row = np.eye(4)
        world_from_row[:3, :3] = content["rows"][name]["world_from_row"]
        world_from_row[:3, 3] = content["rows"][name]["origin"]
        rows.append(TrueRow(name, np.linalg.inv(world_from_row) @ poses, np.array(entry["uprights"])))
    return rows


def walked(video: Path) -> WalkedPath:
    """The path of a drive by visual odometry."""
    follower, odometry = Follower(), Odometry()
    for panorama in frames_of(video, 1):
        follower.forget(odometry.take(follower.update(panorama)))
    return odometry.path


def seen_sides(video: Path, path: WalkedPath, metres: float) -> Iterator[tuple[FaceSweep, float]]:
    """The sweeps on both sides of a drive, and seconds a view."""
    renderer, places = Renderer(), path.world_from_rig[path.part == path.longest, :3, 3]
    some = np.linspace(0, len(path.part) - 1, STRAIGHT).round().astype(int)
    straight = {shown.frame: segments(shown, renderer) for shown in frames_of(video, 1) if shown.frame in some}
    for face in faces_beside(building_axes(path, straight), places[-1] - places[0]).values():
        edges, seconds = FaceEdges(), 0.0
        for shown in frames_of(video, 1):
            begun = time.thread_time()
            edges.add(shown.frame, shown, path.world_from_rig[shown.frame, :3, :3].T @ face)
            seconds += time.thread_time() - begun
        if (sweep := edges.along(path, metres, face)) is not None:
            yield sweep, seconds / len(path.part)


def posts_by_edges(folder: Path) -> list[FaceScore]:
    """What edges tell of the faces beside a simulated drive that its survey has."""
    path, rows, scores = walked(folder / "footage.mp4"), true_rows(folder), list[FaceScore]()
    kept = np.flatnonzero(path.part == path.longest)
    lengths = (
        np.linalg.norm(poses[kept[-1], :3, 3] - poses[kept[0], :3, 3])
        for poses in (rows[0].row_from_rig, path.world_from_rig)
    )
    true_m, length = lengths
    for sweep, view_s in seen_sides(folder / "footage.mp4", path, float(true_m / length)):
        row = facing(rows, path.world_from_rig[kept[0], :3, :3].T @ sweep.path_from_face[:, 2], int(kept[0]))
        if row is None or not len(row.in_view):
            continue
        begun = time.thread_time()
        if (plane := sweep.plane()) is not None:
            candidates = sweep.posts(plane)
            scores.append(score(row, kept, sweep, plane, candidates, (view_s, time.thread_time() - begun)))
    return scores


def facing(rows: Sequence[TrueRow], ahead: Floats, frame: int) -> TrueRow | None:
    """The row that lies in a direction (3,) in the rig frame of a frame."""
    return next((row for row in rows if (row.row_from_rig[frame, :3, :3] @ ahead)[2] < -0.9), None)


def score(
    row: TrueRow,
    kept: Ints,
    sweep: FaceSweep,
    plane: FacePlane,
    found: FacePosts,
    seconds: tuple[float, float],
) -> FaceScore:
    """A plane and its candidates beside the truth, place by place along the way: a path drifts."""
    x, true_x = sweep.places[:, 0], row.row_from_rig[kept, 0, 3]
    order, reach = np.argsort(x), np.array([-EXTENDED_M, EXTENDED_M])
    along = np.interp(
        found.centres,
        np.insert(reach / sweep.metres + x[order[[0, -1]]], 1, x[order]),
        np.insert(reach + true_x[order[[0, -1]]], 1, true_x[order]),
    )
    middles = row.posts.mean(axis=1)
    off = np.abs(along[:, None] - middles)
    between = (along > middles[0]) & (along < middles[-1]) & (off.min(axis=1) > AWAY_M)
    posts = [float(found.scores[np.abs(along - post) < HERE_M].max(initial=0.0)) for post in row.in_view.mean(axis=1)]
    depth = plane.depth * sweep.metres / float(row.row_from_rig[kept, 2, 3].mean())
    return FaceScore(depth, plane.score, tuple(posts), float(found.scores[between].max(initial=0.0)), *seconds)


def text(face: FaceScore) -> str:
    """What a line says of a face."""
    return (
        f"depth {100 * face.depth - 100:+.1f} %, score {face.score:.2f}, {face.first} of {len(face.posts)} posts first"
        f" ({min(face.posts):.2f}, {face.other:.2f})"
    )


def totals(faces: Sequence[FaceScore]) -> Cells:
    """Figures over faces."""
    wrong = [face.score for face in faces if not face.right]
    posts = sum(len(face.posts) for face in faces)
    return {
        "faces": len(faces),
        "plane %": 100 * float(np.mean([face.right for face in faces])),
        "wrong": len(wrong),
        "their score": float(np.mean(wrong)) if wrong else 0.0,
        "posts": posts,
        "first %": 100 * sum(face.first for face in faces) / posts,
        "least": float(np.median([min(face.posts) for face in faces])),
        "other": float(np.median([face.other for face in faces])),
        "s a view": float(np.mean([face.view_s for face in faces])),
        "s a face": float(np.mean([face.face_s for face in faces])),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="test", help="of seeds; drives of `test` are totals only")
    parser.add_argument("--count", type=int, default=18, help="of drives")
    parser.add_argument("--frames", type=int, default=40, help="of a drive")
    parser.add_argument("--width", type=int, default=1024, help="of a drive's panoramas, pixels")
    parser.add_argument("--keep", type=Path, help="keep footage in this folder")


def run(given: argparse.Namespace) -> Figures:
    """Totals over drives; a line for each that may be shown."""
    faces = defaultdict[str, list[FaceScore]](list)
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as temporary, threadpool_limits(1, "blas"):
        for family, seed, folder in drives(given, given.keep or Path(temporary)):
            here = posts_by_edges(folder)
            faces[family] += here
            if not is_test(family, seed):
                print(f"{family} {seed}: {'; '.join(map(text, here))}", flush=True)
    everything = [face for here in faces.values() for face in here]
    return {**{family: totals(here) for family, here in faces.items()}, "total": totals(everything)}
