"""Signs on racks and over the aisle, with what is written on them, as a plugin of savmap.

Hooks import their stage when they are called, so that a command that only asks for the plugin's name or settings starts
fast.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from savmap.geometry.pinhole import angles_from_rotation, rig_from_view
from savmap.plugin.hookspecs import hookimpl
from savmap.types import (
    Detection,
    Drawing,
    Feature,
    Floats,
    Panorama,
    RowFacts,
    RowInspection,
    Score,
    Structure,
    SurveyEntry,
    Track,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)
from savmap_signs.settings import Settings, SignsLimits

if TYPE_CHECKING:
    from savmap.graph import Constraints, Solution
    from savmap.vision.view_planning import Manual, PassPreview

HFOV_DEG = 90.0
FACE_VIEWS_DEG = {"signs upper": (0.0, 25.0), "signs lower": (0.0, -25.0)}
AISLE_VIEWS_DEG = {"signs ahead": (90.0, 25.0), "signs behind": (-90.0, 25.0)}
"""Yaw to the right of straight at the face, and pitch upwards, of views by name. The cart's motion brings every sign of
a face before a view; the views must cover the face's height, and have pixels enough for small signs."""


class Signs:
    """Flat signs: bay signs, aisle signs, rack labels; their four corners, their text and their codes."""

    name = "signs"
    needs_path = True
    classes = ("sign",)
    ifc_classes: ClassVar = {"IfcSign": "sign"}
    model = Path(__file__).parent / "model" / "signs.int8.onnx"
    Config = Settings
    Limits = SignsLimits
    libraries = ("rapidocr", "zxing-cpp")
    reference_names = tuple(f"sign # / {height} {side}" for height in ("upper", "lower") for side in ("left", "right"))
    scale_settings = ("sizes_m",)
    after_pixels = ("pattern", "least_confidence", "shape", "shape_sigma_m", "sizes_m", "size_sigma_m", "parallel")

    def __init__(self, config: Settings) -> None:
        self.config = config

    @hookimpl
    def render_views(
        self, pass_preview: "PassPreview", manual: "Mapping[str, Manual]", attitude: Floats | None
    ) -> ViewPlan:
        """The upper and the lower half of the face, and along the aisle both ways, where signs hang across it."""
        from savmap.vision.view_planning import LEVEL
        from savmap_signs.reading import missing_packages_note

        rig_from_world = attitude.T if attitude is not None else pass_preview.rig_from_manhattan
        directions = FACE_VIEWS_DEG | (AISLE_VIEWS_DEG if self.config.along else {})
        turns = {name: rig_from_view(yaw, pitch, 0.0) for name, (yaw, pitch) in directions.items()}
        specs = [
            ViewSpec(
                name, *angles_from_rotation(rig_from_world @ LEVEL @ turn), hfov_deg=HFOV_DEG, every=self.config.every
            )
            for name, turn in turns.items()
        ]
        note = missing_packages_note() if self.config.read else None
        return ViewPlan(
            tuple(manual[spec.name].over(spec) if spec.name in manual else spec for spec in specs),
            notes=(note,) if note else (),
        )

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection], panorama: Panorama | None) -> list[Feature]:
        from savmap_signs.features import extract_features
        from savmap_signs.reading import read

        reads = self.config.read and (view.frame // view.spec.every) % self.config.read_every == 0
        return extract_features(view, detections, panorama, read if reads else None)

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
        from savmap_signs.tracking import track_signs

        return track_signs(features, facts, start, self.config)

    @hookimpl
    def constrain(self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory) -> "Constraints":
        from savmap_signs.mapping import constrain

        return constrain(tracks, facts, start, self.name, self.config)

    @hookimpl
    def describe(self, tracks: Sequence[Track], solution: "Solution") -> list[Structure]:
        from savmap_signs.mapping import describe

        return describe(tracks, solution, self.name)

    @hookimpl
    def relate(self, structures: Sequence[Structure], others: Mapping[str, Sequence[Structure]]) -> list[Structure]:
        from savmap_signs.mapping import with_bays

        return with_bays(structures, others)

    @hookimpl
    def inspect(
        self,
        structures: Sequence[Structure],
        places: Mapping[str, Sequence[Structure]],
        limits: SignsLimits,
        others: Mapping[str, Sequence[Structure]],
    ) -> RowInspection:
        from savmap_signs.labels import audit

        return audit(structures, [place for group in places.values() for place in group], limits, others)

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
        from savmap_signs.evaluation import evaluate

        return evaluate(structures, survey)

    @hookimpl
    def survey_entry(self, structures: Sequence[Structure]) -> SurveyEntry:
        from savmap_signs.evaluation import survey_entry

        return survey_entry(structures)

    @hookimpl
    def draw(
        self, structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
    ) -> tuple[Drawing, ...]:
        from savmap_signs.evaluation import draw

        return draw(structures, survey, deviations)
