"""The process that reads a building model (`python -m savmap.apps.exchange.imports.model_reader FOLDER`):
which elements have a label, and their bodies, by the geometry kernel of `ifcopenshell`: metres, z up.

An element's label is what savmap wrote, or that of its name, its type, its layer or its class; parts of an assembly
that have none belong to the assembly that has. Openings are not cut out of bodies, which would not change their size.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from savmap.apps.exchange.imports.boxes import Mesh, box_of
from savmap.apps.exchange.imports.model import FAULT, MODEL, REQUEST, RESULT
from savmap.apps.exchange.imports.records import (
    UNITS,
    FileElements,
    ImportOptions,
    ModelRequest,
    SurveyElement,
    element,
    listed,
)
from savmap.errors import OutputError, format_error
from savmap.files.atomic import write_bytes
from savmap.files.serialization import packed, unpacked
from savmap.types import Floats, Ints, array_record
from savmap.types.written import FARTHEST_WORLD_M

MOST_ELEMENTS = 200_000
"""That have a label."""
DEEPEST = 12
"""Of assemblies within assemblies."""
SAME_M = 1e-4
"""A vertex that savmap wrote is still a corner of the body that is drawn."""
SAVMAP, SAVMAP_ATTRIBUTES = "Savmap", "Savmap_Attributes"
"""The property sets that savmap writes (`exports.models.ifc`)."""
Entity = Any
"""An entity of ifcopenshell."""


def main() -> None:
    """Read the model of the folder that the command line names."""
    folder = Path(sys.argv[1])
    try:
        request = unpacked((folder / REQUEST).read_bytes(), ModelRequest)
        result = read(folder / MODEL, request.options, request.labels)
    except OutputError as error:
        (folder / FAULT).write_text(str(error), encoding="utf-8")
    except Exception as error:
        why = f"is not an IFC model that can be read ({listed([format_error(error)])})"
        (folder / FAULT).write_text(why, encoding="utf-8")
    else:
        write_bytes(folder / RESULT, packed(result))


def read(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> FileElements:
    """The elements of a model that have a label. Raises OutputError without the file's name, and whatever the library
    does."""
    import ifcopenshell

    ifcopenshell.get_log()  # what it holds is not of this file
    file = ifcopenshell.open(str(path))
    faults = [line for line in ifcopenshell.get_log().splitlines() if "[error]" in line.lower()]
    unit_m, scale = _units(file, options.unit)
    members, others = _Labels(file, options.labels, labels).members()
    if not members:
        raise OutputError(
            f"no element has a name, type, layer or class with a label ({listed(labels.values())}); there are "
            f"{listed(' '.join(name).strip() for name in others)}: say --layer NAME=LABEL"
        )
    meshes = _meshes(file, [part for member in members for part in member.parts])
    elements, empty = list[SurveyElement](), list[str]()
    for member in members:
        points, vertices = member.points([mesh for part in member.parts for mesh in meshes.get(part.id(), ())], unit_m)
        if not (np.abs(points) < FARTHEST_WORLD_M).all():
            raise OutputError(f"{listed([member.name])} is not finite, or too far away")
        if len(points):
            structure = element(member.name, member.label, points * scale, vertices, member.attributes)
            elements.append(SurveyElement(member.row, options.frame or "world", structure))
        else:
            empty.append(member.name)
    if not elements:
        raise OutputError(f"no element with a label has a body: {listed(empty)}")
    return FileElements(tuple(elements), tuple(_notes(faults, others, empty)))


def _units(file: Any, unit: str | None) -> tuple[float, float]:
    """Metres of the model's unit of length, and by which factor its lengths are larger where the options say another
    one. Raises OutputError where nothing says one."""
    from ifcopenshell.util.unit import calculate_unit_scale

    assignment = next((project.UnitsInContext for project in file.by_type("IfcProject")), None)
    kinds = [getattr(each, "UnitType", "") for each in (assignment.Units if assignment else ())]
    if unit is None and "LENGTHUNIT" not in kinds:
        raise OutputError("says no unit of length: say it, such as --unit mm")
    unit_m = float(calculate_unit_scale(file))
    return unit_m, UNITS[unit] / unit_m if unit else 1.0


def _notes(faults: Sequence[str], others: Counter[tuple[str, str]], empty: Sequence[str]) -> Iterator[str]:
    """What was left out. `faults`: what the library says of damages; `others`: how many elements there are of each
    class and name; `empty`: those without a body."""
    if faults:
        yield f"the model is damaged in {len(faults)} places, and was read as far as possible"
    classes = Counter[str]()
    for (name, _), count in others.items():
        classes[name] += count
    if classes:
        yield f"elements without a label, passed over: {listed(f'{count} {name}' for name, count in classes.items())}"
    if empty:
        yield f"elements whose body is not there or cannot be made, left out: {len(empty)} ({listed(empty)})"


@dataclass(frozen=True, eq=False)
@array_record
class Member:
    """An element that has a label: its row ("" where the file names none), its vertices (n, 3) in the model's unit with
    their labels, where savmap wrote them, and the elements whose bodies are its."""

    name: str
    label: str
    row: str = ""
    vertices: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    vertex_labels: tuple[str, ...] = ()
    attributes: Mapping[str, str] = field(default_factory=dict)
    parts: list[Entity] = field(default_factory=list)

    def points(self, bodies: Sequence[Mesh], unit_m: float) -> tuple[Floats, tuple[str, ...]]:
        """Its vertices, m, with their labels, where bodies have corners there or there is none; else the corners (8, 3)
        of the box around these."""
        vertices = self.vertices * unit_m
        if not bodies:
            return vertices, self.vertex_labels
        corners = np.concatenate([mesh.points for mesh in bodies])
        gaps = np.linalg.norm(vertices[:, None] - corners, axis=2).min(axis=1)
        if len(vertices) and (gaps < SAME_M).all():
            return vertices, self.vertex_labels
        return box_of(bodies), ()


class _Labels:
    """Which elements of a file have a label: by the options (`given`) where there are any, else by those of the
    plugins."""

    def __init__(self, file: Any, given: Mapping[str, str], labels: Mapping[str, str]) -> None:
        import ifcopenshell

        self.file = file
        self.labels = {theirs.casefold(): ours for theirs, ours in given.items()} or labels
        self.schema = ifcopenshell.schema_by_name(file.schema_identifier)
        self.classes = dict[str, list[str]]()

    def members(self) -> tuple[list[Member], Counter[tuple[str, str]]]:
        """The elements that have a label, with their parts, and how many bodies have none, by class and name. Raises
        OutputError for too many."""
        members, others = dict[int, Member | None](), Counter[tuple[str, str]]()
        for product in sorted(self.file.by_type("IfcElement"), key=lambda element: int(element.id())):
            if product.Representation is None or product.is_a("IfcFeatureElement"):
                continue
            wholes = list(_wholes(product))
            for whole in wholes:
                if whole.id() not in members:
                    members[whole.id()] = self.member(whole)
            member = next(filter(None, (members[whole.id()] for whole in wholes)), None)
            if member is None:
                others[product.is_a(), product.ObjectType or product.Name or ""] += 1
            else:
                member.parts.append(product)
        labelled = [member for member in members.values() if member is not None and member.parts]
        if sum(len(member.parts) for member in labelled) > MOST_ELEMENTS:
            raise OutputError(f"more than {MOST_ELEMENTS} elements have a label, which is the most that is read")
        return labelled, others

    def member(self, entity: Entity) -> Member | None:
        """An element that has a label, without parts."""
        name = f"{entity.is_a()} {entity.Name or ''} (#{entity.id()})"
        facts = _properties(entity, SAVMAP)
        if not facts.get("Label"):
            words = (word.casefold() for word in (*_names(entity), *self.classes_of(entity)))
            label = next((self.labels[word] for word in words if word in self.labels), "")
            return Member(name, label) if label else None
        vertices, labels = np.zeros((0, 3)), tuple[str, ...]()
        with suppress(KeyError, ValueError):
            vertices = np.array([facts[f"Vertex{axis}"] for axis in "XYZ"], dtype=np.float64).T.reshape(-1, 3)
            labels = tuple(map(str, facts["VertexLabels"]))
        text = _properties(entity, SAVMAP_ATTRIBUTES).get("text")
        return Member(
            str(facts.get("Id") or name),
            str(facts["Label"]),
            str(facts.get("Row") or ""),
            vertices,
            labels if len(labels) == len(vertices) else (),
            {"text": str(text)} if text else {},
        )

    def classes_of(self, entity: Entity) -> Iterator[str]:
        """The classes of an element, from its own upwards, and that of its type: in IFC2X3, some are classes of types
        alone."""
        from ifcopenshell.util.element import get_type

        name, kind = entity.is_a(), get_type(entity)
        if name not in self.classes:
            declared, names = self.schema.declaration_by_name(name).as_entity(), list[str]()
            while declared is not None:
                names.append(declared.name())
                declared = declared.supertype()
            self.classes[name] = names
        yield from self.classes[name]
        if kind is not None:
            yield kind.is_a().removesuffix("Type")


def _wholes(product: Entity) -> Iterator[Entity]:
    """An element and the assemblies of which it is a part."""
    from ifcopenshell.util.element import get_aggregate

    for _ in range(DEEPEST):
        if product is None or not product.is_a("IfcElement"):
            return
        yield product
        product = get_aggregate(product)


def _names(entity: Entity) -> Iterator[str]:
    """What an element, its type and its layers are called."""
    from ifcopenshell.util.element import get_type

    kind = get_type(entity)
    yield from (entity.Name or "", entity.ObjectType or "", "" if kind is None else kind.Name or "")
    for shape in entity.Representation.Representations if entity.Representation else ():
        for item in (shape, *shape.Items):
            for layer in getattr(item, "LayerAssignments", ()) or getattr(item, "LayerAssignment", ()):
                yield layer.Name or ""


def _properties(entity: Entity, name: str) -> dict[str, Any]:
    """The values of an element's property set of this name; lists of values as lists."""
    for relation in entity.IsDefinedBy:
        properties = relation.RelatingPropertyDefinition if relation.is_a("IfcRelDefinesByProperties") else None
        if properties is not None and properties.is_a("IfcPropertySet") and properties.Name == name:
            return dict(map(_value, properties.HasProperties))
    return {}


