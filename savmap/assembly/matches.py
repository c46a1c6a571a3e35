"""Landmarks matched between two rows: as constraints of the site's solve, and as records with what is left after it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.assembly.matching import AXES, LEAST_SIGMA_M
from savmap.assembly.overlap import Overlap
from savmap.graph.site_poses import PointMatch, SitePoses, residual
from savmap.types import CrossRowLandmark, CrossRowMatch, Floats, Placement, array_record

REJECT_SIGMA = 4.0
COMMON = 0.25


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
