"""Signs through the sequence: pairs of sightings say where a sign might be; the place that most sightings agree with is one.

Random sample consensus (Fischler and Bolles 1981) over all pairs near in time, again and again without the sightings that are
explained. All views count together, so that a sign which passes from the view ahead to that of the face is one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from savmap.errors import StructureError
from savmap.geometry.triangulate import midway, nearest_points
from savmap.types import Feature, Floats, Ints, RowFacts, Track, Trajectory
from savmap_signs.features import PARTS
from savmap_signs.settings import Settings
from savmap_signs.sightings import Sightings, sightings
from savmap_signs.texts import Words, voted

MIN_SUPPORT = 3
WINDOW, PARTNERS = 60, 28
PARALLAX_DEG = (2.0, 70.0)
NEAREST_M, FURTHEST_M = 0.3, 25.0
PAIR_PX, AGREE_PX = 4.0, 6.0
SIDES_M = (0.03, 3.0)
SQUARE_DEG, ALIKE = 22.0, 1.4
BLOCK = 256


def track_signs(features: Sequence[Feature], facts: RowFacts, start: Trajectory, config: Settings) -> list[Track]:
    """Tracks "sign 3 / upper left" and so on of signs, numbered along x from 1, whose `place` has what was read on them.

    Raises StructureError where no sign is seen in at least three frames.
    """
    seen = sightings(features, facts, start)
    found = _found(seen)
    if not found:
        raise StructureError(
            "no sign was seen in three frames or more: do the views show signs, and was the network trained on such?"
        )
    order = sorted(found, key=lambda one: tuple(np.round(one[0].mean(axis=0), 3)))
    return [
        track
        for number, (_, chosen) in enumerate(order, start=1)
        for track in _tracks(number, seen.take(chosen), config)
    ]


def _found(seen: Sightings) -> list[tuple[Floats, Ints]]:
    """Signs' corners (4, 3) m, and the sightings of each."""
    guesses = _guesses(seen)
    if not len(guesses):
        return []
    fits = np.concatenate([seen.off(guesses[at : at + BLOCK]) < AGREE_PX for at in range(0, len(guesses), BLOCK)])
    left, found = np.ones(len(seen), dtype=bool), list[tuple[Floats, Ints]]()
    while True:
        support = (fits & left).sum(axis=1)
        best = int(support.argmax())
        if support[best] < MIN_SUPPORT:
            return found
        quad, chosen = _settled(seen, fits[best] & left, left)
        explained = np.union1d(chosen, np.flatnonzero(fits[best] & left))
        left[explained] = False
        if len(chosen) >= MIN_SUPPORT and is_sign(quad) and not any(_same(quad, other) for other, _ in found):
            found.append((quad, chosen))


def _guesses(seen: Sightings) -> Floats:
    """Corners (h, 4, 3) from pairs of sightings in different frames that meet well, in front of both."""
    order = np.argsort(seen.frames, kind="stable")
    frames = seen.frames[order]
    pairs = []
    for first in range(len(order)):
        later = np.flatnonzero((frames > frames[first]) & (frames <= frames[first] + WINDOW))
        pairs += [(order[first], order[other]) for other in partners(later)]
    if not pairs:
        return np.zeros((0, 4, 3))
    one, other = np.array(pairs).T
    angle = np.degrees(np.arccos(np.clip((seen.rays[one] * seen.rays[other]).sum(axis=-1), -1, 1)))
    wide = (angle.min(axis=1) > PARALLAX_DEG[0]) & (angle.max(axis=1) < PARALLAX_DEG[1])
    return _met(seen, one[wide], other[wide])


def partners(later: Ints) -> Ints:
    """Of later sightings the next ones, for a sign that is soon gone, and some of the rest."""
    rest = later[PARTNERS:]
    spread = np.unique(np.linspace(0, len(rest) - 1, min(len(rest), PARTNERS)).astype(int))
    return np.concatenate([later[:PARTNERS], rest[spread]])


