"""View planning (paper, "Rendering views"): the directions of a row's views, whichever way the camera is turned.

`PassPreview.of_frames` finds the building's axes in a pass's key frames, `choose_face` the one of its four level
directions that faces the structure, and `fit_height` and `fit_count` the smallest field of view that shows enough. The
caller gives functions that recognise the structure.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.errors import StructureError
from savmap.geometry import pinhole
from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.geometry.vanishing import RIG_FORWARD, RIG_UP, facing, manhattan_from_segments
from savmap.types import Floats, Panorama, View, ViewSpec, array_record
from savmap.vision.odometry import lucas_kanade
from savmap.vision.views import Renderer, panorama_pixels

CORNERS = 300
LEAST_TRACKS = 20
LEAST_MOTION_PX = 0.5
ALONG_OVER_ACROSS = 1.5
# shifts of four views, turned by 90 degrees each: what turning adds, and moving along the first and the second
SHIFTS = np.array([[1.0, -1, 0], [1, 0, -1], [1, 1, 0], [1, 0, 1]])
SEARCH_VIEWS = [
    *(ViewSpec(f"level {yaw}", yaw, 0, 0, 100, 512, 512) for yaw in (0, 90, 180, 270)),
    *(ViewSpec(f"pole {pitch}", 45, pitch, 0, 100, 512, 512) for pitch in (90, -90)),
]
SHORTEST_PX, AROUND_PX = 25.0, 11
"""Of segments, the latter around their middles where the camera must see."""
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
FEW = 3
"""Key frames that are asked which way the face lies."""
Extent = Callable[[View], tuple[float, float] | None]
Count = Callable[[View], int]
SMALLEST_HFOV_DEG, LARGEST_HFOV_DEG = 60.0, 155.0
FIRST_HFOV_DEG = 110.0
BORDER_PX = 2.0
CUT_SHARE = 0.12
BEYOND_CUT_DEG = 8.0
SETTLED_DEG = 1.0
MOST_ROUNDS = 12
KEPT_VIEWS = 20
HFOV_STEP_DEG = 5.0
WIDEST_WHOLE_DEG, SPARE_DEG, WHOLE_WIDTH = 125.0, 1.0, 640
"""Of a camera whose whole picture is one view: its widest, what is left at the borders, and the view's pixels."""


def travel_directions(
    pairs: Sequence[tuple[Panorama, Panorama]], spec: ViewSpec, renderer: Renderer
) -> tuple[int, int, int, int]:
    """Which way the camera moves along `spec` and the views turned from it to the right by 90, 180 and 270 degrees: +1
    to the right as it looks along the view (towards the face's +x), -1 to the left, 0 unknown.

    The rig's turning shifts all views alike; half the difference of opposite views is its motion. That must exceed the
    motion measured in the same way in the two views across, which it does only when looking across the way. One view
    may be too bare to track anything in.
    """
    views = [_turned(spec, turn) for turn in (0.0, 90.0, 180.0, 270.0)]
    shifts = np.array([[_shift(pair, view, renderer) for view in views] for pair in pairs]).reshape(-1, 4)
    along, across = np.array([_motion(row) for row in shifts]).reshape(-1, 2).sum(axis=0).tolist()
    least = max(LEAST_MOTION_PX * len(pairs), 1e-9)
    first = int(np.sign(along)) if abs(along) > max(least, ALONG_OVER_ACROSS * abs(across)) else 0
    second = int(np.sign(across)) if abs(across) > max(least, ALONG_OVER_ACROSS * abs(along)) else 0
    return first, second, -first, -second


def _motion(shifts: Floats) -> Floats:
    """Motion (2,) to the right of the first two of four views, by shifts (4,) px; 0 where two or more are nan."""
    finite = np.isfinite(shifts)
    if finite.sum() < 3:
        return np.zeros(2)
    motion: Floats = np.linalg.lstsq(SHIFTS[finite], shifts[finite], rcond=None)[0][1:]
    return motion


def _turned(spec: ViewSpec, degrees: float) -> ViewSpec:
    """A small 90 degree view turned about the vertical of `spec`."""
    rotation = spec.rig_from_view @ pinhole.rig_from_view(degrees, 0, 0)
    return ViewSpec("travel", *pinhole.angles_from_rotation(rotation), hfov_deg=90, width=320, height=240)


