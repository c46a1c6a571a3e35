"""The hooks: the one door through which every structure type, ours and a stranger's, enters savmap.

`savmap.plugin.protocol` says what a plugin's class declares. Every hook but the last is asked of one plugin at a time.
A plugin must write those in `REQUIRED`; the others have defaults. docs/hooks.md shows each with an example.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pluggy
from numpy.typing import NDArray
from pydantic import BaseModel

from savmap.types import (
    CrossRowLandmark,
    Detection,
    FaceDepths,
    Feature,
    FlatParts,
    Floats,
    FoundObject,
    JointCovariance,
    MapWarning,
    Panorama,
    PlaneEvidence,
    PlanePatch,
    RowFacts,
    RowInspection,
    SiteMap,
    Structure,
    Thresholds,
    Track,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)

if TYPE_CHECKING:
    from savmap.graph import Constraints, KeySpace, Landmark, Solution
    from savmap.types import Drawing, Score, SurveyEntry
    from savmap.vision.networks.segmenter import Segmenter
    from savmap.vision.view_planning import Manual, PassPreview

Exporter = Callable[[SiteMap, Path], None]
hookspec = pluggy.HookspecMarker("savmap")
hookimpl = pluggy.HookimplMarker("savmap")
REQUIRED = ("render_views", "extract_features", "track", "constrain", "describe")


@hookspec(firstresult=True)
def render_views(
    pass_preview: "PassPreview",
    predict: Callable[[View], list[Detection]],
    side: Literal["left", "right"] | None,
    manual: Mapping[str, "Manual"],
    attitude: Floats | None,
) -> ViewPlan:
    """View rendering: which views of one pass are cut for this plugin.

    `pass_preview` has key frames of the pass, `predict` runs the plugin's network on a view, `side` is the hand that
    the site file says the face is on, `manual` its hand-aimed views by name (they win), and `attitude` world_from_rig
    (3, 3) of the first key frame if an earlier plugin or map knows it.
    """


@hookspec(firstresult=True)
def detect(view: View, segmenter: "Segmenter", threshold: float, thresholds: Thresholds) -> list[Detection]:
    """Detection: what the network gives for a view. Default: connected regions of each of the plugin's classes.

    `threshold` is the first of `thresholds`, for plugins to which a pixel counts by itself.
    """


@hookspec(firstresult=True)
def extract_features(view: View, detections: Sequence[Detection], panorama: Panorama | None) -> list[Feature]:
    """Feature extraction: points and edges with their covariance, in pixels of the view.

    `panorama` is the one that the view was cut from, for measuring at full resolution; None while views are chosen.
    """


@hookspec(firstresult=True)
def track(features: Sequence[Feature], facts: RowFacts, attitudes: Floats, start: Trajectory | None) -> list[Track]:
    """Tracking: which features of which frames are one physical point.

    `attitudes` (n, 3, 3): world_from_rig; `start`: first poses, where an earlier plugin or map gave them (never None
    for a plugin that declares `needs_path`). Raises StructureError where there is nothing to map.
    """


@hookspec(firstresult=True)
def find(
    gather: Callable[[PlanePatch], PlaneEvidence],
    path: Trajectory,
    points: Mapping[str, Floats],
    facts: RowFacts,
    floor: float | None,
) -> list[FoundObject]:
    """Evidence: the objects that all frames together show, each with the probability that it exists.

    `gather` gives what the frames show of a plane; `path`: the camera's, up to scale; `points`: positions (3,) of the
    plugin's landmarks by name, as solved in an earlier round, none in the first; `floor`: its y before the first
    upright plane, where the pictures told it. `measure` is then asked of every frame, in place of `extract_features`.
    Raises StructureError where nothing is found. Default: none; `track` gets what single frames show."""


@hookspec(firstresult=True)
def measure(
    objects: Sequence[FoundObject],
    spec: ViewSpec,
    frame: int,
    world_from_rig: Floats,
    scores: NDArray[np.float32],
    panorama: Panorama,
) -> list[Feature]:
    """Measuring of what was found, in a view of a frame whose pose is known: features that name their object.

    `world_from_rig` (4, 4) is in the frame and the unit of the objects; `scores` (classes, h, w): what the network gave
    for the view, at half of its size; `panorama`: the part that the views show, in grey. Required of plugins that
    `find`."""


@hookspec(firstresult=True)
def planes(points: Mapping[str, Floats]) -> list[PlanePatch]:
    """The planes that the structure lies in, by the positions (3,) of the plugin's landmarks, by name: the first is the
    face of the orthophoto, and the floor is looked for before it. Default: none."""


@hookspec(firstresult=True)
def flat_parts(points: Mapping[str, Floats]) -> list[FlatParts]:
    """Depth: flat parts of the structure whose depth its edges hardly tell, but what shows on them may; `points`: first
    positions (3,) of the plugin's landmarks, by name. Asked of plugins that find the face. Default: none."""


