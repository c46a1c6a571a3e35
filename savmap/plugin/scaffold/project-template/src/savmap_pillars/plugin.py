"""Pillars that stand on the floor in front of a face, as a plugin of savmap: every hook in a line."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

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


class Known(BaseModel):
    """A length that was measured, with its standard deviation, both in metres."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
    value: Annotated[float, Field(gt=0, lt=100)]
    """Metres."""
    sigma: Annotated[float, Field(gt=0, le=1)] = 0.005
    """Its standard deviation."""


class Settings(BaseModel):
    """Settings of the plugin in a site file."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
    model: Path | None = None
    """Another network's ONNX file."""
    class_names: ClassNames = {}
    """What the network's classes (their names, or numbers from 0) are called here, where its own names differ."""
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Confidence above which a pixel belongs to a pillar."""
    height_m: Known | None = None
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
        pass_preview: Any,
        see: Callable[[View], list[Detection]],
        side: Literal["left", "right"] | None,
        manual: Mapping[str, Any],
        attitude: Floats | None,
    ) -> ViewPlan:
        from savmap_pillars.looking import aim

        return aim(pass_preview, see, side, manual, attitude)

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection]) -> list[Feature]:
        from savmap_pillars.looking import features_of

        return features_of(view, detections)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory | None) -> list[Track]:
        from savmap_pillars.tracking import tracks_of

        if start is None:
            raise SolveError(
                f"row {facts.name}: pillars alone do not locate the camera: add a plugin that maps the face, "
                "or give an earlier map with --trajectory"
            )
        return tracks_of(features, facts, start)

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> Any:
        from savmap_pillars.mapping import constrain

        height = self.config.height_m
        known = (height.value, height.sigma) if height else None
        return constrain(tracks, facts, start, self.name, self.config.plumb_m, known)

    @hookimpl
    def describe(self, tracks: Sequence[Track], solution: Any) -> list[Structure]:
        from savmap_pillars.mapping import describe

        return describe(tracks, solution, self.name)

    @hookimpl
    def shared(self, structures: Sequence[Structure]) -> list[CrossRowLandmark]:
        from savmap_pillars.scoring import shared

        return shared(structures)

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> Any:
        from savmap_pillars.scoring import evaluate

        return evaluate(structures, survey)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> Any:
        from savmap_pillars.scoring import draw

        return draw(structures, survey, deviations)

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Any) -> Any:
        from savmap_pillars.scene import scene

        return scene(section, rng, site)

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Any, drawn: Any) -> Any:
        from savmap_pillars.scene import random_section

        return random_section(rng, site, drawn)
