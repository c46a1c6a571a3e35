"""A map as a building model, IFC4 or IFC4.3 (ISO 16739-1), by the library `ifcopenshell`: metres, z up.

A row is an assembly of the storey, a structure an element of the class that its plugin gives its solid, or a proxy.
What is known of it beside its shape is in the property sets `Savmap` and `Savmap_Attributes`: names that begin with
`Pset_` are buildingSMART's own. Identifiers are made of the names of row, plugin and structure, and so the same in each
export.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from uuid import UUID, uuid5

import numpy as np

from savmap.files.atomic import write_text
from savmap.files.texts import SURROGATES
from savmap.maps.exports import require_library
from savmap.maps.exports.marks import attributes, bytes_of, colours, maker, sigmas, unique
from savmap.maps.exports.models.bodies import Body, Part, RowParts, depth_note, parts_of
from savmap.types import Floats, SiteMap

NAMESPACE = UUID("5c3c2f43-5a0b-5d6e-9b55-0a6d1f1b7c21")
"""Of the identifiers that are made of names."""
PROXY = "IfcBuildingElementProxy"
LONGEST_LABEL = 255
"""Letters of an IfcLabel."""
FLAT_M = 5e-5
"""An outline that is off its plane by more is given as triangles."""
NO_TIME = "1970-01-01T00:00:00"
"""The same map gives the same file."""
UNITS = (
    ("LENGTHUNIT", "METRE"),
    ("AREAUNIT", "SQUARE_METRE"),
    ("VOLUMEUNIT", "CUBIC_METRE"),
    ("PLANEANGLEUNIT", "RADIAN"),
)
Entity = Any
"""An entity of ifcopenshell."""


def write_ifc4(site: SiteMap, path: Path) -> None:
    """The map as IFC4. Raises OutputError where rows have no common frame, or `ifcopenshell` is missing."""
    write_text(path, ifc_text(site, "IFC4"))


def write_ifc4x3(site: SiteMap, path: Path) -> None:
    """The map as IFC4.3; errors as those of `write_ifc4`."""
    write_text(path, ifc_text(site, "IFC4X3"))


def ifc_text(site: SiteMap, schema: str) -> str:
    """The file's text."""
    require_library("ifcopenshell", "bim")
    import ifcopenshell
    import ifcopenshell.guid

    rows = parts_of(site)
    file = ifcopenshell.file(schema=schema)
    header = file.header
    header.file_description.description = ("ViewDefinition [notYetAssigned]",)
    header.file_name.time_stamp = NO_TIME
    header.file_name.preprocessor_version = header.file_name.originating_system = maker()
    schema_of_file = ifcopenshell.schema_by_name(file.schema_identifier)
    _Model(file, schema_of_file, ifcopenshell.guid.compress).build(site, rows)
    text: str = file.to_string()
    return text


