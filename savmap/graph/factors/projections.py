"""Measured pixels as GTSAM's projection factors."""

from collections.abc import Iterator

import gtsam
import numpy as np

from savmap.graph.keys import frame_key, rekey
from savmap.graph.measurements import ImageMeasurements
from savmap.types import Floats


def projection_factors(
    measurements: ImageMeasurements, huber: float | Floats | None, row: int = 0
) -> Iterator[gtsam.NonlinearFactor]:
    """A factor for each measurement, in order, with its full covariance and in Huber's loss, one or one each (n,),
    unless that is None; in a graph of several rows with the keys of `row`. A point behind the camera is off by twice
    the focal length."""
    cameras = [spec.camera for spec in measurements.views]
    lenses = [gtsam.Cal3_S2(camera[0, 0], camera[1, 1], 0.0, camera[0, 2], camera[1, 2]) for camera in cameras]
    mounts = [gtsam.Pose3(gtsam.Rot3(spec.rig_from_view), np.zeros(3)) for spec in measurements.views]
    frames = (measurements.frames + rekey(frame_key(0), row)).tolist()
    points = (measurements.keys + rekey(0, row)).tolist()
    widths = np.broadcast_to(np.inf if huber is None else huber, len(measurements)).tolist()
    losses = {width: gtsam.noiseModel.mEstimator.Huber.Create(width) for width in set(widths)}
    roots, views = whitening(measurements.covariances), measurements.view.tolist()
    for pixel, root, width, frame, point, view in zip(
        measurements.pixels, roots, widths, frames, points, views, strict=True
    ):
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
        if huber is not None:
            noise = gtsam.noiseModel.Robust.Create(losses[width], noise)
        yield gtsam.GenericProjectionFactorCal3_S2(pixel, noise, frame, point, lenses[view], False, False, mounts[view])


def whitening(covariances: Floats) -> Floats:
    """The matrices (n, 2, 2) by which these factors whiten errors."""
    return np.swapaxes(np.linalg.cholesky(np.linalg.inv(covariances)), 1, 2)
