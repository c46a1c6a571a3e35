"""The records that flow through savmap. Frames and conventions: docs/conventions.md.

World frame of a row: metres; x along the aisle to the right as one faces the row, y up from the floor, z out of the face
towards the camera; the face is z = 0. Rig frame (panorama) and view frame: x right, y down, z forward. Pixel centres are
at integer coordinates.
"""

from savmap.types.common import Attribute, Axis, Floats, Ints, Measured, Place
from savmap.types.pictures import Detection, Feature, Flow, Panorama, View, ViewPlan, ViewSpec
from savmap.types.planes import FilmedPanorama, Planes, panorama_of
from savmap.types.rows import (
    CrossRowLandmark,
    FrameTable,
    Placement,
    ReferenceUse,
    RowFacts,
    RowMap,
    SiteMap,
    Structure,
    Tie,
    Track,
    Trajectory,
)

__all__ = [
    "Attribute",
    "Axis",
    "CrossRowLandmark",
    "Detection",
    "Feature",
    "FilmedPanorama",
    "Floats",
    "Flow",
    "FrameTable",
    "Ints",
    "Measured",
    "Panorama",
    "Place",
    "Placement",
    "Planes",
    "ReferenceUse",
    "RowFacts",
    "RowMap",
    "SiteMap",
    "Structure",
    "Tie",
    "Track",
    "Trajectory",
    "View",
    "ViewPlan",
    "ViewSpec",
    "panorama_of",
]
