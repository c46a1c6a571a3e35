"""Racks: uprights and beams of a shelf face, as a plugin of savmap."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from savmap.files.validation import ClassNames
from savmap.plugin.hookspecs import hookimpl
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Feature,
    Floats,
    Panorama,
    RowFacts,
    Structure,
    Track,
    Trajectory,
    View,
    ViewPlan,
)

Pitch = Annotated[float, Field(gt=0.3, lt=20)]
Height = Annotated[float, Field(gt=-1, lt=50)]


class LowestBeam(BaseModel):
    """Height of the bottom edge of the lowest beam (h_ref of the paper): one value, or one a section in order, metres. The values
    alone mean these with the usual sigma."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
    values: Height | tuple[Height, ...]
    """One value, or one a section, left to right."""
    sigma: Annotated[float, Field(gt=0, le=1)] = 0.002
    """Standard deviation of each."""

    @model_validator(mode="before")
    @classmethod
    def _values_alone(cls, given: Any) -> Any:
        return {"values": given} if isinstance(given, int | float | list | tuple) else given


class BayPitch(BaseModel):
    """Distance from an upright's edge to the same edge of the next: one value for all sections, or one a section, metres."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
    value: Pitch | tuple[Pitch, ...]
    """One value, or one a section, left to right."""
    sigma: Annotated[float, Field(gt=0, le=1)] = 0.003
    """Standard deviation of each."""


class Settings(BaseModel):
    """Settings of the plugin in a site file."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
    model: Path | None = None
    """Another network's ONNX file."""
    class_names: ClassNames = {}
    """What the network's classes (their names, or numbers from 0) are called here, where its own names differ."""
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Confidence above which a pixel belongs to a class."""
    every: Annotated[int, Field(gt=0)] | None = None
    """The face is looked at in each so many of the frames used. Default: two or four in a long pass so slow that things
    move by no more than 7.4 degrees between looks."""
    lowest_beam_bottom_height_m: LowestBeam | None = None
    """Height of the bottom edge of the lowest beam, in all sections or section by section, left to right."""
    bay_pitch_m: BayPitch | None = None
    """From an upright's edge to the same edge of the next."""
    beam_setback_m: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.005
    """How far the beams' faces stand behind the uprights'."""
    subpixel: bool = True
    """Whether edges are measured in the panorama itself; false leaves them as masks have them."""


class Shelves:
    """Uprights and beams of the face of a rack."""

    name = "shelves"
    classes = ("upright", "beam")
    model = Path(__file__).parent / "model" / "shelves.int8.onnx"
    Config = Settings
    scale_settings = ("bay_pitch_m", "lowest_beam_bottom_height_m")
    after_pixels = ("lowest_beam_bottom_height_m", "bay_pitch_m", "beam_setback_m")

    def __init__(self, config: Settings) -> None:
        self.config = config

    @hookimpl
    def render_views(
        self,
        pass_preview: Any,
        predict: Callable[[View], list[Detection]],
        side: Literal["left", "right"] | None,
        manual: Mapping[str, Any],
    ) -> ViewPlan:
        from savmap_shelves.aim import aim_at_face, apart

        aim = aim_at_face(
            pass_preview, predict, lambda view, seen: self.extract_features(view, seen, None), side, manual
        )
        every = self.config.every or apart(pass_preview, aim.views[0])
        return replace(aim, views=tuple(replace(view, every=every) for view in aim.views))

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection], panorama: Panorama | None) -> list[Feature]:
        from savmap_shelves.boundaries import extract_features

        return extract_features(view, detections, panorama=panorama if self.config.subpixel else None)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, attitudes: Floats) -> list[Track]:
        from savmap_shelves.tracking import track_structures

        return track_structures(features, facts, attitudes=attitudes)

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> Any:
        from savmap_shelves.bias import PICTURES
        from savmap_shelves.constraints import GridSettings, constrain

        known, pitch = self.config.lowest_beam_bottom_height_m, self.config.bay_pitch_m
        settings = GridSettings(
            lowest_beam_bottom_height_m=known.values if known else None,
            sigma_m=known.sigma if known else 0.002,
            beam_setback_m=self.config.beam_setback_m,
            bay_pitch_m=pitch.value if pitch else None,
            bay_pitch_sigma_m=pitch.sigma if pitch else 0.003,
            bias=PICTURES,
        )
        return constrain(tracks, facts, start, room=self.name, settings=settings)

    @hookimpl
    def describe(self, tracks: Sequence[Track], solution: Any) -> list[Structure]:
        from savmap_shelves.describe import describe

        return describe(tracks, solution, room=self.name)

    @hookimpl
    def cross_row_landmarks(self, structures: Sequence[Structure]) -> list[CrossRowLandmark]:
        from savmap_shelves.shared import shared

        return shared(structures)

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> Any:
        from savmap_shelves.evaluate import evaluate

        return evaluate(structures, survey)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> Any:
        from savmap_shelves.sketch import draw

        return draw(structures, survey, deviations)

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Any) -> Any:
        from savmap_shelves.scene import scene

        return scene(section, rng, site)
