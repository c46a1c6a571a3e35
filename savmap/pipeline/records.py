"""What is asked of a row, and what is known of it after each step of the pipeline."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from typing import TypeVar

from savmap.errors import SavmapError
from savmap.files.journal import Journal
from savmap.graph import Calibration, CameraPriors, Constraints, Problem, References, Solution
from savmap.pipeline.cutting import Cut
from savmap.pipeline.trust.footage import with_warnings
from savmap.plugin.manager import LoadedPlugin
from savmap.site.model import Footage, Pass, pass_names
from savmap.types import (
    Feature,
    FlatDepth,
    Floats,
    Flow,
    FoundObject,
    MapWarning,
    PlanePatch,
    RowFacts,
    RowMap,
    RowPlace,
    RowStrips,
    Structure,
    Track,
    Trajectory,
    ViewSpec,
)
from savmap.vision.evidence import FloorTracks, PackedView
from savmap.vision.markers import MarkerTracks
from savmap.vision.odometry import Followed

Before = TypeVar("Before")
After = TypeVar("After")


@dataclass(frozen=True, eq=False)
class FrameRecord:
    """What was measured in one frame, and is kept while others are measured: features and packed views by plugin, what
    was cut of it, by plugin which shares of its views are dark, and overexposed, and its time in the video."""

    features: Mapping[str, Sequence[Feature]]
    packed_views: Mapping[str, Sequence[PackedView]] = field(default_factory=dict)
    cuts: Sequence[Cut] = ()
    tones: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    stamp_s: float = nan


@dataclass(frozen=True, eq=False)
class DriveFrame:
    """What a drive keeps of a frame for a run that is cut off: its time, a small grey picture (`packed_grey`) that
    tells how the camera moves, how many frames of the video were decoded up to it, up to which time none was lost, the
    points that were followed to it, and whether it is a key frame."""

    stamp_s: float
    grey: bytes
    decoded: int
    whole_until_s: float
    followed: Followed
    is_key: bool


@dataclass(frozen=True, eq=False)
class RowMeasurements:
    """What was measured in a row's pictures: its facts, features by plugin, the first attitude of every pass that is
    known, the plugins that found the face and so locate the camera, the markers, and points that were followed.
    `failed`: by plugin, how it failed, where the row is mapped without it. `warnings`: what of the footage speaks
    against what was measured. `objects`: by plugin, what all frames together show, in the unit of `path`, which is
    up to scale. `depths`: how deep flat parts of structures lie. `floor`: points of the floor. `skipped`: how many
    frames the decoder left out, as the notes say. `tones`: by frame and plugin, where it looked, which shares of its
    views are dark, and overexposed. `walked`: the poses of frames by odometry, those of each pass in a frame of its
    own, in the unit of the face's distance; `levelled`: the passes whose poses there are turned as the row's frame
    is."""

    facts: RowFacts
    features: Mapping[str, Sequence[Feature]]
    attitudes: Mapping[str, Floats]
    locators: frozenset[str]
    notes: tuple[str, ...]
    marks: MarkerTracks
    flows: Sequence[Flow] = ()
    failed: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[MapWarning, ...] = ()
    objects: Mapping[str, tuple[FoundObject, ...]] = field(default_factory=dict)
    path: Trajectory | None = None
    depths: tuple[FlatDepth, ...] = ()
    floor: FloorTracks = field(default_factory=FloorTracks)
    skipped: int = 0
    tones: Sequence[Mapping[str, tuple[float, float]]] = ()
    walked: Trajectory | None = None
    levelled: frozenset[str] = frozenset()


@dataclass(frozen=True, eq=False)
class RowRequest:
    """One row to be mapped: its passes, the plugins that look at them, its references, and settings.

    `path`: the camera's path where an earlier map gives it, and `path_s` the passes and times of its frames, as they
    are in that map. `calibration`: what of the camera is estimated. `appearance`: whether points of any kind help with
    the camera's motion. `strips`: whether strips of the frames are kept for an orthophoto; `stills`: whether panoramas
    are, to be looked at. `against`: mapped rows, by name, in one of which it is recognised.
    """

    name: str
    passes: Sequence[Pass]
    plugins: Sequence[LoadedPlugin]
    references: References
    travel_m: float | None = None
    path: Trajectory | None = None
    path_s: frozenset[tuple[str, float]] | None = None
    calibration: Calibration | None = None
    appearance: bool = False
    strips: bool = False
    stills: bool = False
    against: Mapping[str, RowMap] = field(default_factory=dict)

    @property
    def sees_in_part(self) -> bool:
        """Whether a pass was filmed by a camera that may not see all around."""
        return any(row_pass.clip.camera is not None for row_pass in self.passes)

    @property
    def attitudes(self) -> Mapping[str, Floats]:
        """world_from_rig (3, 3) at the start of the row's (only) pass, where an earlier map gives it."""
        return {"pass 1": self.path.world_from_rig[0, :3, :3]} if self.path is not None else {}

    @property
    def gauge_references(self) -> References:
        """The references that fix place and scale; none where an earlier map's path does."""
        return self.references if self.path is None else References()


