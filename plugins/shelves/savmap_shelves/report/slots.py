"""The openings of racks: where goods stand, how wide and high each is, and how surely that is known; the clear spaces
that two dates are compared by, and the names of bays and levels."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from savmap.maps.exports.frames import alignment_of, in_site, in_world
from savmap.types import Attribute, Floats, JointCovariance, Measured, RowMap, SiteMap, Structure, array_record
from savmap_shelves.mapping import BEAM_CORNERS, RING, USUAL_RACK_DEPTH_M, mean_of, number_of

FRAMES = ("world", "row")
FLOOR = Measured(0.0, 0.0)
"""What all heights are above."""
CLEAR_HEIGHT, LOAD_HEIGHT, DEPTH = "clear height", "load height", "depth"


@dataclass(frozen=True, eq=False)
@array_record
class Slot:
    """An opening of a row's face, between two uprights, on a beam (level 1, 2, ...) or on the floor (level 0).

    `centre` (3,) m lies in the face, in the world's frame (z up), or, with `frame` "row", in the row's own turned z up;
    `covariance` (3, 3). The topmost opening is open above (`clear_height` None): its centre is on its load level.
    `load_height` is that of what goods stand on above the floor. `clear_width` is None where an upright beside it was
    not mapped. Lengths are metres. `depth_m` is the rack's. `assumed`: which of these lengths rest on an edge that
    nothing measured. `warnings`: what speaks against the uprights and beams around it. `unchecked_m`: how far these may
    be off before a second reference shows it.
    """

    row: str
    frame: str
    bay: int
    level: int
    signs: tuple[str, ...]
    bay_signs: tuple[str, ...]
    centre: Floats
    covariance: Floats
    clear_width: Measured | None
    clear_height: Measured | None
    load_height: Measured
    depth_m: float
    depth_assumed: bool
    assumed: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    unchecked_m: float | None = None


@dataclass(frozen=True)
class Bay:
    """A bay of a row: from where to where it is open along x, its clear width, its depth, z of its face, the beams from
    the floor up, and the ids of the uprights beside it; all m in the row's frame."""

    number: int
    extent: tuple[Measured, Measured]
    clear_width: Measured | None
    depth_m: float
    depth_assumed: bool
    face: Measured
    beams: Sequence[Structure]
    uprights: tuple[str, ...]


@dataclass(frozen=True)
class Opening:
    """A space of a bay: its level (0 on the floor), the height of what goods stand on, of the beam above and of the
    clear space between, m; the last two are None where it is open above. `beams`: the ids of those below and above.
    `assumed`: as in `Slot`."""

    level: int
    floor: Measured
    roof: Measured | None
    clear_height: Measured | None
    beams: tuple[str, ...]
    assumed: tuple[str, ...] = ()


def slots_of(site: SiteMap, plugin: str) -> list[Slot]:
    """The openings of all rows, row by row, from left to right and from the floor up. Raises OutputError for a map
    whose structures are not such as the plugin makes them."""
    return [slot for row in site.rows.values() for slot in _slots_of_row(site, row, plugin)]


def _slots_of_row(site: SiteMap, row: RowMap, plugin: str) -> list[Slot]:
    """The row's slots in the world's frame; in the row's own if it has no place there: neither among other rows nor,
    being alone, by the alignment."""
    bays = bays_of(row.structures.get(plugin, ()), row.joint, plugin)
    signs = [
        part
        for name, group in row.structures.items()
        if name != plugin
        for part in group
        if part.attributes.get("text") and "bay" in part.attributes
    ]
    placement = site.placements.get(row.name)
    alignment = alignment_of(site, row.name) if placement is not None or len(site.rows) == 1 else None
    is_placed = placement is not None or alignment is not None
    said = {name: warning for (owner, name), warning in site.warnings().items() if owner == row.name}
    slots = [slot for bay in bays for slot in _slots_of_bay(row, plugin, bay, signs, said)]
    if not slots:
        return []
    centres = np.array([slot.centre for slot in slots])
    covariances = np.array([slot.covariance for slot in slots])
    points = Structure("slots", "slot", centres, covariances, ("",) * len(slots), np.zeros((0, 2), np.int64))
    moved = in_world(in_site(points, placement), alignment)
    frame = FRAMES[0] if is_placed else FRAMES[1]
    return [
        replace(slot, frame=frame, centre=centre, covariance=covariance)
        for slot, centre, covariance in zip(slots, moved.vertices, moved.covariances, strict=True)
    ]


