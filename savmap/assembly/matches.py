"""Which landmarks of one row are which of another, as constraints of the site's solve, and as records with what is left
after it.

Landmarks are matched by their places, and only where no other reading fits nearly as well. A line of landmarks that are
alike fits nearly as well when it slips by one. Each shift that brings a landmark onto another is therefore scored by
its likelihood. The best one is accepted if it is much likelier (`LEAST`, nats) than that the rows have nothing in
common, and than any that pairs a landmark otherwise (`MARGIN`): a line that slips by one loses one pair, 4.5 nats,
which is too little.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.assembly.overlap import Overlap
from savmap.graph.site_poses import PointMatch, SitePoses, residual
from savmap.types import CrossRowLandmark, CrossRowMatch, Floats, Ints, Placement, array_record

GATE = 4.0
NEAR = 3.0
LEAST = 10.0
MARGIN = 6.0
REFINED = 2
FLOOR_SIGMA_M = 0.05
LEAST_SIGMA_M = 0.001
REJECT_SIGMA = 4.0
COMMON = 0.25
AXES = {"x": 0, "y": 1, "z": 2}

Pairs = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Matching:
    """Pairs of landmarks by number; if there are none, whether that is because several readings fit."""

    pairs: Pairs = ()
    ambiguous: bool = False


@dataclass(frozen=True, eq=False)
@array_record
class Differences:
    """In a's frame, along the k axes that all landmarks measure: b's places less a's (n, m, k) m with the rows as they
    stand, their covariance (n, m, k, k) by landmarks and heading, and the covariance (k, k) of the shift of one row
    against the other."""

    between: Floats
    covariance: Floats
    shift: Floats


def match_landmarks(
    of_a: Sequence[CrossRowLandmark], of_b: Sequence[CrossRowLandmark], a_from_b: Placement
) -> Matching:
    """Pairs of landmarks of one kind."""
    offsets = differences(of_a, of_b, a_from_b)
    inverse, tight = _inverse(offsets.covariance), _inverse(offsets.shift)
    gate = _inverse(offsets.covariance + offsets.shift)
    inside = _squares(offsets.between, gate) < GATE**2
    if not inside.any():
        return Matching()
    scored: dict[Pairs, float] = {}
    for shift in offsets.between[inside]:
        pairs = _nearest(offsets.between - shift, inverse)
        for _ in range(REFINED):
            pairs = _nearest(offsets.between - _fitted(pairs, offsets.between, inverse, tight), inverse)
        if pairs not in scored:
            scored[pairs] = _score(pairs, offsets.between, inverse, tight)
    best = max(scored, key=scored.__getitem__)
    if scored[best] < LEAST:
        return Matching()
    b_of_a, a_of_b = dict(best), {j: i for i, j in best}
    others = [  # in which any landmark has another partner
        score
        for pairs, score in scored.items()
        if any(b_of_a.get(i, j) != j or a_of_b.get(j, i) != i for i, j in pairs)
    ]
    if scored[best] - max(others, default=0.0) < MARGIN:
        return Matching(ambiguous=True)
    return Matching(best)


def differences(of_a: Sequence[CrossRowLandmark], of_b: Sequence[CrossRowLandmark], a_from_b: Placement) -> Differences:
    """The differences between all places of a and of b."""
    axes = [number for axis, number in AXES.items() if all(axis in landmark.axes for landmark in (*of_a, *of_b))]
    turn = a_from_b.site_from_row[:3, :3]
    places_a = np.array([landmark.place for landmark in of_a])
    raw = np.array([landmark.place for landmark in of_b])
    places_b = a_from_b.points(raw)
    covariance_a = np.array([landmark.covariance for landmark in of_a])
    covariance_b = turn @ np.array([landmark.covariance for landmark in of_b]) @ turn.T
    middle = raw.mean(axis=0, keepdims=True)
    lever = places_b - a_from_b.points(middle)
    swing = np.radians(np.sqrt(a_from_b.covariance[2, 2])) * np.stack(
        [lever[:, 2], np.zeros(len(raw)), -lever[:, 0]], axis=1
    )
    shift = a_from_b.covariances(middle, np.diag([0.0, FLOOR_SIGMA_M**2, 0.0])[None])[0]
    least = LEAST_SIGMA_M**2 * np.eye(3)
    covariance = covariance_a[:, None] + (covariance_b + swing[:, :, None] * swing[:, None, :])[None] + least
    grid = np.ix_(axes, axes)
    return Differences(
        (places_b[None] - places_a[:, None])[:, :, axes], covariance[:, :, grid[0], grid[1]], shift[grid]
    )


def _inverse(covariances: Floats) -> Floats:
    return np.asarray(np.linalg.inv(covariances), dtype=np.float64)


def _squares(differences: Floats, inverse: Floats) -> Floats:
    squares: Floats = np.einsum("nmi,nmij,nmj->nm", differences, inverse, differences)
    return squares


def _nearest(differences: Floats, inverse: Floats) -> Pairs:
    """Pairs that are each other's nearest and nearer than `NEAR` standard deviations."""
    squares = _squares(differences, inverse)
    to_b: Ints = squares.argmin(axis=1)
    to_a: Ints = squares.argmin(axis=0)
    return tuple((i, j) for i, j in enumerate(to_b.tolist()) if int(to_a[j]) == i and squares[i, j] < NEAR**2)


