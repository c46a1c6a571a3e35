"""Poses of the rows in a site: a graph whose variables are the rows' poses on the floor, as robots' maps are joined by
pose graphs (Lu and Milios 1997; Grisetti et al., "A tutorial on graph-based SLAM", 2010).

On the floor, a row's pose is a `Pose2` of x, -z and heading, so that headings count counter-clockwise from above.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import block_diag

from savmap.errors import SolveError
from savmap.types import Floats, Placement
from savmap.types.common import require

GRID = int(gtsam.symbol("g", 0))
HUBER = 1.345
OFF_GRID_RAD = float(np.radians(10))
QUARTER = np.pi / 2
TURNED = np.array([[0.0, -1.0], [1.0, 0.0]])
FLOOR = np.array([[1.0, 0, 0], [0, 0, -1]])


@dataclass(frozen=True)
class RelativePosePrior:
    """Two rows `a` and `b` that share a camera path: b's frame in a's."""

    a: str
    b: str
    a_from_b: Placement


@dataclass(frozen=True, eq=False)
class PointMatch:
    """A point (3,) m in the frames of rows `a` and `b`: the difference of the two, in a's frame, has `covariance` (k,
    k) along `axes` (k, 3), unit vectors on the floor in a's frame."""

    a: str
    b: str
    in_a: Floats
    in_b: Floats
    axes: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        k = len(self.axes)
        require(self.axes.shape == (k, 3) and self.covariance.shape == (k, k), self, "axes (k, 3), covariance (k, k)")


@dataclass(frozen=True, eq=False)
class SitePoses:
    """Rows' poses by name, with the joint covariance (3n, 3n) of their x m, z m, heading degrees, in the site's
    frame."""

    rows: Mapping[str, Placement]
    joint: Floats

    def relative(self, a: str, b: str) -> Placement:
        """Row b's frame in row a's, with its covariance."""
        first, second = self.rows[a], self.rows[b]
        turn = first.site_from_row[[[0], [2]], [0, 2]]
        step = np.array([second.x_m - first.x_m, second.z_m - first.z_m])
        x, z = turn.T @ step
        slope_a, slope_b = np.zeros((3, 3)), np.zeros((3, 3))
        slope_a[:2, :2], slope_b[:2, :2] = -turn.T, turn.T
        slope_a[:2, 2] = np.radians([-z, x])
        slope_a[2, 2], slope_b[2, 2] = -1.0, 1.0
        slope = np.hstack([slope_a, slope_b])
        slots = [3 * list(self.rows).index(name) + np.arange(3) for name in (a, b)]
        both = np.concatenate(slots)
        heading = (second.heading_deg - first.heading_deg + 180) % 360 - 180
        return Placement(float(x), float(z), heading, slope @ self.joint[np.ix_(both, both)] @ slope.T)


def solve_site_poses(
    start: Mapping[str, Placement],
    priors: Mapping[str, Placement],
    paths: Sequence[RelativePosePrior],
    points: Sequence[PointMatch],
    square_rad: float | None = None,
) -> SitePoses:
    """The rows of `start`, from priors on single rows and what binds them to one another, all with Huber's loss.

    `square_rad`: how far rows may turn from a common grid of right angles (standard deviation); rows that start further
    off it than 10 degrees are left alone. Raises SolveError where a row's pose stays open.
    """
    keys = {name: int(gtsam.symbol("r", number)) for number, name in enumerate(start)}
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for name, place in start.items():
        values.insert(keys[name], pose_of(place))
    for name, place in priors.items():
        graph.add(gtsam.PriorFactorPose2(keys[name], pose_of(place), _noise(_tangent(place))))
    for path in paths:
        noise = _noise(_tangent(path.a_from_b))
        graph.add(gtsam.BetweenFactorPose2(keys[path.a], keys[path.b], pose_of(path.a_from_b), noise))
    for point in points:
        graph.add(_point_factor(point, keys))
    if square_rad is not None:
        first = values.atPose2(next(iter(keys.values()))).theta()
        values.insert(GRID, gtsam.Rot2(first))
        _add_grid(graph, values, list(keys.values()), square_rad)
    return _solved(graph, values, keys)