def bays_of(structures: Sequence[Structure], joint: JointCovariance | None, plugin: str) -> list[Bay]:
    """The bays that have beams, from left to right. Raises OutputError for structures that lack what the plugin gives
    them."""
    uprights = {number_of(part, "upright"): part for part in structures if part.label == "upright"}
    grouped: dict[int, list[Structure]] = {}
    for part in structures:
        if part.label == "beam":
            grouped.setdefault(number_of(part, "bay"), []).append(part)
    sides = {number: (uprights.get(number), uprights.get(number + 1)) for number in grouped}
    return [
        _bay(number, sorted(beams, key=lambda beam: mean_of(beam, 1, "lower")), *sides[number], joint, plugin)
        for number, beams in sorted(grouped.items())
    ]


def _bay(
    number: int,
    beams: Sequence[Structure],
    left: Structure | None,
    right: Structure | None,
    joint: JointCovariance | None,
    plugin: str,
) -> Bay:
    """A bay between uprights, if both were mapped; where one was not, the bay ends with its beams."""
    uprights = [upright for upright in (left, right) if upright is not None]
    extent = (
        edge(left, 0, "right") if left else edge(beams[0], 0, "left"),
        edge(right, 0, "left") if right else edge(beams[0], 0, "right"),
    )
    solid = next((upright.solid for upright in uprights if upright.solid), None)
    face = edge(uprights[0], 2) if uprights else edge(beams[0], 2)
    return Bay(
        number,
        extent,
        gap(joint, plugin, (left, "right"), (right, "left"), 0) if left and right else None,
        USUAL_RACK_DEPTH_M if solid is None else float(np.linalg.norm(solid.depth)),
        solid is None or solid.assumed,
        face,
        beams,
        tuple(upright.id for upright in uprights),
    )


def openings_of(bay: Bay, joint: JointCovariance | None, plugin: str) -> Iterator[Opening]:
    """The openings of a bay from the floor up; the topmost is open above."""
    for level, (below, above) in enumerate(pairwise((None, *bay.beams, None))):
        floor = FLOOR if below is None else edge(below, 1, "upper")
        roof = None if above is None else edge(above, 1, "lower")
        height = roof
        if above is not None and below is not None:
            height = gap(joint, plugin, (below, "upper"), (above, "lower"), 1)
        low = below is not None and is_assumed(below, "upper", plugin, joint)
        high = above is not None and (low or is_assumed(above, "lower", plugin, joint))
        assumed = tuple(name for name, is_so in ((CLEAR_HEIGHT, high), (LOAD_HEIGHT, low)) if is_so)
        yield Opening(
            level, floor, roof, height, tuple(beam.id for beam in (below, above) if beam is not None), assumed
        )


def is_assumed(beam: Structure, side: str, plugin: str, joint: JointCovariance | None) -> bool:
    """Whether nothing measured how high a side of a beam is."""
    heights = beam.assumed(plugin, joint)[:, 1]
    return any(bool(height) for height, label in zip(heights, beam.vertex_labels, strict=True) if side in label.split())


