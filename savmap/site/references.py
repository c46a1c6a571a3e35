"""From the site file's references and calibration to the factor graph's."""

import re
from collections.abc import Iterator, Sequence
from difflib import get_close_matches

from savmap.files.validation import Location
from savmap.graph import (
    Calibration,
    CameraHeight,
    KnownLength,
    KnownMarker,
    References,
    SurveyedPoint,
)
from savmap.site.sections import CalibrationSection, ReferenceSection

NUMBER = re.compile(r"\d+")
OF_MARKERS = "marker "
"""Names of markers begin so."""


def references_of(section: ReferenceSection) -> References:
    """The references of one row as the graph takes them."""
    height = section.camera_height_m
    return References(
        camera_heights=(CameraHeight(height.value, height.sigma),) if height else (),
        lengths=tuple(KnownLength(*given.in_order, given.value, given.sigma, given.axis) for given in section.lengths),
        points=tuple(
            SurveyedPoint(given.vertex, _position(given.axis, given.value), given.sigma) for given in section.points
        ),
        markers=tuple(
            KnownMarker(given.dictionary, given.id, given.size_m, given.sigma_m) for given in section.markers
        ),
        on_contradiction=section.on_contradiction,
    )


def misnamed(section: ReferenceSection, patterns: Sequence[str]) -> Iterator[tuple[Location, str]]:
    """Names in references that no plugin can have: the key within the section, and what is wrong with it. patterns: all
    names that plugins give, with "#" for each number; those of markers need not be among them."""
    named: list[tuple[Location, str]] = [
        (("lengths", n, "between", end), name)
        for n, length in enumerate(section.lengths)
        for end, name in enumerate(length.between)
    ]
    named += [(("points", n, "vertex"), point.vertex) for n, point in enumerate(section.points)]
    for location, name in named:
        pattern = NUMBER.sub("#", name)
        if pattern not in patterns and not name.startswith(OF_MARKERS):
            hint = f"known are {', '.join(patterns)} (#: a number)"
            for near in get_close_matches(pattern, patterns, 1):
                for number in NUMBER.findall(name):
                    near = near.replace("#", number, 1)
                hint = f"did you mean `{near}`?"
            yield location, f"nothing is called `{name}`: {hint}"


def calibration_of(section: CalibrationSection) -> Calibration | None:
    """What of the camera is estimated; None if nothing is."""
    terms = section.panorama, section.rolling_shutter, section.vertical_scale, section.lens_distance
    return Calibration(*terms[:2], section.front_deg, *terms[2:]) if any(terms) else None


def _position(axis: str, value: float) -> tuple[float | None, float | None, float | None]:
    x, y, z = (value if axis == letter else None for letter in "xyz")
    return x, y, z
