"""Pillars that stand on the floor in front of a face, as a plugin of savmap."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

import savmap.plugin as door
from savmap.plugin import Detection, Feature, Floats, RowFacts, Structure, Track, Trajectory, View, hookimpl

SIGMA_PX = 1.0  # how far an end of a mask is off
SAME_M = 0.3  # feet nearer to one another along the row are of one pillar
LOST_M = 0.5  # a pillar whose place is not known better is left out
GATE_M = 0.5  # a pillar further from the surveyed one is another one
OFF_M = 0.05  # drawn as wrong beyond this
AXES: tuple[door.Axis, ...] = ("x", "z")


class Settings(door.PluginSettings):
    """Settings of the plugin in a site file."""

    height_m: door.KnownSize | None = None
    """How tall a pillar is, if all are alike and it is known."""
    plumb_m: Annotated[float, Field(gt=0, le=1)] = 0.02
    """How far a pillar's top may stand off its foot, along x and z: a standard deviation."""


class Pillars:
    """Foot and top of the front of every pillar."""

    name = "pillars"
    classes = ("pillar",)
    model = Path(__file__).parent / "model" / "pillars.onnx"
    Config = Settings
    needs_path = True
    after_pixels = ("height_m", "plumb_m")
    scale_settings = ("height_m",)

    def __init__(self, config: Settings) -> None:
        self.config = config

    @hookimpl
    def render_views(
        self,
        pass_preview: door.PassPreview,
        predict: Callable[[View], list[Detection]],
        side: Literal["left", "right"] | None,
        manual: Mapping[str, door.Manual],
        attitude: Floats | None,
    ) -> door.ViewPlan:
        """The view at the face that shows pillars from foot to top, as narrow as may be."""
        return door.face_view_plan(pass_preview, predict, side, manual, attitude, self.name)

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection]) -> list[Feature]:
        """The foot and the top of each pillar that the view does not cut."""
        return [
            door.point_feature(view, detection, instance, part, pixel, SIGMA_PX)
            for instance, detection in enumerate(detections)
            if not door.touches_border(detection.mask)
            for part, pixel in zip(("foot", "top"), door.upright_ends(detection.mask), strict=True)
        ]

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
        """The same pillar has its foot at the same place on the floor, in whatever frame it is seen."""
        return door.tracks_on_floor(features, facts, start, anchor="foot", same_m=SAME_M)

    @hookimpl
    def constrain(
        self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory, keys: door.KeySpace
    ) -> door.Constraints:
        """A top stands over its foot, and as high above it as is known, if it is."""
        relations: list[door.Relation] = []
        for label, ends in door.keys_by_object(tracks, keys).items():
            relations += [door.equal_coordinate(axis, ends["foot"], ends["top"], self.config.plumb_m) for axis in AXES]
            if (height := self.config.height_m) is not None:
                size = (height.value, height.sigma, f"height of {label}")
                relations.append(door.known_length("y", ends["foot"], ends["top"], *size))
        return door.point_constraints(tracks, facts, start, keys, relations)

    @hookimpl
    def describe(
        self, tracks: Sequence[Track], landmarks: Mapping[str, door.Landmark], solution: door.Solution
    ) -> list[Structure]:
        """Foot, top and height of each pillar."""
        structures = door.point_structures(tracks, landmarks, LOST_M)
        return door.with_sizes(structures, solution, self.name, {"height_m": ("foot", "top", "y")})

    @hookimpl
    def cross_row_landmarks(self, structures: Sequence[Structure]) -> list[door.CrossRowLandmark]:
        """The row across the aisle sees each foot at the same place."""
        return [
            door.CrossRowLandmark(each.id, each.label, each.vertices[0], each.covariances[0]) for each in structures
        ]

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> door.Score:
        """How far feet and tops are from the survey's: `pillars: [[foot, top], ...]`, each x, y, z in the row's frame,
        m."""
        return door.score_points(structures, door.surveyed_points(survey, self.name, 2), GATE_M, self.name)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> tuple[door.Drawing, ...]:
        """A line from foot to top, over the survey's."""
        truth = door.surveyed_points(survey or {}, self.name, 2)
        return door.draw_points(structures, truth, deviations, OFF_M, self.name)
