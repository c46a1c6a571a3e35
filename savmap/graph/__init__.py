"""The factor graph: constraints, references, solve, covariance. The only package that imports gtsam."""

from savmap.graph.appearance import motion_constraints
from savmap.graph.calibration import Calibration, Shutter, Stitching
from savmap.graph.constraints import TIGHT_M, Constraints, Relation, known_distance, known_length, pin, reference, tie
from savmap.graph.keys import KeySpace, frame_key
from savmap.graph.markers import marker_constraints
from savmap.graph.observations import Biases, Observations, observe
from savmap.graph.optimise import PUBLISHED, SolveOptions, located, solve
from savmap.graph.problem import Problem, merge
from savmap.graph.references import CameraHeight, Frames, KnownLength, KnownMarker, References, SurveyedPoint, gauge
from savmap.graph.shapes import flat, graph_of, rectangle
from savmap.graph.sight_lines import sight_lines
from savmap.graph.solution import Landmark, Rejected, Solution
from savmap.graph.start import published_start
from savmap.graph.together import solve_rows

__all__ = [
    "PUBLISHED",
    "TIGHT_M",
    "Biases",
    "Calibration",
    "CameraHeight",
    "Constraints",
    "Frames",
    "KeySpace",
    "KnownLength",
    "KnownMarker",
    "Landmark",
    "Observations",
    "Problem",
    "References",
    "Rejected",
    "Relation",
    "Shutter",
    "Solution",
    "SolveOptions",
    "Stitching",
    "SurveyedPoint",
    "flat",
    "frame_key",
    "gauge",
    "graph_of",
    "known_distance",
    "known_length",
    "located",
    "marker_constraints",
    "merge",
    "motion_constraints",
    "observe",
    "pin",
    "published_start",
    "rectangle",
    "reference",
    "sight_lines",
    "solve",
    "solve_rows",
    "tie",
]
