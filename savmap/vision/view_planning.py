"""View planning (paper, "Rendering views"): the directions of a row's views, whichever way the camera is turned.

`PassPreview.of_frames` finds the building's axes in a pass's key frames, `choose_face` the one of its four level
directions that faces the structure, and `fit_height` and `fit_count` (savmap.vision.field_of_view) the smallest field
of view that shows enough. The caller gives functions that recognise the structure.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from savmap.errors import StructureError
from savmap.geometry import pinhole
from savmap.geometry.vanishing import RIG_FORWARD, RIG_UP, facing, manhattan_from_segments
from savmap.types import Floats, Panorama, View, ViewSpec, array_record
from savmap.vision.travel import travel_directions
from savmap.vision.views import Renderer

SEARCH_VIEWS = [
    *(ViewSpec(f"level {yaw}", yaw, 0, 0, 100, 512, 512) for yaw in (0, 90, 180, 270)),
    *(ViewSpec(f"pole {pitch}", 45, pitch, 0, 100, 512, 512) for pitch in (90, -90)),
]
SHORTEST_PX = 25.0
LEAST_SUPPORT, CLEAR_SUPPORT, CLEARER = 0.25, 0.5, 1.4
"""Of the building's axes: least support; where all frames together have less than the second, each is asked alone, and
counts where it shows axes so many times as clearly."""
Side = Literal["left", "right"]
HANDS: dict[int, Side] = {1: "left", -1: "right"}
"""The hand of the way that a face is on by which way the camera goes along it."""
Score = Callable[[ViewSpec, Panorama], float]
# world_from_view of a level view straight at the face, and of one straight up
LEVEL: Floats = np.diag([1.0, -1.0, -1.0])
UPWARDS: Floats = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
DOWNWARDS: Floats = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
STEEPEST_TILT_DEG = 60.0
FEW = 5
ENOUGH_FRAMES = 100


@dataclass(frozen=True)
class Manual:
    """The values of a view that the site file fixes; None where savmap finds them. The size is always as given."""

    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    hfov_deg: float | None = None
    width: int = 640
    height: int = 480

    @property
    def complete(self) -> bool:
        """Whether all angles are given."""
        return None not in (self.yaw_deg, self.pitch_deg, self.roll_deg, self.hfov_deg)

    def over(self, spec: ViewSpec) -> ViewSpec:
        """The view with these values in place of its own."""
        return replace(spec, **{key: value for key, value in vars(self).items() if value is not None})


@dataclass(frozen=True, eq=False)
@array_record
class PassPreview:
    """What views are planned from: key frames `keys` over a pass, `pairs` of close frames, and the building's axes
    `rig_from_manhattan` (3, 3). `frames` is roughly how many frames of the pass will be used; 0: not known."""

    keys: tuple[Panorama, ...]
    pairs: tuple[tuple[Panorama, Panorama], ...]
    renderer: Renderer
    rig_from_manhattan: Floats
    frames: int = 0

    @classmethod
    def of_frames(
        cls,
        keys: Sequence[Panorama],
        pairs: Sequence[tuple[Panorama, Panorama]] = (),
        renderer: Renderer | None = None,
        frames: int = 0,
    ) -> "PassPreview":
        """Find the building's axes in the key frames. Raises StructureError where none stand out."""
        renderer = renderer or Renderer()
        return cls(tuple(keys), tuple(pairs), renderer, manhattan(_evenly(keys), renderer), frames)

    def apart(self, most: float = np.inf) -> int:
        """`ViewSpec.every` for a long pass: 1, 2 or 4 (so that plugins use the same frames), `most` at most, such that
        a hundred frames or more are used."""
        return next((every for every in (4, 2) if every <= most and self.frames >= every * ENOUGH_FRAMES), 1)

    def views(self, spec: ViewSpec) -> list[View]:
        """The view in every key frame."""
        return [self.renderer.render(panorama, spec) for panorama in self.keys]