def _met(seen: Sightings, one: Ints, other: Ints) -> Floats:
    """The corners (h, 4, 3) that pairs of sightings (m,) share, of those whose rays meet so well, and which look like a sign."""
    quads = midway(seen.origins[one, None], seen.rays[one], seen.origins[other, None], seen.rays[other])
    kept = is_sign(quads)
    for own in (one, other):
        away = np.linalg.norm(quads.mean(axis=1) - seen.origins[own], axis=1)
        kept &= (away > NEAREST_M) & (away < FURTHEST_M) & (seen.off(quads, own) < PAIR_PX)
    return quads[kept]


def _settled(seen: Sightings, chosen: np.ndarray, left: np.ndarray) -> tuple[Floats, Ints]:
    """The corners from all sightings that agree, which are chosen again by them, and these sightings: one a frame."""
    quad = np.zeros((4, 3))
    for _ in range(3):
        own = np.flatnonzero(chosen)
        if len(own) < 2:
            break
        quad = nearest_points(seen.origins[own], np.moveaxis(seen.rays[own], 0, 1))
        off = seen.off(quad[None])[0]
        chosen = _once(seen, np.where(left, off, np.inf))
    return quad, np.flatnonzero(chosen)


def _once(seen: Sightings, off: Floats) -> np.ndarray:
    """Sightings (n,) that agree, the best one of each frame: two views of a frame are of the same pixels."""
    chosen = np.zeros(len(off), dtype=bool)
    taken: set[int] = set()
    for index in np.argsort(off, kind="stable").tolist():
        frame = int(seen.frames[index])
        if off[index] < AGREE_PX and frame not in taken:
            taken.add(frame)
            chosen[index] = True
    return chosen


def is_sign(quads: Floats) -> NDArray[np.bool_]:
    """Which corners (..., 4, 3) are about those of a rectangle of a sign's size."""
    sides = np.roll(quads, -1, axis=-2) - quads
    lengths = np.linalg.norm(sides, axis=-1)
    unit = sides / np.maximum(lengths, 1e-9)[..., None]
    turns = np.abs((unit * np.roll(unit, -1, axis=-2)).sum(axis=-1)).max(axis=-1)
    alike = np.abs(np.log(np.maximum(lengths, 1e-9) / np.maximum(np.roll(lengths, -2, axis=-1), 1e-9))).max(axis=-1)
    sized = (lengths.min(axis=-1) >= SIDES_M[0]) & (lengths.max(axis=-1) <= SIDES_M[1])
    found: NDArray[np.bool_] = sized & (turns < np.sin(np.radians(SQUARE_DEG))) & (alike < np.log(ALIKE))
    return found


def _same(quad: Floats, other: Floats) -> bool:
    """Whether two signs cover the same place and are read from the same side."""
    size = np.linalg.norm(other[2] - other[0])
    near = np.linalg.norm(quad.mean(axis=0) - other.mean(axis=0)) < 0.6 * size
    return bool(near and (quad[1] - quad[0]) @ (other[1] - other[0]) > 0)


def _tracks(number: int, own: Sightings, config: Settings) -> list[Track]:
    words = voted([four[0].readings for four in own.features], config.pattern, config.least_confidence)
    return [_track(number, corner, part, own, words) for corner, part in enumerate(PARTS)]


def _track(number: int, corner: int, part: str, own: Sightings, words: Words) -> Track:
    features = [four[corner] for four in own.features]
    said: dict[str, int | str] = {"text": words.text, "per_mille": round(1000 * words.confidence), "code": words.code}
    return Track(
        name=f"sign {number} / {part}",
        label=features[0].label,
        place={"sign": number, "part": part, **said},
        frames=own.frames,
        views=tuple(feature.view for feature in features),
        pixels=np.concatenate([feature.pixels for feature in features]),
        covariances=np.concatenate([feature.covariance for feature in features]),
    )
