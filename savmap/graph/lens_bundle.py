"""The path of an ordinary lens, adjusted in one bundle with the points that it saw, its focal length and one term of
radial distortion (without it a long row bows). GTSAM's own factors."""

from dataclasses import dataclass

import gtsam
import numpy as np

from savmap.geometry.arrays import Bools, Floats, Ints, array_record
from savmap.geometry.cameras import Pinhole

Given = tuple[float, float, float]
"""What is known of a lens: its focal length and the standard deviation of that, pixels, and that of its radial term."""

PIXEL_SIGMA = 0.4
"""Of a sighting that fits. Outliers count less and less (Cauchy): an edge before another one moves as neither does, and
racks are full of these. By Huber's loss such points bend a path by ten times its error."""
TURN_SIGMA_DEG, TURN_CAUCHY = 0.3, 2.0
"""Of turns by lines, some of which are wrong."""
HOLD = 1e-4
"""Of the first place and of the way's length, as a share of that: nothing tells these."""
FIRST_MOST_PX, MOST_PX = 60.0, 2.0
"""By which a point is off that is left out from the start; by which a sighting is that is not used later."""
MOST_STEPS, LEAST_GAIN = 20, 1e-4


@dataclass(frozen=True, eq=False)
@array_record
class LensPath:
    """Poses world_from_rig (f, 4, 4); points (p, 3), nan where one does not fit; the focal length in pixels, its
    standard deviation, the radial term; of each sighting the ray (n, 3) in the rig frame, and by how many pixels it is
    off (n,)."""

    world_from_rig: Floats
    points: Floats
    focal_px: float
    focal_sigma_px: float
    radial: float
    rays: Floats
    off_px: Floats

    @property
    def fits(self) -> Bools:
        """Which sightings (n,) fit."""
        return np.asarray(self.off_px < MOST_PX)


def adjusted(
    frame: Ints, point: Ints, pixels: Floats, poses: Floats, points: Floats, focal_px: float, given: Given
) -> LensPath:
    """Poses world_from_rig (f, 4, 4) whose turns are about right, and points (p, 3), adjusted to sightings: of which
    frame and point (n,), and at which pixels (n, 2) from the principal point. `focal_px`: where to begin."""
    graph, values, model = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.noiseModel
    lens = gtsam.symbol("k", 0)
    off = misfits(frame, point, pixels, poses, points, focal_px, 0.0)
    typical = np.array([np.median(some) for some in np.split(off, np.flatnonzero(np.diff(point)) + 1)])
    used = np.flatnonzero(typical < FIRST_MOST_PX)
    values.insert(lens, gtsam.Cal3Bundler(focal_px, 0.0, 0.0, 0.0, 0.0))
    focal_given, focal_sigma, radial_sigma = given
    sigmas = model.Diagonal.Sigmas(np.array([focal_sigma, radial_sigma, 1e-6]))
    graph.add(gtsam.PriorFactorCal3Bundler(lens, gtsam.Cal3Bundler(focal_given, 0.0, 0.0, 0.0, 0.0), sigmas))
    noise = model.Robust.Create(model.mEstimator.Cauchy.Create(1.0), model.Isotropic.Sigma(2, PIXEL_SIGMA))
    for number in used.tolist():
        values.insert(gtsam.symbol("p", number), points[number])
    for k in np.flatnonzero(np.isin(point, used)).tolist():
        keys = gtsam.symbol("x", int(frame[k])), gtsam.symbol("p", int(point[k])), lens
        graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(pixels[k], noise, *keys))
    upright = model.Robust.Create(
        model.mEstimator.Cauchy.Create(TURN_CAUCHY), model.Isotropic.Sigma(3, float(np.radians(TURN_SIGMA_DEG)))
    )
    for number, pose in enumerate(poses):
        key = gtsam.symbol("x", number)
        values.insert(key, gtsam.Pose3(pose))
        graph.add(gtsam.PoseRotationPrior3D(key, gtsam.Rot3(pose[:3, :3]), upright))
    first, last = gtsam.symbol("x", 0), gtsam.symbol("x", len(poses) - 1)
    length = float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]))
    held = model.Isotropic.Sigma(3, HOLD * length)
    graph.add(gtsam.PoseTranslationPrior3D(first, gtsam.Pose3(poses[0]), held))
    graph.add(gtsam.RangeFactorPose3(first, last, length, model.Isotropic.Sigma(1, HOLD * length)))
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(MOST_STEPS)
    params.setRelativeErrorTol(LEAST_GAIN)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    found = result.atCal3Bundler(lens)
    try:
        variance = gtsam.Marginals(graph, result).marginalCovariance(lens)[0, 0]
    except RuntimeError:
        variance = focal_sigma**2
    placed = np.full(points.shape, np.nan)
    placed[used] = [result.atPoint3(gtsam.symbol("p", number)) for number in used.tolist()]
    path = np.array([result.atPose3(gtsam.symbol("x", number)).matrix() for number in range(len(poses))])
    off = misfits(frame, point, pixels, path, placed, found.fx(), found.k1())
    camera = Pinhole(1, 1, (found.fx(), found.fx()), (0.0, 0.0), (found.k1(),))
    return LensPath(path, placed, found.fx(), float(np.sqrt(variance)), found.k1(), camera.rays(pixels), off)


def misfits(
    frame: Ints, point: Ints, pixels: Floats, poses: Floats, points: Floats, focal_px: float, radial: float
) -> Floats:
    """By how many pixels sightings (n,) are off; infinite where a point is behind the camera, or not known."""
    turned = np.einsum("nji,nj->ni", poses[frame, :3, :3], points[point] - poses[frame, :3, 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = turned[:, :2] / turned[:, 2:]
        there = focal_px * at * (1 + radial * (at**2).sum(axis=1, keepdims=True))
    return np.where(turned[:, 2] > 0, np.linalg.norm(there - pixels, axis=1), np.inf)
