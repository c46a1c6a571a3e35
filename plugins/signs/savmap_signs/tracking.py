"""Signs through the sequence: pairs of sightings say where a sign might be, and the place that most sightings agree
with is a sign.

Random sample consensus (Fischler and Bolles 1981) over all pairs near in time, repeated without the sightings that are
explained. All views count together, so that a sign that passes from the view ahead to that of the face is tracked as
one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.errors import StructureError
from savmap.geometry.triangulate import midway, nearest_points
from savmap.types import Feature, Floats, Ints, RowFacts, Track, Trajectory
from savmap_signs.features import PARTS
from savmap_signs.reading import Inscription, vote
from savmap_signs.settings import Settings

MIN_SUPPORT = 3  # frames
WINDOW_FRAMES, PARTNERS = 60, 28  # a pair is at most so far apart; partners next in time, and as many of the rest
PARALLAX_DEG = (2.0, 70.0)  # of a pair's rays
DISTANCE_M = (0.3, 25.0)  # of a sign from the camera
PAIR_PX, AGREE_PX = 4.0, 6.0  # errors of the pair that a hypothesis is from, and of all that agree with it
SIDES_M = (0.03, 3.0)
SQUARE_DEG, OPPOSITE_RATIO = 22.0, 1.4  # corners' deviation from right angles; of opposite sides' lengths
SAME_PLACE_SHARE = 0.6  # of a sign's diagonal
BLOCK = 256  # hypotheses compared with all sightings at a time: bounds the memory
PATH_ERROR_M = 0.03
"""How far off the first path may place a camera: much, in pixels, for a sign close by."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """n signs, each as one view of one frame shows it: its four features in the order of `PARTS`, its frame (n,), the
    camera's position (n, 3) m and unit rays to the corners (n, 4, 3) in the row's frame, and the view's focal length
    (n,) px."""

    features: Sequence[tuple[Feature, ...]]
    frames: Ints
    origins: Floats
    rays: Floats
    focal: Floats

    def __len__(self) -> int:
        return len(self.features)

    def take(self, index: Ints) -> "Sightings":
        """The sightings of an index (m,)."""
        return Sightings(
            [self.features[i] for i in index],
            self.frames[index],
            self.origins[index],
            self.rays[index],
            self.focal[index],
        )

    def errors_px(self, quads: Floats) -> Floats:
        """How far off, px, the worst corner of signs is in sightings, beyond what a camera that is off by
        `PATH_ERROR_M` explains; infinite behind the camera. For signs (4, 3) m or (n, 4, 3), one for each sighting:
        (n,). For signs (h, 1, 4, 3): (h, n)."""
        towards = quads - self.origins[:, None]
        distance = np.maximum(np.linalg.norm(towards, axis=-1), 1e-6)
        cosine = (towards * self.rays).sum(axis=-1) / distance
        angle = np.maximum(np.sqrt(np.maximum(2 - 2 * cosine, 0.0)) - PATH_ERROR_M / distance, 0.0)
        worst: Floats = np.where((cosine > 0).all(axis=-1), angle.max(axis=-1) * self.focal, np.inf)
        return worst


def sightings_of(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> Sightings:
    """All signs that frames whose camera is known show whole."""
    poses = dict(zip(start.frames.tolist(), start.world_from_rig, strict=True))
    grouped: dict[tuple[int, str, int], dict[str, Feature]] = {}
    for feature in features:
        if feature.frame in poses:
            grouped.setdefault((feature.frame, feature.view, feature.instance), {})[feature.part] = feature
    whole = [tuple(parts[part] for part in PARTS) for parts in grouped.values() if len(parts) == len(PARTS)]
    cameras = [poses[four[0].frame] for four in whole]
    views = [facts.views[four[0].view] for four in whole]
    rays = [
        pose[:3, :3] @ view.rig_rays(np.array([feature.pixels[0] for feature in four])).T
        for four, pose, view in zip(whole, cameras, views, strict=True)
    ]
    return Sightings(
        whole,
        np.array([four[0].frame for four in whole], np.int64),
        np.array([pose[:3, 3] for pose in cameras]).reshape(-1, 3),
        np.array([columns.T for columns in rays]).reshape(-1, 4, 3),
        np.array([float(view.camera[0, 0]) for view in views]),
    )


def track_signs(features: Sequence[Feature], facts: RowFacts, start: Trajectory, config: Settings) -> list[Track]:
    """Tracks "sign 3 / upper left" and so on, of signs numbered along x from 1. Their `place` has what was read on the
    sign.

    Raises StructureError if no sign was seen in at least three frames.
    """
    sightings = sightings_of(features, facts, start)
    signs = _find_signs(sightings)
    if not signs:
        raise StructureError(
            "no sign was seen in three frames or more: do the views show signs, and was the network trained on such?"
        )
    signs.sort(key=lambda sign: tuple(np.round(sign[0].mean(axis=0), 3)))
    return [
        track
        for number, (_, chosen) in enumerate(signs, start=1)
        for track in _sign_tracks(number, sightings.take(chosen), config)
    ]


def _find_signs(sightings: Sightings) -> list[tuple[Floats, Ints]]:
    """Signs' corners (4, 3) m, and the index of the sightings of each."""
    signs: list[tuple[Floats, Ints]] = []
    hypotheses = _hypotheses(sightings)
    if not len(hypotheses):
        return signs
    blocks = [hypotheses[first : first + BLOCK, None] for first in range(0, len(hypotheses), BLOCK)]
    agree = np.concatenate([sightings.errors_px(block) < AGREE_PX for block in blocks])
    unexplained = np.ones(len(sightings), dtype=bool)
    while True:
        support = agree & unexplained
        best = int(support.sum(axis=1).argmax())
        if support[best].sum() < MIN_SUPPORT:
            return signs
        quad, chosen = _settle(sightings, support[best], unexplained)
        unexplained &= ~agree[best]
        unexplained[chosen] = False
        if len(chosen) >= MIN_SUPPORT and is_sign_shaped(quad) and not any(_same(quad, other) for other, _ in signs):
            signs.append((quad, chosen))