def edge(structure: Structure, axis: int, side: str = "") -> Measured:
    """Coordinate of a structure's edge: the mean of its vertices on that side, which share their error. Raises
    OutputError where no vertex is on it."""
    value = mean_of(structure, axis, side) if side else float(structure.vertices[:, axis].mean())
    chosen = [not side or side in label.split() for label in structure.vertex_labels]
    variance = float(structure.covariances[chosen, axis, axis].mean())
    return Measured(value, float(np.sqrt(max(variance, 0.0))))


def gap(
    joint: JointCovariance | None, plugin: str, first: tuple[Structure, str], second: tuple[Structure, str], axis: int
) -> Measured:
    """From an edge, a structure and a side of it, to another one along an axis, m. The standard deviation leaves out
    what both share; of a map that does not know that, it is that of two edges whose errors are independent."""
    start, end = edge(first[0], axis, first[1]), edge(second[0], axis, second[1])
    if joint is None:
        return Measured(end.value - start.value, float(np.hypot(start.sigma, end.sigma)))
    ends = [
        (plugin, structure, next(k for k, label in enumerate(structure.vertex_labels) if side in label.split()))
        for structure, side in (first, second)
    ]
    variance = joint.of_difference(ends[0], ends[1])[axis, axis]
    return Measured(end.value - start.value, float(np.sqrt(max(variance, 0.0))))


def _slots_of_bay(
    row: RowMap, plugin: str, bay: Bay, signs: Sequence[Structure], said: Mapping[str, Sequence[str]]
) -> Iterator[Slot]:
    """The openings of a bay from the floor up, in the row's frame. `said`: what speaks against structures, by id."""
    here = sorted((part for part in signs if part.attributes["bay"] == f"bay {bay.number}"), key=_middle_x)
    unchecked = {part.id: part.unchecked_m for part in row.structures.get(plugin, ())}
    at_bay = tuple(str(part.attributes["text"]) for part in here if not _between_uprights(part, bay))
    for opening in openings_of(bay, row.joint, plugin):
        centre, covariance = _centre(bay, opening.floor, opening.roof or opening.floor)
        inside = [part for part in here if _between_uprights(part, bay) and _level(part, bay) == opening.level]
        depth, around = (bay.depth_m, bay.depth_assumed), (*bay.uprights, *opening.beams)
        yield Slot(
            row.name,
            "row",
            bay.number,
            opening.level,
            tuple(str(part.attributes["text"]) for part in inside),
            at_bay,
            centre,
            covariance,
            bay.clear_width,
            opening.clear_height,
            opening.floor,
            *depth,
            (*opening.assumed, *([DEPTH] if bay.depth_assumed else [])),
            tuple(dict.fromkeys(warning for name in around for warning in said.get(name, ()))),
            max((off_m for name in around if (off_m := unchecked[name]) is not None), default=None),
        )


def _centre(bay: Bay, floor: Measured, roof: Measured) -> tuple[Floats, Floats]:
    """The middle (3,) of an opening in the bay's face and its covariance (3, 3), opposite edges taken for
    independent."""
    sides = (*bay.extent,), (floor, roof), (bay.face, bay.face)
    middle = np.array([(first.value + second.value) / 2 for first, second in sides])
    sigmas = [np.hypot(first.sigma, second.sigma) / 2 for first, second in sides[:2]]
    return middle, np.diag(np.square([*sigmas, bay.face.sigma]))


def _middle_x(sign: Structure) -> float:
    return float(sign.vertices[:, 0].mean())


def _between_uprights(sign: Structure, bay: Bay) -> bool:
    """Whether a sign hangs in front of an opening or a beam; what hangs on an upright names the bay."""
    left, right = bay.extent
    return left.value <= _middle_x(sign) <= right.value


def _level(sign: Structure, bay: Bay) -> int:
    """The level that a sign names: that of the beam on which it hangs, or of the opening in which it hangs."""
    middle = float(sign.vertices[:, 1].mean())
    return sum(edge(beam, 1, "lower").value <= middle for beam in bay.beams)


