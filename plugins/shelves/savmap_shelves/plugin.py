"""Racks: uprights and beams of a shelf face, as a plugin of savmap.

Hooks import their stage when they are called, so that a run that only asks for the plugin's name or settings starts
fast.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from savmap.plugin.hookspecs import hookimpl
from savmap.types import (
    CrossRowLandmark,
    Detection,
    FaceDepths,
    Feature,
    FlatParts,
    Floats,
    FoundObject,
    JointCovariance,
    MapWarning,
    Panorama,
    PlaneEvidence,
    PlanePatch,
    RowFacts,
    RowInspection,
    Structure,
    Track,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)
from savmap_shelves.inspection.limits import ShelvesLimits
from savmap_shelves.settings import ShelvesSettings

if TYPE_CHECKING:
    from savmap.graph import Constraints, Solution
    from savmap.plugin.hookspecs import Exporter
    from savmap.types import Drawing, Score, SiteMap, SurveyEntry
    from savmap.vision.view_planning import Manual, PassPreview


class Shelves:
    """Uprights and beams of the face of a rack."""

    name = "shelves"
    classes = ("upright", "beam")
    ifc_classes: ClassVar = {"IfcColumn": "upright", "IfcBeam": "beam"}
    model = Path(__file__).parent / "model" / "shelves.int8.onnx"
    Config = ShelvesSettings
    Limits = ShelvesLimits
    reference_names = (
        *(f"upright # / {part}" for part in ("foot", "left", "right")),
        *(f"upright # / {side} / {end}" for side, end in product(("left", "right"), ("bottom", "top"))),
        *(f"bay # / beam # / {edge}" for edge in ("lower", "upper")),
        *(f"bay # / beam # / {edge} {side}" for edge, side in product(("lower", "upper"), ("left", "right"))),
    )
    scale_settings = ("bay_pitch_m", "lowest_beam_bottom_height_m")
    # `plumb` is used on the pixels that were kept, not on the walk
    after_pixels = ("lowest_beam_bottom_height_m", "bay_pitch_m", "beam_setback_m", "plumb")

    def __init__(self, config: ShelvesSettings) -> None:
        self.config = config

    def questions(self, names: Sequence[str]) -> Iterator[str]:
        """About settings, where references use these names."""
        numbers = [match for name in names for match in re.findall(r"^(upright|bay) (\d{1,6})", name)]
        bays = max((int(number) - (label == "upright") for label, number in numbers), default=0)
        if 0 < self.config.values_given < bays:
            values = f"There are {self.config.values_given}, and references name {bays} bays"
            yield f"is a value missing? {values}: give `null` for one without"

    @hookimpl
    def render_views(
        self,
        pass_preview: "PassPreview",
        predict: Callable[[View], list[Detection]],
        side: Literal["left", "right"] | None,
        manual: "Mapping[str, Manual]",
    ) -> ViewPlan:
        from savmap_shelves.views import aim_at_face

        aim = aim_at_face(pass_preview, predict, side, manual)
        return replace(aim, views=tuple(replace(view, every=self.config.every) for view in aim.views))

    @hookimpl
    def find(
        self,
        gather: Callable[[PlanePatch], PlaneEvidence],
        path: Trajectory,
        points: Mapping[str, Floats],
        facts: RowFacts,
        floor: float | None,
    ) -> list[FoundObject]:
        from savmap_shelves.find import find

        return find(gather, path, points, facts, floor)

    @hookimpl
    def measure(
        self,
        objects: Sequence[FoundObject],
        spec: ViewSpec,
        frame: int,
        world_from_rig: Floats,
        scores: NDArray[np.float32],
        panorama: Panorama,
    ) -> list[Feature]:
        from savmap_shelves.edges import measure

        return measure(objects, spec, frame, world_from_rig, scores, panorama, parts=self.config.plumb)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory | None) -> list[Track]:
        from savmap_shelves.association import track_structures

        tracks = track_structures(features, facts)
        if not self.config.plumb or start is None:
            return tracks
        from savmap_shelves.inspection.shapes import straightened

        return straightened(tracks, facts, start)

    @hookimpl
    def planes(self, points: Mapping[str, Floats]) -> list[PlanePatch]:
        from savmap_shelves.evidence import face_patch, tracked_grid

        grid = tracked_grid(points)
        return [face_patch(grid)] if grid else []

    @hookimpl
    def flat_parts(self, points: Mapping[str, Floats]) -> list[FlatParts]:
        from savmap_shelves.evidence import beam_faces

        return beam_faces(points)

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> "Constraints":
        from savmap_shelves.constraints import constrain, grid_settings

        return constrain(tracks, facts, start, plugin=self.name, settings=grid_settings(self.config))

    @hookimpl
    def describe(self, tracks: Sequence[Track], facts: RowFacts, solution: "Solution") -> list[Structure]:
        from savmap_shelves.mapping import describe

        structures = describe(tracks, solution, plugin=self.name, depth_m=self.config.depth_m)
        if not self.config.plumb:
            return structures
        from savmap_shelves.inspection.shapes import with_shapes

        return with_shapes(structures, tracks, facts, solution.trajectory, solution.landmarks_of(self.name))

    @hookimpl
    def warnings(self, structures: Sequence[Structure]) -> list[MapWarning]:
        from savmap_shelves.scale import implausible_scale

        return list(implausible_scale(structures))

    @hookimpl
    def openings(self, structures: Sequence[Structure]) -> list[Structure]:
        from savmap_shelves.report.slots import openings

        return openings(structures, self.name)

    @hookimpl
    def places(self, structures: Sequence[Structure], joint: JointCovariance | None) -> list[Structure]:
        from savmap_shelves.report.slots import places

        return places(structures, self.name, joint)

    @hookimpl
    def inspect(
        self,
        structures: Sequence[Structure],
        places: Mapping[str, Sequence[Structure]],
        joint: JointCovariance | None,
        limits: ShelvesLimits,
        survey: Mapping[str, Any] | None,
        depths: FaceDepths | None,
    ) -> RowInspection:
        from savmap_shelves.inspection.inspect import inspect

        return inspect(structures, places.get(self.name, ()), joint, limits, survey, depths, self.name)

    @hookimpl
    def cross_row_landmarks(self, structures: Sequence[Structure]) -> list[CrossRowLandmark]:
        from savmap_shelves.mapping import cross_row_landmarks

        return cross_row_landmarks(structures)

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> "Score":
        from savmap_shelves.report.evaluation import evaluate

        return evaluate(structures, survey)

    @hookimpl
    def survey_entry(self, structures: Sequence[Structure]) -> "SurveyEntry":
        from savmap_shelves.report.evaluation import survey_entry

        return survey_entry(structures)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> "tuple[Drawing, ...]":
        from savmap_shelves.report.evaluation import draw

        return draw(structures, survey, deviations)

    @hookimpl
    def exporters(self) -> "Mapping[str, Exporter]":
        def write_csv(site: "SiteMap", path: Path) -> None:
            from savmap_shelves.report.slot_files import write_csv

            write_csv(site, path, self.name)

        def write_json(site: "SiteMap", path: Path) -> None:
            from savmap_shelves.report.slot_files import write_json

            write_json(site, path, self.name)

        def write_all(site: "SiteMap", path: Path) -> None:
            from savmap_shelves.report.slot_files import write_elements

            write_elements(site, path, self.name)

        return {"elements-csv": write_all, "slots-csv": write_csv, "slots-json": write_json}
