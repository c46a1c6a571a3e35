"""The records that flow through savmap. Frames and conventions: docs/conventions.md.

World frame of a row: metres; x along the aisle to the right as one faces the row, y up from the floor, z out of the face
towards the camera; the face is z = 0. Rig frame (panorama) and view frame: x right, y down, z forward. Pixel centres are
at integer coordinates.
"""

from savmap.types.common import Axis, Bools, Floats, Ints, Place
from savmap.types.pictures import Aim, Detection, Feature, Flow, Panorama, View, ViewSpec
from savmap.types.planes import FilmedPanorama, Planes, panorama_of
from savmap.types.rows import (
    FrameTable,
    Placement,
    ReferenceUse,
    RowFacts,
    RowMap,
    SharedThing,
    SiteMap,
    Structure,
    Tie,
    Track,
    Trajectory,
)

__all__ = [
    "Aim",
    "Axis",
    "Bools",
    "Detection",
    "Feature",
    "FilmedPanorama",
    "Floats",
    "Flow",
    "FrameTable",
    "Ints",
    "Panorama",
    "Place",
    "Placement",
    "Planes",
    "ReferenceUse",
    "RowFacts",
    "RowMap",
    "SharedThing",
    "SiteMap",
    "Structure",
    "Tie",
    "Track",
    "Trajectory",
    "View",
    "ViewSpec",
    "panorama_of",
]
