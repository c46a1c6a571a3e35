"""Lamps above an aisle, as a plugin of savmap."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from savmap.errors import SolveError
from savmap.files.validation import ClassNames
from savmap.plugin.hookspecs import hookimpl
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Feature,
    Floats,
    RowFacts,
    Structure,
    Track,
    Trajectory,
    View,
    ViewPlan,
)


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
    """The ceiling is looked at in each so many of the frames used: lamps stay in sight for long. Default: two in a pass of 200
    frames, four from 400 on."""
    line: bool = False
    """Whether the lamps are on one line along the aisle, at one height."""


class Lights:
    """Strip and compact lamps of the line above the camera's path."""

    name = "lights"
    classes = ("light",)
    model = Path(__file__).parent / "model" / "lights.int8.onnx"
    Config = Settings
    furnishes = True
    scale_settings = ()
    after_pixels = ("line",)

    def __init__(self, config: Settings) -> None:
        self.config = config

    @hookimpl
    def render_views(
        self,
        pass_preview: Any,
        see: Callable[[View], list[Detection]],
        manual: Mapping[str, Any],
        attitude: Floats | None,
    ) -> ViewPlan:
        from savmap_lights.aim import aim_at_ceiling

        return aim_at_ceiling(pass_preview, see, manual, attitude, self.config.every)

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection]) -> list[Feature]:
        from savmap_lights.features import extract_features

        return extract_features(view, detections)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory | None) -> list[Track]:
        from savmap_lights.tracking import track_lamps

        if start is None:
            raise SolveError(
                f"row {facts.name}: lights alone do not locate the camera: "
                "add a plugin that maps the face (--plugins shelves,lights), or give an earlier map with --trajectory"
            )
        return track_lamps(features, facts, start)

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> Any:
        from savmap_lights.constraints import constrain

        return constrain(tracks, facts, start, self.name, self.config.line)

    @hookimpl
    def describe(self, tracks: Sequence[Track], solution: Any) -> list[Structure]:
        from savmap_lights.describe import describe

        return describe(tracks, solution, self.name)

    @hookimpl
    def shared(self, structures: Sequence[Structure]) -> list[CrossRowLandmark]:
        from savmap_lights.shared import shared

        return shared(structures)

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> Any:
        from savmap_lights.evaluate import evaluate

        return evaluate(structures, survey)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> Any:
        from savmap_lights.sketch import draw

        return draw(structures, survey, deviations)

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Any) -> Any:
        from savmap_lights.scene import scene

        return scene(section, rng, site)

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Any, drawn: Any) -> Any:
        from savmap_lights.scene import random_section

        return random_section(rng, site, drawn)
