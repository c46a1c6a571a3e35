"""Pillars in a row that make up a face, as a plugin of savmap: it finds the face and locates the camera by itself."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

import savmap.plugin as door
from savmap.plugin import Detection, Feature, Floats, RowFacts, Structure, Track, Trajectory, View, hookimpl

SIGMA_PX = 1.0  # how far an end of a mask is off
FLAT_M = 0.02  # how far feet are off the floor, and fronts off the face
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
        """The view that shows most of pillars, from foot to top: that way is the face. The plan says how the rig stands
        to it."""
        return door.face_view_plan(pass_preview, predict, side, manual, attitude, self.name, finds_face=True)

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
    def track(
        self, features: Sequence[Feature], facts: RowFacts, attitudes: Floats, start: Trajectory | None
    ) -> list[Track]:
        """The same pillar is at the same place along the face. The path is not known (unless an earlier map gives it):
        it is estimated in units of the camera's distance, from the steps that all pillars make from frame to frame."""
        return door.tracks_along_face(features, facts, attitudes, anchor="foot")

    @hookimpl
    def constrain(
        self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory, keys: door.KeySpace
    ) -> door.Constraints:
        """A top stands over its foot, and as high above it as is known, if it is. Feet are on the floor, y = 0, and all
        fronts in the face, z = 0; the first foot is at x = 0. Without these the map would have no place; its scale
        comes from references."""
        objects = door.keys_by_object(tracks, keys)
        relations = [door.fixed_coordinate("x", next(iter(objects.values()))["foot"])]
        for label, ends in objects.items():
            relations += [
                door.fixed_coordinate("y", ends["foot"], 0.0, FLAT_M),
                door.fixed_coordinate("z", ends["foot"], 0.0, FLAT_M),
            ]
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
