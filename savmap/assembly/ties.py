"""What ties rows: things matched between two of them and camera paths, with what is left of each once the rows are placed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.assembly.matching import AXES, LEAST_SIGMA_M
from savmap.assembly.overlap import Overlap
from savmap.graph.site_poses import PointMatch, SitePoses, residual
from savmap.types import CrossRowLandmark, Floats, Placement, Tie

REJECT_SIGMA = 4.0
COMMON = 0.25


@dataclass(frozen=True, eq=False)
class Found:
    """A thing of row `a` that is one of row `b`, of one kind, matched where b stood in a's frame."""

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
        """Numbers of the axes of a's frame that both tell."""
        return [AXES[axis] for axis in self.in_a.axes if axis in self.in_b.axes]

    @property
    def covariance(self) -> Floats:
        """Of what is between the two places (3, 3), in a's frame."""
        turn = self.a_from_b.site_from_row[:3, :3]
        both: Floats = self.in_a.covariance + turn @ self.in_b.covariance @ turn.T
        return both + LEAST_SIGMA_M**2 * np.eye(3)

    def tie(self, count: int = 1) -> PointMatch:
        """The tie on the floor, one of `count`. Errors of things of one kind in one row have a part in common, of variance `COMMON`:
        however many there are, their mean is no better known than that."""
        floor = [axis for axis in self.axes if axis != AXES["y"]]
        covariance = self.covariance[np.ix_(floor, floor)] * (1 + (count - 1) * COMMON)
        return PointMatch(self.a, self.b, self.in_a.place, self.in_b.place, np.eye(3)[floor], covariance)

    def off_sigma(self, places: SitePoses) -> float:
        """What is left, in standard deviations."""
        tie = self.tie()
        left = residual(tie, places.relative(self.a, self.b))
        return float(np.sqrt(left @ np.linalg.solve(tie.covariance, left)))

    def told(self, places: SitePoses) -> str:
        """What is left, for a line to the user."""
        left = residual(self.tie(), places.relative(self.a, self.b))
        return f"{np.linalg.norm(left):.2f} m, {self.off_sigma(places):.0f} standard deviations,"

    def shown(self, places: SitePoses) -> Tie:
        """The tie with what is left in the site's frame."""
        one, other = places.rows[self.a], places.rows[self.b]
        turn = one.site_from_row[:3, :3]
        left = turn.T @ (other.points(self.in_b.place[None])[0] - one.points(self.in_a.place[None])[0])
        off, sigma = np.full(3, np.nan), np.full(3, np.nan)
        if len(self.axes) == 3:
            off, sigma = turn @ left, np.sqrt(np.diag(turn @ self.covariance @ turn.T))
        for axis in self.axes if len(self.axes) < 3 else ():
            nearest = int(np.argmax(np.abs(turn[:, axis])))
            off[nearest] = np.sign(turn[nearest, axis]) * left[axis]
            sigma[nearest] = np.sqrt(self.covariance[axis, axis])
        return Tie(self.a, self.b, self.in_a.id, self.in_b.id, off, sigma)


def fits(own: Found, places: SitePoses) -> bool:
    """Whether what is left may be chance."""
    return own.off_sigma(places) < REJECT_SIGMA


def worst_of_each(wrong: Sequence[Found], places: SitePoses) -> list[Found]:
    """The worst match of each two rows and kind."""
    worst: dict[tuple[tuple[str, str], str], Found] = {}
    for own in sorted(wrong, key=lambda own: own.off_sigma(places)):
        worst[own.rows, own.kind] = own
    return list(worst.values())


def path_tie(one: Overlap, places: SitePoses) -> Tie:
    """A common camera path as a tie: what is left at its middle."""
    a, b = places.rows[one.tie.a], places.rows[one.tie.b]
    turn = a.site_from_row[:3, :3]
    left = b.points(one.in_b[None])[0] - a.points(one.in_a[None])[0]
    sigma = np.sqrt(np.diag(turn @ np.diag(one.sigma_m**2) @ turn.T))
    name = f"{one.count} frames"
    return Tie(one.tie.a, one.tie.b, name, name, left, sigma)