@dataclass(frozen=True)
class Face:
    """The direction of a face: a view straight at it, level in the building, which way the camera goes along it (+1:
    towards +x, -1: towards -x, 0: not known), its score, and that of the best face on the other hand."""

    spec: ViewSpec
    travel: int
    score: float
    across_score: float = 0.0

    @property
    def hand(self) -> Side | None:
        """The hand of the way that the face is on; None where that is not known."""
        return HANDS.get(self.travel)

    @property
    def rig_from_world(self) -> Floats:
        """Rotation (3, 3) of the row's frame as seen by a level view straight at the face."""
        return self.spec.rig_from_view @ LEVEL.T

    @property
    def world_from_rig(self) -> Floats:
        """Rotation (3, 3): where to start a frame's orientation from."""
        return self.rig_from_world.T


def face_candidates(rig_from_manhattan: Floats, hfov_deg: float = 100.0) -> tuple[ViewSpec, ...]:
    """The four level views along the building's horizontal axes, the first along -z, then to the right.

    Where the rig is tilted so far that another axis could be the vertical (less than 60 degrees from the rig's up), the
    four that follow from it are added.
    """
    back = rig_from_manhattan[:, 2]
    return tuple(
        _spec("face", facing(rig_from_manhattan, up, back) @ LEVEL @ pinhole.rig_from_view(turn, 0, 0), hfov_deg)
        for up in _verticals(rig_from_manhattan)
        for turn in (0.0, 90.0, 180.0, 270.0)
    )


def _verticals(rig_from_manhattan: Floats) -> list[Floats]:
    directions = [*rig_from_manhattan.T, *-rig_from_manhattan.T]
    upright = [d for d in directions if float(RIG_UP @ d) >= np.cos(np.radians(STEEPEST_TILT_DEG))]
    return sorted(upright, key=lambda d: -float(RIG_UP @ d))


def _spec(name: str, rig_from_view: Floats, hfov_deg: float) -> ViewSpec:
    return ViewSpec(name, *pinhole.angles_from_rotation(rig_from_view), hfov_deg=hfov_deg)


def choose_face(pass_preview: PassPreview, score: Score, side: Side | None = None, hfov_deg: float = 100.0) -> Face:
    """The level direction that faces the structure best.

    `score(spec, panorama)` says how much like a face the view of a panorama is (0: not at all). Directions across the
    camera's way are preferred. `side`, where the structure is as seen in the direction of travel, decides between the
    faces of both sides: on the left, the camera moves towards the face's +x. Raises StructureError where no view
    scores.
    """
    specs = face_candidates(pass_preview.rig_from_manhattan, hfov_deg)
    travels = [way for spec in specs[::4] for way in travel_directions(pass_preview.pairs, spec, pass_preview.renderer)]
    ways = list(zip(specs, travels, strict=True))
    across = [(spec, travel) for spec, travel in ways if travel and side in (None, HANDS[travel])]
    faces = [_scored(pass_preview, score, *way) for way in across or ways]
    best = max(faces, key=lambda face: face.score)
    if best.score <= 0:
        where = f"on the {side} of the way" if side else "in any direction"
        raise StructureError(
            f"no structure is seen {where}; check the side, or give the view's angles in the site file"
        )
    others = (face.score for face in faces if best.travel and face.travel == -best.travel)
    return replace(best, across_score=max(others, default=0.0))


def _scored(pass_preview: PassPreview, score: Score, spec: ViewSpec, travel: int) -> Face:
    return Face(spec, travel, float(np.mean([score(spec, panorama) for panorama in _evenly(pass_preview.keys)])))


def _evenly(keys: Sequence[Panorama]) -> list[Panorama]:
    """A few of the key frames, evenly spaced."""
    chosen = np.linspace(0, len(keys) - 1, min(FEW, len(keys))).round().astype(int)
    return [keys[i] for i in chosen]


def ceiling_view(face: Face, hfov_deg: float = 110.0, name: str = "ceiling") -> ViewSpec:
    """The view straight up in the building; its x runs along the row's."""
    return _spec(name, face.rig_from_world @ UPWARDS, hfov_deg)


