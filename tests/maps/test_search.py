"""Things of a map by their name, or by what is written on them."""

from collections.abc import Mapping

import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.maps.search import find_structures
from savmap.types import FrameTable, Placement, RowMap, SiteMap, Structure, Trajectory


def plate(number: int, x: float, attributes: Mapping[str, float | int | str]) -> Structure:
    place = np.array([[x, 1.8, 0.0]])
    return Structure(
        f"plate {number}", "plate", place, 1e-6 * np.eye(3)[None], ("middle",), np.zeros((0, 2), int), attributes
    )


@pytest.fixture
def site() -> SiteMap:
    things = (
        plate(1, 2.0, {"text": "A21-03", "bay": "section 3"}),
        plate(2, 5.0, {"text": "", "code": "QRCode:B7"}),
    )
    row = RowMap(
        "A", FrameTable(np.zeros(0), ()), {}, Trajectory(np.zeros(0, int), np.zeros((0, 4, 4))), {"plates": things}, ()
    )
    return SiteMap({"A": row}, {}, placements={"A": Placement(10.0, 1.0, 0.0, np.zeros((3, 3)))})


@pytest.mark.parametrize("name", ["A21-03", "a21-03", "plate 1"])
def test_structure_is_found_by_its_text_and_by_its_id(site: SiteMap, name: str) -> None:
    assert list(map(str, find_structures(site, name))) == [
        'row A, plate 1 "A21-03", section 3: x 2.000, y 1.800, z 0.000 m (+- 1 mm); in the site x 12.000, y 1.800, z 1.000 m'
    ]


def test_a_code_is_found_with_and_without_its_kind(site: SiteMap) -> None:
    assert list(map(str, find_structures(site, "B7"))) == list(map(str, find_structures(site, "QRCode:B7")))


def test_what_is_not_there_is_told_with_what_is_near(site: SiteMap) -> None:
    with pytest.raises(SiteError, match="`A21-08` is not in the map; nearest: A21-03"):
        find_structures(site, "A21-08")
