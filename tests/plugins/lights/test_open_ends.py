"""How long a strip is of which an end was never seen; the space that lamps fill, as closed as any solid."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.maps.exports.models.bodies import body_of
from savmap.types import Floats, Structure
from savmap_lights.open_ends import COMPACT_M, STRIP_M, THICKNESS_M, UNKNOWN_M, common_length, with_solids
from savmap_lights.plugin import Lights, Settings


def lamp(*vertices: tuple[float, float, float]) -> Structure:
    count = len(vertices)
    labels = tuple(f"end {k}" for k in range(count))
    return Structure("light 1", "light", np.array(vertices), np.zeros((count, 3, 3)), labels, np.zeros((0, 2), int))


def strips(*lengths: float) -> list[Structure]:
    return [lamp((3.0 * k, 6, 1), (3.0 * k + length, 6, 1)) for k, length in enumerate(lengths)]


def test_most_strips_have_one_length() -> None:
    assert common_length(strips(1.5, 1.51, 1.5, 1.49, 4.5)) == pytest.approx(1.5)


def test_strips_that_differ_or_are_few_have_none() -> None:
    assert common_length(strips(1.5)) is None
    assert common_length(strips(1.5, 1.7)) is None
    assert common_length(strips(1.5, 1.5, 1.5, 1.5, 2.0, 2.4)) is None


def seen_from(lamp: Structure, end: int) -> Structure:
    """The lamp, of which one end was not seen."""
    covariances = lamp.covariances.copy()
    covariances[end, 0, 0] = UNKNOWN_M**2
    return replace(lamp, covariances=covariances, attributes={"ends": f"end {end} not seen"})


def test_an_end_that_was_not_seen_is_a_warning_but_beyond_all_lamps() -> None:
    names = ("light 1", "light 2", "light 3")
    first, second, third = (replace(lamp, id=name) for name, lamp in zip(names, strips(1.5, 1.5, 1.5), strict=True))
    plugin = Lights(Settings())
    assert plugin.warnings([seen_from(first, 0), second, seen_from(third, 1)]) == []
    inner = [seen_from(first, 1), seen_from(second, 0), third]
    said = [(warning.code, warning.subjects, warning.figure) for warning in plugin.warnings(inner)]
    assert said == [
        ("inaccurate-element", ("light 1",), "end 1 not seen"),
        ("inaccurate-element", ("light 2",), "end 0 not seen"),
    ]
    assert inner[0].assumed("lights", None)[:, 0].tolist() == [False, True]


def sizes(*vertices: tuple[float, float, float]) -> Floats:
    """The lamp's extent (3,) m."""
    solid = with_solids([lamp(*vertices)])[0].solid
    assert solid is not None
    assert solid.assumed
    assert Lights.ifc_classes[solid.ifc_class] == "light"
    body = body_of(solid)
    assert body is not None
    middle = (body.points[:, 1].min() + body.points[:, 1].max()) / 2
    assert abs(middle - vertices[0][1]) < 1e-9
    return np.ptp(body.points, axis=0)


def test_strips_reach_from_end_to_end() -> None:
    np.testing.assert_allclose(sizes((1, 8, 1), (2.5, 8, 1)), [1.5, THICKNESS_M, STRIP_M])
    np.testing.assert_allclose(sizes((1, 8, 1), (1, 8, 3)), [STRIP_M, THICKNESS_M, 2.0])


def test_compact_lamps_are_square() -> None:
    np.testing.assert_allclose(sizes((1, 8, 1)), [COMPACT_M, THICKNESS_M, COMPACT_M])


def test_a_strip_whose_ends_are_one_has_no_solid() -> None:
    assert with_solids([lamp((1, 8, 1), (1, 8.5, 1))])[0].solid is None
