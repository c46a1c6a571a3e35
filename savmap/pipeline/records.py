"""What is asked of a row, and what is known of it after each step of the pipeline."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from savmap.files.journal import Journal
from savmap.graph import Calibration, CameraPriors, Constraints, Problem, References, Solution
from savmap.pipeline.cutting import Cut
from savmap.plugin.manager import LoadedPlugin
from savmap.site.model import Footage, Pass, pass_names
from savmap.types import (
    Doubt,
    Feature,
    FlatDepth,
    Floats,
    Flow,
    PlanePatch,
    RowFacts,
    RowStrips,
    Structure,
    Track,
    Trajectory,
)
from savmap.vision.evidence import FloorTracks, PackedView
from savmap.vision.markers import MarkerTracks


@dataclass(frozen=True, eq=False)
class FrameRecord:
    """What was measured in one frame, and is kept while others are measured: features and packed views by plugin, and
    what was cut of it."""

    features: Mapping[str, Sequence[Feature]]
    packed_views: Mapping[str, Sequence[PackedView]] = field(default_factory=dict)
    cuts: Sequence[Cut] = ()


FrameJournal = Journal[FrameRecord]


@dataclass(frozen=True, eq=False)
class RowMeasurements:
    """What was measured in a row's pictures: its facts, features by plugin, the first attitude of every pass that is
    known, the plugins that found the face and so locate the camera, the markers, and points that were followed.
    `failed`: by plugin, how it failed, where the row is mapped without it. `doubts`: what of the footage speaks against
    what was measured. `depths`: how deep flat parts of structures lie. `floor`: points of the floor. `skipped`: how
    many frames the decoder left out, as the notes say."""

    facts: RowFacts
    features: Mapping[str, Sequence[Feature]]
    attitudes: Mapping[str, Floats]
    locators: frozenset[str]
    notes: tuple[str, ...]
    marks: MarkerTracks
    flows: Sequence[Flow] = ()
    failed: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    depths: tuple[FlatDepth, ...] = ()
    floor: FloorTracks = field(default_factory=FloorTracks)
    skipped: int = 0


@dataclass(frozen=True, eq=False)
class RowRequest:
    """One row to be mapped: its passes, the plugins that look at them, its references, and settings.

    `path`: the camera's path where an earlier map gives it. `calibration`: what of the camera is estimated.
    `appearance`: whether points of any kind help with the camera's motion. `measurements`: what an earlier run
    measured, if it is still valid. `strips`: whether strips of the frames are kept for an orthophoto; `stills`: whether
    panoramas are, to be looked at. `journal`: keeps what is measured in single frames, for a run that is cut off.
    """

    name: str
    passes: Sequence[Pass]
    plugins: Sequence[LoadedPlugin]
    references: References
    travel_m: float | None = None
    path: Trajectory | None = None
    calibration: Calibration | None = None
    appearance: bool = False
    measurements: RowMeasurements | None = None
    strips: bool = False
    stills: bool = False
    journal: FrameJournal | None = None

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


@dataclass(frozen=True, eq=False)
class LocatedRow(MeasuredRow):
    """A measured row with the first poses of its frames, and the frames as the graph takes them."""

    start: Trajectory
    frames: CameraPriors


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

    @property
    def moments(self) -> list[tuple[Footage, float]]:
        """Which picture each frame is: the same in every row that is seen in it."""
        passes = self.request.passes
        footage = {name: row_pass.footage for name, row_pass in zip(pass_names(passes), passes, strict=True)}
        table = self.measurements.facts.frames
        return [(footage[name], stamp) for name, stamp in zip(table.passes, table.stamps_s.tolist(), strict=True)]


@dataclass(frozen=True, eq=False)
class SolvedRow(PosedRow):
    """A row with the solution of its graph."""

    solution: Solution


@dataclass(frozen=True, eq=False)
class DescribedRow(SolvedRow):
    """A solved row with its structures by plugin, and its face if a plugin knows it."""

    structures: Mapping[str, tuple[Structure, ...]]
    face: PlanePatch | None
