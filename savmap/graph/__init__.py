"""The factor graph: constraints, references, solve, covariance. The only package that imports gtsam."""

from savmap.graph.calibration import Calibration
from savmap.graph.constraints import (
    TIGHT_M,
    Constraints,
    Relation,
    equal_coordinate,
    fixed_coordinate,
    known_coordinate,
    known_distance,
    known_length,
)
from savmap.graph.factors.appearance import motion_constraints
from savmap.graph.factors.checks import check_jacobians, require_valid_constraints
from savmap.graph.factors.scene import (
    MeasuredDepth,
    floor_constraints,
    marker_constraints,
    measured_depths,
    with_depths,
    without_presumed,
)
from savmap.graph.factors.shapes import flat, graph_of, rectangle
from savmap.graph.initial.gaps import where_tracks_miss_frames
from savmap.graph.initial.start import published_start
from savmap.graph.joint import solve_rows
from savmap.graph.keys import KeySpace, frame_key
from savmap.graph.measurements import Biases, ImageMeasurements, image_measurements, sight_lines
from savmap.graph.problem import Problem, found_references, merge
from savmap.graph.references import (
    CameraHeight,
    CameraPriors,
    KnownLength,
    KnownMarker,
    References,
    SurveyedPoint,
    camera_priors,
)
from savmap.graph.solver.optimise import LocatedCamera, SolveOptions, locate_camera, solve
from savmap.graph.solver.solution import Landmark, Solution
from savmap.types.calibration import LensDistance, Shutter, Stitching, VerticalScale

__all__ = [
    "TIGHT_M",
    "Biases",
    "Calibration",
    "CameraHeight",
    "CameraPriors",
    "Constraints",
    "ImageMeasurements",
    "KeySpace",
    "KnownLength",
    "KnownMarker",
    "Landmark",
    "LensDistance",
    "LocatedCamera",
    "MeasuredDepth",
    "Problem",
    "References",
    "Relation",
    "Shutter",
    "Solution",
    "SolveOptions",
    "Stitching",
    "SurveyedPoint",
    "VerticalScale",
    "camera_priors",
    "check_jacobians",
    "equal_coordinate",
    "fixed_coordinate",
    "flat",
    "floor_constraints",
    "found_references",
    "frame_key",
    "graph_of",
    "image_measurements",
    "known_coordinate",
    "known_distance",
    "known_length",
    "locate_camera",
    "marker_constraints",
    "measured_depths",
    "merge",
    "motion_constraints",
    "published_start",
    "rectangle",
    "require_valid_constraints",
    "sight_lines",
    "solve",
    "solve_rows",
    "where_tracks_miss_frames",
    "with_depths",
    "without_presumed",
]
