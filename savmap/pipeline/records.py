"""What is asked of a row, and what is known of it after each step of the pipeline."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from savmap.graph import Calibration, CameraPriors, Constraints, Problem, References, Solution
from savmap.pipeline.measure import FrameJournal, RowMeasurements
from savmap.plugin.manager import LoadedPlugin
from savmap.site.model import Footage, Pass, pass_names
from savmap.types import PlanePatch, RowStrips, Structure, Track, Trajectory


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