class _Model:
    """An IFC file as it grows."""

    def __init__(self, file: Any, schema: Any, compress: Callable[[str], str]) -> None:
        self.file, self.schema, self.compress = file, schema, compress
        self.make: Callable[..., Entity] = file.create_entity
        self.classes = dict[str, str]()

    def build(self, site: SiteMap, rows: Sequence[RowParts]) -> None:
        """Everything from the project to the last element."""
        self.axes = self.make("IfcAxis2Placement3D", self.point((0.0, 0.0, 0.0)))
        context = self.make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, self.axes)
        self.contexts = {
            name: self.make(
                "IfcGeometricRepresentationSubContext", name, "Model", ParentContext=context, TargetView=view
            )
            for name, view in (("Body", "MODEL_VIEW"), ("Axis", "GRAPH_VIEW"))
        }
        palette = colours(part.structure.label for row in rows for part in row.parts)
        self.styles = {label: self.styles_of(label, colour) for label, colour in palette.items()}
        units = self.make(
            "IfcUnitAssignment", [self.make("IfcSIUnit", UnitType=kind, Name=name) for kind, name in UNITS]
        )
        names = json.dumps(sorted(site.rows))
        project = self.make("IfcProject", self.guid("project", names), Name="Map", UnitsInContext=units)
        project.RepresentationContexts = [context]
        project.Description = _text(depth_note(rows)) or None
        storey = self.place_of_rows(site, project, names)
        assemblies = [self.row(site, row, storey) for row in rows]
        if assemblies:
            guid = self.guid("contained", names)
            self.make("IfcRelContainedInSpatialStructure", guid, RelatedElements=assemblies, RelatingStructure=storey)

    def styles_of(self, label: str, colour: str) -> tuple[Entity, Entity]:
        """The styles of a label's surfaces and curves."""
        shade = self.make("IfcColourRgb", None, *(value / 255 for value in bytes_of(colour)))
        surface = self.make("IfcSurfaceStyle", _label(label), "BOTH", [self.make("IfcSurfaceStyleShading", shade)])
        return surface, self.make("IfcCurveStyle", Name=_label(label), CurveColour=shade)

    def place_of_rows(self, site: SiteMap, project: Entity, names: str) -> Entity:
        """Site, building and storey, of which nothing is known but where the site is on Earth, and that perhaps."""
        whole, placement = project, None
        for kind in ("Site", "Building", "BuildingStorey"):
            placement = self.make("IfcLocalPlacement", placement, self.axes)
            guid = self.guid(kind, names)
            part = self.make(f"Ifc{kind}", guid, Name=kind, ObjectPlacement=placement, CompositionType="ELEMENT")
            if kind == "Site" and site.alignment and site.alignment.anchor:
                part.RefLatitude, part.RefLongitude = map(_compound, site.alignment.anchor)
            self.aggregate(whole, [part], kind, names)
            whole = part
        return whole

    def row(self, site: SiteMap, row: RowParts, storey: Entity) -> Entity:
        """A row's assembly with its elements."""
        axes = self.make("IfcAxis2Placement3D", self.point(row.origin))
        placement = self.make("IfcLocalPlacement", storey.ObjectPlacement, axes)
        assembly = self.make(
            "IfcElementAssembly",
            self.guid("row", row.name),
            Name=_label(row.name),
            ObjectType="row",
            ObjectPlacement=placement,
            PredefinedType="USERDEFINED",
        )
        keys = unique([json.dumps([part.plugin, part.structure.id]) for part in row.parts])
        parts = [self.element(part, row, placement, key) for part, key in zip(row.parts, keys, strict=True)]
        self.aggregate(assembly, parts, "parts", row.name)
        verdict = site.rows[row.name].verdict
        facts: dict[str, Any] = {"Row": row.name} | ({"Grade": verdict.grade} if verdict else {})
        self.describe(assembly, "Savmap", facts, row.name)
        return assembly

    def element(self, part: Part, row: RowParts, whole: Entity, key: str) -> Entity:
        """A structure's element, with its shape and what is known of it. `whole`: the row's placement; `key`: its name
        in the row."""
        structure = part.structure
        axes, shapes = self.shape(part, row.origin)
        product = self.make(
            self.element_class(part.ifc_class),
            self.guid("element", row.name, key),
            Name=_label(structure.id),
            ObjectType=_label(structure.label) or None,
            ObjectPlacement=self.make("IfcLocalPlacement", whole, axes),
            Tag=_label(structure.id),
        )
        if shapes:
            product.Representation = self.make("IfcProductDefinitionShape", Representations=shapes)
        spread = sigmas(structure)
        facts = {
            "Row": part.row,
            "Plugin": part.plugin,
            "Id": structure.id,
            "Label": structure.label,
            "DepthAssumed": None if part.body is None else part.assumed,
            "Warnings": list(part.warnings),
            "VertexLabels": list(structure.vertex_labels),
            **{f"Vertex{axis}": structure.vertices[:, k].round(6).tolist() for k, axis in enumerate("XYZ")},
            **{f"Sigma{axis}": spread[:, k].round(6).tolist() for k, axis in enumerate("XYZ")},
        }
        self.describe(product, "Savmap", facts, row.name, key)
        values = attributes(structure)
        names = unique([_label(name) for name in values])
        self.describe(product, "Savmap_Attributes", dict(zip(names, values.values(), strict=True)), row.name, key)
        return product

    def element_class(self, name: str) -> str:
        """This class, or that of proxies where the schema has none of this name for elements that are made of names and
        shapes alone."""
        if name not in self.classes:
            try:
                entity = self.schema.declaration_by_name(name).as_entity()
            except RuntimeError:
                entity = None
            fits = entity is not None and not entity.is_abstract()
            fits = fits and entity._is("IfcElement") and not entity._is("IfcFeatureElement")
            fits = fits and all(attribute.optional() for attribute in entity.all_attributes()[1:])
            self.classes[name] = name if fits else PROXY
        return self.classes[name]

    def shape(self, part: Part, origin: Floats) -> tuple[Entity, list[Entity]]:
        """Where a structure's element stands from its row's origin, and its shape there."""
        structure, (surface, curve) = part.structure, self.styles[part.structure.label]
        if part.body is not None and part.body.flatness_m() < FLAT_M:
            return self.extruded(part.body, origin, surface)
        if part.body is not None:
            corners = [_numbers(point) for point in part.body.points - origin]
            points = self.make("IfcCartesianPointList3D", corners)
            index = (part.body.triangles + 1).tolist()
            item = self.make("IfcTriangulatedFaceSet", Coordinates=points, Closed=True, CoordIndex=index)
            return self.axes, [self.representation("Body", "Tessellation", item, surface)]
        points = [self.point(vertex) for vertex in structure.vertices - origin]
        if len(structure.edges):
            lines = [self.make("IfcPolyline", [points[a], points[b]]) for a, b in structure.edges.tolist()]
            item = self.make("IfcGeometricCurveSet", lines)
            return self.axes, [self.representation("Axis", "GeometricCurveSet", item, curve)]
        if not points:
            return self.axes, []
        return self.axes, [self.representation("Axis", "GeometricSet", self.make("IfcGeometricSet", points))]

    def extruded(self, body: Body, origin: Floats, style: Entity) -> tuple[Entity, list[Entity]]:
        """A body as an area pushed along its depth: the element's z axis looks into it, its x axis is one of the
        outline's sides."""
        outline = body.outline[::-1]
        z, x = -body.normal, outline[1] - outline[0]
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        frame = np.stack([x, np.cross(z, x), z])
        direction = [self.make("IfcDirection", _numbers(axis)) for axis in (z, x)]
        axes = self.make("IfcAxis2Placement3D", self.point(outline[0] - origin), *direction)
        corners = [self.point(corner[:2]) for corner in (outline - outline[0]) @ frame.T]
        line = self.make("IfcPolyline", [*corners, corners[0]])
        area = self.make("IfcArbitraryClosedProfileDef", "AREA", None, line)
        length = float(np.linalg.norm(body.depth))
        way = self.make("IfcDirection", _numbers(frame @ body.depth / length))
        item = self.make("IfcExtrudedAreaSolid", SweptArea=area, ExtrudedDirection=way, Depth=length)
        return axes, [self.representation("Body", "SweptSolid", item, style)]

    def representation(self, name: str, kind: str, item: Entity, style: Entity = None) -> Entity:
        """A shape of one item in the context of this name."""
        if style is not None:
            self.make("IfcStyledItem", item, [style])
        return self.make("IfcShapeRepresentation", self.contexts[name], name, kind, [item])

    def describe(self, element: Entity, name: str, facts: Mapping[str, Any], *key: str) -> None:
        """A property set for an element, where something is known."""
        properties = [self.property(*entry) for entry in facts.items() if entry[1] not in ("", [], None)]
        if properties:
            properties_of = self.make("IfcPropertySet", self.guid(name, *key), Name=name, HasProperties=properties)
            self.make(
                "IfcRelDefinesByProperties",
                self.guid(f"{name} defines", *key),
                RelatedObjects=[element],
                RelatingPropertyDefinition=properties_of,
            )

    def property(self, name: str, value: Any) -> Entity:
        """A property of one value, or of a list of them, all of one type: lengths where they are numbers, else
        texts."""
        if isinstance(value, list):
            lengths = isinstance(value[0], float)
            given = value if lengths else [_text(text) for text in value]
            kind = "IfcLengthMeasure" if lengths else _text_type(given)
            return self.make("IfcPropertyListValue", name, ListValues=[self.make(kind, item) for item in given])
        if isinstance(value, bool):
            nominal = self.make("IfcBoolean", value)
        elif isinstance(value, str):
            nominal = self.make(_text_type([_text(value)]), _text(value))
        elif isinstance(value, int) and abs(value) < 2**31:
            nominal = self.make("IfcInteger", value)
        else:
            nominal = self.make("IfcReal", float(value))
        return self.make("IfcPropertySingleValue", name, NominalValue=nominal)

    def aggregate(self, whole: Entity, parts: Sequence[Entity], *key: str) -> None:
        """Say of which parts a whole consists."""
        self.make("IfcRelAggregates", self.guid("aggregates", *key), RelatingObject=whole, RelatedObjects=list(parts))

    def guid(self, *key: str) -> str:
        """The identifier that is made of these names."""
        text = SURROGATES.sub("\ufffd", json.dumps(key, ensure_ascii=False))
        return self.compress(uuid5(NAMESPACE, text).hex)

    def point(self, place: Iterable[float]) -> Entity:
        """A point (2) or (3)."""
        return self.make("IfcCartesianPoint", _numbers(place))


def _compound(degrees: float) -> list[int]:
    """An angle as degrees, minutes, seconds and millionths of a second, none of which has the other sign."""
    rest = round(abs(degrees) * 3_600_000_000)
    parts = rest // 3_600_000_000, rest // 60_000_000 % 60, rest // 1_000_000 % 60, rest % 1_000_000
    return [-part if degrees < 0 else part for part in parts]


def _label(text: str) -> str:
    return _text(text)[:LONGEST_LABEL]


def _text_type(texts: Sequence[str]) -> str:
    """The type that holds all of these texts."""
    return "IfcLabel" if all(len(text) <= LONGEST_LABEL for text in texts) else "IfcText"


def _text(text: str) -> str:
    return SURROGATES.sub("\ufffd", text).replace("\x00", "\ufffd")


def _numbers(values: Iterable[float]) -> list[float]:
    """To a nanometre: sums of rounded numbers are given as they are meant."""
    return [round(float(value), 9) + 0.0 for value in values]
