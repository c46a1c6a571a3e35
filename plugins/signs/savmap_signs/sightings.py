"""Signs as they were seen, all frames and views together, as rays in the row's frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.types import Feature, Floats, Ints, RowFacts, Trajectory
from savmap_signs.features import PARTS

START_M = 0.03
"""How far the first path may have a camera from its place: much, in pixels, for a sign close by."""


@dataclass(frozen=True)
class Sightings:
    """n signs as seen: their four features, frames (n,), the camera's places (n, 3), unit rays to the corners (n, 4, 3) in the row's
    frame, and the views' focal lengths (n,) px."""

    features: Sequence[tuple[Feature, ...]]
    frames: Ints
    origins: Floats
    rays: Floats
    focal: Floats

    def __len__(self) -> int:
        return len(self.features)

    def take(self, chosen: NDArray[np.bool_] | Ints) -> "Sightings":
        """Those that a mask or indices choose."""
        index = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        return Sightings(
            [self.features[i] for i in index],
            self.frames[index],
            self.origins[index],
            self.rays[index],
            self.focal[index],
        )

    def off(self, quads: Floats, own: Ints | None = None) -> Floats:
        """How far, px, the worst corner of signs (h, 4, 3) would be off each sighting, beyond what a camera that is `START_M` off its
        place explains: (h, n); infinite behind the camera. With `own` (h,), off that one sighting each: (h,)."""
        if own is None:
            quads, own = quads[:, None], np.arange(len(self))
        towards = quads - self.origins[own, None]
        length = np.maximum(np.linalg.norm(towards, axis=-1), 1e-6)
        cosine = (towards * self.rays[own]).sum(axis=-1) / length
        angle = np.maximum(np.sqrt(np.maximum(2 - 2 * cosine, 0.0)) - START_M / length, 0.0)
        worst: Floats = np.where((cosine > 0).all(axis=-1), angle.max(axis=-1) * self.focal[own], np.inf)
        return worst


def sightings(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> Sightings:
    """All signs seen in frames whose camera is known."""
    poses = dict(zip(start.frames.tolist(), start.world_from_rig, strict=True))
    grouped: dict[tuple[int, str, int], dict[str, Feature]] = {}
    for feature in features:
        if feature.frame in poses:
            grouped.setdefault((feature.frame, feature.view, feature.instance), {})[feature.part] = feature
    whole = [tuple(own[part] for part in PARTS) for own in grouped.values() if len(own) == len(PARTS)]
    turned = [
        poses[four[0].frame][:3, :3] @ facts.views[four[0].view].rig_rays(np.array([f.pixels[0] for f in four])).T
        for four in whole
    ]
    return Sightings(
        whole,
        np.array([four[0].frame for four in whole], np.int64),
        np.array([poses[four[0].frame][:3, 3] for four in whole]).reshape(-1, 3),
        np.array([rays.T for rays in turned]).reshape(-1, 4, 3),
        np.array([float(facts.views[four[0].view].camera[0, 0]) for four in whole]),
    )
