"""Signs in a view: from masks to their four corners, measured in the panorama, and what is written on them."""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.types import Detection, Feature, Floats, Panorama, View
from savmap_signs.corners import SIGMA_MASK_PX, refined
from savmap_signs.quads import quad_of
from savmap_signs.reading import read

PARTS = ("upper left", "upper right", "lower right", "lower left")


def extract_features(
    view: View, detections: Sequence[Detection], panorama: Panorama | None, reads: bool, read_every: int
) -> list[Feature]:
    """Four points for each sign that the view shows whole; the first of them carries what was read."""
    features: list[Feature] = []
    due = reads and (view.frame // view.spec.every) % read_every == 0
    for instance, detection in enumerate(detections):
        quad = quad_of(detection.mask)
        if quad is not None:
            features += _sign(view, detection, instance, quad, panorama, due)
    return features


def _sign(
    view: View, detection: Detection, instance: int, quad: Floats, panorama: Panorama | None, due: bool
) -> list[Feature]:
    covariances: Floats = np.tile(SIGMA_MASK_PX**2 * np.eye(2), (4, 1, 1))
    readings: Mapping[str, float] = {}
    if panorama is not None:
        quad, covariances = refined(panorama, view.spec, quad)
        readings = read(panorama, view.spec, quad) if due else {}
    return [
        Feature(
            view.frame,
            view.spec.name,
            detection.label,
            part,
            instance,
            quad[number][None],
            covariances[number][None],
            score=detection.score,
            readings=readings if number == 0 else {},
        )
        for number, part in enumerate(PARTS)
    ]