UPRIGHT_LINE = np.array([[0, 1]])
ENDS = ("lower", "upper")
FLOOR_OPENING = "floor opening"
"""What stands on the floor shares the error of the row's height, which no other opening has."""


def openings(structures: Sequence[Structure], plugin: str = "shelves") -> list[Structure]:
    """A structure "bay 3 / opening 2" for each slot with a beam above it, numbered by the beam it stands on; 0 stands
    on the floor. Its corners are those of the clear space between uprights and beams; where an upright was not mapped,
    it is a line in the middle of the bay, which has a height alone. Raises OutputError for structures that lack what
    the plugin gives them."""
    return [
        _opening_structure(bay, opening, opening.roof)
        for bay in bays_of(structures, None, plugin)
        for opening in openings_of(bay, None, plugin)
        if opening.roof is not None
    ]


def places(
    structures: Sequence[Structure], plugin: str = "shelves", joint: JointCovariance | None = None
) -> list[Structure]:
    """The bays, "bay 3", from the floor to their topmost beam, and their levels, "bay 3 / level 2", which are the slots
    of the export: the space on a beam up to the next one, level 0 on the floor; the topmost is open above and lies on
    its beam. A bay is also called a bay. Clear widths and heights are among the attributes, as the slots have them;
    what is not known is not there. `assumed`: "clear height assumed"."""
    bays = bays_of(structures, joint, plugin)
    return [place for bay in bays for place in _bay_places(bay, joint, plugin)]


def _bay_places(bay: Bay, joint: JointCovariance | None, plugin: str) -> Iterator[Structure]:
    """A bay and its levels."""
    yield _between_heights(f"bay {bay.number}", "bay", bay, FLOOR, edge(bay.beams[-1], 1, "upper"), {})
    for opening in openings_of(bay, joint, plugin):
        name = f"bay {bay.number} / level {opening.level}"
        more: dict[str, Attribute] = {"level": opening.level}
        if opening.clear_height:
            more["clear_height_m"] = opening.clear_height
        if opening.assumed:
            more["assumed"] = f"{', '.join(opening.assumed)} assumed"
        yield _between_heights(name, "level", bay, opening.floor, opening.roof or opening.floor, more)


def _between_heights(
    name: str, label: str, bay: Bay, low: Measured, high: Measured, more: Mapping[str, Attribute]
) -> Structure:
    """The rectangle of a bay between two heights."""
    width = {"clear_width_m": bay.clear_width} if bay.clear_width else {}
    attributes = {"bay": bay.number, **width, **more}
    return _structure(name, label, bay.extent, (low, high), bay.face, attributes)


def _opening_structure(bay: Bay, opening: Opening, roof: Measured) -> Structure:
    left, right = bay.extent
    middle = Measured((left.value + right.value) / 2, float(np.hypot(left.sigma, right.sigma)) / 2)
    xs = bay.extent if bay.clear_width else (middle,)
    name, label = f"bay {bay.number} / opening {opening.level}", "opening" if opening.level else FLOOR_OPENING
    attributes: dict[str, Attribute] = {"bay": bay.number, "level": opening.level}
    return _structure(name, label, xs, (opening.floor, roof), bay.face, attributes)


def _structure(
    name: str,
    label: str,
    xs: Sequence[Measured],
    ys: Sequence[Measured],
    z: Measured,
    attributes: Mapping[str, Attribute],
) -> Structure:
    """A rectangle in the face, or, of a single x, an upright line."""
    labels, edges = (BEAM_CORNERS, RING) if len(xs) == 2 else (ENDS, UPRIGHT_LINE)
    corners = [(x, y, z) for y in ys for x in xs]
    return Structure(
        name,
        label,
        np.array([[side.value for side in corner] for corner in corners]),
        np.array([np.diag([side.sigma**2 for side in corner]) for corner in corners]),
        tuple(f"{name} / {part}" for part in labels),
        edges,
        attributes,
    )