def _score(pairs: Pairs, between: Floats, inverse: Floats, tight: Floats) -> float:
    """Log-likelihood against pairing nothing, at the shift that suits the pairs and the rows' places best."""
    if not pairs:
        return 0.0
    rows, columns = np.array(pairs).T
    shift = _fitted(pairs, between, inverse, tight)
    left = between[rows, columns] - shift
    squares = np.einsum("ni,nij,nj->n", left, inverse[rows, columns], left)
    return float((NEAR**2 - squares).sum() - shift @ tight @ shift) / 2


def _fitted(pairs: Pairs, between: Floats, inverse: Floats, tight: Floats) -> Floats:
    """The shift (k,) that suits the pairs and the rows' places best."""
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    weights = inverse[rows, columns]
    pull = np.einsum("nij,nj->i", weights, between[rows, columns])
    shift: Floats = np.linalg.solve(weights.sum(axis=0) + tight, pull)
    return shift


@dataclass(frozen=True, eq=False)
@array_record
class LandmarkMatch:
    """A landmark of row `a` that is one of row `b`, of one kind, matched where b's frame stood in a's."""

    a: str
    b: str
    kind: str
    in_a: CrossRowLandmark
    in_b: CrossRowLandmark
    a_from_b: Placement

    def __str__(self) -> str:
        return f"row {self.a}'s {self.in_a.id} as row {self.b}'s {self.in_b.id}"

    @property
    def rows(self) -> tuple[str, str]:
        return self.a, self.b

    @property
    def axes(self) -> list[int]:
        """Numbers of the axes of a's frame that both landmarks measure."""
        return [AXES[axis] for axis in self.in_a.axes if axis in self.in_b.axes]

    @property
    def covariance(self) -> Floats:
        """Covariance (3, 3) of the difference between the two places, in a's frame."""
        turn = self.a_from_b.site_from_row[:3, :3]
        both: Floats = self.in_a.covariance + turn @ self.in_b.covariance @ turn.T
        return both + LEAST_SIGMA_M**2 * np.eye(3)

    def constraint(self, count: int = 1) -> PointMatch:
        """The match on the floor, one of `count`. Errors of landmarks of one kind in one row have a part in common, of
        variance `COMMON`: however many there are, their mean is no better known than that."""
        floor = [axis for axis in self.axes if axis != AXES["y"]]
        covariance = self.covariance[np.ix_(floor, floor)] * (1 + (count - 1) * COMMON)
        return PointMatch(self.a, self.b, self.in_a.place, self.in_b.place, np.eye(3)[floor], covariance)

    def residual_sigmas(self, poses: SitePoses) -> float:
        """The residual in standard deviations."""
        constraint = self.constraint()
        left = residual(constraint, poses.relative(self.a, self.b))
        return float(np.sqrt(left @ np.linalg.solve(constraint.covariance, left)))

    def fits(self, poses: SitePoses) -> bool:
        """Whether the residual may be chance."""
        return self.residual_sigmas(poses) < REJECT_SIGMA

    def residual_text(self, poses: SitePoses) -> str:
        """The residual, for a line to the user."""
        left = residual(self.constraint(), poses.relative(self.a, self.b))
        return f"{np.linalg.norm(left):.2f} m, {self.residual_sigmas(poses):.0f} sigma"

    def record(self, poses: SitePoses) -> CrossRowMatch:
        """The match with its residual in the site's frame."""
        a, b = poses.rows[self.a], poses.rows[self.b]
        turn = a.site_from_row[:3, :3]
        left = turn.T @ (b.points(self.in_b.place[None])[0] - a.points(self.in_a.place[None])[0])
        off, sigma = np.full(3, np.nan), np.full(3, np.nan)
        if len(self.axes) == 3:
            off, sigma = turn @ left, np.sqrt(np.diag(turn @ self.covariance @ turn.T))
        for axis in self.axes if len(self.axes) < 3 else ():
            nearest = int(np.argmax(np.abs(turn[:, axis])))
            off[nearest] = np.sign(turn[nearest, axis]) * left[axis]
            sigma[nearest] = np.sqrt(self.covariance[axis, axis])
        return CrossRowMatch(self.a, self.b, self.in_a.id, self.in_b.id, off, sigma)


def worst_of_each(matches: Sequence[LandmarkMatch], poses: SitePoses) -> list[LandmarkMatch]:
    """The worst match of each two rows and kind."""
    worst: dict[tuple[tuple[str, str], str], LandmarkMatch] = {}
    for match in sorted(matches, key=lambda match: match.residual_sigmas(poses)):
        worst[match.rows, match.kind] = match
    return list(worst.values())


def overlap_record(overlap: Overlap, poses: SitePoses) -> CrossRowMatch:
    """A common camera path as a match, with the residual at its middle."""
    a, b = poses.rows[overlap.prior.a], poses.rows[overlap.prior.b]
    turn = a.site_from_row[:3, :3]
    left = b.points(overlap.in_b[None])[0] - a.points(overlap.in_a[None])[0]
    sigma = np.sqrt(np.diag(turn @ np.diag(overlap.sigma_m**2) @ turn.T))
    name = f"{overlap.count} frames"
    return CrossRowMatch(overlap.prior.a, overlap.prior.b, name, name, left, sigma)