def _shift(pair: tuple[Panorama, Panorama], spec: ViewSpec, renderer: Renderer) -> float:
    """Median shift of the picture's corners to the right, pixels; nan where too few can be tracked."""
    first, second = (
        np.asarray(cv2.cvtColor(renderer.render(p, spec).image, cv2.COLOR_RGB2GRAY), np.uint8) for p in pair
    )
    detected = cv2.goodFeaturesToTrack(first, CORNERS, 0.01, 5)
    if detected is None:
        return float("nan")
    corners = np.asarray(detected, np.float32)
    moved, _ = lucas_kanade(first, second, corners)
    back, _ = lucas_kanade(second, first, moved)
    good = np.linalg.norm(back - corners, axis=-1).ravel() < 1.0
    return float(np.median((moved - corners)[good, 0, 0])) if good.sum() >= LEAST_TRACKS else float("nan")


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
    `rig_from_manhattan` (3, 3); and where it is known before the face is, which way the camera goes along the face
    towards which it looks (as `Face.travel`)."""

    keys: tuple[Panorama, ...]
    pairs: tuple[tuple[Panorama, Panorama], ...]
    renderer: Renderer
    rig_from_manhattan: Floats
    travel: int = 0

    @classmethod
    def of_frames(
        cls,
        keys: Sequence[Panorama],
        pairs: Sequence[tuple[Panorama, Panorama]] = (),
        renderer: Renderer | None = None,
    ) -> "PassPreview":
        """Find the building's axes in the key frames. Raises StructureError where none stand out."""
        renderer = renderer or Renderer()
        return cls(tuple(keys), tuple(pairs), renderer, manhattan(_evenly(keys), renderer))

    @cached_property
    def view(self) -> Callable[[Panorama, ViewSpec], View]:
        """A view in a frame. The latest are kept, and with them what a network gives for them."""
        return lru_cache(KEPT_VIEWS)(self.renderer.render)

    def views(self, spec: ViewSpec) -> list[View]:
        """The view in every key frame."""
        return [self.view(panorama, spec) for panorama in self.keys]


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


def face_candidates(rig_from_manhattan: Floats, hfov_deg: float = FIRST_HFOV_DEG) -> tuple[ViewSpec, ...]:
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


def whole_view(panorama: Panorama, name: str = "face") -> Manual | None:
    """The view that shows all that an ordinary lens sees, turned as the camera is; None of one that sees so much that
    views are chosen in it."""
    mask = panorama.seen
    if mask is None:
        return None
    level, upright = mask[panorama.height // 2], mask[:, panorama.height]
    across, down = (np.count_nonzero(line) * np.pi / panorama.height for line in (level, upright))
    if not (level[panorama.height] and across < np.radians(WIDEST_WHOLE_DEG)):
        return None
    hfov = float(np.degrees(across)) - SPARE_DEG
    wide = float(np.tan(np.radians(hfov) / 2) / np.tan((down - np.radians(SPARE_DEG)) / 2))
    height = 8 * round(WHOLE_WIDTH / wide / 8)
    return Manual(0.0, 0.0, 0.0, round(hfov, 3), WHOLE_WIDTH, height)


def _seen_in_part(pass_preview: PassPreview, specs: Sequence[ViewSpec]) -> list[tuple[ViewSpec, int]]:
    """The views in whose middle a camera sees that does not see all around, and which way it goes along each, by how
    the picture shifts."""
    seen, panorama = list[tuple[ViewSpec, int]](), pass_preview.keys[0]
    for spec in specs:
        x, y = panorama_pixels_from_rays(spec.rig_from_view[:, 2], panorama.height).astype(int)
        if panorama.seen is None or panorama.seen[y.clip(0, panorama.height - 1), x % (2 * panorama.height)]:
            shifts = [_shift(pair, spec, pass_preview.renderer) for pair in pass_preview.pairs]
            shift = float(np.nansum(shifts))
            seen.append((spec, -int(np.sign(shift)) if abs(shift) > LEAST_MOTION_PX else 0))
    return seen


def choose_face(pass_preview: PassPreview, score: Score, side: Side | None = None) -> Face:
    """The level direction that faces the structure best.

    `score(spec, panorama)` says how much like a face the view of a panorama is (0: not at all). Directions across the
    camera's way are preferred. `side`, where the structure is as seen in the direction of travel, decides between the
    faces of both sides: on the left, the camera moves towards the face's +x. Raises StructureError where no view
    scores.
    """
    specs = face_candidates(pass_preview.rig_from_manhattan)
    if pass_preview.travel:
        ways = [(specs[0], pass_preview.travel)]
    elif pass_preview.keys[0].seen is not None:
        ways = _seen_in_part(pass_preview, specs)
    else:
        pairs, renderer = pass_preview.pairs, pass_preview.renderer
        travels = [way for spec in specs[::4] for way in travel_directions(pairs, spec, renderer)]
        ways = list(zip(specs, travels, strict=True))
    across = [(spec, travel) for spec, travel in ways if travel and side in (None, HANDS[travel])]
    unknown = [way for way in ways if side is None or not way[1]]
    faces = [_scored(pass_preview, score, *way) for way in across or unknown]
    best = max(faces, key=lambda face: face.score, default=None)
    if best is None or best.score <= 0:
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
    """The axes (3, 3), named alike, of frames whose segments show them with this support: of a rig that turns."""
    axes: list[Floats] = []
    for frame in (manhattan_from_segments(*pair) for pair in edges):
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
    ends = [_segments_in(renderer.render(panorama, spec), shown_in(panorama, spec)) for spec in SEARCH_VIEWS]
    return np.concatenate([pair[0] for pair in ends]), np.concatenate([pair[1] for pair in ends])


def shown_in(panorama: Panorama, spec: ViewSpec) -> NDArray[np.bool_] | None:
    """Which pixels (h, w) of a view the camera sees, and all around them; None of a camera that sees all around."""
    if panorama.seen is None:
        return None
    at = panorama_pixels(spec, panorama.height)
    shown = cv2.remap(panorama.seen, at[..., 0], at[..., 1], cv2.INTER_NEAREST)
    return np.asarray(cv2.erode(shown, np.ones((AROUND_PX, AROUND_PX))) > 0)


def _segments_in(view: View, shown: NDArray[np.bool_] | None) -> tuple[Floats, Floats]:
    grey = cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY)
    if shown is not None and not shown.any():
        return np.zeros((0, 3)), np.zeros((0, 3))
    ends = segments_in(np.asarray(grey, np.uint8))
    if shown is not None:
        x, y = ends.mean(axis=1).round().astype(int).T
        ends = ends[shown[y.clip(0, view.spec.height - 1), x.clip(0, view.spec.width - 1)]]
    return view.spec.rig_rays(ends[:, 0]), view.spec.rig_rays(ends[:, 1])