@dataclass(frozen=True, eq=False)
class MeasuredRow:
    """A row and what was measured in its pictures, and strips of these if they were asked for."""

    request: RowRequest
    measurements: RowMeasurements
    strips: RowStrips = field(default_factory=RowStrips, kw_only=True)

    @property
    def moments(self) -> list[tuple[Footage, float]]:
        """Which picture each frame is: the same in every row that is seen in it."""
        passes = self.request.passes
        footage = {name: row_pass.footage for name, row_pass in zip(pass_names(passes), passes, strict=True)}
        table = self.measurements.facts.frames
        return [(footage[name], stamp) for name, stamp in zip(table.passes, table.stamps_s.tolist(), strict=True)]


@dataclass(frozen=True, eq=False)
class WalkedRow(MeasuredRow):
    """A row as the drive saw it, and what was kept of the pictures for what comes after it.

    plugins: with the networks that were used. packed_views: by plugin, for those whose structure lies in planes. floor:
    views of the floor, whose specifications are in `floor_views`. journal: has a strip of every frame
    (`savmap.vision.strips`) in the series `strips_of(row)`.
    """

    plugins: Sequence[LoadedPlugin]
    packed_views: Mapping[str, Sequence[PackedView]]
    journal: Journal
    floor: tuple[PackedView, ...] = ()
    floor_views: Mapping[str, ViewSpec] = field(default_factory=dict)


def drive_of(row: str, row_pass: str) -> str:
    """What the series of a drive's frames is called in a journal: by the first row that is seen in it, and its pass."""
    return f"{row}, {row_pass}, frames"


def strips_of(row: str) -> str:
    """What the series of a row's strips is called in a journal."""
    return f"{row}, strips"


@dataclass(frozen=True, eq=False)
class LocatedRow(MeasuredRow):
    """A measured row with the first poses of its frames, and the frames as the graph takes them. `place`: where in a
    mapped row it was recognised."""

    start: Trajectory
    frames: CameraPriors
    place: RowPlace | None = field(default=None, kw_only=True)


@dataclass(frozen=True, eq=False)
class TrackedRow(LocatedRow):
    """A located row with tracks and constraints by plugin, constraints of markers and motion, notes, and figures for
    the report."""

    tracks: Mapping[str, Sequence[Track]]
    constraints: Mapping[str, Constraints]
    camera_constraints: tuple[Constraints, ...]
    notes: tuple[str, ...]
    figures: Mapping[str, int]


@dataclass(frozen=True, eq=False)
class PosedRow(TrackedRow):
    """A tracked row as a problem for the graph."""

    problem: Problem


@dataclass(frozen=True, eq=False)
class SolvedRow(PosedRow):
    """A row with the solution of its graph."""

    solution: Solution


@dataclass(frozen=True, eq=False)
class DescribedRow(SolvedRow):
    """A solved row with its structures by plugin, its face if a plugin knows it, and, in metres, what was found and is
    not mapped, for it may exist or not."""

    structures: Mapping[str, tuple[Structure, ...]]
    face: PlanePatch | None
    uncertain: tuple[FoundObject, ...] = ()


def each(items: Sequence[Before | SavmapError], step: Callable[[Before], After]) -> list[After | SavmapError]:
    """What a step gives for each item. An item that is an error stays; an expected error of the step stands for its
    item."""
    results: list[After | SavmapError] = []
    for item in items:
        try:
            results.append(item if isinstance(item, SavmapError) else step(item))
        except SavmapError as error:
            results.append(with_warnings(error, item.measurements.warnings) if isinstance(item, MeasuredRow) else error)
    return results
