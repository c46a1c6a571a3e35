"""Records of maps: structures, rows, and rows in the frame of their site."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import not_
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, PlainSerializer

from savmap.types.common import Attribute, Axis, Bools, Floats, Ints, Measured, array_record, require
from savmap.types.evidence import PlanePatch
from savmap.types.pictures import ViewSpec
from savmap.types.rows import FrameTable, Trajectory
from savmap.types.verdicts import MapWarning, Verdict
from savmap.types.written import (
    LARGEST,
    QUATERNION,
    Covariance,
    Degrees,
    Metres,
    Outline,
    Point,
    SomeDeviations,
    SomeMetres,
    SomeNumbers,
    WorldMetres,
    rounded,
)

if TYPE_CHECKING:
    import pandas

SIGMA, METRES = "_sigma_m", "_m"
UNCHECKED = "unchecked_m"
"""Attribute: how far, m, a structure may be off before a second reference shows it; none of next to nothing."""
ASSUMED_M = 0.03
"""A coordinate that was not solved for and has a larger standard deviation than this, m, is an assumption."""
ENDS = ("ends", "edges")
"""Attributes in which plugins say which ends were not measured: "top assumed", "upper edge not seen", "neither edge
seen"."""
OFF_SIGMAS = 3.0
"""What differs by more standard deviations than these is contradicted."""
Deviations = Annotated[float, Field(ge=0, le=LARGEST), PlainSerializer(lambda value: min(rounded(value), LARGEST))]
LatLon = Annotated[
    tuple[Annotated[float, Field(ge=-90, le=90)], Annotated[float, Field(ge=-180, le=180)]],
    PlainSerializer(lambda angles: rounded(angles, QUATERNION)),
]


@dataclass(frozen=True, eq=False)
@array_record
class Solid:
    """The space that a structure fills: a flat outline (n, 3) m in the row's frame, corners in order, pushed along
    `depth` (3,) m.

    `assumed`: the depth was neither measured nor given. `ifc_class`: what the structure is in a building model, such as
    IfcBeam.
    """

    outline: Annotated[Outline, Field(alias="outline_m")]
    depth: Annotated[Point, Field(alias="depth_m")]
    assumed: bool
    ifc_class: Annotated[
        str, Field(pattern="^Ifc[A-Za-z0-9]+$", max_length=80, description="its class in building models")
    ] = "IfcBuildingElementProxy"

    def __post_init__(self) -> None:
        require(self.outline.shape == (len(self.outline), 3) and len(self.outline) >= 3, self, "outline (n, 3), n >= 3")
        require(self.depth.shape == (3,) and bool(np.linalg.norm(self.depth) > 0), self, "depth (3,), not zero")
        finite = np.isfinite(self.outline).all() and np.isfinite(self.depth).all()
        require(bool(finite), self, "a number of its outline or depth is not finite")


