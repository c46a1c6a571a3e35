"""The path of an ordinary lens, adjusted in one bundle with the points that it saw, its focal length and one term of
radial distortion (without it a long row bows). GTSAM's own factors."""

from dataclasses import dataclass

import gtsam
import numpy as np

from savmap.geometry.arrays import Bools, Floats, Ints, array_record
from savmap.geometry.cameras import Pinhole

Given = tuple[float, float, float]
"""What is known of a lens: its focal length and the standard deviation of that, pixels, and that of its radial term."""

SIGMAS_PX = 20.0, 3.0, 0.4
"""Of a sighting that fits, from first to last; the lens is free in the last step alone. Outliers count less and less
(Cauchy): an edge before another one moves as neither does, and faces are full of these. By Huber's loss such points
bend a path by ten times its error."""
TURN_SIGMA_DEG, TURN_CAUCHY = 0.3, 2.0
"""Of turns by lines, some of which are wrong."""
HOLD = 1e-4
"""Of the first place and of the way's length, as a share of that: nothing tells these."""
FIRST_MOST_PX, MOST_PX = 60.0, 2.0
"""By which a point is off that is left out from the start; by which a sighting is that is not used later."""
MOST_STEPS, FIRST_GAIN, LEAST_GAIN, TINY = 20, 1e-3, 1e-4, 1e-6
LEAST_DEPTH = 0.05
"""Of a point, in the middle distance of the points."""
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
    held, path, placed, camera = _held(poses), poses, points, gtsam.Cal3Bundler(focal_px, 0.0, 0.0, 0.0, 0.0)
    lens = gtsam.Cal3_S2(focal_px, focal_px, 0.0, 0.0, 0.0)
    for sigma_px in SIGMAS_PX:
        off = misfits(frame, point, pixels, path, placed, camera.fx(), camera.k1())
        nearest, typical = np.full(len(points), np.inf), np.full(len(points), np.inf)
        np.minimum.at(nearest, point, np.nan_to_num(depths(frame, point, path, placed), nan=-1.0))
        typical[np.unique(point)] = [np.median(some) for some in np.split(off, np.flatnonzero(np.diff(point)) + 1)]
        used = (nearest > LEAST_DEPTH) & (typical < FIRST_MOST_PX)
        graph, values = gtsam.NonlinearFactorGraph(held), gtsam.Values()
        last = sigma_px == SIGMAS_PX[-1]
        if last:
            values.insert(LENS, camera)
            graph.add(_lens_prior(given))
        for number, pose in enumerate(path):
            values.insert(gtsam.symbol("x", number), gtsam.Pose3(pose))
        for number in np.flatnonzero(used).tolist():
            values.insert(gtsam.symbol("p", number), placed[number])
        noise = _robust(1.0, gtsam.noiseModel.Isotropic.Sigma(2, sigma_px))
        for k in np.flatnonzero(used[point]).tolist():
            keys = gtsam.symbol("x", int(frame[k])), gtsam.symbol("p", int(point[k]))
            if last:
                graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(pixels[k], noise, *keys, LENS))
            else:
                graph.add(gtsam.GenericProjectionFactorCal3_S2(pixels[k], noise, *keys, lens))
        params = gtsam.LevenbergMarquardtParams()
        params.setMaxIterations(MOST_STEPS)
        params.setRelativeErrorTol(LEAST_GAIN if last else FIRST_GAIN)
        values = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
        camera = values.atCal3Bundler(LENS) if last else camera
        placed = np.full(points.shape, np.nan)
        placed[used] = [values.atPoint3(gtsam.symbol("p", number)) for number in np.flatnonzero(used).tolist()]
        path = np.array([values.atPose3(gtsam.symbol("x", number)).matrix() for number in range(len(poses))])
    try:
        variance = gtsam.Marginals(graph, values).marginalCovariance(LENS)[0, 0]
    except RuntimeError:
        variance = given[1] ** 2
    off = misfits(frame, point, pixels, path, placed, camera.fx(), camera.k1())
    rays = Pinhole(1, 1, (camera.fx(), camera.fx()), (0.0, 0.0), (camera.k1(),)).rays(pixels)
    return LensPath(path, placed, camera.fx(), float(np.sqrt(variance)), camera.k1(), rays, off)


def _lens_prior(given: Given) -> gtsam.NonlinearFactor:
    focal_px, focal_sigma_px, radial_sigma = given
    sigmas = gtsam.noiseModel.Diagonal.Sigmas(np.array([focal_sigma_px, radial_sigma, TINY]))
    return gtsam.PriorFactorCal3Bundler(LENS, gtsam.Cal3Bundler(focal_px, 0.0, 0.0, 0.0, 0.0), sigmas)


def _held(poses: Floats) -> gtsam.NonlinearFactorGraph:
    """What is known without points: how poses (f, 4, 4) are turned; and where and how large all is, which nothing
    tells."""
    graph, model = gtsam.NonlinearFactorGraph(), gtsam.noiseModel
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


def depths(frame: Ints, point: Ints, poses: Floats, points: Floats) -> Floats:
    """How far before its camera each sighting's point is (n,)."""
    return np.asarray(np.einsum("nj,nj->n", poses[frame, :3, 2], points[point] - poses[frame, :3, 3]))


def misfits(
    frame: Ints, point: Ints, pixels: Floats, poses: Floats, points: Floats, focal_px: float, radial: float
) -> Floats:
    """By how many pixels sightings (n,) are off; infinite where a point is not before the camera, or not known."""
    turned = np.einsum("nji,nj->ni", poses[frame, :3, :3], points[point] - poses[frame, :3, 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = turned[:, :2] / turned[:, 2:]
        projected = focal_px * at * (1 + radial * (at**2).sum(axis=1, keepdims=True))
    return np.where(turned[:, 2] > LEAST_DEPTH, np.linalg.norm(projected - pixels, axis=1), np.inf)
