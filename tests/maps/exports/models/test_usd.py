"""USD: what `usd-core` reads of the text that savmap writes itself, and of the binary form."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import savmap
from savmap.apps.exchange.usd import quoted
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

pytestmark = pytest.mark.extra("usd")
FORMS = ("usda", "usdc")


def opened(site: SiteMap, path: Path) -> Any:
    from pxr import Usd

    return Usd.Stage.Open(str(savmap.export(site, path)))


def structures(stage: Any) -> list[Any]:
    return [prim for prim in stage.Traverse() if prim.GetAttribute("savmap:id")]


def in_world(prim: Any) -> Floats:
    from pxr import UsdGeom

    matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    points = np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get(), np.float64)
    whole: Floats = points @ matrix[:3, :3] + matrix[3, :3]
    return whole


@pytest.mark.parametrize("form", FORMS)
def test_positions_are_those_of_the_map(form: str, tmp_path: Path) -> None:
    from pxr import UsdGeom

    stage = opened(made_up_site(), tmp_path / f"map.{form}")
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetDefaultPrim().GetPath() == "/World"
    wanted = expected(made_up_site())
    found = {
        tuple(prim.GetAttribute(f"savmap:{name}").Get() for name in ("row", "id")): prim for prim in structures(stage)
    }
    assert set(found) == set(wanted)
    assert max(distance_m(in_world(found[key]), wanted[key]) for key in wanted) < NEAREST_M
    vertices = np.array(found["B", "tube"].GetAttribute("savmap:vertices").Get())
    assert distance_m(vertices, wanted["B", "tube"]) < NEAREST_M


@pytest.mark.parametrize("form", FORMS)
def test_prims_say_what_is_known(form: str, tmp_path: Path) -> None:
    from pxr import UsdGeom, UsdPhysics, UsdSemantics

    stage = opened(SiteMap({"A": row("A", things())}, {}), tmp_path / f"map.{form}")
    post = stage.GetPrimAtPath("/World/A/post_1")
    assert post.IsA(UsdGeom.Mesh)
    assert post.HasAPI(UsdPhysics.CollisionAPI)
    assert list(UsdSemantics.LabelsAPI(post, "class").GetLabelsAttr().Get()) == ["post"]
    known = {name: post.GetAttribute(f"savmap:{name}").Get() for name in ("depthAssumed", "ifcClass", "plugin")}
    assert known == {"depthAssumed": True, "ifcClass": "IfcColumn", "plugin": "things"}
    assert list(post.GetAttribute("savmap:warnings").Get()) == [warning_of("post 1").line]
    np.testing.assert_allclose(post.GetAttribute("savmap:sigmas").Get()[0], [0.01, 0.03, 0.02], atol=1e-9)
    assert post.GetAttribute("savmap:attributes:far").Get() == 10**12
    assert post.GetAttribute("savmap:attributes:width_m_sigma").Get() == 0.005
    tube = stage.GetPrimAtPath("/World/A/tube")
    assert tube.IsA(UsdGeom.BasisCurves)
    assert not tube.HasAPI(UsdPhysics.CollisionAPI)
    assert stage.GetPrimAtPath("/World/A/spot").IsA(UsdGeom.Points)
    assert stage.GetPrimAtPath("/World/A").GetAttribute("savmap:grade").Get() == "check"


@pytest.mark.parametrize("site", [made_up_site(), hostile_site()], ids=["plain", "hostile"])
def test_stages_are_valid(site: SiteMap, tmp_path: Path) -> None:
    from pxr import UsdValidation

    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    errors = UsdValidation.ValidationContext(validators).Validate(opened(site, tmp_path / "map.usda"))
    assert [error.GetMessage() for error in errors] == []


@pytest.mark.parametrize("form", FORMS)
def test_any_text_is_kept_as_text(form: str, tmp_path: Path) -> None:
    stage = opened(hostile_site(), tmp_path / f"map.{form}")
    prims = structures(stage)
    assert [prim.GetAttribute("savmap:id").Get() for prim in prims] == [readable(text) for text in (*EVIL, EVIL[0])]
    assert len({prim.GetPath() for prim in prims}) == len(EVIL) + 1
    assert {str(prim.GetPath()).count("/") for prim in prims} == {3}
    assert [prim.GetName() for prim in stage.GetPseudoRoot().GetChildren()] == ["World"]


@pytest.mark.parametrize("text", [*EVIL, "".join(map(chr, range(1, 256))), "\x007", '"""', "\\", "@</a>@"])
def test_quoted_texts_are_read_as_they_were(text: str) -> None:
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous()
    layer.ImportFromString(f'#usda 1.0\ndef "a"\n{{\n    custom string b = {quoted(text)}\n}}\n')
    assert layer.GetAttributeAtPath("/a.b").default == readable(text).replace("\x00", "\ufffd")


def test_maps_without_structures_are_valid(tmp_path: Path) -> None:
    assert not structures(opened(SiteMap({}, {}), tmp_path / "map.usda"))


@pytest.mark.parametrize("form", FORMS)
def test_depths_that_are_assumed_are_told(form: str, tmp_path: Path) -> None:
    assert opened(made_up_site(), tmp_path / f"map.{form}").GetRootLayer().documentation == DEPTH_NOTE
    given = SiteMap({"A": row("A", things()[1:2])}, {})
    assert not opened(given, tmp_path / f"given.{form}").GetRootLayer().documentation