def pose_of(place: Placement) -> gtsam.Pose2:
    """A place as a pose on the floor."""
    return gtsam.Pose2(place.x_m, -place.z_m, float(np.radians(place.heading_deg)))


def residual(point: PointMatch, a_from_b: Placement) -> Floats:
    """What is left between the two places of a point: b's less a's (k,) m."""
    left: Floats = point.axes @ (a_from_b.points(point.in_b[None])[0] - point.in_a)
    return left


def _solved(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: Mapping[str, int]) -> SitePoses:
    try:
        solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        marginals = gtsam.Marginals(graph, solved)
        joint = np.array(marginals.jointMarginalCovariance(list(keys.values())).fullMatrix())
    except RuntimeError as error:
        raise SolveError(f"the rows' places in the site are not determined by what binds them: {error}") from error
    poses = [solved.atPose2(key) for key in keys.values()]
    turns = block_diag(*(_site_from_tangent(pose.theta()) for pose in poses))
    joint = turns @ joint @ turns.T
    places = {}
    for number, (name, pose) in enumerate(zip(keys, poses, strict=True)):
        block = slice(3 * number, 3 * number + 3)
        places[name] = Placement(pose.x(), -pose.y(), float(np.degrees(pose.theta())), joint[block, block])
    return SitePoses(places, joint)


def _site_from_tangent(heading_rad: float) -> Floats:
    """Derivative (3, 3) of x, z and heading in degrees by a small motion of a pose in its own frame."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    slope: Floats = np.array([[cos, -sin, 0], [-sin, -cos, 0], [0, 0, np.degrees(1.0)]])
    return slope


def _tangent(place: Placement) -> Floats:
    """A place's covariance as that of small motions in its own frame."""
    back = np.linalg.inv(_site_from_tangent(np.radians(place.heading_deg)))
    covariance: Floats = back @ place.covariance @ back.T
    return covariance


def _noise(covariance: Floats) -> gtsam.noiseModel.Robust:
    huber = gtsam.noiseModel.mEstimator.Huber.Create(HUBER)
    return gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Gaussian.Covariance(covariance))


def _point_factor(point: PointMatch, keys: Mapping[str, int]) -> gtsam.NonlinearFactor:
    in_a, in_b = FLOOR @ point.in_a, FLOOR @ point.in_b
    axes = point.axes @ FLOOR.T

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        pose_a, pose_b = map(values.atPose2, factor.keys())
        turn_a, turn_b = pose_a.rotation().matrix(), pose_b.rotation().matrix()
        seen = turn_a.T @ (turn_b @ in_b + pose_b.translation() - pose_a.translation())
        if jacobians is not None:
            turn = turn_a.T @ turn_b
            jacobians[0] = -axes @ np.column_stack([np.eye(2), TURNED @ seen])
            jacobians[1] = axes @ np.column_stack([turn, turn @ TURNED @ in_b])
        left: Floats = axes @ (seen - in_a)
        return left

    return gtsam.CustomFactor(_noise(point.covariance), [keys[point.a], keys[point.b]], error)


def _add_grid(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: Sequence[int], sigma_rad: float) -> None:
    """Every row that starts near a multiple of a right angle off the grid is held there."""
    noise = _noise(np.array([[sigma_rad**2]]))
    for key in keys:
        turn = values.atPose2(key).theta() - values.atRot2(GRID).theta()
        quarters = round(turn / QUARTER)
        if abs(turn - quarters * QUARTER) < OFF_GRID_RAD:
            graph.add(_grid_factor(noise, key, quarters * QUARTER))


def _grid_factor(noise: gtsam.noiseModel.Robust, key: int, wanted: float) -> gtsam.NonlinearFactor:
    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        turn = values.atPose2(factor.keys()[0]).theta() - values.atRot2(factor.keys()[1]).theta() - wanted
        if jacobians is not None:
            jacobians[0] = np.array([[0.0, 0.0, 1.0]])
            jacobians[1] = np.array([[-1.0]])
        left: Floats = np.array([(turn + np.pi) % (2 * np.pi) - np.pi])
        return left

    return gtsam.CustomFactor(noise, [key, GRID], error)