@dataclass(frozen=True, eq=False)
@array_record
class Structure:
    """A mapped structure: vertices (n, 3) m in the row's frame with covariances (n, 3, 3) m^2 and labels (n), edges (m,
    2), pairs of vertex numbers from 0, and the space that it fills, where its plugin knows that (None: it is lines
    alone)."""

    id: str
    label: str
    vertices: Floats
    covariances: Floats
    vertex_labels: tuple[str, ...]
    edges: Ints
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    solid: Solid | None = None

    def __post_init__(self) -> None:
        count = len(self.vertices)
        require(
            self.vertices.shape == (count, 3) and self.covariances.shape == (count, 3, 3),
            self,
            "vertices (n, 3), covariances (n, 3, 3)",
        )
        require(len(self.vertex_labels) == count, self, "vertices and vertex_labels differ in number")

    @property
    def vertex_names(self) -> tuple[str, ...]:
        """What each vertex is called in its row: its label, after the structure's id where that is not in it."""
        return tuple(label if label.startswith(self.id) else f"{self.id} / {label}" for label in self.vertex_labels)

    @property
    def unchecked_m(self) -> float | None:
        """How far it may be off before a second reference shows it; None where that is next to nothing."""
        value = self.attributes.get(UNCHECKED)
        return float(value) if isinstance(value, float | int) else None

    def sizes(self) -> Iterator[tuple[str, float, float]]:
        """Lengths among its attributes that have a standard deviation: name in words, such as "clear width", m, m. One
        is `Measured`, or "width_m" goes with "width_sigma_m"."""
        for key, given in self.attributes.items():
            if key.endswith(METRES) and isinstance(given, Measured):
                yield key.removesuffix(METRES).replace("_", " "), given.value, given.sigma
            value = self.attributes.get(key.removesuffix(SIGMA) + METRES)
            if key.endswith(SIGMA) and isinstance(given, float | int) and isinstance(value, float | int):
                yield key.removesuffix(SIGMA).replace("_", " "), float(value), float(given)

    def assumed(self, plugin: str, joint: "JointCovariance | None") -> Bools:
        """For each vertex and axis (n, 3) whether nothing measured the coordinate: its plugin takes it to be so, such
        as where a post ends that goods hide. It is unsure and was not solved for, as far as `joint` knows, or it is the
        least sure one of an end that its plugin says it assumes."""
        variances = np.diagonal(self.covariances, axis1=1, axis2=2)
        solved: Bools = np.ones(variances.shape, bool)
        if joint is not None:
            numbers = range(len(self.vertices))
            solved = np.array([joint.solved(plugin, self, number) for number in numbers], bool).reshape(-1, 3)
        unsure = (variances > ASSUMED_M**2) & ~solved
        assumed: Bools = unsure | (self._assumed_ends()[:, None] & (variances == variances.max(axis=1, keepdims=True)))
        return assumed

    def _assumed_ends(self) -> Bools:
        """Which vertices (n,) its plugin says that it assumes, by their labels or by words of these; all, where it
        names none."""
        assumed = np.zeros(len(self.vertices), bool)
        for text in (self.attributes[key] for key in ENDS if isinstance(self.attributes.get(key), str)):
            words = set(str(text).split())
            named = np.array([f" {label} " in f" {text} " for label in self.vertex_labels], bool)
            if not named.any():
                named = np.array([bool(words.intersection(label.split())) for label in self.vertex_labels], bool)
            assumed |= named if named.any() else True
        return assumed


@dataclass(frozen=True, eq=False)
@array_record
class CrossRowLandmark:
    """A point of a structure that another row may have mapped too.

    `id` is the structure's. Landmarks of one `kind` look alike, so that one may be taken for another. `place` (3,) m in
    the row's frame has `covariance` (3, 3) m^2. `axes` are those of the row along which both rows see the landmark in
    the same place. `behind_m`: only rows back to back share the landmark, with faces no further apart than that; None:
    any rows may.
    """

    id: str
    kind: str
    place: Floats
    covariance: Floats
    axes: tuple[Axis, ...] = ("x", "y", "z")
    behind_m: float | None = None

    def __post_init__(self) -> None:
        require(self.place.shape == (3,) and self.covariance.shape == (3, 3), self, "place (3,), covariance (3, 3)")
        finite = np.isfinite(self.place).all() and np.isfinite(self.covariance).all()
        require(bool(finite), self, f"a number of `{self.id}` is not finite")
        require(bool(self.axes), self, "at least one axis is needed")


@dataclass(frozen=True)
class ReferenceUse:
    """A reference of the solve: its name, the given value, its given standard deviation and the solved value, all in
    `unit`. `softened`: the larger standard deviation that it was used with, where references contradict one another.
    `left_out`: it was not used."""

    name: str
    value: float
    sigma: float
    solved: float
    unit: str = "m"
    softened: float | None = None
    left_out: bool = False

    @property
    def sigma_used(self) -> float | None:
        """The standard deviation that it was used with; None where it was not used."""
        return None if self.left_out else max(self.softened or 0.0, self.sigma)

    @property
    def deviation(self) -> float:
        """Solved less given, in given standard deviations."""
        return (self.solved - self.value) / self.sigma

    @property
    def state(self) -> Literal["used", "softened", "contradicted", "left out"]:
        """In a word: how it was used, or that it was used and the solution contradicts it."""
        if self.left_out:
            return "left out"
        if abs(self.deviation) > OFF_SIGMAS:
            return "contradicted"
        return "softened" if self.softened else "used"


