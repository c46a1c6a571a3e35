"""The door for plugins, and the one place that their authors import from: docs/writing-plugins.md says what each name
is for.

A name is looked up when it is first used, so that `savmap --help` does not import the factor graph.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from savmap.errors import PluginError as PluginError
    from savmap.errors import SavmapError as SavmapError
    from savmap.errors import SolveError as SolveError
    from savmap.errors import StructureError as StructureError
    from savmap.files.validation import ClassNames as ClassNames
    from savmap.files.validation import checked as checked
    from savmap.geometry.pinhole import angles_from_rotation as angles_from_rotation
    from savmap.geometry.pinhole import project as project
    from savmap.graph import Constraints as Constraints
    from savmap.graph import KeySpace as KeySpace
    from savmap.graph import Landmark as Landmark
    from savmap.graph import Relation as Relation
    from savmap.graph import Solution as Solution
    from savmap.graph import equal_coordinate as equal_coordinate
    from savmap.graph import fixed_coordinate as fixed_coordinate
    from savmap.graph import flat as flat
    from savmap.graph import frame_key as frame_key
    from savmap.graph import graph_of as graph_of
    from savmap.graph import image_measurements as image_measurements
    from savmap.graph import known_coordinate as known_coordinate
    from savmap.graph import known_distance as known_distance
    from savmap.graph import known_length as known_length
    from savmap.graph import rectangle as rectangle
    from savmap.graph import sight_lines as sight_lines
    from savmap.plugin.contract import check_plugin as check_plugin
    from savmap.plugin.hookspecs import Exporter as Exporter
    from savmap.plugin.hookspecs import hookimpl as hookimpl
    from savmap.plugin.inspection import InspectionLimits as InspectionLimits
    from savmap.plugin.inspection import Limit as Limit
    from savmap.plugin.points.sightings import Sightings as Sightings
    from savmap.plugin.points.sightings import frames_showing as frames_showing
    from savmap.plugin.points.sightings import gathering_level as gathering_level
    from savmap.plugin.points.sightings import sightings as sightings
    from savmap.plugin.points.sightings import track_of as track_of
    from savmap.plugin.points.sightings import tracks_along_face as tracks_along_face
    from savmap.plugin.points.sightings import tracks_on_floor as tracks_on_floor
    from savmap.plugin.points.structures import draw_points as draw_points
    from savmap.plugin.points.structures import keys_by_object as keys_by_object
    from savmap.plugin.points.structures import point_constraints as point_constraints
    from savmap.plugin.points.structures import point_structures as point_structures
    from savmap.plugin.points.structures import score_points as score_points
    from savmap.plugin.points.structures import surveyed_points as surveyed_points
    from savmap.plugin.points.structures import with_sizes as with_sizes
    from savmap.plugin.points.views import count_view_plan as count_view_plan
    from savmap.plugin.points.views import face_view_plan as face_view_plan
    from savmap.plugin.points.views import point_feature as point_feature
    from savmap.plugin.points.views import touches_border as touches_border
    from savmap.plugin.points.views import upright_ends as upright_ends
    from savmap.plugin.protocol import KnownSize as KnownSize
    from savmap.plugin.protocol import Plugin as Plugin
    from savmap.plugin.protocol import PluginSettings as PluginSettings
    from savmap.types import Attribute as Attribute
    from savmap.types import Axis as Axis
    from savmap.types import Bools as Bools
    from savmap.types import CloseUp as CloseUp
    from savmap.types import CrossRowLandmark as CrossRowLandmark
    from savmap.types import Detection as Detection
    from savmap.types import Distances as Distances
    from savmap.types import Drawing as Drawing
    from savmap.types import FaceDepths as FaceDepths
    from savmap.types import Feature as Feature
    from savmap.types import Finding as Finding
    from savmap.types import FindingTable as FindingTable
    from savmap.types import FlatParts as FlatParts
    from savmap.types import Floats as Floats
    from savmap.types import FoundObject as FoundObject
    from savmap.types import FrameTable as FrameTable
    from savmap.types import Ints as Ints
    from savmap.types import JointCovariance as JointCovariance
    from savmap.types import MapWarning as MapWarning
    from savmap.types import Measured as Measured
    from savmap.types import Panorama as Panorama
    from savmap.types import PlaneEvidence as PlaneEvidence
    from savmap.types import PlanePatch as PlanePatch
    from savmap.types import RowFacts as RowFacts
    from savmap.types import RowInspection as RowInspection
    from savmap.types import Score as Score
    from savmap.types import SiteMap as SiteMap
    from savmap.types import Solid as Solid
    from savmap.types import Structure as Structure
    from savmap.types import SurveyEntry as SurveyEntry
    from savmap.types import Thresholds as Thresholds
    from savmap.types import Track as Track
    from savmap.types import Trajectory as Trajectory
    from savmap.types import View as View
    from savmap.types import ViewPlan as ViewPlan
    from savmap.types import ViewSpec as ViewSpec
    from savmap.vision.view_planning import DOWNWARDS as DOWNWARDS
    from savmap.vision.view_planning import LEVEL as LEVEL
    from savmap.vision.view_planning import UPWARDS as UPWARDS
    from savmap.vision.view_planning import Face as Face
    from savmap.vision.view_planning import Manual as Manual
    from savmap.vision.view_planning import PassPreview as PassPreview
    from savmap.vision.view_planning import ceiling_view as ceiling_view
    from savmap.vision.view_planning import choose_face as choose_face
    from savmap.vision.view_planning import face_at as face_at
    from savmap.vision.view_planning import fit_count as fit_count
    from savmap.vision.view_planning import fit_height as fit_height
    from savmap.vision.view_planning import floor_view as floor_view
    from savmap.vision.view_planning import tilted as tilted

_NAMES = {
    "savmap.errors": "PluginError SavmapError SolveError StructureError",
    "savmap.files.validation": "ClassNames checked",
    "savmap.geometry.pinhole": "angles_from_rotation project",
    "savmap.graph": (
        "Constraints KeySpace Landmark Relation Solution flat frame_key graph_of known_distance known_length "
        "equal_coordinate fixed_coordinate image_measurements known_coordinate rectangle sight_lines"
    ),
    "savmap.plugin.contract": "check_plugin",
    "savmap.plugin.hookspecs": "Exporter hookimpl",
    "savmap.plugin.inspection": "InspectionLimits Limit",
    "savmap.plugin.points.sightings": (
        "Sightings frames_showing gathering_level sightings track_of tracks_along_face tracks_on_floor"
    ),
    "savmap.plugin.points.structures": (
        "draw_points keys_by_object point_constraints point_structures score_points surveyed_points with_sizes"
    ),
    "savmap.plugin.points.views": ("count_view_plan face_view_plan point_feature touches_border upright_ends"),
    "savmap.plugin.protocol": "KnownSize Plugin PluginSettings",
    "savmap.types": (
        "Attribute Axis Bools CloseUp CrossRowLandmark Detection Distances Drawing FaceDepths Feature Finding "
        "FindingTable FlatParts Floats FoundObject FrameTable Ints JointCovariance MapWarning Measured Panorama "
        "PlaneEvidence PlanePatch RowFacts RowInspection Score SiteMap Solid Structure SurveyEntry Thresholds Track "
        "Trajectory View ViewPlan ViewSpec"
    ),
    "savmap.vision.view_planning": (
        "DOWNWARDS LEVEL UPWARDS Face Manual PassPreview ceiling_view choose_face face_at fit_count fit_height "
        "floor_view tilted"
    ),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'savmap.plugin' has no attribute '{name}'")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted(_MODULES)
