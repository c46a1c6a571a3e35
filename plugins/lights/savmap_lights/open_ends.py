"""What of lamps is not measured: an end out of sight, light that no lamp explains, and the space that they fill."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.plugin import Floats, Solid, Structure, Track
from savmap_lights.tracking import BESIDE, BY_MASK, SEEN_TO

FEWEST, ALIKE, ALIKE_M, MOST = 2, 0.01, 0.02, 0.75
ENOUGH = 0.6
UNKNOWN_M = 1000.0
"""The standard deviation of what is not known: of a strip's end that no frame showed, along the strip."""
SIDES, SIDES_NOT_SEEN = "sides", "not seen"
"""The attribute of a compact lamp, and its value where the brightness falls around it in at most a quarter of the
frames."""
LIGHT_BESIDE = "light beside, x m"
"""The attribute of a lamp that tells where, beside it, something shines that may be a lamp too."""


def is_whole(lamp: Structure) -> bool:
    """Whether all of a lamp's ends were seen."""
    return bool((np.diagonal(lamp.covariances, axis1=1, axis2=2) < (UNKNOWN_M / 2) ** 2).all())


def with_open_ends(lamps: Sequence[Structure], tracks: Sequence[Track]) -> list[Structure]:
    """The lamps; those with one end in sight get a vertex for the other: at the length of most other strips, if these
    have one and it was seen lit for most of that; else as far as it was, `UNKNOWN_M` along x."""
    seen_to = _by_lamp(tracks, SEEN_TO)
    length = common_length([lamp for lamp in lamps if len(lamp.vertices) == 2])
    return [_opened(lamp, seen_to[lamp.id], length, lamps) if lamp.id in seen_to else lamp for lamp in lamps]


def with_remarks(lamps: Sequence[Structure], tracks: Sequence[Track]) -> list[Structure]:
    """The lamps, with the attributes `SIDES`, where most frames measured a lamp in the network's mask alone, and
    `LIGHT_BESIDE`."""
    unseen, x_of = _by_lamp(tracks, BY_MASK), _by_lamp(tracks, BESIDE)
    sides = {name: {SIDES: SIDES_NOT_SEEN} for name in unseen}
    lights = {name: {LIGHT_BESIDE: x} for name, x in x_of.items()}
    return [
        replace(lamp, attributes={**lamp.attributes, **sides.get(lamp.id, {}), **lights.get(lamp.id, {})})
        for lamp in lamps
    ]


def _by_lamp(tracks: Sequence[Track], name: str) -> dict[str, float]:
    """By lamp, what is said in m in its tracks' places in mm."""
    return {
        f"{track.label} {track.place[track.label]}": float(track.place[name]) / 1000
        for track in tracks
        if name in track.place
    }


def common_length(strips: Sequence[Structure]) -> float | None:
    """The length, m, that most strips have within a centimetre or two: of the outermost, joints may not show. None
    where they differ, or are few."""
    lengths = np.array([np.linalg.norm(strip.vertices[1] - strip.vertices[0]) for strip in strips])
    if len(lengths) < FEWEST:
        return None
    usual = float(np.median(lengths))
    alike = np.abs(lengths - usual) < ALIKE * usual + ALIKE_M
    return usual if alike.sum() >= FEWEST and alike.mean() >= MOST else None


def _opened(lamp: Structure, seen_to: float, length: float | None, lamps: Sequence[Structure]) -> Structure:
    here = lamp.vertices[0]
    way = 1.0 if lamp.vertex_labels[0] == "end 0" else -1.0
    has_usual_length = length is not None and way * (seen_to - here[0]) > ENOUGH * length
    far, covariance = here.copy(), lamp.covariances[0].copy()
    if has_usual_length and length is not None:
        far[0] = here[0] + way * length
        covariance[0, 0] += ALIKE_M**2
        has_usual_length = not _is_another_there(lamp, float(far[0]), way, lamps)
    if not has_usual_length:
        far[0] = seen_to
        covariance[0, :] = covariance[:, 0] = 0.0
        covariance[0, 0] = UNKNOWN_M**2
    vertices, covariances = np.stack([here, far]), np.stack([lamp.covariances[0], covariance])
    order = [0, 1] if way > 0 else [1, 0]
    return replace(
        lamp,
        vertices=vertices[order],
        covariances=covariances[order],
        vertex_labels=("end 0", "end 1"),
        edges=np.array([[0, 1]], np.int64),
        attributes={**lamp.attributes, "ends": f"end {1 if way > 0 else 0} not seen"},
    )


def without_inner_end(lamps: Sequence[Structure]) -> list[Structure]:
    """The lamps of which an end towards another lamp was not seen. The outermost end of a line may be out of view."""
    middles = np.array([lamp.vertices[:, 0].mean() for lamp in lamps])
    return [
        lamp
        for lamp, middle in zip(lamps, middles.tolist(), strict=True)
        if not is_whole(lamp) and bool((_way(lamp) * (middles - middle) > 0).any())
    ]


def _way(lamp: Structure) -> float:
    """The direction along x in which a lamp's end was not seen."""
    return -1.0 if str(lamp.attributes["ends"]).startswith("end 0") else 1.0


def _is_another_there(lamp: Structure, far: float, way: float, lamps: Sequence[Structure]) -> bool:
    """Whether another lamp's vertex lies between a lamp's end and where its other would be."""
    others = np.concatenate([[np.inf], *(other.vertices[:, 0] for other in lamps if other is not lamp)])
    ahead = way * (others - lamp.vertices[0, 0])
    return bool(((ahead > 0) & (ahead < way * (far - lamp.vertices[0, 0]) - ALIKE_M)).any())


STRIP_M, COMPACT_M, THICKNESS_M = 0.12, 0.4, 0.08
"""Width of a strip, side of a compact lamp, and height of both: usual sizes of lamps in halls."""
SHORTEST_M = 1e-3
UP = np.array([0.0, 1.0, 0.0])


def with_solids(structures: Sequence[Structure]) -> list[Structure]:
    """Lamps with the space around what was mapped, which is the middle of their height."""
    return [replace(lamp, solid=_solid(lamp.vertices)) for lamp in structures]


def _solid(vertices: Floats) -> Solid | None:
    """Of two ends or of a centre; None where a strip's ends lie above one another."""
    along = (vertices[-1] - vertices[0]) * [1.0, 0.0, 1.0]
    length = float(np.linalg.norm(along))
    if length < SHORTEST_M and len(vertices) > 1:
        return None
    way = along / length if len(vertices) > 1 else np.array([1.0, 0.0, 0.0])
    half = (STRIP_M if len(vertices) > 1 else COMPACT_M) / 2
    across = half * np.cross(way, UP)
    first, last = (
        (vertices[0], vertices[-1]) if len(vertices) > 1 else (vertices[0] - half * way, vertices[0] + half * way)
    )
    outline = np.array([first - across, last - across, last + across, first + across])
    return Solid(outline - THICKNESS_M / 2 * UP, THICKNESS_M * UP, assumed=True, ifc_class="IfcLightFixture")
