"""Lamps above an aisle, as a plugin of savmap."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

import savmap.plugin as door
from savmap.plugin import Detection, Feature, Floats, RowFacts, Structure, Track, Trajectory, View, hookimpl
from savmap_lights.features import extract_features
from savmap_lights.open_ends import LIGHT_BESIDE, is_whole, with_open_ends, with_remarks, with_solids, without_inner_end
from savmap_lights.scores import centre_of, score_lamps
from savmap_lights.space.ties import ties
from savmap_lights.tracking import track_lamps

LOST_M = 1.0  # a lamp whose place is not known better is left out
OFF_M = 0.05  # drawn as wrong beyond this
Point = tuple[float, float, float]


class Settings(door.PluginSettings):
    """Settings of the plugin in a site file."""

    every: Annotated[int, Field(gt=0)] = 1
    """The ceiling is looked at in every n-th key frame."""
    line: bool = False
    """Whether the lamps are on one line along the aisle, at one height. Otherwise that is tested, and used where it
    holds."""


class SurveyedLamp(BaseModel):
    """The two ends of a lamp's long axis; they coincide for a compact lamp."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    ends: tuple[Point, Point]


class SurveyedRow(BaseModel):
    """Lamps, and the uprights' x, of which the outermost are the row's ends. Other plugins' keys are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    lights: list[SurveyedLamp]
    uprights: list[tuple[float, float]] = Field(default_factory=list)

    def ends(self) -> Floats:
        """The lamps' ends (n, 2, 3)."""
        return np.array([lamp.ends for lamp in self.lights], dtype=np.float64).reshape(-1, 2, 3)

    def ends_x(self) -> tuple[float, float]:
        """x of the row's ends; without uprights the row has no end."""
        if not self.uprights:
            return float("-inf"), float("inf")
        return min(min(x) for x in self.uprights), max(max(x) for x in self.uprights)


def read_row(entry: Mapping[str, Any]) -> SurveyedRow:
    """The lamps of a row's entry. Raises OutputError."""
    return door.checked(SurveyedRow, entry, "survey")


def _not_known(lamp: Structure) -> door.MapWarning:
    x, y, z = centre_of(lamp)[0].tolist()
    return door.MapWarning("inaccurate-element", (lamp.id,), str(lamp.attributes["ends"]), (x, y, z))


class Lights:
    """Strip and compact lamps of the line above the camera's path: two ends, or a centre."""

    name = "lights"
    classes = ("light",)
    ifc_classes: ClassVar = {"IfcLightFixture": "light"}
    model = Path(__file__).parent / "model" / "lights.int8.onnx"
    Config = Settings
    reference_names = tuple(f"light # / {part}" for part in ("centre", "end #", "glimpse", "middle", "side"))
    scale_settings = ()
    after_pixels = ("line",)
    needs_path = True
    in_every_frame = True

    def __init__(self, config: Settings) -> None:
        self.config = config

    @hookimpl
    def render_views(
        self,
        pass_preview: door.PassPreview,
        predict: Callable[[View], list[Detection]],
        manual: Mapping[str, door.Manual],
        attitude: Floats | None,
    ) -> door.ViewPlan:
        """Straight up, as narrow as shows two lamps. Paper, section III.B."""
        return door.count_view_plan(
            pass_preview, predict, manual, attitude, "ceiling", door.UPWARDS, every=self.config.every
        )

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection]) -> list[Feature]:
        """Centres and ends of lamps."""
        return extract_features(view, detections)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
        """The lamps of the line nearest above the camera's path."""
        return track_lamps(features, facts, start)

    @hookimpl
    def constrain(
        self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory, keys: door.KeySpace
    ) -> door.Constraints:
        """Points that share y and z with `line`, or as far as that is so. Paper, last paragraph of section III.E."""
        relations = ties(tracks, door.keys_by_object(tracks, keys), facts, start, self.config.line)
        return door.point_constraints(tracks, facts, start, keys, relations)

    @hookimpl
    def describe(self, tracks: Sequence[Track], landmarks: Mapping[str, door.Landmark]) -> list[Structure]:
        """A structure "light 1" for each lamp, with the vertices "end 0" and "end 1", or "centre". Of a strip with one
        end in sight, the other is as far as it was seen, and not known along x. The space that a lamp fills has an
        assumed width and height."""
        lamps = with_open_ends(door.point_structures(tracks, landmarks, LOST_M), tracks)
        return with_remarks(with_solids(lamps), tracks)

    @hookimpl
    def warnings(self, structures: Sequence[Structure]) -> list[door.MapWarning]:
        """What shines on the lamps' line, is none of them, and was seen as often as they were; and lamps of which an
        end was not seen that others lie beyond."""
        lights = [
            (float(lamp.attributes[LIGHT_BESIDE]), lamp) for lamp in structures if LIGHT_BESIDE in lamp.attributes
        ]
        places = [(x, *centre_of(lamp)[0, 1:].tolist()) for x, lamp in lights]
        shining = [door.MapWarning("incomplete-map", (self.name,), f"light at x {at[0]:.2f} m", at) for at in places]
        return [*shining, *map(_not_known, without_inner_end(structures))]

    @hookimpl
    def cross_row_landmarks(self, structures: Sequence[Structure]) -> list[door.CrossRowLandmark]:
        """Every lamp's centre, which the row across the aisle sees too; its vertices' errors are taken for common to
        all of them."""
        return [
            door.CrossRowLandmark(lamp.id, lamp.label, centre_of(lamp)[0], np.asarray(lamp.covariances.mean(axis=0)))
            for lamp in structures
            if is_whole(lamp)
        ]

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> door.Score:
        """The distances between centres and between ends of lamps of the line that is mapped, between the row's ends.
        Raises OutputError where the survey's are malformed."""
        if "lights" not in survey:
            return door.Score()
        surveyed = read_row(survey)
        return score_lamps(structures, surveyed.ends(), surveyed.ends_x())

    @hookimpl
    def survey_entry(self, structures: Sequence[Structure]) -> door.SurveyEntry:
        """The lamps' ends."""
        from savmap_lights.scores import survey_entry

        return survey_entry(structures)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> tuple[door.Drawing, ...]:
        """Strips as lines, compact lamps as points."""
        ends = read_row(survey).ends() if survey and "lights" in survey else None
        return door.draw_points(structures, ends, deviations, OFF_M, "lamps")
