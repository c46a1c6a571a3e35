"""The path of an ordinary lens, adjusted in one bundle with the points that it saw, its focal length and one term of
radial distortion (without it a long row bows). GTSAM's own factors."""

from dataclasses import dataclass

import gtsam
import numpy as np

from savmap.geometry.arrays import Bools, Floats, Ints, array_record
from savmap.geometry.cameras import Pinhole

Given = tuple[float, float, float]
"""What is known of a lens: its focal length and the standard deviation of that, pixels, and that of its radial term."""

SIGMAS_PX = 2.0, 0.4
"""Of a sighting that fits, at first and in the end. Outliers count less and less (Cauchy): an edge before another one
moves as neither does, and faces are full of these. By Huber's loss such points bend a path by ten times its error."""
TURN_SIGMA_DEG, TURN_CAUCHY = 0.3, 2.0
"""Of turns by lines, some of which are wrong."""
HOLD = 1e-4
"""Of the first place and of the way's length, as a share of that: nothing tells these."""
FIRST_MOST_PX, MOST_PX = 60.0, 2.0
"""By which a point is off that is left out from the start; by which a sighting is that is not used later."""
MOST_STEPS, LEAST_GAIN, TINY = 20, 1e-4, 1e-6
LENS = gtsam.symbol("k", 0)


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
    off = misfits(frame, point, pixels, poses, points, focal_px, 0.0)
    typical = np.array([np.median(some) for some in np.split(off, np.flatnonzero(np.diff(point)) + 1)])
    used = np.flatnonzero(typical < FIRST_MOST_PX)
    held, values = _held(poses, given), gtsam.Values()
    values.insert(LENS, gtsam.Cal3Bundler(focal_px, 0.0, 0.0, 0.0, 0.0))
    for number in used.tolist():
        values.insert(gtsam.symbol("p", number), points[number])
    for number, pose in enumerate(poses):
        values.insert(gtsam.symbol("x", number), gtsam.Pose3(pose))
    sightings = np.flatnonzero(np.isin(point, used)).tolist()
    keys = [(gtsam.symbol("x", int(frame[k])), gtsam.symbol("p", int(point[k])), LENS) for k in sightings]
    for sigma_px in SIGMAS_PX:
        graph = gtsam.NonlinearFactorGraph(held)
        noise = _robust(1.0, gtsam.noiseModel.Isotropic.Sigma(2, sigma_px))
        for k, key in zip(sightings, keys, strict=True):
            graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(pixels[k], noise, *key))
        params = gtsam.LevenbergMarquardtParams()
        params.setMaxIterations(MOST_STEPS)
        params.setRelativeErrorTol(LEAST_GAIN)
        values = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    camera = values.atCal3Bundler(LENS)
    try:
        variance = gtsam.Marginals(graph, values).marginalCovariance(LENS)[0, 0]
    except RuntimeError:
        variance = given[1] ** 2
    placed = np.full(points.shape, np.nan)
    placed[used] = [values.atPoint3(gtsam.symbol("p", number)) for number in used.tolist()]
    path = np.array([values.atPose3(gtsam.symbol("x", number)).matrix() for number in range(len(poses))])
    off = misfits(frame, point, pixels, path, placed, camera.fx(), camera.k1())
    rays = Pinhole(1, 1, (camera.fx(), camera.fx()), (0.0, 0.0), (camera.k1(),)).rays(pixels)
    return LensPath(path, placed, camera.fx(), float(np.sqrt(variance)), camera.k1(), rays, off)


def _held(poses: Floats, given: Given) -> gtsam.NonlinearFactorGraph:
    """What is known without points: the lens, how poses (f, 4, 4) are turned; and where and how large all is, which
    nothing tells."""
    graph, model = gtsam.NonlinearFactorGraph(), gtsam.noiseModel
    focal_px, focal_sigma_px, radial_sigma = given
    sigmas = model.Diagonal.Sigmas(np.array([focal_sigma_px, radial_sigma, TINY]))
    graph.add(gtsam.PriorFactorCal3Bundler(LENS, gtsam.Cal3Bundler(focal_px, 0.0, 0.0, 0.0, 0.0), sigmas))
    upright = _robust(TURN_CAUCHY, model.Isotropic.Sigma(3, float(np.radians(TURN_SIGMA_DEG))))
    for number, pose in enumerate(poses):
        graph.add(gtsam.PoseRotationPrior3D(gtsam.symbol("x", number), gtsam.Rot3(pose[:3, :3]), upright))
    first, last = gtsam.symbol("x", 0), gtsam.symbol("x", len(poses) - 1)
    length = float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]))
    place = model.Isotropic.Sigma(3, HOLD * length)
    graph.add(gtsam.PoseTranslationPrior3D(first, gtsam.Pose3(poses[0]), place))
    graph.add(gtsam.RangeFactorPose3(first, last, length, model.Isotropic.Sigma(1, HOLD * length)))
    return graph


def _robust(scale: float, noise: gtsam.noiseModel.Base) -> gtsam.noiseModel.Robust:
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(scale), noise)


def misfits(
    frame: Ints, point: Ints, pixels: Floats, poses: Floats, points: Floats, focal_px: float, radial: float
) -> Floats:
    """By how many pixels sightings (n,) are off; infinite where a point is behind the camera, or not known."""
    turned = np.einsum("nji,nj->ni", poses[frame, :3, :3], points[point] - poses[frame, :3, 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = turned[:, :2] / turned[:, 2:]
        projected = focal_px * at * (1 + radial * (at**2).sum(axis=1, keepdims=True))
    return np.where(turned[:, 2] > 0, np.linalg.norm(projected - pixels, axis=1), np.inf)
