"""The records that flow through savmap. Frames and conventions: docs/conventions.md.

World frame of a row: metres; x along the aisle to the right as one faces the row, y up from the floor, z out of the
face towards the camera; the face is z = 0. Rig frame (panorama) and view frame: x right, y down, z forward. Pixel
centres are at integer coordinates.
"""

from savmap.types.common import Attribute, Axis, Bools, Floats, Ints, Measured, Place, array_record
from savmap.types.drawings import Drawing, Kind, Picture, Role, Tone
from savmap.types.evidence import Expected, FlatDepth, FlatParts, PlaneEvidence, PlanePatch
from savmap.types.maps import (
    Alignment,
    AlignmentResidual,
    CrossRowLandmark,
    CrossRowMatch,
    JointCovariance,
    Placement,
    ReferenceUse,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    assumed_axes,
)
from savmap.types.orthophotos import Orthophoto, RowStrips, Still, Strip
from savmap.types.pictures import Detection, Feature, Flow, Panorama, Thresholds, View, ViewPlan, ViewSpec
from savmap.types.planes import FilmedPanorama, Planes, panorama_of
from savmap.types.rows import FrameTable, RowFacts, Track, Trajectory
from savmap.types.scores import Distances, Evaluation, Score, Survey, SurveyEntry, pool
from savmap.types.verdicts import Doubt, Verdict

__all__ = [
    "Alignment",
    "AlignmentResidual",
    "Attribute",
    "Axis",
    "Bools",
    "CrossRowLandmark",
    "CrossRowMatch",
    "Detection",
    "Distances",
    "Doubt",
    "Drawing",
    "Evaluation",
    "Expected",
    "Feature",
    "FilmedPanorama",
    "FlatDepth",
    "FlatParts",
    "Floats",
    "Flow",
    "FrameTable",
    "Ints",
    "JointCovariance",
    "Kind",
    "Measured",
    "Orthophoto",
    "Panorama",
    "Picture",
    "Place",
    "Placement",
    "PlaneEvidence",
    "PlanePatch",
    "Planes",
    "ReferenceUse",
    "Role",
    "RowFacts",
    "RowMap",
    "RowStrips",
    "Score",
    "SiteMap",
    "Solid",
    "Still",
    "Strip",
    "Structure",
    "Survey",
    "SurveyEntry",
    "Thresholds",
    "Tone",
    "Track",
    "Trajectory",
    "Verdict",
    "View",
    "ViewPlan",
    "ViewSpec",
    "array_record",
    "assumed_axes",
    "panorama_of",
    "pool",
]
