"""The records that flow through savmap. Frames and conventions: docs/conventions.md.

World frame of a row: metres; x along the aisle to the right as one faces the row, y up from the floor, z out of the
face towards the camera; the face is z = 0. Rig frame (panorama) and view frame: x right, y down, z forward. Pixel
centres are at integer coordinates.
"""

from savmap.types.common import Attribute as Attribute
from savmap.types.common import Axis as Axis
from savmap.types.common import Bools as Bools
from savmap.types.common import Floats as Floats
from savmap.types.common import Ints as Ints
from savmap.types.common import Measured as Measured
from savmap.types.common import Place as Place
from savmap.types.common import array_record as array_record
from savmap.types.drawings import Drawing as Drawing
from savmap.types.drawings import Kind as Kind
from savmap.types.drawings import Picture as Picture
from savmap.types.drawings import Role as Role
from savmap.types.drawings import Tone as Tone
from savmap.types.evidence import FlatDepth as FlatDepth
from savmap.types.evidence import FlatParts as FlatParts
from savmap.types.evidence import FoundObject as FoundObject
from savmap.types.evidence import PlaneEvidence as PlaneEvidence
from savmap.types.evidence import PlanePatch as PlanePatch
from savmap.types.inspection import AppliedLimit as AppliedLimit
from savmap.types.inspection import CloseUp as CloseUp
from savmap.types.inspection import Finding as Finding
from savmap.types.inspection import FindingTable as FindingTable
from savmap.types.inspection import Inspection as Inspection
from savmap.types.inspection import RowInspection as RowInspection
from savmap.types.inspection import graded as graded
from savmap.types.maps import Alignment as Alignment
from savmap.types.maps import AlignmentResidual as AlignmentResidual
from savmap.types.maps import CrossRowLandmark as CrossRowLandmark
from savmap.types.maps import CrossRowMatch as CrossRowMatch
from savmap.types.maps import JointCovariance as JointCovariance
from savmap.types.maps import Placement as Placement
from savmap.types.maps import ReferenceUse as ReferenceUse
from savmap.types.maps import RowMap as RowMap
from savmap.types.maps import SiteMap as SiteMap
from savmap.types.maps import Solid as Solid
from savmap.types.maps import Structure as Structure
from savmap.types.maps import assumed_axes as assumed_axes
from savmap.types.orthophotos import FaceDepths as FaceDepths
from savmap.types.orthophotos import Orthophoto as Orthophoto
from savmap.types.orthophotos import RowStrips as RowStrips
from savmap.types.orthophotos import Still as Still
from savmap.types.orthophotos import Strip as Strip
from savmap.types.pictures import Detection as Detection
from savmap.types.pictures import Feature as Feature
from savmap.types.pictures import Flow as Flow
from savmap.types.pictures import Panorama as Panorama
from savmap.types.pictures import Thresholds as Thresholds
from savmap.types.pictures import View as View
from savmap.types.pictures import ViewPlan as ViewPlan
from savmap.types.pictures import ViewSpec as ViewSpec
from savmap.types.places import RowPlace as RowPlace
from savmap.types.planes import FilmedPanorama as FilmedPanorama
from savmap.types.planes import Planes as Planes
from savmap.types.planes import panorama_of as panorama_of
from savmap.types.rows import FrameTable as FrameTable
from savmap.types.rows import RowFacts as RowFacts
from savmap.types.rows import Track as Track
from savmap.types.rows import Trajectory as Trajectory
from savmap.types.scores import Distances as Distances
from savmap.types.scores import Evaluation as Evaluation
from savmap.types.scores import Score as Score
from savmap.types.scores import Survey as Survey
from savmap.types.scores import SurveyEntry as SurveyEntry
from savmap.types.scores import pool as pool
from savmap.types.verdicts import MapWarning as MapWarning
from savmap.types.verdicts import Verdict as Verdict