@dataclass(frozen=True, eq=False)
@array_record
class JointCovariance:
    """How the errors of a row's vertices go together: what two of them share does not count in the distance between
    them.

    `coordinates`: by plugin and structure id, for each vertex and axis (v, 3) the number of the solved coordinate that
    it is, -1 where it shares its error with no other. `covariance` (n, n) m^2 of the solved coordinates. `hidden` (k,
    n): how far, m, each of them is off with each error of a reference that no second one would show.
    """

    coordinates: Mapping[str, Mapping[str, Ints]]
    covariance: Floats
    hidden: Floats = field(default_factory=lambda: np.zeros((0, 1)))

    def __post_init__(self) -> None:
        require(self.covariance.shape == (len(self.covariance),) * 2, self, "covariance must be (n, n)")
        fits = self.hidden.shape in ((0, 1), (len(self.hidden), len(self.covariance)))
        require(fits, self, "hidden must be (k, n)")

    def moves(self, plugin: str, structure: Structure, vertex: int) -> Floats:
        """How far (k, 3) m a vertex is off with each error of a reference that no second one would show."""
        numbers = self._numbers(plugin, structure, vertex)
        moved: Floats = np.where(numbers >= 0, np.take(self.hidden, numbers, axis=1, mode="clip"), 0.0)
        return moved

    def of_difference(self, first: tuple[str, Structure, int], second: tuple[str, Structure, int]) -> Floats:
        """Covariance (3, 3) m^2 of the difference of two vertices of the row, each given as plugin, structure and the
        vertex's number."""
        if (first[0], first[1].id, first[2]) == (second[0], second[1].id, second[2]):
            return np.zeros((3, 3))
        numbers = np.concatenate([self._numbers(*first), self._numbers(*second)])
        variances = np.concatenate([np.diag(structure.covariances[vertex]) for _, structure, vertex in (first, second)])
        solved = numbers >= 0
        both = np.diag(np.where(solved, 0.0, variances))
        both[np.ix_(solved, solved)] = self.covariance[np.ix_(numbers[solved], numbers[solved])]
        difference: Floats = both[:3, :3] + both[3:, 3:] - both[:3, 3:] - both[3:, :3]
        return difference

    def solved(self, plugin: str, structure: Structure, vertex: int) -> tuple[bool, ...]:
        """Whether each coordinate of a vertex was solved for; what was not is what the plugin takes it to be."""
        return tuple(bool(number >= 0) for number in self._numbers(plugin, structure, vertex))

    def _numbers(self, plugin: str, structure: Structure, vertex: int) -> Ints:
        numbers = self.coordinates.get(plugin, {}).get(structure.id)
        return np.full(3, -1) if numbers is None else numbers[vertex]


SKIPPED = "frames skipped"
"""A row's figure: how many frames of its passes the decoder left out."""
PROVISIONAL = "note provisional"
"""A row's figure: of which frames it is mapped while the walk goes on."""


@dataclass(frozen=True, eq=False)
@array_record
class RowMap:
    """The map of one row: frames, views by name, trajectory, structures by plugin, references, figures for the report,
    the part of a plane, in metres, that is the row's face where a plugin says so (which map files do not hold), the
    verdict (None: nobody judged), and how the errors of the vertices go together (None: not known)."""

    name: str
    frames: FrameTable
    views: Mapping[str, ViewSpec]
    trajectory: Trajectory
    structures: Mapping[str, tuple[Structure, ...]]
    references: tuple[ReferenceUse, ...]
    report: Mapping[str, float | int | str] = field(default_factory=dict)
    face: PlanePatch | None = None
    verdict: Verdict | None = None
    joint: JointCovariance | None = None

    @property
    def skipped(self) -> int:
        """How many frames of its passes the decoder left out; 0 where an older map does not say."""
        return int(self.report.get(SKIPPED, 0))


@dataclass(frozen=True, eq=False)
@array_record
class Placement:
    """Where a row stands in the site's frame (y up, metres): its origin at (x, 0, z), its x axis turned by
    `heading_deg` about y, counter-clockwise as seen from above. `covariance` (3, 3) of x m, z m and heading in
    degrees."""

    x_m: Metres
    z_m: Metres
    heading_deg: Degrees
    covariance: Annotated[Covariance, Field(description="xx, xz, xh, zz, zh, hh of x m, z m, heading degrees")]

    def __post_init__(self) -> None:
        require(self.covariance.shape == (3, 3), self, "covariance must be (3, 3)")

    @property
    def site_from_row(self) -> Floats:
        """Transform (4, 4)."""
        turn = np.deg2rad(self.heading_deg)
        cos, sin = np.cos(turn), np.sin(turn)
        transform: Floats = np.array([[cos, 0, sin, self.x_m], [0, 1, 0, 0], [-sin, 0, cos, self.z_m], [0, 0, 0, 1]])
        return transform

    def points(self, points: Floats) -> Floats:
        """Points (n, 3) of the row in the site's frame."""
        transform = self.site_from_row
        moved: Floats = points @ transform[:3, :3].T + transform[:3, 3]
        return moved

    def covariances(self, points: Floats, covariances: Floats) -> Floats:
        """Covariances (n, 3, 3) of points (n, 3) of the row, in the site's frame; the placement's own covariance is
        added."""
        turn, slopes = self.site_from_row[:3, :3], self.slopes(points)
        whole: Floats = turn @ covariances @ turn.T + slopes @ self.covariance @ np.swapaxes(slopes, 1, 2)
        return whole

    def slopes(self, points: Floats) -> Floats:
        """Derivatives (n, 3, 3) of points (n, 3) of the row, in the site's frame, by x m, z m and heading in
        degrees."""
        arm = points @ self.site_from_row[:3, :3].T
        slopes: Floats = np.zeros((len(points), 3, 3))
        slopes[:, 0, 0] = slopes[:, 2, 1] = 1.0
        slopes[:, 0, 2], slopes[:, 2, 2] = np.deg2rad(arm[:, 2]), -np.deg2rad(arm[:, 0])
        return slopes