@hookspec(firstresult=True)
def constrain(tracks: Sequence[Track], facts: RowFacts, start: Trajectory, keys: "KeySpace") -> "Constraints":
    """Constraint generation: first positions, pixels and relations of the plugin's landmarks, whose keys `keys` gives,
    and GTSAM factors of its own."""


@hookspec(firstresult=True)
def describe(
    tracks: Sequence[Track], facts: RowFacts, landmarks: "Mapping[str, Landmark]", solution: "Solution"
) -> list[Structure]:
    """Solution to structures: what goes into the map. `landmarks`: the plugin's own, by name."""


@hookspec(firstresult=True)
def relate(structures: Sequence[Structure], others: Mapping[str, Sequence[Structure]]) -> list[Structure]:
    """The plugin's structures of a row again, in the same order, with attributes that say how they stand to what other
    plugins mapped there (`others`, by plugin). Default: as they are."""


@hookspec(firstresult=True)
def warnings(structures: Sequence[Structure]) -> list[MapWarning]:
    """Trust: what the plugin itself knows to be wrong with a row's structures, beside what the engine tests. That a
    structure may not exist is its attribute `probability` (0..1), and no warning. A row with a warning is not `trusted`
    but to be checked by a person. Default: none."""


@hookspec(firstresult=True)
def openings(structures: Sequence[Structure]) -> list[Structure]:
    """Comparison of two dates: the spaces between a row's structures whose clear width and height matter, as structures
    of a label of their own. Default: none."""


@hookspec(firstresult=True)
def places(structures: Sequence[Structure], joint: JointCovariance | None) -> list[Structure]:
    """Search and viewer: the places of a row that have a name and are no structure, such as what lies between two of
    them, as structures with an id and a label of their own, and attributes that number them, or say how large they are
    (`Measured`). `joint`: what the errors of the structures' vertices share; None where that is not known. Default:
    none."""


@hookspec(firstresult=True)
def inspect(
    structures: Sequence[Structure],
    places: Mapping[str, Sequence[Structure]],
    joint: JointCovariance | None,
    limits: BaseModel,
    survey: Mapping[str, Any] | None,
    others: Mapping[str, Sequence[Structure]],
    depths: FaceDepths | None,
) -> RowInspection:
    """Inspection: what of a row's structures keeps the limits, and what does not.

    `places`: those of the row that have a name, by plugin; `joint`: what the errors of the structures' vertices share;
    `limits`: an object of the plugin's `Limits`; `survey`: the row's entry of a drawing or survey, where one is given,
    m; `others`: the plugin's structures of the other rows, each in its row's frame; `depths`: how deep behind the face
    lies what is seen there, where the run kept pictures of it. Default: nothing is inspected."""


@hookspec(firstresult=True)
def cross_row_landmarks(structures: Sequence[Structure]) -> list[CrossRowLandmark]:
    """Assembly of a site: which of a row's structures other rows may have mapped too, and along which axes both rows
    give the same position. Default: none."""


@hookspec(firstresult=True)
def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> "Score":
    """Structures against a surveyor's sheet of the row."""


@hookspec(firstresult=True)
def survey_entry(structures: Sequence[Structure]) -> "SurveyEntry":
    """Import of a survey: what somebody measured of a row, as the plugin's keys of the row's entry in a survey file,
    which `evaluate` reads.

    `structures`: elements of the plugin's classes in the row's frame, from a table, a drawing or a building model (the
    corners of a box): points in any order, whose labels may be empty. Default: nothing, the plugin takes no survey of
    that kind."""


@hookspec(firstresult=True)
def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> "tuple[Drawing, ...]":
    """How structures look in the face view and in the plan, over the survey where there is one.

    `deviations`: by structure id, how far it is off the survey, m.
    """


@hookspec(firstresult=True)
def exporters() -> Mapping[str, Exporter]:
    """Further map formats for `savmap export`: name to a function that writes a map to a path. Every plugin is asked.

    The path is a temporary one; what was written is put in its place when the function returns."""