def _value(given: Entity) -> tuple[str, Any]:
    """The name and the value of a property."""
    if given.is_a("IfcPropertyListValue"):
        return given.Name, [value.wrappedValue for value in given.ListValues or ()]
    value = given.NominalValue if given.is_a("IfcPropertySingleValue") else None
    return given.Name, None if value is None else value.wrappedValue


def _meshes(file: Any, products: Sequence[Entity]) -> dict[int, list[Mesh]]:
    """The bodies of elements by the elements' numbers, m; of an element whose geometry cannot be made, none."""
    from ifcopenshell import geom

    settings = geom.settings()
    settings.set("disable-opening-subtractions", True)
    settings.set("no-normals", True)
    shapes, meshes = dict[str, tuple[Floats, Ints]](), dict[int, list[Mesh]]()
    for body in geom.iterator(settings, file, 1, include=list(products)):
        geometry, place = body.geometry, np.array(body.transformation.matrix, dtype=np.float64).reshape(4, 4).T
        if geometry.id not in shapes:
            points = np.array(geometry.verts, dtype=np.float64).reshape(-1, 3)
            shapes[geometry.id] = points, np.array(geometry.faces, dtype=np.int64).reshape(-1, 3)
        if len(shapes[geometry.id][1]):
            meshes.setdefault(body.id, []).append(Mesh(*shapes[geometry.id], place))
    return meshes


if __name__ == "__main__":
    main()