@dataclass(frozen=True, eq=False)
@array_record
class AlignmentResidual:
    """How far a place of the map is from where the user knows it, after the alignment: `residual_m` (3,) is the given
    place less the map's, in the world's axes, `sigma_m` (3,) its standard deviation; of a line, across it. Both are NaN
    (in a file: null) along axes that were not given. `deviation` is the residual in standard deviations. `used`:
    whether the alignment rests on it, too."""

    row: str
    at: str
    residual_m: SomeNumbers
    sigma_m: SomeDeviations
    deviation: Deviations
    used: bool = True

    def __post_init__(self) -> None:
        require(self.residual_m.shape == (3,) and self.sigma_m.shape == (3,), self, "residual_m (3,), sigma_m (3,)")


@dataclass(frozen=True, eq=False)
@array_record
class Alignment:
    """Where the site stands in the user's world (z up, metres): the site's x axis points `heading_deg`
    counter-clockwise from the world's, its origin is at (x, y, z). `covariance` (3, 3) of x m, y m and heading in
    degrees. `anchor`: latitude and longitude, degrees (WGS 84), of the world's origin, if its x axis points east and
    its y axis north. `residuals`: of the places that it was solved from. `scale`: how much longer the user's distances
    between them are than the map's, which stays as it is (None: they do not tell)."""

    x_m: WorldMetres
    y_m: WorldMetres
    heading_deg: Degrees
    covariance: Annotated[Covariance, Field(description="xx, xy, xh, yy, yh, hh of x m, y m, heading degrees")]
    z_m: Metres = 0.0
    anchor: Annotated[LatLon | None, Field(alias="anchor_lat_lon_deg")] = None
    residuals: Annotated[tuple[AlignmentResidual, ...], Field(exclude_if=not_)] = ()
    scale: Annotated[Measured | None, Field(exclude_if=not_)] = None

    def __post_init__(self) -> None:
        require(self.covariance.shape == (3, 3), self, "covariance must be (3, 3)")

    @property
    def world_from_level(self) -> Floats:
        """Transform (4, 4) from the site's frame, turned so that z points up, to the world's."""
        turn = np.deg2rad(self.heading_deg)
        cos, sin = np.cos(turn), np.sin(turn)
        transform: Floats = np.array(
            [[cos, -sin, 0, self.x_m], [sin, cos, 0, self.y_m], [0, 0, 1, self.z_m], [0, 0, 0, 1]]
        )
        return transform

    def covariances(self, points: Floats) -> Floats:
        """Covariances (n, 3, 3) m^2 that the alignment's own gives points (n, 3) of the world."""
        arm = np.deg2rad(points - np.array([self.x_m, self.y_m, self.z_m]))
        slopes = np.zeros((len(points), 3, 3))
        slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
        slopes[:, 0, 2], slopes[:, 1, 2] = -arm[:, 1], arm[:, 0]
        whole: Floats = slopes @ self.covariance @ np.swapaxes(slopes, 1, 2)
        return whole


@dataclass(frozen=True, eq=False)
@array_record
class CrossRowMatch:
    """A structure, or a stretch of frames, that two rows have in common, by its id in either row.

    `residual_m` (3,) is b's place less a's in the site's frame, once the rows are placed; `sigma_m` (3,) is its
    standard deviation. Both are NaN (in a file: null) along axes that the match does not measure.
    """

    row_a: str
    row_b: str
    id_a: str
    id_b: str
    residual_m: SomeMetres
    sigma_m: SomeDeviations


