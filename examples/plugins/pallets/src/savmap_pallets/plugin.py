"""Pallets on the floor before a rack, as a plugin of savmap: the door through which the engine comes in.

Each hook imports what it needs when it is called, so that a command that only asks for the settings stays quick.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from savmap.files.validation import ClassNames
from savmap.plugin.hookspecs import hookimpl
from savmap.types import Detection, Feature, Floats, RowFacts, SiteMap, Structure, Track, Trajectory, View, ViewPlan

Metres = Annotated[float, Field(gt=0.05, lt=5)]


class Settings(BaseModel):
    """Settings of the plugin in a site file."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
    model: Path | None = None
    """Another network's ONNX file."""
    class_names: ClassNames = {}
    """What the network's classes (their names, or numbers from 0) are called here, where its own names differ."""
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Confidence above which a pixel belongs to a pallet."""
    size_m: tuple[Metres, Metres, Metres] = (1.2, 0.8, 0.144)
    """Length, width and height of a pallet, m: a EUR pallet's."""
    hfov_deg: Annotated[float, Field(ge=60, le=130)] = 110.0
    """Horizontal field of view of the view of the floor."""
    every: Annotated[int, Field(gt=0)] = 1
    """The floor is looked at in each so many of the frames used."""


class Pallets:
    """Pallets that stand on the floor between the camera's path and the face, whichever way they are turned."""

    name = "pallets"
    classes = ("pallet",)
    model = Path(__file__).parent / "model" / "pallets.int8.onnx"
    Config = Settings
    scale_settings = ()
    after_pixels = ("size_m",)
    needs_path = True

    def __init__(self, config: Settings) -> None:
        self.config = config

    @property
    def size(self) -> Floats:
        """Length, height and width (3,), m: along a pallet's own x, y and z."""
        long, wide, high = self.config.size_m
        return np.array([long, high, wide])

    @hookimpl
    def render_views(self, pass_preview: Any, manual: Mapping[str, Any], attitude: Floats | None) -> ViewPlan:
        from savmap_pallets.aim import aim_at_floor

        return aim_at_floor(pass_preview, manual, attitude, self.config.hfov_deg, self.config.every)

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection]) -> list[Feature]:
        from savmap_pallets.features import extract_features

        return extract_features(view, detections)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
        from savmap_pallets.tracking import track_pallets

        return track_pallets(features, facts, start, self.size)

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> Any:
        from savmap_pallets.constraints import constrain

        return constrain(tracks, facts, start, self.size, self.name)

    @hookimpl
    def describe(self, tracks: Sequence[Track], solution: Any) -> list[Structure]:
        from savmap_pallets.describe import describe

        return describe(tracks, solution, self.size, self.name)

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> Any:
        from savmap_pallets.evaluate import evaluate

        return evaluate(structures, survey)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> Any:
        from savmap_pallets.sketch import draw

        return draw(structures, survey, deviations)

    @hookimpl
    def exporters(self) -> Mapping[str, Callable[[SiteMap, Path], None]]:
        from savmap_pallets.export import write_pallets

        return {"pallets": write_pallets}
