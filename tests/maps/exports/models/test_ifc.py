"""IFC: structures stand where they are by ifcopenshell's own geometry, have the right classes, and say what is known of them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import savmap
from savmap.apps.exchange.ifc import ifc_text
from savmap.types import Floats, SiteMap

from .made_up_models import (
    DEPTH_NOTE,
    EVIL,
    NEAREST_M,
    distance_m,
    expected,
    hostile_site,
    made_up_site,
    readable,
    row,
    things,
    warning_of,
)

pytestmark = pytest.mark.extra("bim")

SCHEMAS = ("ifc", "ifc4x3")


def opened(site: SiteMap, path: Path, name: str = "ifc") -> Any:
    import ifcopenshell

    return ifcopenshell.open(str(savmap.export(site, path, name)))


def structures(file: Any) -> list[Any]:
    return [product for product in file.by_type("IfcElement") if not product.is_a("IfcElementAssembly")]


def known(product: Any) -> dict[str, Any]:
    from ifcopenshell.util import element

    properties: dict[str, Any] = element.get_psets(product)["Savmap"]
    return properties


def in_world(product: Any) -> Floats:
    """The corners of an element: of a body by the geometry kernel, in the element's own frame; of lines and points as they are given."""
    from ifcopenshell import geom
    from ifcopenshell.util import placement

    matrix = placement.get_local_placement(product.ObjectPlacement)
    shape = product.Representation.Representations[0]
    if shape.RepresentationIdentifier == "Body":
        points = np.array(geom.create_shape(geom.settings(), product).geometry.verts).reshape(-1, 3)
    else:
        lines = shape.Items[0].Elements
        points = np.array(
            [p.Coordinates for line in lines for p in (line.Points if line.is_a("IfcPolyline") else [line])]
        )
    whole: Floats = points @ matrix[:3, :3].T + matrix[:3, 3]
    return whole


@pytest.mark.parametrize("name", SCHEMAS)
def test_positions_are_those_of_the_map(name: str, tmp_path: Path) -> None:
    from ifcopenshell.util import element

    file = opened(made_up_site(), tmp_path / "map.ifc", name)
    wanted = expected(made_up_site())
    found = {(known(product)["Row"], product.Name): product for product in structures(file)}
    assert set(found) == set(wanted)
    assert max(distance_m(in_world(found[key]), wanted[key]) for key in wanted) < NEAREST_M
    rows = file.by_type("IfcElementAssembly")
    assert [assembly.Name for assembly in rows] == ["A", "B"]
    assert {element.get_aggregate(product) for product in found.values()} == set(rows)
    assert element.get_container(rows[0]).is_a("IfcBuildingStorey")
    site = file.by_type("IfcSite")[0]
    assert (site.RefLatitude, site.RefLongitude) == ((48, 8, 13, 200000), (-11, -34, -30, 0))


@pytest.mark.parametrize("name", SCHEMAS)
def test_elements_say_what_they_are(name: str, tmp_path: Path) -> None:
    from ifcopenshell.util import element

    file = opened(SiteMap({"A": row("A", things())}, {}), tmp_path / "map.ifc", name)
    assert file.schema == {"ifc": "IFC4", "ifc4x3": "IFC4X3"}[name]
    classes = {product.Name: product.is_a() for product in structures(file)}
    proxy = "IfcBuildingElementProxy"
    assert classes == {
        **{"post 1": "IfcColumn", "post 2": "IfcColumn", "bar / 1": "IfcBeam", "corner": proxy, "tube": proxy},
        **{"plate": proxy if name == "ifc" else "IfcSign", "spot": proxy},
    }
    post = next(product for product in structures(file) if product.Name == "post 1")
    said = known(post)
    assert {key: said[key] for key in ("Plugin", "Id", "Label", "DepthAssumed")} == {
        **{"Plugin": "things", "Id": "post 1", "Label": "post", "DepthAssumed": True}
    }
    assert [said[key] for key in ("SigmaX", "SigmaY", "SigmaZ")] == [[0.01] * 4, [0.03] * 4, [0.02] * 4]
    assert said["Warnings"] == [warning_of("post 1").line]
    attributes = element.get_psets(post)["Savmap_Attributes"]
    assert (attributes["number"], attributes["width_m"], attributes["width_m sigma"]) == (7, 0.1, 0.005)


