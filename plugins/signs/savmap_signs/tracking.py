"""Signs through the sequence: pairs of sightings say where a sign might be; the place that most sightings agree with is one.

Random sample consensus (Fischler and Bolles 1981) over all pairs near in time, again and again without the sightings that are
explained. All views count together, so that a sign which passes from the view ahead to that of the face is one.
"""

from collections.abc import Sequence

import numpy as np

from savmap.errors import StructureError
from savmap.geometry.triangulate import nearest_points
from savmap.types import Feature, Floats, Ints, RowFacts, Track, Trajectory
from savmap_signs.features import PARTS
from savmap_signs.settings import Settings
from savmap_signs.sightings import Sightings, sightings
from savmap_signs.texts import Words, voted

MIN_SUPPORT = 3
WINDOW, PARTNERS = 60, 14
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
        if len(chosen) >= MIN_SUPPORT and _is_sign(quad) and not any(_same(quad, other) for other, _ in found):
            found.append((quad, chosen))


def _guesses(seen: Sightings) -> Floats:
    """Corners (h, 4, 3) from pairs of sightings in different frames that meet well, in front of both."""
    order = np.argsort(seen.frames, kind="stable")
    frames = seen.frames[order]
    pairs = []
    for first in range(len(order)):
        later = np.flatnonzero((frames > frames[first]) & (frames <= frames[first] + WINDOW))
        chosen = later[np.unique(np.linspace(0, len(later) - 1, min(len(later), 4 * PARTNERS)).astype(int))]
        pairs += [(order[first], order[other]) for other in chosen]
    if not pairs:
        return np.zeros((0, 4, 3))
    one, other = np.array(pairs).T
    angle = np.degrees(np.arccos(np.clip(np.einsum("nki,nki->nk", seen.rays[one], seen.rays[other]), -1, 1)))
    wide = (angle.min(axis=1) > PARALLAX_DEG[0]) & (angle.max(axis=1) < PARALLAX_DEG[1])
    one, other = one[wide], other[wide]
    kept = [_met(seen, a, b) for a, b in zip(one.tolist(), other.tolist(), strict=True)]
    return np.array([quad for quad in kept if quad is not None]).reshape(-1, 4, 3)


def _met(seen: Sightings, one: int, other: int) -> Floats | None:
    """The corners that two sightings share, where their rays meet so well, and they look like a sign."""
    pair = np.array([one, other])
    quad = nearest_points(seen.origins[pair], np.moveaxis(seen.rays[pair], 0, 1))
    away = np.linalg.norm(quad.mean(axis=0) - seen.origins[pair], axis=1)
    if away.min() < NEAREST_M or away.max() > FURTHEST_M or not _is_sign(quad):
        return None
    return quad if seen.take(pair).off(quad[None]).max() < PAIR_PX else None


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


def _is_sign(quad: Floats) -> bool:
    """Whether corners (4, 3) are about those of a rectangle of a sign's size."""
    sides = np.roll(quad, -1, axis=0) - quad
    lengths = np.linalg.norm(sides, axis=1)
    if lengths.min() < SIDES_M[0] or lengths.max() > SIDES_M[1]:
        return False
    unit = sides / lengths[:, None]
    turns = np.abs(np.einsum("ki,ki->k", unit, np.roll(unit, -1, axis=0)))
    alike = max(max(a / b, b / a) for a, b in ((lengths[0], lengths[2]), (lengths[1], lengths[3])))
    return bool(turns.max() < np.sin(np.radians(SQUARE_DEG)) and alike < ALIKE)


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
