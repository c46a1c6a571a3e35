"""A building model as somebody else's program writes it: millimetres, the building turned and moved, storeys, profiles
of steel, and shapes that many elements share."""

from collections.abc import Callable, Sequence
from math import cos, radians, sin
from pathlib import Path
from typing import Any

Point = Sequence[float]
PLACE = "A=5,3,30,0.3"
"""Where the storey's origin, and its x axis, is in the world: as `--place` says it."""


class Building:
    """An IFC file with a storey, to which elements are added at places in the storey, mm."""

    def __init__(self, schema: str = "IFC4", unit: bool = True, east_mm: float = 5000) -> None:
        import ifcopenshell
        import ifcopenshell.guid

        self.file, self.guid = ifcopenshell.file(schema=schema), ifcopenshell.guid.new
        self.make: Callable[..., Any] = self.file.create_entity
        self.owner = self._owner() if schema == "IFC2X3" else None
        self.context = self.make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, self.axes())
        length = [self.make("IfcSIUnit", None, "LENGTHUNIT", "MILLI", "METRE")] if unit else []
        units = self.make(
            "IfcUnitAssignment", [*length, self.make("IfcSIUnit", None, "PLANEANGLEUNIT", None, "RADIAN")]
        )
        self.root("IfcProject", "hall", RepresentationContexts=[self.context], UnitsInContext=units)
        along = (cos(radians(30)), sin(radians(30)), 0.0)
        building = self.make("IfcLocalPlacement", None, self.axes((east_mm, 3000, 100), (0, 0, 1), along))
        self.storey = self.make("IfcLocalPlacement", building, self.axes((0, 0, 200)))
        self.root("IfcBuilding", "hall", ObjectPlacement=building, CompositionType="ELEMENT")
        self.root("IfcBuildingStorey", "ground", ObjectPlacement=self.storey, CompositionType="ELEMENT")

    def _owner(self) -> Any:
        """What IFC2X3 wants to know of everything."""
        somebody, office = self.make("IfcPerson", FamilyName="N"), self.make("IfcOrganization", Name="O")
        program = self.make("IfcApplication", office, "1", "P", "P")
        both = self.make("IfcPersonAndOrganization", somebody, office)
        return self.make("IfcOwnerHistory", both, program, None, "ADDED", None, None, None, 0)

    def root(self, kind: str, name: str, **values: Any) -> Any:
        return self.make(kind, self.guid(), self.owner, name, **values)

    def axes(self, at: Point = (0, 0, 0), z: Point | None = None, x: Point | None = None) -> Any:
        ways = [None if way is None else self.make("IfcDirection", list(map(float, way))) for way in (z, x)]
        return self.make("IfcAxis2Placement3D", self.make("IfcCartesianPoint", list(map(float, at))), *ways)

    def flat_axes(self) -> Any:
        return self.make("IfcAxis2Placement2D", self.make("IfcCartesianPoint", [0.0, 0.0]))

    def girder(self, height: float, width: float, length: float) -> Any:
        """A profile with flanges and fillets, along z; its height lies along y."""
        sizes = float(width), float(height), 5.0, 6.0, 5.0
        return self.solid(self.make("IfcIShapeProfileDef", "AREA", None, self.flat_axes(), *sizes), length)

    def tube(self, radius: float, length: float) -> Any:
        return self.solid(self.make("IfcCircleProfileDef", "AREA", None, self.flat_axes(), float(radius)), length)

    def block(self, x: float, y: float, z: float) -> Any:
        profile = self.make("IfcRectangleProfileDef", "AREA", None, self.flat_axes(), float(x), float(y))
        return self.solid(profile, z)

    def solid(self, profile: Any, length: float) -> Any:
        up = self.make("IfcDirection", [0.0, 0.0, 1.0])
        return self.make("IfcExtrudedAreaSolid", profile, self.axes(), up, float(length))

    def shared(self, *items: Any) -> Callable[[], Any]:
        """Items that several elements have: each is given a shape that refers to them."""
        source = self.make("IfcRepresentationMap", self.axes(), self._shape("SweptSolid", items))
        origin = self.make("IfcCartesianPoint", [0.0, 0.0, 0.0])
        target = self.make("IfcCartesianTransformationOperator3D", None, None, origin, 1.0, None)
        return lambda: self._shape("MappedRepresentation", [self.make("IfcMappedItem", source, target)])

    def _shape(self, kind: str, items: Sequence[Any]) -> Any:
        return self.make("IfcShapeRepresentation", self.context, "Body", kind, list(items))

    def add(self, kind: str, name: str, shape: Any, at: Point, z: Point = (0, 0, 1), x: Point = (1, 0, 0)) -> Any:
        """An element of a class, with a solid or a shape that is shared (None: without a body)."""
        values = {"ObjectPlacement": self.make("IfcLocalPlacement", self.storey, self.axes(at, z, x))}
        if shape is not None:
            shape = shape if shape.is_a("IfcShapeRepresentation") else self._shape("SweptSolid", [shape])
            values["Representation"] = self.make("IfcProductDefinitionShape", Representations=[shape])
        return self.root(kind, name, **values)

    def typed(self, element: Any, kind: str, name: str, **values: Any) -> None:
        """Say of which type an element is."""
        made = self.root(kind, name, **values)
        self.root("IfcRelDefinesByType", "", RelatedObjects=[element], RelatingType=made)

    def assemble(self, name: str, parts: Sequence[Any]) -> None:
        whole = self.root("IfcElementAssembly", name)
        self.root("IfcRelAggregates", "", RelatingObject=whole, RelatedObjects=list(parts))

    def write(self, path: Path) -> Path:
        self.file.write(str(path))
        return path


def bays(schema: str) -> Building:
    """Two bays of 2.7 m from x = 0 with three levels, front and back, on a floor."""
    building = Building(schema)
    post, bar = building.shared(building.girder(100, 60, 6000)), building.shared(building.girder(120, 50, 2700))
    for x in (0, 2800, 5600):
        for y in (0, 1100):
            column = building.add("IfcColumn", f"P{x}", post(), (x + 50, y + 30, 0), x=(0, 1, 0))
            column.ObjectType = "Post 100"
    for x in (100, 2900):
        for z in (1500, 3000, 4500):
            for y in (0, 1150):
                building.add("IfcBeam", "Bar", bar(), (x, y - 25, z - 60), z=(1, 0, 0), x=(0, 1, 0))
    building.add("IfcSlab", "Floor", building.block(9000, 9000, 200), (0, 0, -200))
    return building