def segments_in(grey: NDArray[np.uint8]) -> Floats:
    """The ends (n, 2, 2) px of the straight segments of a picture (h, w)."""
    lines = cv2.createLineSegmentDetector().detect(grey)[0]
    ends = np.zeros((0, 2, 2)) if lines is None else np.asarray(lines, np.float64).reshape(-1, 2, 2)
    return np.asarray(ends[np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > SHORTEST_PX])


AUTOMATIC = Manual()


@dataclass(frozen=True)
class Fitted:
    """A view, and a line for the user about what is wrong with it, if anything is."""

    spec: ViewSpec
    warning: str | None = None


@dataclass(frozen=True)
class _Elevations:
    """Lowest and highest elevation of the structure over the key frames, degrees in the building, and whether the
    frame cuts it below and above."""

    low_deg: float
    high_deg: float
    cut_low: bool
    cut_high: bool


UNKNOWN = _Elevations(-80.0, 80.0, False, False)


def fit_height(
    pass_preview: PassPreview,
    face: Face,
    extent: Extent,
    manual: Manual = AUTOMATIC,
    name: str = "face",
    margin: float = 0.05,
) -> Fitted:
    """The view at the face that shows its whole height in all key frames at the smallest field of view.

    `extent(view)` gives the top and bottom row of the structure in a view, at the frame's border where that cuts it, or
    None where there is no structure. `margin` is the share of the view's height kept free above and below. Values of
    `manual` are kept. Raises StructureError where the structure is in no view.
    """
    if manual.complete:
        return Fitted(manual.over(ViewSpec(name, 0.0)))
    spec = manual.over(tilted(face, 0.0, FIRST_HFOV_DEG, name))
    whole: list[tuple[bool, float, ViewSpec]] = []
    for _ in range(MOST_ROUNDS):
        extremes = _elevations(pass_preview, face, spec, extent)
        following = manual.over(_covering(face, extremes or UNKNOWN, spec, margin))
        settled = _change(following, spec) < SETTLED_DEG
        if extremes and not (extremes.cut_low or extremes.cut_high):
            whole.append((following.hfov_deg > spec.hfov_deg + SETTLED_DEG, spec.hfov_deg, spec))
        if settled:
            break
        spec = following
    if extremes is None:
        raise StructureError(f"view {name}: no structure is seen in its direction; give its angles in the site file")
    if not whole:
        return Fitted(
            spec, f"view {name}: the whole height of the structure is not seen at {spec.hfov_deg:.0f} degrees"
        )
    return Fitted(min(whole, key=lambda tried: tried[:2])[2])