@pytest.mark.parametrize("ifc_class", ["IfcElement", "IfcWall", "IfcOpeningElement", "IfcPerson", "IfcLabel", "Ifc'("])
def test_classes_that_no_element_may_have_are_proxies(ifc_class: str) -> None:
    post = things()[0]
    assert post.solid is not None
    odd = replace(post, solid=replace(post.solid, ifc_class=ifc_class))
    text = ifc_text(SiteMap({"A": row("A", [odd])}, {}), "IFC4")
    assert ("=IFCWALL(" if ifc_class == "IfcWall" else "=IFCBUILDINGELEMENTPROXY(") in text


@pytest.mark.parametrize("name", SCHEMAS)
@pytest.mark.parametrize("site", [made_up_site(), hostile_site(), SiteMap({}, {})], ids=["plain", "hostile", "empty"])
def test_models_are_valid(site: SiteMap, name: str, tmp_path: Path) -> None:
    from ifcopenshell import validate

    log = validate.json_logger()
    validate.validate(str(savmap.export(site, tmp_path / "map.ifc", name)), log)
    assert log.statements == []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # ifcopenshell leaves files of its own open
@pytest.mark.parametrize("name", SCHEMAS)
def test_models_obey_the_rules_of_the_schema(name: str, tmp_path: Path) -> None:
    from ifcopenshell import validate

    log = validate.json_logger()
    path = savmap.export(made_up_site(), tmp_path / "map.ifc", name)
    validate.validate(str(path), log, express_rules=True)
    assert log.statements == []


@pytest.mark.parametrize("name", SCHEMAS)
def test_any_text_is_kept_as_text(name: str, tmp_path: Path) -> None:
    file = opened(hostile_site(), tmp_path / "map.ifc", name)
    products = structures(file)
    ids = [known(product).get("Id", "") for product in products]
    assert sorted(ids) == sorted(readable(text) for text in (*EVIL, EVIL[0]))
    assert len({product.GlobalId for product in products}) == len(products)
    assert max(len(product.Name) for product in products) == 255


def test_identifiers_stay_when_others_come() -> None:
    few, many = ({"A": row("A", things()[:count])} for count in (1, 7))
    names = ["=IFCCOLUMN('", "=IFCELEMENTASSEMBLY('"]
    for name in names:
        one, other = (ifc_text(SiteMap(rows, {}), "IFC4").split(name)[1][:22] for rows in (few, many))
        assert one == other


def test_a_list_has_values_of_one_type(tmp_path: Path) -> None:
    part = things()[0]
    labels = ("short", "L" * 300, *part.vertex_labels[2:])
    file = opened(SiteMap({"A": row("A", [replace(part, vertex_labels=labels)])}, {}), tmp_path / "map.ifc")
    lists = {one.Name: {value.is_a() for value in one.ListValues} for one in file.by_type("IfcPropertyListValue")}
    assert lists["VertexLabels"] == {"IfcText"}
    assert lists["Warnings"] == {"IfcLabel"}
    assert lists["VertexX"] == {"IfcLengthMeasure"}


def test_depths_that_are_assumed_are_told(tmp_path: Path) -> None:
    (project,) = opened(made_up_site(), tmp_path / "map.ifc").by_type("IfcProject")
    assert project.Description == DEPTH_NOTE
    (other,) = opened(SiteMap({"A": row("A", things()[1:2])}, {}), tmp_path / "given.ifc").by_type("IfcProject")
    assert other.Description is None
