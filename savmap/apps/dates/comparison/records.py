"""Records of a comparison: two maps of one place, made at different times."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from savmap.apps.dates.comparison.elements import LEAN
from savmap.types import Floats, array_record

State = Literal["same", "moved", "changed", "new", "missing", "not seen"]
"""`moved`: its middle is elsewhere. `changed`: its size, its text or another of its figures is another. `not seen`: one
map has it, and the other's camera did not pass there, or its plugin was not asked."""
HIT = ("x", "z", LEAN)
"""Figures of a post that change where something hits it."""
CHANGES: tuple[State, ...] = ("moved", "changed", "new", "missing")


@dataclass(frozen=True)
class Difference:
    """A figure of an element on both dates.

    `what`: "x", "y" or "z" of its middle, "size x" (or y, z), or an attribute's name. `old` and `new` are metres (a
    lean's mm in 1 m, as its difference and sigma are), or texts; an old place stands in the new row's frame, scaled as
    the row is. `difference_m` is new less old without what all elements of a kind have in common; `sigma_m` is its
    standard deviation, and `p` the chance of at least as much where nothing changed. Texts have neither difference nor
    sigma. `edges`: along its axis, where the two edges that make a place or a size lie in the old map and in the new
    one, m, each in its own frame; figures of which these are equal are one measurement. `q`: the share of chance among
    all figures at least as unlikely.
    """

    what: str
    old: float | str
    new: float | str
    p: float
    difference_m: float | None = None
    sigma_m: float | None = None
    significant: bool = False
    edges: tuple[float, ...] = ()
    q: float = 1.0

    @property
    def sigmas(self) -> float:
        """The difference in standard deviations; 0 for texts."""
        return abs(self.difference_m / self.sigma_m) if self.difference_m is not None and self.sigma_m else 0.0


@dataclass(frozen=True, eq=False)
@array_record
class ElementChange:
    """An element of a row on both dates: its ids (None: that map has none), the text on it, the middle (3,) m in the
    new row's frame, and the figures that were tested. `p` is the least of theirs. `is_post`: it is slender and stands
    on the floor."""

    plugin: str
    label: str
    state: State
    old_id: str | None
    new_id: str | None
    text: str
    position_m: Floats
    differences: tuple[Difference, ...] = ()
    p: float = 1.0
    is_post: bool = False

    @property
    def hit(self) -> float | None:
        """The probability that a post stands elsewhere on the floor, or leans otherwise, as one that was hit does, or
        one that was set plumb again; None where it differs by no more than chance."""
        figures = [figure.q for figure in self.significant if figure.what in HIT]
        return 1 - min(figures) if self.is_post and figures else None

    @property
    def name(self) -> str:
        """The new id, or the old one of what is not there any more."""
        return self.new_id or self.old_id or ""

    @property
    def significant(self) -> tuple[Difference, ...]:
        """What of it differs by more than chance, the least likely first."""
        return tuple(sorted((figure for figure in self.differences if figure.significant), key=lambda figure: figure.p))


@dataclass(frozen=True)
class ScaleDifference:
    """By how much more, as a share, the new map measures along an axis ("x" or "y") of a row, with the standard
    deviation that the elements in common and both maps' own uncertainties of scale give it. `old_sigma`, `new_sigma`:
    the latter of each. `p`: the chance of at least as much where both maps' references hold."""

    axis: str
    share: float
    sigma: float
    old_sigma: float
    new_sigma: float
    p: float
    significant: bool = False

    @property
    def sigmas(self) -> float:
        """The difference in standard deviations."""
        return abs(self.share) / self.sigma


@dataclass(frozen=True, eq=False)
@array_record
class RowMotion:
    """How the old row's frame lies in the new one's: turned by `heading_deg` about y, counter-clockwise as seen from
    above, then moved by `shift_m` (3,). `covariance` (4, 4) of the shift in m and the heading in degrees, for a turn
    about `middle_m` (3,) of the new frame.

    `scale` (3,): by how much more, as a share, the new map measures along each axis from there. `pairs`: elements found
    in both. `alternatives_m`: shifts along x that fit as well as this one; if there are any, nothing in the row tells
    which is right.
    """

    shift_m: Floats
    heading_deg: float
    covariance: Floats
    scale: Floats
    middle_m: Floats
    pairs: int
    alternatives_m: tuple[float, ...] = ()

    @property
    def ambiguous(self) -> bool:
        """Whether another shift fits as well."""
        return bool(self.alternatives_m)

    @property
    def shift_covariance(self) -> Floats:
        """Covariance (3, 3) m^2 of `shift_m`: a heading that is off turns the frame's origin about the middle of the
        row."""
        lever = self.shift_m - self.middle_m
        by_heading = np.deg2rad([lever[2], 0.0, -lever[0]])
        slopes = np.column_stack([np.eye(3), by_heading])
        spread: Floats = slopes @ self.covariance @ slopes.T
        return spread

    def points(self, points: Floats) -> Floats:
        """Points (n, 3) of the old row in the new row's frame, scaled as that is."""
        turn = np.deg2rad(self.heading_deg)
        cos, sin = np.cos(turn), np.sin(turn)
        rigid = points @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T + self.shift_m
        scaled: Floats = rigid + self.scale * (rigid - self.middle_m)
        return scaled


@dataclass(frozen=True, eq=False)
@array_record
class RowComparison:
    """A row on both dates: its names, how the frames lie (None: nothing in common was found, and nothing is compared),
    its elements from left to right, the openings between them, of which only sizes are compared, and how the maps'
    scales differ, where anything tells."""

    old: str
    new: str
    motion: RowMotion | None
    elements: tuple[ElementChange, ...] = ()
    openings: tuple[ElementChange, ...] = ()
    scales: tuple[ScaleDifference, ...] = ()

    @property
    def scale_differs(self) -> bool:
        """Whether one map measures more than the other, beyond what the references of both allow."""
        return any(scale.significant for scale in self.scales)

    @property
    def changes(self) -> tuple[ElementChange, ...]:
        """Elements, then openings, that are not as they were."""
        return tuple(change for change in (*self.elements, *self.openings) if change.state in CHANGES)


@dataclass(frozen=True, eq=False)
@array_record
class Comparison:
    """Two maps of one place: rows that both have, and names of rows that only one has. `failed`: names of rows that one
    has, and that the other map's run could not map. `renamed`: a missing and a new row each that may be one, by name.
    `level`: the share of false ones among the changes that is accepted (Benjamini and Hochberg's false discovery
    rate)."""

    rows: tuple[RowComparison, ...]
    missing: tuple[str, ...]
    new: tuple[str, ...]
    level: float
    failed: tuple[str, ...] = ()
    renamed: tuple[tuple[str, str], ...] = ()

    @property
    def changed(self) -> bool:
        """Whether anything is not as it was, or one map's scale is not the other's."""
        return bool(self.missing or self.new) or any(row.changes or row.scale_differs for row in self.rows)

    @property
    def compared(self) -> bool:
        """Whether anything was compared: there is a row in which something in common was found."""
        return any(row.motion is not None for row in self.rows)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the rows of which the comparison cannot say whether they changed."""
        return (*(row.new for row in self.rows if row.motion is None), *self.failed)