def _elevations(pass_preview: PassPreview, face: Face, spec: ViewSpec, extent: Extent) -> _Elevations | None:
    """Of the key frames only so many are asked as it takes to see that the frame cuts the structure below and above."""
    ends = np.zeros((0, 2))
    few = _evenly(pass_preview.keys)
    for panorama in [*few, *(key for key in pass_preview.keys if all(key is not asked for asked in few))]:
        rows = extent(pass_preview.view(panorama, spec))
        ends = ends if rows is None else np.vstack([ends, rows])
        if ((ends == [0, spec.height - 1]).sum(axis=0) > CUT_SHARE * len(pass_preview.keys)).all():
            break
    if not len(ends):
        return None
    top, bottom = ends.T
    pitch = pinhole.angles_from_rotation(face.spec.rig_from_view.T @ spec.rig_from_view)[1]
    elevations = pitch + np.degrees(np.arctan((spec.camera[1, 2] - np.array([top, bottom])) / spec.camera[1, 1]))
    cut_high = float(np.mean(top <= BORDER_PX)) > CUT_SHARE
    cut_low = float(np.mean(bottom >= spec.height - 1 - BORDER_PX)) > CUT_SHARE
    return _Elevations(float(elevations[1].min()), float(elevations[0].max()), cut_low, cut_high)


def _covering(face: Face, extremes: _Elevations, spec: ViewSpec, margin: float) -> ViewSpec:
    """The view that covers these elevations with its margins, and a little more where the frame cut the structure; the
    widest where it cut both ends."""
    if extremes.cut_low and extremes.cut_high:
        return tilted(face, 0.0, LARGEST_HFOV_DEG, spec.name)
    low = max(extremes.low_deg - BEYOND_CUT_DEG * extremes.cut_low, -88.0)
    high = min(extremes.high_deg + BEYOND_CUT_DEG * extremes.cut_high, 88.0)
    half = np.radians(min(high - low, 170.0) / 2)
    tangent = np.tan(half) / (1 - 2 * margin) * spec.width / spec.height
    hfov = float(np.clip(np.degrees(2 * np.arctan(tangent)), SMALLEST_HFOV_DEG, LARGEST_HFOV_DEG))
    return tilted(face, (low + high) / 2, hfov, spec.name)


def _change(a: ViewSpec, b: ViewSpec) -> float:
    """How far two views differ, degrees."""
    turned = a.rig_from_view.T @ b.rig_from_view
    angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
    return max(float(angle), abs(a.hfov_deg - b.hfov_deg))


def fit_count(
    pass_preview: PassPreview,
    spec: ViewSpec,
    count: Count,
    at_least: int = 2,
    share: float = 0.95,
    manual: Manual = AUTOMATIC,
    smallest_deg: float = SMALLEST_HFOV_DEG,
) -> Fitted:
    """The view along `spec` with the smallest field of view that shows `at_least` objects in this share of the key
    frames.

    `count(view)` gives how many a view shows. A step is added for the frames between. Values of `manual` are kept.
    """
    if manual.hfov_deg is not None:
        return Fitted(manual.over(spec))
    keys = [*pass_preview.keys]
    for hfov in np.arange(smallest_deg, LARGEST_HFOV_DEG + 1, HFOV_STEP_DEG):
        candidate = manual.over(replace(spec, hfov_deg=float(hfov)))
        if _enough(pass_preview, keys, candidate, count, at_least, share):
            wider = min(float(hfov) + HFOV_STEP_DEG, LARGEST_HFOV_DEG)
            return Fitted(replace(candidate, hfov_deg=wider))
    return Fitted(
        candidate, f"view {spec.name}: fewer than {at_least} are in sight in some frames, however wide the view"
    )


def _enough(
    pass_preview: PassPreview, keys: list[Panorama], spec: ViewSpec, count: Count, at_least: int, share: float
) -> bool:
    """Whether enough of the key frames show enough objects, until a frame decides it, which is then the first of
    them."""
    may_fail = int(np.floor((1 - share) * len(keys) + 1e-9))
    for number, panorama in enumerate(keys):
        may_fail -= count(pass_preview.view(panorama, spec)) < at_least
        if may_fail < 0:
            keys.insert(0, keys.pop(number))
            return False
    return True
