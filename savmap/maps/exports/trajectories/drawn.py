"""What recordings show of structures: segments, colours, texts, standard deviations."""

from collections.abc import Iterator, Sequence

from savmap.errors import visible
from savmap.maps.exports.frames import Element
from savmap.maps.exports.marks import bytes_of, colours, sigmas
from savmap.types import Floats, Measured, Structure

FRAME = "map"
"""The frame's name in messages: that of ROS for a map."""
NANO = 1_000_000_000
LINE_M = 0.02

Colour = tuple[int, int, int]


def coloured(found: Sequence[Element]) -> Iterator[tuple[Element, Colour]]:
    """The elements, each with its label's colour."""
    palette = colours(element.structure.label for element in found)
    for element in found:
        yield element, bytes_of(palette[element.structure.label])


def segments(structure: Structure) -> Floats:
    """The edges' ends (n, 2, 3) m."""
    ends: Floats = structure.vertices[structure.edges.reshape(-1, 2)]
    return ends


def texts(element: Element) -> dict[str, str]:
    """Row, plugin, label, attributes and the vertices' standard deviations as texts, by name."""
    structure = element.structure
    attributes = {
        name: f"{value.value:g} +- {value.sigma:g}" if isinstance(value, Measured) else str(value)
        for name, value in structure.attributes.items()
    }
    vertices = {
        f"sigma of {label}, mm": " ".join(f"{1000 * value:.1f}" for value in sigma)
        for label, sigma in zip(structure.vertex_labels, sigmas(structure), strict=True)
    }
    whole = {"row": element.row, "plugin": element.plugin, "label": structure.label, **attributes, **vertices}
    return {visible(name): visible(value) for name, value in whole.items()}


def title(element: Element) -> str:
    """The name that a structure is shown with: what is written on it, or its id."""
    structure = element.structure
    return visible(str(structure.attributes.get("text") or f"{element.row}: {structure.id}"))
