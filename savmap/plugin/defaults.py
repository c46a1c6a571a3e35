"""The hooks that a plugin may leave out: these implementations are asked last."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from savmap.plugin.hookspecs import hookimpl
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Doubt,
    Expected,
    FlatParts,
    Floats,
    PlaneEvidence,
    PlanePatch,
    Structure,
    Thresholds,
    View,
)

if TYPE_CHECKING:
    from savmap.types import Drawing, Score, SurveyEntry
    from savmap.vision.networks.segmenter import Segmenter

MIN_PIXELS = 12


@hookimpl(trylast=True)
def detect(view: View, segmenter: "Segmenter", thresholds: Thresholds) -> list[Detection]:
    """Connected regions of the network's classes above the thresholds, instance by instance where it tells them
    apart."""
    return segmenter.detections(view.image, thresholds, MIN_PIXELS)


@hookimpl(trylast=True)
def planes(points: Mapping[str, Floats]) -> list[PlanePatch]:
    """None: the structure is not looked for in planes."""
    return []


@hookimpl(trylast=True)
def expect(points: Mapping[str, Floats], evidence: Sequence[PlaneEvidence], floor: float | None) -> list[Expected]:
    """What was tracked is right."""
    return []


@hookimpl(trylast=True)
def flat_parts(points: Mapping[str, Floats]) -> list[FlatParts]:
    """None: edges tell how deep the structure lies."""
    return []


@hookimpl(trylast=True)
def relate(structures: Sequence[Structure]) -> list[Structure]:
    """They stay as they are."""
    return list(structures)


@hookimpl(trylast=True)
def doubt(structures: Sequence[Structure]) -> list[Doubt]:
    """All is plausible."""
    return []


@hookimpl(trylast=True)
def openings(structures: Sequence[Structure]) -> list[Structure]:
    """No space between them matters."""
    return []


@hookimpl(trylast=True)
def places(structures: Sequence[Structure]) -> list[Structure]:
    """No place between them has a name."""
    return []


@hookimpl(trylast=True)
def cross_row_landmarks(structures: Sequence[Structure]) -> list[CrossRowLandmark]:
    """Other rows have none of them."""
    return []


@hookimpl(trylast=True)
def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> "Score":
    """Nothing is scored."""
    from savmap.types import Score

    return Score()


@hookimpl(trylast=True)
def survey_entry(structures: Sequence[Structure]) -> "SurveyEntry":
    """The plugin takes no survey from tables and drawings."""
    from savmap.types import SurveyEntry

    return SurveyEntry({}, {own.id: "its plugin reads no tables or drawings" for own in structures})


@hookimpl(trylast=True)
def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> "tuple[Drawing, ...]":
    """Nothing is drawn."""
    return ()