def _hypotheses(sightings: Sightings) -> Floats:
    """Corners (h, 4, 3) m from pairs of sightings in different frames whose rays meet well, in front of both
    cameras."""
    order = np.argsort(sightings.frames, kind="stable")
    frames = sightings.frames[order]
    pairs = []
    for first in range(len(order)):
        later = np.flatnonzero((frames > frames[first]) & (frames <= frames[first] + WINDOW_FRAMES))
        pairs += [(order[first], order[partner]) for partner in partners(later)]
    if not pairs:
        return np.zeros((0, 4, 3))
    first_index, second_index = np.array(pairs).T
    cosine = (sightings.rays[first_index] * sightings.rays[second_index]).sum(axis=-1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    wide = (angle.min(axis=1) > PARALLAX_DEG[0]) & (angle.max(axis=1) < PARALLAX_DEG[1])
    return _triangulate(sightings.take(first_index[wide]), sightings.take(second_index[wide]))


def partners(later: Ints) -> Ints:
    """Which of the later sightings (n,) to pair a sighting with: the next ones, for a sign that is soon gone, and a
    spread of the rest."""
    rest = later[PARTNERS:]
    spread = np.unique(np.linspace(0, len(rest) - 1, min(len(rest), PARTNERS)).astype(int))
    return np.concatenate([later[:PARTNERS], rest[spread]])


def _triangulate(first: Sightings, second: Sightings) -> Floats:
    """Corners (h, 4, 3) m of the pairs of sightings, m in each, whose rays meet within `PAIR_PX` and have the shape of
    a sign."""
    quads = midway(first.origins[:, None], first.rays, second.origins[:, None], second.rays)
    kept = is_sign_shaped(quads)
    for sightings in (first, second):
        distance = np.linalg.norm(quads.mean(axis=1) - sightings.origins, axis=1)
        kept &= (distance > DISTANCE_M[0]) & (distance < DISTANCE_M[1]) & (sightings.errors_px(quads) < PAIR_PX)
    return quads[kept]


def _settle(sightings: Sightings, agree: NDArray[np.bool_], unexplained: NDArray[np.bool_]) -> tuple[Floats, Ints]:
    """A sign's corners (4, 3) m from the sightings that agree, which are chosen again by these corners, and their
    index."""
    quad, chosen = np.zeros((4, 3)), np.flatnonzero(agree)
    for _ in range(3):
        if len(chosen) < 2:
            break
        quad = nearest_points(sightings.origins[chosen], np.moveaxis(sightings.rays[chosen], 0, 1))
        errors = np.where(unexplained, sightings.errors_px(quad), np.inf)
        chosen = _best_of_each_frame(sightings.frames, errors)
    return quad, chosen


def _best_of_each_frame(frames: Ints, errors_px: Floats) -> Ints:
    """The index of the sighting that agrees best in each frame, if it agrees: two views of a frame show the same
    pixels."""
    order = np.argsort(errors_px, kind="stable")
    best = order[np.unique(frames[order], return_index=True)[1]]
    return np.sort(best[errors_px[best] < AGREE_PX])


def is_sign_shaped(quads: Floats) -> NDArray[np.bool_]:
    """Which corners (..., 4, 3) m are approximately those of a rectangle of a sign's size."""
    sides = np.roll(quads, -1, axis=-2) - quads
    lengths = np.linalg.norm(sides, axis=-1)
    positive = np.maximum(lengths, 1e-9)
    unit = sides / positive[..., None]
    skew = np.abs((unit * np.roll(unit, -1, axis=-2)).sum(axis=-1)).max(axis=-1)
    ratio = np.abs(np.log(positive / np.roll(positive, -2, axis=-1))).max(axis=-1)
    sized = (lengths.min(axis=-1) >= SIDES_M[0]) & (lengths.max(axis=-1) <= SIDES_M[1])
    shaped: NDArray[np.bool_] = sized & (skew < np.sin(np.radians(SQUARE_DEG))) & (ratio < np.log(OPPOSITE_RATIO))
    return shaped


def _same(quad: Floats, other: Floats) -> bool:
    """Whether two signs are in the same place and are read from the same side."""
    diagonal = np.linalg.norm(other[2] - other[0])
    near = np.linalg.norm(quad.mean(axis=0) - other.mean(axis=0)) < SAME_PLACE_SHARE * diagonal
    return bool(near and (quad[1] - quad[0]) @ (other[1] - other[0]) > 0)


def _sign_tracks(number: int, sightings: Sightings, config: Settings) -> list[Track]:
    readings = (four[0].readings for four in sightings.features)
    inscription = vote(readings, config.pattern, config.least_confidence)
    return [_corner_track(number, corner, sightings, inscription) for corner in range(len(PARTS))]


def _corner_track(number: int, corner: int, sightings: Sightings, inscription: Inscription) -> Track:
    features = [four[corner] for four in sightings.features]
    return Track(
        name=f"sign {number} / {PARTS[corner]}",
        label=features[0].label,
        place={
            "sign": number,
            "part": PARTS[corner],
            "text": inscription.text,
            "per_mille": round(1000 * inscription.confidence),
            "code": inscription.code,
        },
        frames=sightings.frames,
        views=tuple(feature.view for feature in features),
        pixels=np.concatenate([feature.pixels for feature in features]),
        covariances=np.concatenate([feature.covariance for feature in features]),
    )
