"""Signs on racks and over the aisle, with what is written on them, as a plugin of savmap."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import SolveError
from savmap.plugin.hookspecs import hookimpl
from savmap.types import Detection, Feature, Floats, Panorama, RowFacts, Structure, Track, Trajectory, View, ViewPlan
from savmap_signs.settings import Settings


class Signs:
    """Flat signs: bay signs, aisle signs, rack labels; their four corners, their text and their codes."""

    name = "signs"
    classes = ("sign",)
    model = Path(__file__).parent / "model" / "signs.int8.onnx"
    Config = Settings
    libraries = ("rapidocr", "zxing-cpp")
    scale_settings = ("sizes_m",)
    after_pixels = ("pattern", "least_confidence", "shape", "shape_sigma_m", "sizes_m", "size_sigma_m", "parallel")

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
        from savmap_signs.aim import aim_at_signs

        return aim_at_signs(pass_preview, manual, attitude, self.config)

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection], panorama: Panorama | None) -> list[Feature]:
        from savmap_signs.features import extract_features

        return extract_features(view, detections, panorama, self.config.read, self.config.read_every)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory | None) -> list[Track]:
        from savmap_signs.tracking import track_signs

        if start is None:
            raise SolveError(
                f"row {facts.name}: signs alone do not locate the camera: "
                "add a plugin that maps the face (--plugins shelves,signs), or give an earlier map with --trajectory"
            )
        return track_signs(features, facts, start, self.config)

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> Any:
        from savmap_signs.constraints import constrain

        return constrain(tracks, facts, start, self.name, self.config)

    @hookimpl
    def describe(self, tracks: Sequence[Track], solution: Any) -> list[Structure]:
        from savmap_signs.describe import describe

        return describe(tracks, solution, self.name)

    @hookimpl
    def relate(self, structures: Sequence[Structure], others: Mapping[str, Sequence[Structure]]) -> list[Structure]:
        from savmap_signs.bays import with_bays

        return with_bays(structures, others)

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> Any:
        from savmap_signs.evaluate import evaluate

        return evaluate(structures, survey)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> Any:
        from savmap_signs.sketch import draw

        return draw(structures, survey, deviations)

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Any) -> Any:
        from savmap_signs.scene import scene

        return scene(section, rng, site)

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Any, drawn: Any) -> Any:
        from savmap_signs.random_plates import random_section

        return random_section(rng, site, drawn)
