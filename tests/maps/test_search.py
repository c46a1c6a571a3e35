"""Things of a map by their name, or by what is written on them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.maps.search import find_structures, places_within
from savmap.types import Alignment, FrameTable, Measured, Placement, RowMap, SiteMap, Structure, Trajectory

RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])


def plate(number: int, x: float, attributes: Mapping[str, float | int | str]) -> Structure:
    place = np.array([[x, 1.8, 0.0]])
    return Structure(
        f"plate {number}", "plate", place, 1e-6 * np.eye(3)[None], ("middle",), np.zeros((0, 2), int), attributes
    )


@pytest.fixture
def site() -> SiteMap:
    things = (
        plate(1, 2.0, {"text": "A21-03", "bay": "bay 3"}),
        plate(2, 5.0, {"text": "", "code": "QRCode:B7"}),
    )
    row = RowMap(
        "A", FrameTable(np.zeros(0), ()), {}, Trajectory(np.zeros(0, int), np.zeros((0, 4, 4))), {"plates": things}, ()
    )
    return SiteMap({"A": row}, {}, placements={"A": Placement(10.0, 1.0, 0.0, np.zeros((3, 3)))})


@pytest.mark.parametrize("name", ["A21-03", "a21-03", "plate 1"])
def test_structure_is_found_by_its_text_and_by_its_id(site: SiteMap, name: str) -> None:
    assert list(map(str, find_structures(site, name))) == [
        'row A, plate 1 "A21-03", bay 3: x 2.000, y 1.800, z 0.000 m (+- 1, 1, 1 mm); in the site x 12.000, y 1.800, z 1.000 m'
    ]


def post(top_sigma_m: float, foot_sigma_m: float = 0.05) -> SiteMap:
    """A post that was seen at the left and the right, but neither to its foot nor to its top."""
    corners = [(x, y) for y in ("bottom", "top") for x in ("left", "right")]
    vertices = np.array([[1.1 if x == "right" else 1.0, 5.0 if y == "top" else 0.0, 0.0] for x, y in corners])
    sigmas = np.array([[0.003, top_sigma_m if y == "top" else foot_sigma_m, 0.0001] for _, y in corners])
    labels = tuple(f"post 1 / {x} / {y}" for x, y in corners)
    covariances = np.stack([np.diag(own**2) for own in sigmas])
    whole = Structure("post 1", "post", vertices, covariances, labels, np.zeros((0, 2), int))
    path = Trajectory(np.zeros(0, int), np.zeros((0, 4, 4)))
    return SiteMap({"A": RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {"posts": (whole,)}, ())}, {})


@pytest.mark.parametrize(
    ("sigmas_m", "said"),
    [
        ((0.3, 0.05), "post 1, bottom: x 1.050, y 0.000, z 0.000 m (+- 3, 50, 0.1 mm)"),
        ((0.01, 0.01), "post 1: x 1.050, y 2.500, z 0.000 m (+- 3, 10, 0.1 mm)"),
        ((0.05, 0.005), "post 1: x 1.050, y 2.500, z 0.000 m (+- 3, 36, 0.1 mm)"),
        ((0.5, 0.4), "post 1: x 1.050, y 2.500, z 0.000 m (+- 3, 453, 0.1 mm)"),
    ],
)
def test_a_vertex_that_nobody_measured_does_not_say_where_its_structure_is(
    sigmas_m: tuple[float, float], said: str
) -> None:
    assert list(map(str, find_structures(post(*sigmas_m), "post 1"))) == [f"row A, {said}"]


def test_a_map_that_is_aligned_says_where_it_is_in_the_users_world() -> None:
    aligned = replace(post(0.3), alignment=Alignment(10.0, 20.0, 90.0, np.zeros((3, 3))))
    (hit,) = find_structures(aligned, "post 1")
    assert hit.world_position_m == pytest.approx([10, 21.05, 0])
    assert str(hit).endswith("; in the world x 10.000, y 21.050, z 0.000 m")
    (unplaced,) = find_structures(replace(aligned, failed={"B": "no structure"}), "post 1")
    assert unplaced.world_position_m is None


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("post 1 / left / top", ["post 1 / left / top"]),
        ("bottom of post 1", ["post 1 / left / bottom", "post 1 / right / bottom"]),
        ("middle of plate 1", ["plate 1 / middle"]),
    ],
)
def test_vertices_are_found(site: SiteMap, name: str, found: list[str]) -> None:
    row = site.rows["A"]
    both = replace(row, structures={**row.structures, **post(0.3).rows["A"].structures})
    hits = find_structures(replace(site, rows={"A": both}), name)
    assert [hit.structure.id for hit in hits] == found


def test_a_code_is_found_with_and_without_its_kind(site: SiteMap) -> None:
    assert list(map(str, find_structures(site, "B7"))) == list(map(str, find_structures(site, "QRCode:B7")))


def test_what_is_not_there_is_told_with_what_is_near(site: SiteMap) -> None:
    with pytest.raises(SiteError, match="`A21-08` is not in the map; nearest: A21-03"):
        find_structures(site, "A21-08")


def test_where_nothing_was_read_the_map_says_so(site: SiteMap) -> None:
    with pytest.raises(SiteError) as caught:
        find_structures(post(0.3), "A21-08")
    assert str(caught.value).startswith("`A21-08` is not in the map: no text was read in it")
    assert str(caught.value).endswith("; it has post (1)")
    with pytest.raises(SiteError, match=r"`zzz` is not in the map$"):
        find_structures(site, "zzz")
    with pytest.raises(SiteError, match="it has nothing"):
        find_structures(SiteMap({}, {}), "A21-08")


def numbered(name: str, label: str, x: float, **numbers: int) -> Structure:
    return replace(plate(1, x, numbers), id=name, label=label)


@pytest.fixture
def hall() -> SiteMap:
    """Two rows of two bays, each with two bars."""
    bars = tuple(numbered(f"bay {k} / bar {n}", "bar", 10.0 * k + n, bay=k, bar=n) for k in (1, 2) for n in (1, 2))
    tags = (replace(plate(9, 21.0, {"text": "X", "bay": "bay 2"}), id="tag 9"),)
    path = Trajectory(np.zeros(0, int), np.zeros((0, 4, 4)))
    rows = {
        name: RowMap(name, FrameTable(np.zeros(0), ()), {}, path, {"bars": bars, "tags": tags}, ())
        for name in ("A", "B")
    }
    return SiteMap(rows, {})


def places() -> dict[str, dict[str, list[Structure]]]:
    own = [numbered(f"bay {k}", "bay", 10.0 * k, bay=k) for k in (1, 2)]
    own += [numbered(f"bay {k} / level {n}", "level", 0.0, bay=k, level=n) for k in (1, 2) for n in (0, 1)]
    return {"A": {"bars": own}, "B": {"bars": own}}


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("bay 2", ["A bay 2", "B bay 2"]),
        ("Bay 2", ["A bay 2", "B bay 2"]),
        ("bay 2 level 1", ["A bay 2 / level 1", "B bay 2 / level 1"]),
        ("A: level 0", ["A bay 1 / level 0", "A bay 2 / level 0"]),
        ("bay 1 / bar 2", ["A bay 1 / bar 2", "B bay 1 / bar 2"]),
        ("bar 2", [f"{row} bay {k} / bar 2" for row in "AB" for k in (1, 2)]),
        ("bar 2 of bay 1, row B", ["B bay 1 / bar 2"]),
        ("B: bar2 section1", ["B bay 1 / bar 2"]),
        ("level 1 of bay 2 in A", ["A bay 2 / level 1"]),
        ("row A / bay 02 / level 0", ["A bay 2 / level 0"]),
        ("row A, bay 1 / bar 1", ["A bay 1 / bar 1"]),
        ("row A bay 1", ["A bay 1"]),
        ("Row b bar 2 of bay 1", ["B bay 1 / bar 2"]),
    ],
)
def test_what_a_description_means_is_found(hall: SiteMap, name: str, found: list[str]) -> None:
    assert [f"{hit.row} {hit.structure.id}" for hit in find_structures(hall, name, places)] == found


def test_a_place_is_told_with_the_places_within(hall: SiteMap) -> None:
    section = next(hit for hit in find_structures(hall, "bay 2", places) if hit.structure.label == "bay")
    assert [hit.structure.id for hit in places_within(hall, section, places())] == [
        "bay 2 / level 0",
        "bay 2 / level 1",
    ]
    (bar,) = find_structures(hall, "row A, bay 1 / bar 1", places)
    assert places_within(hall, bar, places()) == []


def test_without_places_its_parts_are_found(hall: SiteMap) -> None:
    found = find_structures(hall, "bay 2 in row A")
    assert [hit.structure.id for hit in found] == ["tag 9"]
    assert len(find_structures(hall, "bay 1 in row A")) == 2


def test_places_are_not_asked_for_where_a_name_is_there(hall: SiteMap) -> None:
    def refuse() -> dict[str, dict[str, list[Structure]]]:
        raise AssertionError

    assert len(find_structures(hall, "Bay 1 / bar 2", refuse)) == 2


@pytest.mark.parametrize("name", ["level 9", "row A", "A", " / ", "bay", "9" * 400, "of in on"])
def test_what_describes_nothing_is_not_found(hall: SiteMap, name: str) -> None:
    if name == "bay":
        assert len(find_structures(hall, name, places)) == 4
        return
    with pytest.raises(SiteError, match="is not in the map"):
        find_structures(hall, name, places)


def plated(x: float, y: float, **attributes: str) -> SiteMap:
    """A plate before or beside bay 1, of which level 0 is 2 m high and level 1, on a beam of 10 cm, is open above."""
    own = replace(plate(1, x, attributes), vertices=np.array([[x, y, 0.02]]))
    path = Trajectory(np.zeros(0, int), np.zeros((0, 4, 4)))
    return SiteMap({"A": RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {"plates": (own,)}, ())}, {})


def bay_of_two_levels(called: str) -> dict[str, dict[str, list[Structure]]]:
    heights = {"": (0.0, 2.1), " / level 0": (0.0, 2.0), " / level 1": (2.1, 2.1)}
    found = []
    for name, (low, high) in heights.items():
        corners = np.array([[x, y, 0.0] for y in (low, high) for x in (0.1, 2.8)])
        width = {"clear_width_m": Measured(2.7, 0.004)}
        found.append(
            Structure(
                f"{called}{name}", "place", corners, np.tile(1e-6 * np.eye(3), (4, 1, 1)), (*"abcd",), RING, width
            )
        )
    return {"A": {"posts": found}}


@pytest.mark.parametrize(
    ("x", "y", "slot"), [(1, 1.0, "1 / level 0"), (1, 2.05, "1 / level 1"), (1, 3.0, "1 / level 1"), (0.05, 1.5, "1")]
)
def test_what_is_written_is_told_with_its_slot(x: float, y: float, slot: str) -> None:
    (hit,) = find_structures(plated(x, y, text="A21-03", bay="bay 1"), "A21-03", lambda: bay_of_two_levels("bay 1"))
    assert hit.slot is not None
    assert hit.slot.structure.id == f"bay {slot}"
    assert str(hit.slot).endswith("; clear width 2.700 m +- 4.0 mm")
    assert hit.slot.position_m[0] == pytest.approx(1.45)


@pytest.mark.parametrize("attributes", [{"text": "X"}, {"text": "", "bay": "bay 1"}, {"text": "X", "bay": "bay 9"}])
def test_what_names_no_bay_has_no_slot(attributes: dict[str, str]) -> None:
    (hit,) = find_structures(plated(1, 1, **attributes), "plate 1", lambda: bay_of_two_levels("bay 1"))
    assert hit.slot is None