def floor_view(face: Face, hfov_deg: float = 110.0, name: str = "floor") -> ViewSpec:
    """The view straight down in the building; its x runs along the row's, and the face is above its middle."""
    return _spec(name, face.rig_from_world @ DOWNWARDS, hfov_deg)


def face_at(world_from_rig: Floats) -> Face:
    """The face of a row whose frame is known: the attitude (3, 3) of the rig tells which way it lies."""
    return Face(_spec("face", world_from_rig.T @ LEVEL, 100.0), 0, 1.0)


def tilted(face: Face, pitch_deg: float, hfov_deg: float, name: str) -> ViewSpec:
    """The view at the face, raised by `pitch_deg` in the building."""
    return _spec(name, face.spec.rig_from_view @ pinhole.rig_from_view(0, pitch_deg, 0), hfov_deg)


def manhattan(panoramas: Sequence[Panorama], renderer: Renderer) -> Floats:
    """rig_from_manhattan (3, 3): the building's axes in the rig frame, as columns; mean over frames of one pass.

    y is the axis nearest the rig's up, z of the others the one nearest its back (so that one looks along -z). The rig
    may be turned any way about the vertical and tilted by some 45 degrees. Raises StructureError where no three axes
    stand out.
    """
    edges = [segments(panorama, renderer) for panorama in panoramas]
    rays_a, rays_b = (np.concatenate([pair[side] for pair in edges]) for side in (0, 1))
    coarse = manhattan_from_segments(rays_a, rays_b)
    if coarse is None or coarse.support < CLEAR_SUPPORT:
        clear = _clear_alone(edges, LEAST_SUPPORT if coarse is None else max(LEAST_SUPPORT, CLEARER * coarse.support))
        if 2 * len(clear) > len(edges):
            return facing(_mean(clear), RIG_UP, -RIG_FORWARD)
    if coarse is None or coarse.support < LEAST_SUPPORT:
        raise StructureError(
            "no building directions stand out in the pictures; give the views' angles in the site file"
        )
    refined = [manhattan_from_segments(*pair, coarse.rig_from_manhattan) for pair in edges]
    return _mean([frame.rig_from_manhattan for frame in refined if frame is not None])


def _clear_alone(edges: Sequence[tuple[Floats, Floats]], least: float) -> list[Floats]:
    """The axes (3, 3) of the frames whose own segments show them with this support, named alike: a rig that turns from
    frame to frame has none that fit all frames together, or wrong ones."""
    found = [manhattan_from_segments(*pair) for pair in edges]
    axes: list[Floats] = []
    for frame in found:
        if frame is not None and frame.support >= least:
            like = axes[-1] if axes else frame.rig_from_manhattan
            axes.append(facing(frame.rig_from_manhattan, like[:, 1], like[:, 2]))
    return axes


def _mean(rotations: Sequence[Floats]) -> Floats:
    """The rotation nearest to all of these."""
    left, _, right = np.linalg.svd(np.median(rotations, axis=0))
    mean: Floats = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    return mean


def segments(panorama: Panorama, renderer: Renderer) -> tuple[Floats, Floats]:
    """Unit rays (n, 3) of the ends of the straight segments seen in views that cover the sphere, rig frame."""
    ends = [_segments_in(renderer.render(panorama, spec)) for spec in SEARCH_VIEWS]
    return np.concatenate([pair[0] for pair in ends]), np.concatenate([pair[1] for pair in ends])


def _segments_in(view: View) -> tuple[Floats, Floats]:
    grey = cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY)
    lines = cv2.createLineSegmentDetector().detect(grey)[0]
    ends = np.zeros((0, 2, 2)) if lines is None else np.asarray(lines, np.float64).reshape(-1, 2, 2)
    ends = ends[np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > SHORTEST_PX]
    return view.spec.rig_rays(ends[:, 0]), view.spec.rig_rays(ends[:, 1])