@dataclass(frozen=True, eq=False)
@array_record
class SiteMap:
    """The map of a site.

    `rows`: the mapped rows by name. `made_by`: versions of software and models. `failed`: rows that could not be
    mapped, and why. `placements`: where rows stand in the site's frame, as far as that is known. `matches`: what
    neighbouring rows have in common. `alignment`: where the site stands in the user's world, where that is known.
    """

    rows: Mapping[str, RowMap]
    made_by: Mapping[str, str]
    failed: Mapping[str, str] = field(default_factory=dict)
    placements: Mapping[str, Placement] = field(default_factory=dict)
    matches: tuple[CrossRowMatch, ...] = ()
    alignment: Alignment | None = None

    def to_dataframe(self) -> "pandas.DataFrame":
        """A pandas table with a line for each vertex: row, plugin, structure (its id), label, vertex (its label),
        position x_m, y_m, z_m and standard deviations sigma_x_m, sigma_y_m, sigma_z_m in the row's frame, assumed (the
        axes along which nothing measured it, such as "y"), warnings (what the row's verdict says against the structure,
        or the whole row; empty where it says nothing), and the structure's attributes."""
        import pandas  # slow to import

        return pandas.DataFrame(list(self._vertices()))

    def warnings(self) -> Mapping[tuple[str, str], Sequence[str]]:
        """What the rows' verdicts say against structures, by row and id, in lines: see `warnings_of`."""
        return {
            (row.name, structure.id): [warning.line for warning in warnings_of(row, structure.id)]
            for row in self.rows.values()
            for structures in row.structures.values()
            for structure in structures
        }

    @property
    def banner(self) -> str:
        """Which rows could not be mapped, which must be checked before their map is used, and which are provisional, in
        one line; "" where there are none."""
        provisional = [name for name, row in self.rows.items() if PROVISIONAL in row.report]
        against = [name for name, row in self.rows.items() if row.verdict and row.verdict.warnings]
        warned = [name for name in against if name not in provisional]
        count = len(self.rows.keys() | self.failed.keys())
        rows = "1 row" if count == 1 else f"{count} rows"
        parts = (
            ([*self.failed], "could not be mapped"),
            (warned, "must be checked"),
            (provisional, "mapped provisionally, while the walk goes on"),
        )
        return "; ".join(f"{len(names)} of {rows} {what}: {', '.join(names)}" for names, what in parts if names)

    html: ClassVar[Callable[["SiteMap"], str | None]] = staticmethod(lambda _: None)
    """What a notebook shows of a map; set where there is something that can tell."""

    def _repr_html_(self) -> str | None:
        return SiteMap.html(self)

    def _vertices(self) -> Iterator[dict[str, object]]:
        for row in self.rows.values():
            for plugin, structures in row.structures.items():
                for structure in structures:
                    yield from _vertex_lines(row, plugin, structure)


def assumed_axes(structure: Structure, plugin: str, joint: JointCovariance | None) -> list[str]:
    """For each vertex the axes along which nothing measured it: "", "y", "xy"."""
    assumed = structure.assumed(plugin, joint)
    return ["".join(np.array(["x", "y", "z"])[vertex]) for vertex in assumed]


def warnings_of(row: RowMap, structure: str) -> tuple[MapWarning, ...]:
    """What a row's verdict says against one of its structures: what is about it, and what is about the whole row."""
    warnings = row.verdict.warnings if row.verdict else ()
    return tuple(warning for warning in warnings if warning.of_row or structure in warning.subjects)


def _vertex_lines(row: RowMap, plugin: str, structure: Structure) -> Iterator[dict[str, object]]:
    element = {"row": row.name, "plugin": plugin, "structure": structure.id, "label": structure.label}
    warnings = "; ".join(warning.line for warning in warnings_of(row, structure.id))
    axes = assumed_axes(structure, plugin, row.joint)
    vertices = zip(structure.vertex_labels, structure.vertices, structure.covariances, axes, strict=True)
    for label, position, covariance, assumed in vertices:
        place = dict(zip(("x_m", "y_m", "z_m"), position.tolist(), strict=True))
        sigmas = dict(zip(("sigma_x_m", "sigma_y_m", "sigma_z_m"), np.sqrt(np.diag(covariance)).tolist(), strict=True))
        vertex = {"vertex": label, **place, **sigmas, "assumed": assumed, "warnings": warnings}
        yield {**element, **vertex, **structure.attributes}
